//! PSNR and depth error (`eval.md`, PSNR), in f64.
//!
//! Images are sRGB-encoded [`RgbImage`](crate::math::image::RgbImage)s with values in `[0, 1]`, or the same
//! in f64 for tests that need more digits than a renderer has.

use super::sizes::{MetricError, same_size};
use crate::math::image::Image;
use crate::math::real::Real;

/// Lower bound of mean squared errors: equal images have 120 dB.
const MSE_FLOOR: f64 = 1e-12;

/// Peak signal-to-noise ratio in dB over all pixels and channels. The prediction is clamped to `[0, 1]`;
/// neither image is quantised. NaN if a value is NaN.
///
/// ```
/// use vbgs_studio::{eval::metrics::psnr, math::image::Image};
/// let truth = Image::filled(4, 3, [0.5f32; 3]);
/// let prediction = Image::filled(4, 3, [0.25f32; 3]);
/// assert!((psnr(&prediction, &truth).unwrap() - 12.0412).abs() < 1e-4);
/// ```
///
/// # Errors
/// The images differ in size or have no pixels.
pub fn psnr<R: Real>(
    prediction: &Image<[R; 3]>,
    truth: &Image<[R; 3]>,
) -> Result<f64, MetricError> {
    same_size(prediction, truth, "ground truth")?;
    psnr_of(prediction.data.iter().zip(&truth.data))
}

/// [`psnr`] over the pixels where `mask` is true.
///
/// # Errors
/// The images differ in size, or the mask has no pixels.
pub fn psnr_masked<R: Real>(
    prediction: &Image<[R; 3]>,
    truth: &Image<[R; 3]>,
    mask: &Image<bool>,
) -> Result<f64, MetricError> {
    same_size(prediction, truth, "ground truth")?;
    same_size(prediction, mask, "mask")?;
    let pixels = prediction.data.iter().zip(&truth.data).zip(&mask.data);
    psnr_of(pixels.filter(|(_, kept)| **kept).map(|(pair, _)| pair))
}

fn psnr_of<'a, R: Real>(
    pixels: impl Iterator<Item = (&'a [R; 3], &'a [R; 3])>,
) -> Result<f64, MetricError> {
    let (mut sum, mut n_values) = (0.0, 0usize);
    for (prediction, truth) in pixels {
        for (p, t) in prediction.iter().zip(truth) {
            // A display clamps too; photographs are in range.
            let error = p.to_f64().clamp(0.0, 1.0) - t.to_f64();
            sum += error * error;
        }
        n_values += 3;
    }
    // An empty mean would be NaN and propagate through every average unnoticed.
    if n_values == 0 {
        return Err(MetricError::NoPixels);
    }
    Ok(decibels(sum / n_values as f64))
}

/// PSNR in dB of a mean squared error at a value range of 1.
pub(super) fn decibels(mse: f64) -> f64 {
    // Not `max`, which would turn NaN into a perfect score.
    -10.0 * if mse < MSE_FLOOR { MSE_FLOOR } else { mse }.log10()
}

/// Coverage from which a pixel's depth counts.
const COVERED: f32 = 0.5;
/// Maximum ratio of the `delta_125` measure.
const DELTA: f64 = 1.25;

/// Depth error over pixels with ground truth and coverage ≥ ½. The four errors are NaN if there are none
/// (`completeness` 0).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct DepthError {
    /// Mean absolute error, world units.
    pub mae: f64,
    /// Root mean squared error, world units.
    pub rmse: f64,
    /// Mean of absolute error over true depth.
    pub abs_rel: f64,
    /// Share of pixels with `max(p/t, t/p) < 1.25`.
    pub delta_125: f64,
    /// Share of pixels with ground truth whose coverage is at least ½.
    pub completeness: f64,
}

/// Compares depth maps of the same kind in world units: both view depth `z` (as from
/// [`CpuRenderer`](crate::render::cpu::CpuRenderer)) or both ray distance. Ground truth that is not finite
/// or not positive counts as missing.
///
/// # Errors
/// The images differ in size, or there is no ground truth.
pub fn depth_error(
    prediction: &Image<f32>,
    coverage: &Image<f32>,
    truth: &Image<f32>,
) -> Result<DepthError, MetricError> {
    same_size(prediction, coverage, "coverage")?;
    same_size(prediction, truth, "ground truth depth")?;
    let (mut n_truth, mut n_used, mut n_close) = (0usize, 0usize, 0usize);
    let (mut absolute, mut squared, mut relative) = (0.0, 0.0, 0.0);
    for ((p, a), t) in prediction.data.iter().zip(&coverage.data).zip(&truth.data) {
        let (p, t) = (f64::from(*p), f64::from(*t));
        // Written so that NaN counts as missing.
        if !(t.is_finite() && t > 0.0) {
            continue;
        }
        n_truth += 1;
        if *a >= COVERED {
            let error = (p - t).abs();
            n_used += 1;
            absolute += error;
            squared += error * error;
            relative += error / t;
            n_close += usize::from(p < DELTA * t && t < DELTA * p);
        }
    }
    if n_truth == 0 {
        return Err(MetricError::NoPixels);
    }
    let n = n_used as f64;
    Ok(DepthError {
        mae: absolute / n,
        rmse: (squared / n).sqrt(),
        abs_rel: relative / n,
        delta_125: n_close as f64 / n,
        completeness: n / n_truth as f64,
    })
}

/// Mean and population standard deviation (ddof 0); NaN without values.
pub fn mean_std(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    // Two passes: views score nearly alike, so a difference of squares would cancel.
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n;
    (mean, variance.sqrt())
}
