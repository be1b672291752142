//! Spatially correlated random fields over images.

use crate::math::image::Image;
use crate::math::rng::Rng;

/// Gaussian field of unit variance with a correlation length of about `sigma` pixels.
pub(super) fn correlated_noise(
    width: usize,
    height: usize,
    sigma: f64,
    rng: &mut Rng,
) -> Image<f32> {
    let white = (0..width * height).map(|_| rng.normal() as f32).collect();
    let white = Image::from_vec(width, height, white);
    let reach = (2.5 * sigma).ceil() as i64;
    let weight = |i: i64| (-0.5 * (i as f64 / sigma).powi(2)).exp() as f32;
    let weights: Vec<f32> = (-reach..=reach).map(weight).collect();
    // The variance of a weighted sum of independent unit normals is the sum of squared weights.
    let norm = weights.iter().map(|w| w * w).sum::<f32>().sqrt();
    let weights: Vec<f32> = weights.iter().map(|w| w / norm).collect();
    separable_filter(&white, &weights)
}

/// Separable filter over rows, then columns, with mirrored borders.
pub(super) fn separable_filter(image: &Image<f32>, weights: &[f32]) -> Image<f32> {
    let (width, height) = (image.width, image.height);
    let reach = weights.len() as i64 / 2;
    let mirrored = |at: i64, n: usize| {
        let period = 2 * n as i64;
        let at = at.rem_euclid(period);
        at.min(period - 1 - at) as usize
    };
    let mut rows = image.clone();
    let mut line = Vec::new();
    for (from, to) in image.data.chunks(width).zip(rows.data.chunks_mut(width)) {
        line.clear();
        line.extend((-reach..width as i64 + reach).map(|x| from[mirrored(x, width)]));
        for (window, value) in line.windows(weights.len()).zip(to) {
            *value = window.iter().zip(weights).map(|(v, w)| v * w).sum();
        }
    }
    let mut out = Image::filled(width, height, 0.0f32);
    for (y, to) in out.data.chunks_mut(width).enumerate() {
        for (i, weight) in weights.iter().enumerate() {
            let row = mirrored(y as i64 + i as i64 - reach, height) * width;
            for (value, from) in to.iter_mut().zip(&rows.data[row..row + width]) {
                *value += weight * from;
            }
        }
    }
    out
}
