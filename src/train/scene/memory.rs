//! What the scene preset takes of the machine's memory.

use super::config::{COMPONENT_BYTES, SceneConfig};
use crate::model::scene::photometric::PhotometricState;
use crate::observation::surface::SurfacePoint;
use crate::train::memory::{FRAMES_AT_ONCE, MemoryEstimate, PIXEL_BYTES, PROGRAM_BYTES};

/// What a component of a scene takes, beside its own bytes, while a checkpoint of it is written: a copy
/// of its sums and seed, its place in their order, and room to grow. Measured on Lego with 96,000 to
/// 616,000 components: the peak grows by 429 bytes a component, 199 of them the model's. The splats of
/// the exported scene are made after that copy is dropped, and are smaller.
const SCENE_COPY_BYTES: usize = 230;
/// Owner, shift and distance of a point.
const SCENE_POINT_BYTES: usize = 16;

impl SceneConfig {
    /// What a run over frames of `pixels` takes with as many components as the settings allow.
    pub fn memory(&self, pixels: usize) -> MemoryEstimate {
        // A checkpoint holds a copy of what photographs taught, too.
        let photographs = if self.photometric.is_some() { 2 * PhotometricState::BYTES } else { 0 };
        let per_component = COMPONENT_BYTES + SCENE_COPY_BYTES + photographs;
        let point = size_of::<SurfacePoint>() + size_of::<f32>();
        let of_points = pixels * (FRAMES_AT_ONCE * point + SCENE_POINT_BYTES + PIXEL_BYTES);
        MemoryEstimate {
            model: (self.max_components as u64).saturating_mul(per_component as u64),
            frames: PROGRAM_BYTES + of_points as u64,
        }
    }
}
