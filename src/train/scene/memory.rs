//! Memory estimate of the scene preset.

use super::config::{COMPONENT_BYTES, SceneConfig};
use crate::math::measured_pixel::MeasuredPixel;
use crate::model::scene::photometric::PhotometricState;
use crate::observation::surface::SurfacePoint;
use crate::train::memory::{MemoryEstimate, PIXEL_BYTES};

/// Additional bytes per component while a checkpoint is written: a copy of sums and seed, the index in stored
/// order, and spare capacity. Measured on Lego with 96,000 to 616,000 components: the peak grows by 429 bytes
/// a component, 199 of them the model's. The splats of the exported scene are made after the copy is dropped,
/// and are smaller.
const SCENE_COPY_BYTES: usize = 230;
/// Additional bytes per component for photometric training, besides two copies of its state: record, sums
/// over pixels, and step.
const PHOTOGRAPH_SPLAT_BYTES: usize = 480;
/// Bytes per pixel of a photograph in memory: colours and depths.
const PHOTOGRAPH_PIXEL_BYTES: usize = size_of::<[u8; 4]>() + size_of::<f32>();
/// Lists and sums of the rendered comparison picture, independent of its size.
const PHOTOGRAPH_BYTES: u64 = 58_000_000;
/// Program, threads and decoders, without per-pixel buffers.
const SCENE_PROGRAM_BYTES: u64 = 16_000_000;
const DECODER_PIXEL_BYTES: usize = 30;
/// Owner, shift and distance of a point.
const SCENE_POINT_BYTES: usize = 16;
/// Maximum number of frames stored for a second alignment.
pub const MOST_KEPT_FRAMES: usize = 16;
/// Maximum number of bytes for their contributions.
pub const MOST_KEPT_BYTES: usize = 32 << 20;
/// Contributions of a frame per pixel: on the Kinect 5,500 components of 168 bytes each, plus half of that
/// for the means of its points.
const KEPT_PIXEL_BYTES: usize = 4;

impl SceneConfig {
    /// Estimates the memory of a run over frames of `pixels`, of which `frames_at_once` are in memory, with
    /// the maximum number of components.
    pub fn memory(&self, pixels: usize, frames_at_once: usize) -> MemoryEstimate {
        // A checkpoint contains a copy of the photometric state, and so does the final picture if photographs
        // are buffered. Pixels of buffered photographs are shared by all copies.
        let waiting = self.photometric.map_or(0, |rule| rule.waiting_bytes(pixels));
        let [of_splat, of_pixel] = match self.photometric {
            Some(rule) => {
                let copies = if rule.shuffle_buffer > 0 { 3 } else { 2 };
                let of_splat = copies * PhotometricState::BYTES + PHOTOGRAPH_SPLAT_BYTES;
                // One photograph is compared at a time.
                let of_pixel = frames_at_once * PHOTOGRAPH_PIXEL_BYTES + size_of::<MeasuredPixel>();
                [of_splat, of_pixel]
            }
            None => [0; 2],
        };
        let of_photographs = self.photometric.map_or(0, |_| PHOTOGRAPH_BYTES) + waiting as u64;
        let kept = match self.aligns_twice() {
            // Twice, as a checkpoint holds a copy.
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
