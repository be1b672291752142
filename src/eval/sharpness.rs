//! Sharpness: fine detail of a photograph that a render reproduces (`evaluation.md`, Sharpness).
//!
//! PSNR is hardly sensitive to sharpness: the finest bands contain little energy, and a blurred edge has a
//! smaller error than a displaced sharp one. Bands are therefore compared separately, by energy and
//! correlation.
//!
//! Both images are decomposed with the same masked blur, so neither the border nor uncovered areas count as
//! detail.

use super::comparison::COVERED;
use super::metrics;
use super::metrics::MetricError;
use super::ssim::ssim;
use crate::math::image::{Image, RgbImage};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Number of octave bands: details of about 1, 2, 4 and 8 pixels.
pub(super) const N_BANDS: usize = 4;
/// Binomial taps of the blur between two bands (Burt and Adelson 1983).
const TAPS: [f64; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];
/// Weights of red, green and blue in luma (BT.601), on encoded values.
const LUMA: [f64; 3] = [0.299, 0.587, 0.114];
/// Variance of a photograph's band (values in `[0, 1]`) below which it has no detail to compare.
const MIN_ENERGY: f64 = 1e-9;
/// Ratio of a render's energy to the photograph's, below which the render's detail is rounding noise.
const ROUNDING: f64 = 1e-12;

/// Comparison of one octave band.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SharpnessBand {
    /// Ratio of the render's energy in the band to the photograph's: 1 if equally sharp, less if
    /// blurred, more with spurious detail.
    pub energy_ratio: f64,
    /// Correlation of the bands of render and photograph, −1 to 1. It is high if detail is in the right
    /// places.
    pub correlation: f64,
}

/// Compares the luma of two images over covered pixels and returns `N` bands from the finest. Returns
/// `None` if the photograph has no detail in some band, or no pixel is covered. All images have equal
/// size.
pub(super) fn bands<const N: usize>(
    render: &RgbImage,
    coverage: &Image<f32>,
    truth: &RgbImage,
) -> Option<[SharpnessBand; N]> {
    let width = render.width.max(1);
    let mut level = covered_luma(render, coverage, truth);
    let n_covered: f64 = level.iter().map(|[mask, ..]| mask).sum();
    let mut found = [SharpnessBand { energy_ratio: 0.0, correlation: 0.0 }; N];
    let mut coarser = vec![[0.0; 3]; level.len()];
    for (octave, band) in found.iter_mut().enumerate() {
        // Collected in order and added below: the last digits of a parallel sum would depend on the threads.
        let rows: Vec<[f64; 3]> = coarser
            .par_chunks_mut(width)
            .enumerate()
            .map_init(Vec::new, |sums, (row, out)| blur_row(&level, row, 1 << octave, sums, out))
            .collect();
        let [rr, tt, rt] = [0, 1, 2].map(|i| rows.iter().map(|row| row[i]).sum::<f64>());
        // Also covers NaN and images without pixels.
        if tt.is_nan() || tt <= MIN_ENERGY * n_covered {
            return None;
        }
        // A render without detail leaves rounding noise, whose correlation is meaningless.
        let correlation = if rr > ROUNDING * tt { rt / (rr * tt).sqrt() } else { 0.0 };
        *band = SharpnessBand { energy_ratio: rr / tt, correlation };
        std::mem::swap(&mut level, &mut coarser);
    }
    Some(found)
}

pub(super) fn mean(views: &[[SharpnessBand; N_BANDS]]) -> Option<[SharpnessBand; N_BANDS]> {
    let mut means = *views.first()?;
    for (i, band) in means.iter_mut().enumerate() {
        band.energy_ratio = metrics::mean(views.iter().map(|bands| bands[i].energy_ratio))?;
        band.correlation = metrics::mean(views.iter().map(|bands| bands[i].correlation))?;
    }
    Some(means)
}

/// Returns the SSIM of the gradient magnitudes per channel (after Chen, Yang and Xie 2006). It is
/// insensitive to brightness, and low if edges are missing or blurred.
pub(super) fn gradient_ssim(render: &RgbImage, truth: &RgbImage) -> Result<f64, MetricError> {
    ssim(&gradients(render), &gradients(truth))
}

