//! The seam between presets on the side of a run: what ties a preset's settings, the preparation of
//! frames and the learner together by type, so that no learner is ever handed the other preset's
//! material. [`start`](super::start) is the one place that asks which preset a run follows; whoever
//! needs less than the types asks [`AnyPreset`].

use super::error::SessionError;
use super::memory::Estimate;
use super::mismatch::Mismatch;
use super::prepare::Prepare;
use super::run::RunConfig;
use crate::dataset::calibration::ColorCamera;
use crate::dataset::range::PositionRange;
use crate::dataset::unproject::CameraConvention;
use crate::dataset::{Dataset, Layout};
use crate::math::normalization::Normalization;
use crate::model::stored::StoredModel;
use crate::train::learner::{Learner, Learns};

/// What a preset's learner learns from.
pub type ObservationOf<P> = <<P as TypedPreset>::Preparation as Prepare>::Observation;

/// The settings of a preset, and what they imply of types.
pub trait TypedPreset: AnyPreset {
    /// How frames become what the learner learns from.
    type Preparation: Prepare;

    /// Settings of the preparation for a run whose model works in the coordinates of
    /// `normalization`.
    fn preparation(&self, run: &RunConfig, normalization: Normalization) -> Self::Preparation;

    /// A learner that has seen nothing, for a dataset whose positions lie in `range`.
    ///
    /// # Errors
    /// [`SessionError`] if the machine has no room for it or the data gives no start.
    fn begin(
        &self,
        dataset: &Dataset,
        run: &RunConfig,
        range: &PositionRange,
        pixels: usize,
    ) -> Result<Beginning<ObservationOf<Self>>, SessionError>;

    /// A learner that goes on where one with these settings stopped after `frames` frames.
    ///
    /// # Errors
    /// [`Mismatch`] if the stored model is not one of these settings.
    fn restore(
        &self,
        model: &StoredModel,
        frames: u64,
    ) -> Result<Beginning<ObservationOf<Self>>, Mismatch>;
}

/// A learner at the begin of a session.
pub struct Beginning<O> {
    /// The learner.
    pub learner: Box<dyn Learns<O>>,
    /// World to model coordinates.
    pub normalization: Normalization,
}

/// What can be asked of a preset's settings without knowing the preset.
pub trait AnyPreset {
    /// Seed of every random stream.
    fn seed(&self) -> u64;

    /// The camera that photographs were taken by; `None` if the one that measured depth.
    fn color_camera(&self) -> Option<ColorCamera>;

    /// How pixels of a layout become rays.
    fn camera_convention(&self, layout: Layout) -> CameraConvention;

    /// What a run over frames of `pixels` takes of the machine's memory at most.
    fn memory(&self, pixels: usize) -> Estimate;

    /// The setting by which a model of so many components depends on the order of frames, and what
    /// to do about it; `None` if it does not, or if only its start can tell.
    fn order_dependence(&self, components: usize) -> Option<OrderDependence>;

    /// Refuses a stored model that is not one of these settings.
    ///
    /// # Errors
    /// [`Mismatch`] says in what.
    fn check(&self, model: &StoredModel) -> Result<(), Mismatch>;

    /// A learner with the stored model, whatever it learns from.
    ///
    /// # Errors
    /// As [`TypedPreset::restore`].
    fn revive(&self, model: &StoredModel, frames: u64) -> Result<Revived, Mismatch>;
}

/// A learner out of a checkpoint.
pub struct Revived {
    /// The learner.
    pub learner: Box<dyn Learner>,
    /// World to model coordinates.
    pub normalization: Normalization,
}

/// Why a model depends on the order of frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OrderDependence {
    /// The setting that makes it so, as the command line spells it.
    pub found: String,
    /// What to train with instead.
    pub advice: &'static str,
}
