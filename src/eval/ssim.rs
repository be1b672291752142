//! Structural similarity (`evaluation.md`, SSIM) in f64.
//!
//! The window is separable: columns are summed first, then rows of those sums, with 22 products per
//! position instead of 121. Sums are in f64, because variances are differences of nearly equal numbers.
//! Channels are processed in blocks of eight, so that the compiler vectorises. Rows are added in order, so
//! the score is bit-identical for any number of threads.

use super::metrics::{MetricError, SSIM_WINDOW, same_size};
use crate::math::image::Image;
use crate::math::real::Real;
use crate::math::simd::{Isa, Kernel, Vector};
use rayon::prelude::*;

const SSIM_RADIUS: usize = SSIM_WINDOW / 2;
const SSIM_SIGMA: f64 = 1.5;
/// Stabilising constant for the means at a value range of 1; the next constant is that for the
/// variances.
const SSIM_C1: f64 = 0.01 * 0.01;
const SSIM_C2: f64 = 0.03 * 0.03;
/// Number of moments under the window: x, y, x², y² and xy.
const N_MOMENTS: usize = 5;
/// Number of channel values of neighbouring pixels that are summed side by side, so that the compiler
/// vectorises.
const BLOCK: usize = 8;

/// Returns the structural similarity with an 11×11 Gaussian window (σ = 1.5) and biased moments. It is
/// averaged over channels and the `(W − 10)(H − 10)` positions inside the image. Positions whose window
/// touches a NaN do not count. Values are nominally in `[0, 1]` and not clamped.
///
/// # Errors
/// The images differ in size, have no pixels, or are smaller than the window.
pub fn ssim<R: Real>(
    prediction: &Image<[R; 3]>,
    truth: &Image<[R; 3]>,
) -> Result<f64, MetricError> {
    same_size(prediction, truth, "ground truth")?;
    let (width, height) = (prediction.width, prediction.height);
    if width == 0 || height == 0 {
        return Err(MetricError::NoPixels);
    }
    // Inner windows only: zeros beyond the border would reward dark borders.
    if width < SSIM_WINDOW || height < SSIM_WINDOW {
        return Err(MetricError::TooSmall { width, height });
    }
    let (isa, window) = (Isa::best(), gaussian_window());
    let n_rows = height + 1 - SSIM_WINDOW;
    // Collected rather than reduced: the order of a parallel sum would change the last digits.
    // Each row sums its eleven pixel rows anew, so that rows are independent and carry no rounding over.
    let row_sums: Vec<(f64, usize)> = (0..n_rows)
        .into_par_iter()
        .map_init(Vec::new, |moments, row| {
            let images = [prediction, truth];
            isa.run(SsimRow { images, row, window: &window, moments })
        })
        .collect();
    match row_sums.iter().map(|(_, n)| n).sum::<usize>() {
        0 => Err(MetricError::NoPixels),
        n => Ok(row_sums.iter().map(|(sum, _)| sum).sum::<f64>() / n as f64),
    }
}

fn gaussian_window() -> [f64; SSIM_WINDOW] {
    let weight = |i: usize| {
        let x = i as f64 - SSIM_RADIUS as f64;
        (-x * x / (2.0 * SSIM_SIGMA * SSIM_SIGMA)).exp()
    };
    let weights: [f64; SSIM_WINDOW] = std::array::from_fn(weight);
    let sum: f64 = weights.iter().sum();
    weights.map(|w| w / sum)
}

struct SsimRow<'a, R> {
    /// Prediction and ground truth.
    images: [&'a Image<[R; 3]>; 2],
    row: usize,
    window: &'a [f64; SSIM_WINDOW],
    /// Scratch buffer for the column moments under the window at `row`: five planes of interleaved RGB.
    moments: &'a mut Vec<f64>,
}

impl<R: Real> Kernel for SsimRow<'_, R> {
    /// Sum of similarities, and their number.
    type Output = (f64, usize);

    #[inline(always)]
    fn run<V: Vector>(mut self) -> (f64, usize) {
        self.sum_columns();
        self.sum_positions()
    }
}

impl<R: Real> SsimRow<'_, R> {
    #[inline(always)]
    fn sum_columns(&mut self) {
        let width = self.images[0].width;
        let n = 3 * width;
        self.moments.clear();
        self.moments.resize(N_MOMENTS * n, 0.0);
        let mut at = 0;
        while at < n {
            let mut sums = [[0.0; BLOCK]; N_MOMENTS];
            for (tap, &weight) in self.window.iter().enumerate() {
                let row = (self.row + tap) * width;
                let [x, y] = self.images.map(|i| &i.data[row..][..width].as_flattened()[at..]);
                // The last block of a row is padded, and its surplus sums are discarded below.
                if let (Some(x), Some(y)) = (x.first_chunk(), y.first_chunk()) {
                    add(&mut sums, weight, x, y);
                } else {
                    add(&mut sums, weight, &padded(x), &padded(y));
                }
            }
            let end = n.min(at + BLOCK);
            for (plane, sums) in self.moments.chunks_exact_mut(n).zip(&sums) {
                plane[at..end].copy_from_slice(&sums[..end - at]);
            }
            at = end;
        }
    }

    #[inline(always)]
    fn sum_positions(&self) -> (f64, usize) {
        let plane = self.moments.len() / N_MOMENTS;
        let n = plane - 3 * (SSIM_WINDOW - 1);
        let (mut total, mut n_known, mut at) = (0.0, 0, 0);
        while at < n {
            let mut sums = [[0.0; BLOCK]; N_MOMENTS];
            for (sums, plane) in sums.iter_mut().zip(self.moments.chunks_exact(plane)) {
                for (tap, &weight) in self.window.iter().enumerate() {
                    let values = &plane[at + 3 * tap..];
                    let values = values.first_chunk().copied().unwrap_or_else(|| padded(values));
                    for (sum, value) in sums.iter_mut().zip(values) {
                        *sum += weight * value;
                    }
                }
            }
            let similarity = &similarity(&sums)[..BLOCK.min(n - at)];
            let is_known = |value: &&f64| !value.is_nan();
            total += similarity.iter().filter(is_known).sum::<f64>();
            n_known += similarity.iter().filter(is_known).count();
            at += BLOCK;
        }
        (total, n_known)
    }
}

#[inline(always)]
fn add<R: Real>(sums: &mut [[f64; BLOCK]; N_MOMENTS], weight: f64, x: &[R; BLOCK], y: &[R; BLOCK]) {
    for i in 0..BLOCK {
        let (x, y) = (x[i].to_f64(), y[i].to_f64());
        sums[0][i] += weight * x;
        sums[1][i] += weight * y;
        sums[2][i] += weight * (x * x);
        sums[3][i] += weight * (y * y);
        sums[4][i] += weight * (x * y);
    }
}

#[inline(always)]
fn padded<R: Real>(values: &[R]) -> [R; BLOCK] {
    std::array::from_fn(|i| values.get(i).copied().unwrap_or(R::of(0.0)))
}

#[inline(always)]
fn similarity([x, y, xx, yy, xy]: &[[f64; BLOCK]; N_MOMENTS]) -> [f64; BLOCK] {
    std::array::from_fn(|i| {
        let (mean_xx, mean_yy, mean_xy) = (x[i] * x[i], y[i] * y[i], x[i] * y[i]);
        let luminance = (2.0 * mean_xy + SSIM_C1) / (mean_xx + mean_yy + SSIM_C1);
        let variances = (xx[i] - mean_xx) + (yy[i] - mean_yy);
        luminance * (2.0 * (xy[i] - mean_xy) + SSIM_C2) / (variances + SSIM_C2)
    })
}