/// Returns a quarter of the Sobel gradient magnitude, so that a step from 0 to 1 has length 1. Border
/// pixels are repeated beyond the border.
fn gradients(image: &RgbImage) -> Image<[f64; 3]> {
    let Image { width, height, .. } = *image;
    let mut out = Image::filled(width, height, [0.0; 3]);
    out.data.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, out)| {
        let rows = [row.saturating_sub(1), row, (row + 1).min(height - 1)];
        for (column, out) in out.iter_mut().enumerate() {
            let columns = [column.saturating_sub(1), column, (column + 1).min(width - 1)];
            *out = std::array::from_fn(|channel| {
                let at = |i: usize, j: usize| f64::from(image.at(columns[i], rows[j])[channel]);
                let side = |i: usize| at(i, 0) + 2.0 * at(i, 1) + at(i, 2);
                let edge = |j: usize| at(0, j) + 2.0 * at(1, j) + at(2, j);
                0.25 * f64::hypot(side(2) - side(0), edge(2) - edge(0))
            });
        }
    });
    out
}

/// Returns mask, luma of the render and luma of the photograph per pixel, all zero if uncovered.
fn covered_luma(render: &RgbImage, coverage: &Image<f32>, truth: &RgbImage) -> Vec<[f64; 3]> {
    let luma = |pixel: &[f32; 3]| pixel.iter().zip(LUMA).map(|(v, w)| f64::from(*v) * w).sum();
    let pixels = render.data.par_iter().zip(&truth.data).zip(&coverage.data);
    let is_compared = |truth, coverage| coverage >= COVERED && !metrics::is_left_out(truth);
    let values = pixels.map(|((render, truth), &coverage)| match is_compared(truth, coverage) {
        true => [1.0, luma(render), luma(truth)],
        false => [0.0; 3],
    });
    values.collect()
}

