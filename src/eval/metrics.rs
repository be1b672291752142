//! PSNR and depth error (`evaluation.md`, PSNR), in f64.
//!
//! Images are sRGB-encoded [`RgbImage`](crate::math::image::RgbImage)s with values in `[0, 1]`, or f64
//! images for tests that need more digits.

use super::comparison::COVERED;
use super::report::quantile;
use crate::math::image::Image;
use crate::math::real::Real;

/// Lower bound of mean squared errors, so that equal images have a PSNR of 120 dB.
const MSE_FLOOR: f64 = 1e-12;

/// Returns the peak signal-to-noise ratio in dB over all pixels and channels. The prediction is clamped
/// to `[0, 1]`; neither image is quantised. The result is NaN if a value is NaN.
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

/// Returns [`psnr`] over the pixels where `mask` is true.
///
/// # Errors
/// The images differ in size, or `mask` is true for no pixel.
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
    for (prediction, truth) in pixels.filter(|(_, truth)| !is_left_out(truth)) {
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

/// True if a mask leaves a pixel of the photograph out of comparisons.
pub(super) fn is_left_out<R: Real>(truth: &[R; 3]) -> bool {
    truth[0].to_f64().is_nan()
}

/// Converts a mean squared error at a value range of 1 to PSNR in dB.
pub(super) fn decibels(mse: f64) -> f64 {
    // Not `max`, which would turn NaN into a perfect score.
    -10.0 * if mse < MSE_FLOOR { MSE_FLOOR } else { mse }.log10()
}

/// Returns the mean absolute error of a depth map, over pixels with ground truth and coverage ≥ ½, world
/// units. Both maps must be of one kind: view depth `z` (as from
/// [`CpuRenderer`](crate::render::cpu::CpuRenderer)) or ray distance. The result is NaN without such
/// pixels. Ground truth that is not finite or not positive counts as missing.
///
/// # Errors
/// The images differ in size, or there is no ground truth.
pub fn depth_error(
    prediction: &Image<f32>,
    coverage: &Image<f32>,
    truth: &Image<f32>,
) -> Result<f64, MetricError> {
    same_size(prediction, coverage, "coverage")?;
    same_size(prediction, truth, "ground truth depth")?;
    let (mut n_truth, mut n_used, mut sum) = (0usize, 0usize, 0.0);
    for ((p, a), t) in prediction.data.iter().zip(&coverage.data).zip(&truth.data) {
        let (p, t) = (f64::from(*p), f64::from(*t));
        // Written so that NaN counts as missing.
        if !(t.is_finite() && t > 0.0) {
            continue;
        }
        n_truth += 1;
        if *a >= COVERED {
            n_used += 1;
            sum += (p - t).abs();
        }
    }
    if n_truth == 0 {
        return Err(MetricError::NoPixels);
    }
    Ok(sum / n_used as f64)
}

/// Returns the mean and the population standard deviation (ddof 0); NaN if there are no values.
pub fn mean_std(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    // Two passes: views score nearly alike, so a difference of squares would cancel.
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n;
    (mean, variance.sqrt())
}

/// Returns the mean; `None` if there are no values.
pub(super) fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let values: Vec<f64> = values.into_iter().collect();
    (!values.is_empty()).then(|| mean_std(&values).0)
}

/// Side length of the square SSIM window in pixels (Wang et al. 2004).
pub(super) const SSIM_WINDOW: usize = 11;

/// Error of an image comparison.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MetricError {
    /// The images differ in size.
    #[error(
        "{what}: expected {}x{} like the prediction, found {}x{}; render at the size of the ground truth",
        expected[0], expected[1], found[0], found[1]
    )]
    SizeMismatch { what: &'static str, expected: [usize; 2], found: [usize; 2] },
    /// There is no pixel to compare, or none under the mask.
    #[error(
        "expected at least one pixel to compare, found none; check the mask or the ground truth"
    )]
    NoPixels,
    /// The image is smaller than the SSIM window.
    #[error(
        "SSIM: expected at least {SSIM_WINDOW}x{SSIM_WINDOW} pixels, found {width}x{height}; use larger images"
    )]
    TooSmall { width: usize, height: usize },
}

/// Checks that two images have equal size. `what` names the second image in the error.
pub(super) fn same_size<A, B>(
    prediction: &Image<A>,
    other: &Image<B>,
    what: &'static str,
) -> Result<(), MetricError> {
    let (expected, found) = ([prediction.width, prediction.height], [other.width, other.height]);
    (expected == found).then_some(()).ok_or(MetricError::SizeMismatch { what, expected, found })
}

/// Median and quartiles of repeated measurements.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Median.
    pub median: f64,
    /// First and third quartile.
    pub quartiles: [f64; 2],
}

impl Spread {
    /// Computes median and quartiles. All are zero without values.
    pub fn of(mut values: Vec<f64>) -> Self {
        // Total order: with NaN, the result must not depend on the input order.
        values.sort_by(f64::total_cmp);
        let [low, median, high] = [0.25, 0.5, 0.75].map(|q| quantile(&values, q));
        Self { median, quartiles: [low, high] }
    }

    /// Returns the spread of a value that was measured once.
    pub fn exact(value: f64) -> Self {
        Self { median: value, quartiles: [value; 2] }
    }

    /// Multiplies median and quartiles by a factor.
    pub fn scaled(self, factor: f64) -> Self {
        Self { median: factor * self.median, quartiles: self.quartiles.map(|q| factor * q) }
    }
}

impl std::fmt::Display for Spread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [low, high] = self.quartiles;
        // More digits would exceed the precision of the measurement.
        let digits = if self.median >= 100.0 {
            0
        } else if self.median >= 1.0 {
            1
        } else {
            3
        };
        write!(f, "{:.digits$} [{low:.digits$}, {high:.digits$}]", self.median)
    }
}
