//! What the scene preset takes of the machine's memory.

use super::config::{COMPONENT_BYTES, SceneConfig};
use crate::math::measured_pixel::MeasuredPixel;
use crate::model::scene::photometric::PhotometricState;
use crate::observation::surface::SurfacePoint;
use crate::train::memory::{MemoryEstimate, PIXEL_BYTES};

/// What a component of a scene takes, beside its own bytes, while a checkpoint of it is written: a copy
/// of its sums and seed, its place in their order, and room to grow. Measured on Lego with 96,000 to
/// 616,000 components: the peak grows by 429 bytes a component, 199 of them the model's. The splats of
/// the exported scene are made after that copy is dropped, and are smaller.
const SCENE_COPY_BYTES: usize = 230;
/// What learning from photographs takes of a component beside two copies of what they taught: its
/// record, its sums in the picture and its step.
const PHOTOGRAPH_SPLAT_BYTES: usize = 480;
/// The photograph of a frame in memory: colours and depths.
const PHOTOGRAPH_PIXEL_BYTES: usize = size_of::<[u8; 4]>() + size_of::<f32>();
/// Lists and sums of the picture that a photograph is compared with, whatever its size.
const PHOTOGRAPH_BYTES: u64 = 58_000_000;
/// The program itself, and what its threads and decoders need of a frame besides.
const SCENE_PROGRAM_BYTES: u64 = 16_000_000;
const DECODER_PIXEL_BYTES: usize = 30;
/// Owner, shift and distance of a point.
const SCENE_POINT_BYTES: usize = 16;
/// Frames that are kept for a second look at most.
pub const MOST_KEPT_FRAMES: usize = 16;
/// Bytes of all that these taught at most.
pub const MOST_KEPT_BYTES: usize = 32 << 20;
/// What a frame taught, by pixel: of the Kinect 5,500 components of 168 bytes, and half as many that it showed.
const KEPT_PIXEL_BYTES: usize = 4;

impl SceneConfig {
    /// What a run over frames of `pixels`, so many of them in memory at once, takes with as many components
    /// as the settings allow.
    pub fn memory(&self, pixels: usize, frames_at_once: usize) -> MemoryEstimate {
        // A checkpoint holds a copy of what photographs taught, too, and so does what is drawn at the end
        // where some of them wait, whose pixels all of these share.
        let waiting = self.photometric.map_or(0, |rule| rule.waiting_bytes(pixels));
        let [of_splat, of_pixel] = match self.photometric {
            Some(rule) => {
                let copies = if rule.shuffle_buffer > 0 { 3 } else { 2 };
                let of_splat = copies * PhotometricState::BYTES + PHOTOGRAPH_SPLAT_BYTES;
                // One is compared at a time.
                let of_pixel = frames_at_once * PHOTOGRAPH_PIXEL_BYTES + size_of::<MeasuredPixel>();
                [of_splat, of_pixel]
            }
            None => [0; 2],
        };
        let of_photographs = self.photometric.map_or(0, |_| PHOTOGRAPH_BYTES) + waiting as u64;
        let kept = match self.looks_twice() {
            // And once more in a checkpoint.
            true => 2 * (MOST_KEPT_FRAMES * pixels * KEPT_PIXEL_BYTES).min(MOST_KEPT_BYTES),
            false => 0,
        };
        let fixed = of_photographs + SCENE_PROGRAM_BYTES + kept as u64;
        // A lattice is merged only in a copy.
        let most = match self.births.is_order_invariant() {
            true => self.most_seeds(),
            false => self.max_components,
        };
        let per_component = COMPONENT_BYTES + SCENE_COPY_BYTES + of_splat;
        let point = size_of::<SurfacePoint>() + size_of::<f32>();
        let of_points = pixels
            * (frames_at_once * point
                + SCENE_POINT_BYTES
                + PIXEL_BYTES
                + DECODER_PIXEL_BYTES
                + of_pixel);
        MemoryEstimate {
            model: (most as u64).saturating_mul(per_component as u64),
            frames: fixed + of_points as u64,
        }
    }
}
