//! The seam between learning from photographs and whatever device compares them.

use super::compared::Compared;
use super::row::RowChoice;
use super::view::PreparedView;
use super::walk::PixelRule;
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;

/// Compares photographs with splats: the processor, or a device beside it.
pub trait PhotometricComparer: Send + Sync {
    /// What it runs on, for reports.
    fn name(&self) -> String;

    /// Compares the chosen rows of a photograph with the picture of the view's splats. What is
    /// mostly covered counts as covered where the coverage is not known.
    ///
    /// # Errors
    /// [`ComparerError`] if the device is lost, has no memory for the view, or does not answer. Nothing
    /// is known of the view then.
    fn compare<'a>(
        &'a mut self,
        view: &PreparedView<'a>,
        photograph: &Image<MeasuredPixel>,
        rule: PixelRule,
        rows: RowChoice,
    ) -> Result<Compared<'a>, ComparerError>;
}

/// A device could not compare a photograph.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{device}: expected a photograph to be compared, which failed: {reason}")]
pub struct ComparerError {
    /// What it was to run on.
    pub device: String,
    /// What went wrong, in the device's words.
    pub reason: String,
}
