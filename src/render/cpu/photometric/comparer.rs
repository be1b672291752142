//! Interface between photometric training and the device that compares photographs.

use super::compared::PhotometricSums;
use super::row::RowSubset;
use super::view::PreparedView;
use super::walk::PixelRule;
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;

/// Compares photographs with rendered splats, on the CPU or another device.
pub trait PhotometricComparer: Send + Sync {
    /// Device name for reports.
    fn name(&self) -> String;

    /// Compares the chosen rows of a photograph with the rendering of the view's splats. If a pixel's target
    /// coverage is unknown, a mostly covered pixel counts as fully covered.
    ///
    /// # Errors
    /// [`ComparerError`] if the device is lost, runs out of memory or does not respond. No result is
    /// available then.
    fn compare<'a>(
        &'a mut self,
        view: &PreparedView<'a>,
        photograph: &Image<MeasuredPixel>,
        rule: PixelRule,
        rows: RowSubset,
    ) -> Result<PhotometricSums<'a>, ComparerError>;
}

/// A photograph could not be compared on a device.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{device}: comparing a photograph failed: {reason}")]
pub struct ComparerError {
    /// Device that should have compared it.
    pub device: String,
    /// Reason reported by the device or driver.
    pub reason: String,
}
