//! Frames to observations, stage by stage.

use super::emit::Emitter;
use super::fit::{FitRows, Fitted};
use super::occluders::Occluders;
use super::planes::Planes;
use super::recipe::TILE;
use super::settings::SurfaceSettings;
use super::status::{PixelStatus, SurfaceCounts};
use crate::dataset::calibration::Calibration;
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::math::image::Image;
use crate::math::simd::Isa;
use crate::observation::photograph::Photograph;
use crate::observation::surface::Observation;
use glam::{DQuat, DVec3};

/// Turns frames into observations; keeps its scratch memory between frames.
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
    occluders: Occluders,
    statuses: Image<PixelStatus>,
}

impl Preparer {
    /// On the best instruction set of this machine, with no memory yet.
    pub fn new() -> Self {
        Self::on(Isa::best())
    }

    /// On a given instruction set; results have equal bits on all of them.
    pub fn on(isa: Isa) -> Self {
        let statuses = Image::filled(0, 0, PixelStatus::Hole);
        Self {
            isa,
            planes: Planes::default(),
            fitted: Fitted::default(),
            occluders: Occluders::default(),
            statuses,
        }
    }

    /// Replaces `out` by the surface points and measured ranges of a frame; the share of pixels that
    /// made none is counted by reason.
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
        let Self { isa, planes, fitted, occluders, statuses } = self;
        let (width, height) = depth.size();
        resize(&mut out.ranges, width, height);
        resize(statuses, width, height);
        let calibration = settings.calibration();
        // Whole before the first fit: windows read beyond their tile, occluders come from anywhere.
        planes.fill(frame, depth, &profile, calibration, &mut out.ranges, statuses);
        out.points.clear();
        let emitter = Emitter::new(frame, planes, settings, &profile, occluders);
        // A row of tiles at a time: what was fitted is still in the cache when points are made.
        for top in (0..height).step_by(TILE) {
            let rows = top..height.min(top + TILE);
            let sampling = settings.sampling;
            isa.run(FitRows {
                planes,
                rows: rows.clone(),
                sampling,
                profile: &profile,
                out: fitted,
            });
            emitter.emit(fitted, rows, &mut out.points, statuses);
        }
        out.point_weight = settings.sampling.weight();
        out.origin = settings.origin;
        out.camera = frame.camera;
        out.tolerance = profile.tolerance;
        out.photograph = settings.photograph.then(|| photograph(frame, calibration, &out.ranges));
        Ok(SurfaceCounts::of(&statuses.data))
    }

    /// Status of every pixel of the last frame that was prepared.
    pub fn statuses(&self) -> &Image<PixelStatus> {
        &self.statuses
    }
}

impl Default for Preparer {
    fn default() -> Self {
        Self::new()
    }
}

/// The frame's colours over black with the gain of its calibration, from where they were taken.
fn photograph(frame: &Frame, calibration: &Calibration, ranges: &Image<f32>) -> Photograph {
    let gain = calibration.gain(&frame.name).map(|gain| gain as f32);
    let color_camera = frame.photographed_by(calibration.color_camera.as_ref());
    // Depth of another camera says nothing of a pixel here.
    let is_registered = color_camera.is_none();
    let pixel = |(i, &[red, green, blue, alpha]): (usize, &[u8; 4])| {
        let opaque = f32::from(alpha) / 255.0;
        let covered = match is_registered {
            true if alpha < u8::MAX => opaque,
            true if ranges.data[i].is_finite() => 1.0,
            _ => f32::NAN,
        };
        let [r, g, b] = [red, green, blue].map(|channel| f32::from(channel) / 255.0 * opaque);
        [r * gain[0], g * gain[1], b * gain[2], covered]
    };
    let Image { width, height, data } = &frame.color;
    let pixels = data.iter().enumerate().map(pixel).collect();
    let pixels = Image::from_vec(*width, *height, pixels);
    let depth = frame.camera.intrinsics;
    let (intrinsics, offset, turn) = match &color_camera {
        None => (depth, DVec3::ZERO, DQuat::IDENTITY),
        Some(camera) => (camera.intrinsics(depth), DVec3::from_array(camera.offset), camera.turn()),
    };
    Photograph { intrinsics, offset, turn, pixels }
}

/// Every value is to be written.
fn resize<T: Clone + Default>(image: &mut Image<T>, width: usize, height: usize) {
    image.data.resize(width * height, T::default());
    (image.width, image.height) = (width, height);
}
