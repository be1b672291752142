//! Settings of a run behind one interface for all presets. Code that needs a preset's concrete types
//! uses [`TypedPreset`](super::frame_loop::TypedPreset).

use super::settings::method::Method;
use crate::dataset::Layout;
use crate::dataset::calibration::{Calibration, ColorCamera};
use crate::dataset::unproject::CameraConvention;
use crate::math::measured_pixel::Normalization;
use crate::model::attributes::StoredModel;
use crate::model::splat::splats::CovarianceForm;
use crate::render::Antialias;
use crate::train::candidates::IndexError;
use crate::train::learner::Learner;
use crate::train::outcome::MemoryEstimate;

/// Interface to the settings of a run, the same for all presets.
pub trait AnyPreset {
    /// Seed of every random stream.
    fn seed(&self) -> u64;

    /// Camera calibration, if the preset supports any.
    fn calibration(&self) -> Option<&Calibration>;

    /// Colour camera of the photographs; `None` if the depth camera took them.
    fn color_camera(&self) -> Option<ColorCamera> {
        self.calibration()?.color_camera
    }

    /// Maximum number of components.
    fn component_limit(&self) -> ComponentLimit;

    /// Sets the default maximum number of components to its usual value, or to `most` if that is less. Without
    /// effect on a number that the user set, or that is fixed.
    fn lower_default_limit(&mut self, _most: usize) {}

    /// Method for converting a component's posterior covariance to the shape of a splat.
    fn covariance_form(&self) -> CovarianceForm;

    /// Names and values of the settings that position the model in the world and were estimated from the
    /// dataset. Only models with equal values can be merged.
    fn world_placement(&self) -> Vec<(&'static str, String)>;

    /// Returns the convention by which pixels become viewing rays, for datasets with the given layout.
    fn camera_convention(&self, layout: Layout) -> CameraConvention;

    /// Upper bound on the memory in bytes of a run with frames of `pixels` pixels.
    fn memory(&self, pixels: usize) -> MemoryEstimate;

    /// Fuses the models, in the given order, within the limits of these settings. `origin` is the common
    /// earlier model that all runs continued, if any. `None` unless all models match these settings and
    /// can be fused.
    fn fuse(&self, origin: Option<&StoredModel>, models: &[&StoredModel]) -> Option<StoredModel>;

    /// Returns a model after training on all its buffered photographs; `None` if it has none.
    fn settled(&self, _model: &StoredModel) -> Option<StoredModel> {
        None
    }

    /// Checks that a stored model matches these settings.
    ///
    /// # Errors
    /// [`Mismatch`] states the difference.
    fn check(&self, model: &StoredModel) -> Result<(), Mismatch>;
}

/// Maximum number of components of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ComponentLimit {
    /// Fixed number of components, all of which are allocated at the start.
    Fixed(usize),
    /// Maximum set by the user.
    Asked(usize),
    /// Default maximum.
    Default(usize),
    /// Default maximum, lowered to what fits into memory.
    Lowered(usize),
}

impl ComponentLimit {
    /// Maximum number of components.
    pub fn components(self) -> usize {
        let (Self::Fixed(n) | Self::Asked(n) | Self::Default(n) | Self::Lowered(n)) = self;
        n
    }
}

/// Learner with the transformation from world to model coordinates.
pub struct PlacedLearner<L: ?Sized = dyn Learner> {
    /// The learner.
    pub learner: Box<L>,
    /// Transformation from world to model coordinates.
    pub normalization: Normalization,
}

/// Difference between a stored model and the settings stored with it.
#[derive(Debug, thiserror::Error)]
pub enum Mismatch {
    /// The prior differs.
    #[error("expected the prior that its settings imply, found another")]
    Prior,
    /// The stored model lacks a property that the settings require; the text describes the property.
    #[error("expected {0} according to its settings, found another")]
    Form(String),
    /// A setting is out of range.
    #[error("section `CONF`: {0}")]
    Setting(String),
    /// The search index over the components' means could not be built.
    #[error(transparent)]
    Index(#[from] IndexError),
}

/// Returns the comment lines of a splat file: program and settings, antialiasing rule, and the
/// covariance conversion if it is not the default.
pub fn file_comments(method: &Method, n_frames: u64) -> Vec<String> {
    let program = concat!("vbgs-studio ", env!("CARGO_PKG_VERSION"));
    let preset = method.preset();
    let mut comments = vec![
        format!("vbgs made by {program}, preset {preset}, from {n_frames} frames"),
        // Renderers disagree about the opacity: some reduce it by as much as the area grows.
        format!("vbgs antialias {}: 0.3 px2 added, opacity kept", Antialias::Footprint),
        // The same for brush, gsplat and nerfstudio.
        "SplatRenderMode: default".to_owned(),
    ];
    if method.as_any().covariance_form() == CovarianceForm::LegacyCholesky {
        comments.push("vbgs legacy-cov".to_owned());
    }
    comments
}
