//! What a scene is trained with on one dataset.

use crate::dataset::surface::SurfaceSettings;
use crate::math::normalization::Normalization;
use crate::train::scene::config::SceneConfig;
use crate::train::scene::units::{Budget, StructuralScale};
use serde::{Deserialize, Serialize};

/// Every setting of a scene on one dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneRun {
    /// Seed of the order of frames.
    pub seed: u64,
    /// The structural scale as it was asked for.
    pub scale: StructuralScale,
    /// Most components, as it was asked for.
    pub budget: Option<Budget>,
    /// Settings of the engine, the structural scale in world units among them.
    #[serde(flatten)]
    pub engine: SceneConfig,
    /// How frames are prepared.
    pub surface: SurfaceSettings,
}

impl SceneRun {
    /// How frames are prepared for the engine's settings: with their photographs if these are learnt.
    pub fn prepared_surface(&self) -> SurfaceSettings {
        SurfaceSettings { photograph: self.engine.photometric.is_some(), ..self.surface.clone() }
    }

    /// World to model coordinates: a shift alone.
    pub fn normalization(&self) -> Normalization {
        Normalization { offset: self.surface.origin.to_array(), scale: [1.0; 3] }
    }
}
