//! What can be asked of a preset's settings without knowing the preset: by far the most of what a run,
//! a checkpoint or a panel wants to know. Whoever needs the types asks
//! [`TypedPreset`](super::preset::TypedPreset).

use super::mismatch::Mismatch;
use crate::dataset::Layout;
use crate::dataset::calibration::{Calibration, ColorCamera};
use crate::dataset::unproject::CameraConvention;
use crate::math::normalization::Normalization;
use crate::model::splat::splats::CovarianceForm;
use crate::model::stored::StoredModel;
use crate::train::learner::Learner;
use crate::train::memory::MemoryEstimate;

/// What can be asked of a preset's settings without knowing the preset.
pub trait AnyPreset {
    /// Seed of every random stream.
    fn seed(&self) -> u64;

    /// Corrections of the cameras, if the preset knows any.
    fn calibration(&self) -> Option<&Calibration>;

    /// The camera that photographs were taken by; `None` if the one that measured depth.
    fn color_camera(&self) -> Option<ColorCamera> {
        self.calibration()?.color_camera
    }

    /// How many components there may be.
    fn component_limit(&self) -> ComponentLimit;

    /// How the posterior of a component becomes the shape of a splat.
    fn covariance_form(&self) -> CovarianceForm;

    /// What was found on the dataset and places the model in the world: names and values. Models are
    /// added only where these agree.
    fn placement(&self) -> Vec<(&'static str, String)>;

    /// How pixels of a layout become rays.
    fn camera_convention(&self, layout: Layout) -> CameraConvention;

    /// What a run over frames of `pixels` takes of the machine's memory at most.
    fn memory(&self, pixels: usize) -> MemoryEstimate;

    /// The setting by which a model of so many components depends on the order of frames, and what
    /// to do about it; `None` if it does not, or if only its start can tell.
    fn order_dependence(&self, components: usize) -> Option<OrderDependence>;

    /// Whether models of these settings have components of their own, so that they are fused; others have
    /// the same from the beginning, and are added.
    fn is_fused(&self) -> bool;

    /// The models, in this order, as one that may exceed no limit of these settings; all went on from
    /// `origin`, if there is one. `None` unless they are fused and of these settings.
    fn fuse(&self, origin: Option<&StoredModel>, models: &[&StoredModel]) -> Option<StoredModel>;

    /// Refuses a stored model that is not one of these settings.
    ///
    /// # Errors
    /// [`Mismatch`] says in what.
    fn check(&self, model: &StoredModel) -> Result<(), Mismatch>;

    /// A learner with the stored model, whatever it learns from.
    ///
    /// # Errors
    /// As [`TypedPreset::restore`](super::preset::TypedPreset::restore).
    fn revive(&self, model: &StoredModel, frames: u64) -> Result<Revived, Mismatch>;
}

/// How many components a model may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ComponentLimit {
    /// It has so many from the start, used or not.
    Fixed(usize),
    /// It grows up to so many, which the user asked for.
    Asked(usize),
    /// It grows up to so many, as nobody asked for fewer.
    Default(usize),
}

impl ComponentLimit {
    /// How many, whoever asked.
    pub fn components(self) -> usize {
        let (Self::Fixed(n) | Self::Asked(n) | Self::Default(n)) = self;
        n
    }
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
