//! Settings of the scene preset: the user's values, and their result on a dataset.

pub mod start;
pub mod table;

use crate::dataset::surface::SurfaceSettings;
use crate::math::measured_pixel::Normalization;
use crate::train::scene::config::SceneConfig;
use crate::train::scene::units::{Budget, StructuralScale};
use serde::{Deserialize, Serialize};

pub use start::SceneError;
pub use table::SceneOverrides;

/// Every setting of a scene on one dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneRun {
    /// Seed of every random stream.
    pub seed: u64,
    /// Requested structural scale: maximum distance of a point from the point at which its component was
    /// created.
    pub scale: StructuralScale,
    /// Requested maximum number of components.
    pub budget: Option<Budget>,
    /// Settings of the training engine, including the structural scale in world units.
    #[serde(flatten)]
    pub engine: SceneConfig,
    /// Settings for preparing frames.
    pub surface: SurfaceSettings,
}

impl SceneRun {
    /// Settings for preparing frames, with photographs if the engine trains on photographs.
    pub fn prepared_surface(&self) -> SurfaceSettings {
        SurfaceSettings { photograph: self.engine.photometric.is_some(), ..self.surface.clone() }
    }

    /// Transformation from world to model coordinates: a translation only.
    pub fn normalization(&self) -> Normalization {
        Normalization { offset: self.surface.origin.to_array(), scale: [1.0; 3] }
    }
}
