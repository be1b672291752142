//! Size checks of image comparisons, and their errors.

use crate::math::image::Image;

/// Side of the SSIM window in pixels (Wang et al. 2004).
pub(super) const SSIM_WINDOW: usize = 11;

/// Error of an image comparison.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MetricError {
    /// The planes differ in size.
    #[error(
        "{what}: expected {expected_width}x{expected_height} like the prediction, found {width}x{height}; render at the size of the ground truth"
    )]
    SizeMismatch {
        /// The plane of wrong size.
        what: &'static str,
        /// Width of the prediction, pixels.
        expected_width: usize,
        /// Height of the prediction, pixels.
        expected_height: usize,
        /// Width found, pixels.
        width: usize,
        /// Height found, pixels.
        height: usize,
    },
    /// No pixel, or none under the mask.
    #[error(
        "expected at least one pixel to compare, found none; check the mask or the ground truth"
    )]
    NoPixels,
    /// The image is smaller than the SSIM window.
    #[error(
        "SSIM without padding: expected at least {SSIM_WINDOW}x{SSIM_WINDOW} pixels, found {width}x{height}; use larger images or zero padding"
    )]
    TooSmall {
        /// Width found, pixels.
        width: usize,
        /// Height found, pixels.
        height: usize,
    },
}

/// Checks that two planes have equal size; `what` names the second.
pub(super) fn same_size<A, B>(
    prediction: &Image<A>,
    other: &Image<B>,
    what: &'static str,
) -> Result<(), MetricError> {
    if (prediction.width, prediction.height) == (other.width, other.height) {
        return Ok(());
    }
    Err(MetricError::SizeMismatch {
        what,
        expected_width: prediction.width,
        expected_height: prediction.height,
        width: other.width,
        height: other.height,
    })
}
