//! What two images must share to be compared, and why they cannot be.

use crate::math::image::Image;

/// Side of the SSIM window in pixels (Wang et al. 2004).
pub(super) const SSIM_WINDOW: usize = 11;

/// Why two images cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MetricError {
    /// The planes differ in size.
    #[error(
        "{what}: expected {expected_width}x{expected_height} like the prediction, found {width}x{height}; render at the size of the ground truth"
    )]
    SizeMismatch {
        /// Which plane is off.
        what: &'static str,
        /// Columns of the prediction.
        expected_width: usize,
        /// Rows of the prediction.
        expected_height: usize,
        /// Columns of the image found, pixels.
        width: usize,
        /// Rows of the image found, pixels.
        height: usize,
    },
    /// No pixel, or none under the mask.
    #[error(
        "expected at least one pixel to compare, found none; check the mask or the ground truth"
    )]
    NoPixels,
    /// The SSIM window does not fit.
    #[error(
        "SSIM without padding: expected at least {SSIM_WINDOW}x{SSIM_WINDOW} pixels, found {width}x{height}; use larger images or zero padding"
    )]
    TooSmall {
        /// Columns of the image found, pixels.
        width: usize,
        /// Rows of the image found, pixels.
        height: usize,
    },
}

/// Refuses two planes of different sizes; `what` names the second one.
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
