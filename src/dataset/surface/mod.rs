//! Frames to observations (`accuracy.md` 2): a robust plane is fitted around every pixel in inverse
//! depth, pixels that no plane explains are dropped, the others take its depth and normal.

pub mod fates;
pub mod sensor;
pub mod settings;

mod emit;
mod fit;
mod occluders;
mod painter;
mod planes;

use super::error::FrameError;
use super::frame::Frame;
use crate::math::image::Image;
use crate::math::observation::Observation;
use crate::math::simd::Isa;
use emit::Emitter;
pub use fates::{PixelFate, SurfaceCounts};
use fit::{FitRows, Fitted};
use occluders::Occluders;
use planes::Planes;
pub use sensor::Sensor;
pub use settings::SurfaceSettings;
use std::ops::RangeInclusive;

/// Pixels from the centre of the window to its side.
const RADIUS: usize = 2;
/// Least-squares rounds; from the second on only inliers take part.
const ROUNDS: usize = 3;
/// Neighbours that a round needs, the pixel itself included.
const MIN_INLIERS: usize = 5;
/// Share of the window that must be inliers in the end.
const MIN_SHARE: f64 = 0.3;
/// Pixels on a side of a tile.
const TILE: usize = 8;
/// Lengths whose squares and inverses f32 holds.
const LENGTHS: RangeInclusive<f64> = 1e-9..=1e9;

/// Turns frames into observations; keeps its scratch memory between frames.
#[derive(Clone, Debug)]
pub struct Preparer {
    isa: Isa,
    planes: Planes,
    fitted: Fitted,
    occluders: Occluders,
    fates: Image<PixelFate>,
}

impl Preparer {
    /// No memory yet.
    pub fn new() -> Self {
        Self::on(Isa::best())
    }

    /// On an instruction set; all give the same bits.
    pub fn on(isa: Isa) -> Self {
        let fates = Image::filled(0, 0, PixelFate::Hole);
        Self {
            isa,
            planes: Planes::default(),
            fitted: Fitted::default(),
            occluders: Occluders::default(),
            fates,
        }
    }

    /// Replaces `out` by what a frame says.
    ///
    /// # Errors
    /// A frame without depth.
    pub fn prepare(
        &mut self,
        frame: &Frame,
        settings: &SurfaceSettings,
        out: &mut Observation,
    ) -> Result<SurfaceCounts, FrameError> {
        let depth = frame.depth_to_use()?;
        let profile = settings.profile(depth, &frame.camera.intrinsics);
        let Self { isa, planes, fitted, occluders, fates } = self;
        let (width, height) = depth.size();
        resize(&mut out.ranges, width, height);
        resize(fates, width, height);
        let calibration = settings.calibration();
        planes.fill(frame, depth, &profile, calibration, &mut out.ranges, fates);
        out.points.clear();
        let emitter = Emitter::new(frame, planes, settings, &profile, occluders);
        for top in (0..height).step_by(TILE) {
            let rows = top..height.min(top + TILE);
            isa.run(FitRows { planes, rows: rows.clone(), profile: &profile, out: fitted });
            emitter.emit(fitted, rows, &mut out.points, fates);
        }
        out.origin = settings.origin;
        out.camera = frame.camera;
        out.tolerance = profile.tolerance;
        Ok(SurfaceCounts::of(&fates.data))
    }

    /// What became of the pixels of the last frame.
    pub fn fates(&self) -> &Image<PixelFate> {
        &self.fates
    }
}

impl Default for Preparer {
    fn default() -> Self {
        Self::new()
    }
}

/// Every value is to be written.
fn resize<T: Clone + Default>(image: &mut Image<T>, width: usize, height: usize) {
    image.data.resize(width * height, T::default());
    (image.width, image.height) = (width, height);
}