/// Blurs covered pixels of a row with a separable filter whose taps are `step` pixels apart (à trous).
/// Returns the sums of `r²`, `t²` and `r t` over the row, where `r` and `t` are the differences of both
/// images from their blurs. Spreading the taps, rather than shrinking the image, yields every band at
/// every pixel.
fn blur_row(
    level: &[[f64; 3]],
    row: usize,
    step: usize,
    sums: &mut Vec<f64>,
    out: &mut [[f64; 3]],
) -> [f64; 3] {
    let width = out.len();
    let rows: [&[[f64; 3]]; TAPS.len()] = std::array::from_fn(|i| {
        let source = (row + i * step).checked_sub(2 * step);
        // Empty beyond the border, which adds nothing.
        source.and_then(|at| level.get(at * width..(at + 1) * width)).unwrap_or_default()
    });
    // Sums of columns between margins, which are zero like everything beyond the border.
    sums.clear();
    sums.resize(3 * (width + 4 * step), 0.0);
    for (tap, row) in TAPS.iter().zip(rows) {
        let sums = sums[6 * step..].iter_mut().zip(row.as_flattened());
        sums.for_each(|(sum, value)| *sum += tap * value);
    }
    // Slices of equal length and equal taps added first: the compiler vectorises, in half the time.
    let near: [&[f64]; TAPS.len()] = std::array::from_fn(|i| &sums[3 * i * step..][..3 * width]);
    for (i, out) in out.as_flattened_mut().iter_mut().enumerate() {
        let [outer, inner] = [near[0][i] + near[4][i], near[1][i] + near[3][i]];
        *out = TAPS[0] * outer + TAPS[1] * inner + TAPS[2] * near[2][i];
    }
    let mut products = [0.0; 3];
    for (out, finer) in out.iter_mut().zip(rows[2]) {
        if finer[0] == 0.0 {
            *out = [0.0; 3];
            continue;
        }
        // Includes the pixel's own weight, so the divisor is positive.
        let [share, r, t] = *out;
        *out = [1.0, r / share, t / share];
        let [r, t] = [1, 2].map(|k| finer[k] - out[k]);
        products = [products[0] + r * r, products[1] + t * t, products[2] + r * t];
    }
    products
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    pub const SIZE: (usize, usize) = (48, 36);

    /// Returns noise on smooth waves, which has detail in every band.
    pub fn picture() -> RgbImage {
        let mut rng = Rng::new(7, Purpose::Synthetic, 0);
        let pixel = |i: usize| {
            let (x, y) = ((i % SIZE.0) as f64, (i / SIZE.0) as f64);
            let wave = 0.1 * (0.3 * x).sin() + 0.1 * (0.4 * y).cos();
            std::array::from_fn(|_| (0.5 + wave + 0.2 * (rng.uniform() - 0.5)) as f32)
        };
        Image::from_vec(SIZE.0, SIZE.1, (0..SIZE.0 * SIZE.1).map(pixel).collect())
    }

    /// Blurs covered values by the definition: the weighted mean of 25 values around each.
    pub fn naive_blur(values: &[f64], mask: &[bool], width: usize, step: usize) -> Vec<f64> {
        let at = |i: usize| {
            let (mut sum, mut share) = (0.0, 0.0);
            for (j, k) in (0..5).flat_map(|j| (0..5).map(move |k| (j, k))) {
                let x = (i % width + j * step).checked_sub(2 * step).filter(|x| *x < width);
                let y = (i / width + k * step).checked_sub(2 * step);
                let source = x.zip(y).map(|(x, y)| y * width + x).filter(|i| *i < mask.len());
                if let Some(source) = source.filter(|i| mask[*i]) {
                    let weight = [1.0, 4.0, 6.0, 4.0, 1.0].map(|tap| tap / 16.0);
                    sum += weight[j] * weight[k] * values[source];
                    share += weight[j] * weight[k];
                }
            }
            if mask[i] { sum / share } else { 0.0 }
        };
        (0..values.len()).map(at).collect()
    }

    pub fn soft(image: &RgbImage) -> RgbImage {
        let mut out = image.clone();
        for channel in 0..3 {
            let plane: Vec<f64> = image.data.iter().map(|p| f64::from(p[channel])).collect();
            let blurred = naive_blur(&plane, &vec![true; plane.len()], image.width, 1);
            out.data.iter_mut().zip(blurred).for_each(|(p, v)| p[channel] = v as f32);
        }
        out
    }

    #[test]
    fn an_image_is_as_sharp_as_itself() {
        let (image, coverage) = (picture(), Image::filled(SIZE.0, SIZE.1, 1.0));
        for band in bands::<N_BANDS>(&image, &coverage, &image).unwrap() {
            assert_eq!(band.energy_ratio, 1.0);
            assert!((band.correlation - 1.0).abs() < 1e-12);
        }
        assert!((gradient_ssim(&image, &image).unwrap() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_blurred_copy_lacks_energy_and_keeps_its_places() {
        let (image, coverage) = (picture(), Image::filled(SIZE.0, SIZE.1, 1.0));
        let copy = soft(&image);
        let found = bands::<N_BANDS>(&copy, &coverage, &image).unwrap();
        assert!(found[0].energy_ratio < 0.1 && found[1].energy_ratio < 0.85, "{found:?}");
        assert!(found[0].energy_ratio < found[1].energy_ratio, "{found:?}");
        assert!(found[3].energy_ratio > 0.8 && found[3].correlation > 0.95, "{found:?}");
        assert!(found[1].correlation > 0.9, "{found:?}");
        assert!(gradient_ssim(&copy, &image).unwrap() < 0.7);
    }

    #[test]
    fn a_shifted_copy_has_energy_in_the_wrong_places() {
        let (image, coverage) = (picture(), Image::filled(SIZE.0, SIZE.1, 1.0));
        let mut copy = image.clone();
        copy.data.rotate_right(3);
        let found = bands::<1>(&copy, &coverage, &image).unwrap();
        assert!((found[0].energy_ratio - 1.0).abs() < 0.1, "{found:?}");
        assert!(found[0].correlation.abs() < 0.2, "{found:?}");
    }

    #[test]
    fn what_is_not_covered_does_not_count() {
        let image = picture();
        let mut coverage = Image::filled(SIZE.0, SIZE.1, 1.0);
        let mut render = image.clone();
        for i in 0..SIZE.0 * SIZE.1 / 2 {
            (coverage.data[i], render.data[i]) = (0.1, [1.0, 0.0, 1.0]);
        }
        for band in bands::<N_BANDS>(&render, &coverage, &image).unwrap() {
            assert_eq!(band.energy_ratio, 1.0);
        }
        assert_eq!(bands::<1>(&render, &coverage.map(|_| 0.0), &image), None);
        let flat = Image::filled(SIZE.0, SIZE.1, [0.5; 3]);
        assert_eq!(bands::<1>(&image, &coverage, &flat), None, "no detail to compare with");
        let found = bands::<1>(&flat, &Image::filled(SIZE.0, SIZE.1, 1.0), &image).unwrap();
        assert!(found[0].energy_ratio < 1e-20 && found[0].correlation == 0.0, "{found:?}");
    }
}
