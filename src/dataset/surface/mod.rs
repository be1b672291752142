//! Converts frames to observations (`dataset.md`, Plane fit). A robust plane is fitted around every
//! pixel in inverse depth; pixels without an accepted plane are dropped, the others get the plane's
//! depth and normal.
//!
//! | stage | file |
//! |---|---|
//! | codes to depth, noise and pixel status | `planes` |
//! | plane fit around every pixel, in blocks of eight | `fit` |
//! | depth, normal and colour of kept pixels | `emit`, `color_lookup`, `seen` |
//!
//! Inverse depth of a plane is affine in pixel coordinates, so the fit is linear and exact; depth itself is
//! not affine. The fit also filters flying pixels: a mixture of two surfaces is on neither plane.

pub mod sample;
pub mod sensor;
pub mod settings;

mod color_lookup;
pub mod emit;
mod fit;
mod planes;
mod seen;

use super::error::FrameError;
use super::frame::Frame;
use crate::math::image::Image;
use crate::math::simd::Isa;
use crate::observation::surface::Observation;
use color_lookup::{Beside, ColorLookup};
use emit::{EmitRows, Emitter};
use fit::{FitRows, Fitted};
use planes::{FillPlanes, Planes};
use seen::{Projection, ReprojectedDepths, SeeFrame, registered, seen_beside};
use settings::TILE;

pub use emit::{PixelStatus, SurfaceCounts};
pub use sensor::Sensor;
pub use settings::{PixelSampling, SurfaceSettings};

/// Converts frames to observations; reuses its scratch memory between frames.
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::dataset::surface::{Preparer, SurfaceSettings};
/// use vbgs_studio::observation::surface::Observation;
///
/// let demo = vbgs_studio::dataset::synthetic::demo()?;
/// let settings = SurfaceSettings::new(&demo, DVec3::ZERO);
/// let mut observation = Observation::empty();
/// let counts = Preparer::new().prepare(&demo.load(0, 0)?, &settings, &mut observation)?;
/// assert_eq!(counts.kept, observation.points.len());
/// assert!(counts.kept > 10 * counts.dropped(), "edges and slants are few: {counts:?}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Preparer {
    isa: Isa,
    planes: Planes,
    fitted: Fitted,
    seen: ReprojectedDepths,
    statuses: Image<PixelStatus>,
}

impl Preparer {
    /// Creates a preparer for the best instruction set of this machine, without allocating memory.
    pub fn new() -> Self {
        Self::on(Isa::best())
    }

    /// Creates a preparer for a given instruction set. Results are bitwise equal on all instruction
    /// sets.
    pub fn on(isa: Isa) -> Self {
        let statuses = Image::filled(0, 0, PixelStatus::Hole);
        Self {
            isa,
            planes: Planes::default(),
            fitted: Fitted::default(),
            seen: ReprojectedDepths::default(),
            statuses,
        }
    }

    /// Replaces `out` by the surface points and measured ranges of a frame. Returns the numbers of
    /// pixels by status.
    ///
    /// # Errors
    /// Fails for a frame without depth.
    pub fn prepare(
        &mut self,
        frame: &Frame,
        settings: &SurfaceSettings,
        out: &mut Observation,
    ) -> Result<SurfaceCounts, FrameError> {
        let depth = frame.require_depth()?;
        let profile = &settings.profile(depth, &frame.camera.intrinsics);
        let Self { isa, planes, fitted, seen, statuses } = self;
        let (width, height) = depth.size();
        resize(&mut out.ranges, width, height);
        resize(statuses, width, height);
        let calibration = settings.calibration();
        // Complete before the first fit: windows extend beyond a tile, and occluders may be anywhere.
        let ranges = &mut out.ranges;
        isa.run(FillPlanes { planes, frame, depth, profile, calibration, ranges, statuses });
        let color_camera = frame.photographed_by(calibration.color_camera.as_ref());
        let camera = color_camera.as_ref().map(Projection::new);
        if let (Some(color_camera), Some(camera)) = (&color_camera, &camera) {
            let k = &frame.camera.intrinsics;
            let [x, y] = color_camera.focal;
            // The larger ratio, so that squares of neighbouring pixels leave no gap.
            let footprint = (x / k.fx).max(y / k.fy) as f32;
            let size = [frame.color.width, frame.color.height];
            let is_whole = settings.photograph;
            isa.run(SeeFrame { planes, camera, footprint, size, is_whole, out: seen });
        }
        let margin = profile.tolerance.margin;
        let beside = camera.as_ref().map(|camera| Beside { camera, depths: seen, margin });
        let colors = ColorLookup::new(frame, calibration, beside);
        let emitter = Emitter::new(frame, planes, settings, profile, colors);
        let sampling = settings.sampling;
        out.points.clear();
        // One row of tiles at a time, so that fitted planes are still in the cache when points are made.
        for top in (0..height).step_by(TILE) {
            let rows = top..height.min(top + TILE);
            isa.run(FitRows { planes, rows: rows.clone(), sampling, profile, out: fitted });
            let points = &mut out.points;
            isa.run(EmitRows { emitter: &emitter, fitted, rows, points, statuses });
        }
        out.point_weight = settings.sampling.weight();
        out.origin = settings.origin;
        out.camera = frame.camera;
        out.tolerance = profile.tolerance;
        // Its memory is reused.
        let earlier = out.photograph.take();
        out.photograph = settings.photograph.then(|| {
            let gain = calibration.gain(&frame.name);
            match &color_camera {
                None => registered(frame, planes, gain, earlier),
                Some(camera) => seen_beside(frame, seen, camera, gain, earlier),
            }
        });
        Ok(SurfaceCounts::of(&statuses.data))
    }

    /// Returns the status of every pixel of the last prepared frame.
    pub fn statuses(&self) -> &Image<PixelStatus> {
        &self.statuses
    }
}

impl Default for Preparer {
    fn default() -> Self {
        Self::new()
    }
}

// Old values remain: the caller writes all of them.
fn resize<T: Clone + Default>(image: &mut Image<T>, width: usize, height: usize) {
    image.data.resize(width * height, T::default());
    (image.width, image.height) = (width, height);
}
