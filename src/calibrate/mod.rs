//! Self-calibration of a recording: colour camera and depth bias. Surfaces seen by several views must be thin
//! and have equal colours (`pipeline.md`, Calibration).
//!
//! Depth and colour camera are estimated jointly by robust least squares (`evidence`, `fit`) with a
//! prior on sensor errors (`unknowns`). Results must also reduce the residuals of frames that they were
//! not fitted to (`verdict`). Values that the data does not determine keep their initial value
//! ([`CalibratedValue`]).

mod camera;
mod color;
mod covariance;
mod evidence;
mod fit;
mod gains;
mod matches;
mod pyramid;
mod report;
mod unknowns;
mod verdict;

use crate::dataset::Dataset;
use crate::dataset::calibration::{Calibration, CalibrationError, ColorCamera};
use crate::dataset::error::{DatasetError, FrameError};
use crate::dataset::frame::{DepthKind, Frame};
use crate::dataset::surface::{PixelSampling, SurfaceSettings};
use crate::pipeline::memory;
use crate::pipeline::memory::MemoryError;
use crate::pipeline::plan::{Plan, Selection};
use crate::pipeline::settings::scene::{SceneError, SceneOverrides, SceneRun};
use crate::train::scene::units::{COARSEST_DEFAULT, StructuralScale};
use camera::registered;
use evidence::{Evidence, ResidualKind};
use matches::{MatchedDepth, Matches};
use pyramid::Pyramid;
use unknowns::{DEPTH, Estimate, N, SensorPrior, Unknowns};
use verdict::{CrossValidation, LEVELS, STEPS, Views, search};

pub use report::{Agreement, Calibrated};
pub use unknowns::CalibratedValue;

/// Default maximum number of frames. Further frames add little information.
pub const DEFAULT_FRAMES: usize = 24;
/// Approximate total number of pixels used from all frames.
const PIXELS: f64 = 120_000.0;
/// Minimum number of components seen by several frames.
const MIN_COMPONENTS: usize = 100;
/// Size of components, relative to the scene's structural scale, for the check that frames share
/// surfaces. They are large, because the depth of the views may be wrong.
const COARSE: f64 = 4.0;

/// Options of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibratePlan {
    /// Split to use; `None` for the training split.
    pub split: Option<String>,
    /// Maximum number of frames; they are evenly spaced over the split.
    pub max_frames: usize,
    /// Initial calibration. Values that the data does not determine are kept.
    pub start: Calibration,
}

/// Error of a calibration.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// The dataset lacks the requested split, or has no split with depth.
    #[error("{0}")]
    Dataset(#[from] DatasetError),
    /// The scene preset cannot use the dataset's depth.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// No points can be computed from a frame.
    #[error("{0}")]
    Frame(#[from] FrameError),
    /// The result is not a valid calibration.
    #[error("{0}")]
    Calibration(#[from] CalibrationError),
    /// The machine has too little memory.
    #[error("{0}")]
    Memory(#[from] MemoryError),
    /// Fewer than two frames see the same surface.
    #[error(
        "{dataset}: expected at least 2 frames that see the same surface, found {found}; add frames to the recording, use more of them (`--max-frames`) or name another split (`--split`)"
    )]
    NothingInCommon {
        /// Name of the dataset.
        dataset: String,
        /// Description of the usable frames and of their shared surfaces.
        found: String,
    },
}

/// Calibrates depth and the colour camera. `progress` receives the number of completed steps and the
/// total.
///
/// # Errors
/// [`CalibrateError`] if frames cannot be read or used, or share too few surfaces.
pub fn run(
    dataset: &Dataset,
    plan: &CalibratePlan,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Calibrated, CalibrateError> {
    let selection = Selection { split: plan.split.clone(), ..Selection::all_frames() };
    let all = Plan::new(dataset, &selection, 0)?;
    let n_frames = plan.max_frames.min(all.frames.len());
    memory::check_calibration(n_frames, all.pixels(dataset))?;
    // Frames, both searches, and three steps around them.
    let (mut done, steps) = (0, n_frames + 3 + 2 * STEPS);
    let mut tick = || {
        done += 1;
        progress(done, steps);
    };
    let (mut input, skipped) = survey(dataset, &all, plan, &mut tick)?;
    // Made once: all fits, of all frames and of both halves, share them.
    let images: Vec<Pyramid> =
        input.frames.iter().map(|f| Pyramid::new(f.color.as_ref().clone(), LEVELS)).collect();
    let before = agreement(&input, &images)?;
    tick();
    let known = dataset.known_calibration().and_then(|known| known.color_camera);
    let metre = dataset.units_per_metre();
    let (calibration, values, note) = cameras(&input, &images, (known, metre), &mut tick)?;
    tick();
    // An absurd result is an error rather than a file that `train` refuses.
    calibration.check()?;
    input.calibration = calibration;
    let after = agreement(&input, &images)?;
    tick();
    Ok(Calibrated {
        dataset: dataset.name.clone(),
        split: dataset.splits[all.split].name.clone(),
        frames: input.frames.len(),
        before,
        after,
        values,
        notes: note.into_iter().collect(),
        changed: input.calibration != plan.start,
        calibration: input.calibration,
        skipped,
    })
}

/// Calibrates depth and colour camera jointly, or depth alone if the change of the camera is not
/// significant. Returns the calibration, the result for each value and, if the camera was not changed,
/// the reason.
fn cameras(
    input: &CalibrationInput,
    images: &[Pyramid],
    (known, metre): (Option<ColorCamera>, f64),
    mut tick: impl FnMut(),
) -> Result<(Calibration, Vec<CalibratedValue>, Option<String>), FrameError> {
    let views = Views { frames: &input.frames, images };
    let given = input.calibration.color_camera;
    let as_registered = registered(&input.frames[0].camera.intrinsics);
    let start = Unknowns::of(&input.calibration, given.unwrap_or(as_registered));
    let known = known.or(given).unwrap_or(as_registered);
    let prior = SensorPrior::new(known, &start, metre);
    // All at once, because depth and camera compensate for one another.
    let free: Vec<usize> = (0..N).collect();
    let mut fit = |free: &[usize]| -> Result<_, FrameError> {
        let (mut best, mut evidence) = search(input, views, &prior, &start, free, &mut tick)?;
        let mut judge = CrossValidation::new(input, views, &prior, (start, best.unknowns), free)?;
        judge.scale_evidence(&mut evidence, &mut best, free);
        Ok((best, evidence, judge))
    };
    let (mut best, mut evidence, mut judge) = fit(&free)?;
    let (is_camera_accepted, found) = judge.test_camera(&best.unknowns);
    let of = |best: &Unknowns, color_camera| Calibration {
        color_camera,
        depth_offset: best.depth[0],
        depth_scale: best.depth[1],
        ..input.calibration.clone()
    };
    if is_camera_accepted {
        let values = judge.accept_values(&mut evidence, &mut best, &free);
        // The second search is skipped.
        (0..STEPS).for_each(|_| tick());
        let calibration = of(&best.unknowns, Some(best.unknowns.camera.camera()));
        return Ok((calibration, values, None));
    }
    let staying =
        if given.is_some() { judge.unchanged_camera_values(&evidence, &best) } else { Vec::new() };
    // Small errors of poses and depth can be compensated by a slightly different camera. Depth found with
    // that camera does not hold for the original one, so it is searched again.
    let free = DEPTH.to_vec();
    let (mut best, mut evidence, mut judge) = fit(&free)?;
    let mut values = judge.accept_values(&mut evidence, &mut best, &free);
    values.extend(staying);
    let kept = if given.is_some() {
        "the colour camera stays"
    } else {
        "the colour images are registered to depth"
    };
    Ok((of(&best.unknowns, given), values, Some(format!("{kept}: {found}"))))
}

/// Reads evenly spaced frames and checks that they share surfaces. Also returns, as text, which frames
/// could not be read and why.
fn survey(
    dataset: &Dataset,
    all: &Plan,
    plan: &CalibratePlan,
    mut tick: impl FnMut(),
) -> Result<(CalibrationInput, Vec<String>), CalibrateError> {
    let nothing =
        |found: String| CalibrateError::NothingInCommon { dataset: dataset.name.clone(), found };
    let total = all.frames.len();
    let n = plan.max_frames.min(total);
    let (mut frames, mut skipped) = (Vec::new(), Vec::new());
    // Even-numbered frames first: two halves that see the same places.
    for i in (0..n).step_by(2).chain((1..n).step_by(2)) {
        match dataset.load(all.split, all.frames[i * total / n]) {
            Ok(frame) => frames.push(frame),
            // One damaged frame must not end the calibration.
            Err(error) => skipped.push(error.to_string()),
        }
        tick();
    }
    if frames.len() < 2 {
        return Err(nothing(format!("{} usable of {n} chosen", frames.len())));
    }
    // Prepared as for training, so that the result holds there.
    let overrides = SceneOverrides {
        calibration: Some(plan.start.clone()),
        // Points are matched by position, so cells must cover the depth noise.
        ray_search: Some(false),
        // With the finer default of small images, the camera's roll errs by more than its standard error.
        scale: Some(StructuralScale::Pixels(COARSEST_DEFAULT)),
        ..SceneOverrides::default()
    };
    let mut run = SceneRun::new(dataset, all, &overrides)?;
    // Slants of coarse pixels err within a pixel, which would bias the camera; so would their patches.
    run.surface.omits_slants = true;
    let h = run.scale_of_samples(dataset, all)?;
    // Bounds the time: large frames are subsampled, small ones are not.
    let pixels: usize = frames.iter().map(|f| f.color.width * f.color.height).sum();
    let size = [frames[0].color.width, frames[0].color.height].map(|n| n as u32);
    // All frames of a split have one encoding.
    let along_z = frames[0].depth.as_ref().is_some_and(|depth| depth.kind == DepthKind::Z);
    let input = CalibrationInput {
        along_z,
        surface: run.surface,
        calibration: Calibration {
            color_camera: plan.start.color_camera.map(|camera| match camera.size {
                Some(_) => camera.scaled_to(size),
                None => camera,
            }),
            ..plan.start.clone()
        },
        h,
        // A root, because the stride applies to columns and rows.
        step: (pixels as f64 / PIXELS).sqrt().ceil() as usize,
        frames,
    };
    let depth = [plan.start.depth_offset, plan.start.depth_scale];
    let matches = input.match_frames(&input.frames, depth, None, COARSE)?;
    if matches.len() < MIN_COMPONENTS {
        let (frames, n) = (input.frames.len(), matches.len());
        return Err(nothing(format!("{frames} frames with {n} patches of surface in common")));
    }
    Ok((input, skipped))
}

fn agreement(input: &CalibrationInput, images: &[Pyramid]) -> Result<Agreement, FrameError> {
    let Calibration { depth_offset, depth_scale, color_camera: camera, .. } = input.calibration;
    let matches = input.match_frames(&input.frames, [depth_offset, depth_scale], camera, 1.0)?;
    // Gains are known, so that differences in exposure do not count as disagreement between cameras.
    let gains = input.frames.iter().map(|frame| input.calibration.gain(&frame.name)).collect();
    let camera = camera.unwrap_or_else(|| registered(&input.frames[0].camera.intrinsics));
    let at = Unknowns::of(&input.calibration, camera);
    let (births, components) = (matches.births, matches.len());
    let evidence = Evidence::new(matches, images, gains, 0);
    let at = Estimate::as_recorded(at, input.frames.len());
    Ok(Agreement {
        color_variance: evidence.variance(&at, ResidualKind::Color),
        births,
        components,
    })
}

struct CalibrationInput {
    /// Frames of both halves: first the even-numbered ones, then the odd-numbered ones. Both halves see
    /// the same places.
    frames: Vec<Frame>,
    along_z: bool,
    /// Settings for the conversion of frames to surface points, without the calibration.
    surface: SurfaceSettings,
    calibration: Calibration,
    /// Structural scale (size of a component), world units.
    h: f64,
    /// Pixel stride in columns and rows.
    step: usize,
}

impl CalibrationInput {
    /// Matches the points of frames, using components of `growth` times the structural scale.
    ///
    /// # Errors
    /// Fails for a frame without depth.
    fn match_frames(
        &self,
        frames: &[Frame],
        depth: [f64; 2],
        color_camera: Option<ColorCamera>,
        growth: f64,
    ) -> Result<Matches, FrameError> {
        let [depth_offset, depth_scale] = depth;
        let calibration =
            Calibration { color_camera, depth_offset, depth_scale, ..self.calibration.clone() };
        let settings = SurfaceSettings {
            calibration: Some(calibration),
            // Pixels are subsampled by `step` instead.
            sampling: PixelSampling::Every,
            ..self.surface.clone()
        };
        let depth = MatchedDepth { values: depth, along_z: self.along_z };
        Matches::new(frames, &settings, depth, (growth * self.h, self.step))
    }
}

/// Synthetic views for calibration tests.
#[cfg(test)]
mod test_views {
    use super::matches::{CameraPose, MatchedDepth, Matches};
    use super::pyramid::Pyramid;
    use super::unknowns::{SensorPrior, Unknowns};
    use crate::dataset::calibration::{Calibration, ColorCamera};
    use crate::math::image::Image;
    use crate::observation::surface::SurfacePoint;
    use glam::{DMat3, DVec3};

    pub(in crate::calibrate) const CAMERA: ColorCamera = ColorCamera {
        focal: [80.0, 80.0],
        principal: [40.0, 30.0],
        offset: [0.01, -0.02, 0.0],
        rotation: [0.0, 0.0, 0.02],
        size: None,
    };

    pub(in crate::calibrate) fn begin() -> Unknowns {
        Unknowns::of(&Calibration::NONE, CAMERA)
    }

    pub(in crate::calibrate) fn prior() -> SensorPrior {
        SensorPrior::new(CAMERA, &begin(), 1.0)
    }

    pub(in crate::calibrate) fn stand(centre: DVec3) -> CameraPose {
        CameraPose { rotation: DMat3::IDENTITY, centre }
    }

    pub(in crate::calibrate) const MEASURED: MatchedDepth =
        MatchedDepth { values: [0.0, 1.0], along_z: false };

    pub(in crate::calibrate) fn ramps(n: usize) -> Vec<Pyramid> {
        let ramp = |i: usize| [(3 * (i % 80)) as u8, (4 * (i / 80)) as u8, 100, 255];
        let image = || Image::from_vec(80, 60, (0..80 * 60).map(ramp).collect());
        (0..n).map(|_| Pyramid::new(image(), 1)).collect()
    }

    /// Returns matches of a wall seen by two cameras. The second camera is closer by `nearer` (world units).
    pub(in crate::calibrate) fn wall(nearer: f64) -> Matches {
        let (mut views, mut poses) = (Vec::new(), Vec::new());
        for view in 0..2 {
            let centre = DVec3::new(0.1 * f64::from(view), 0.0, nearer * f64::from(view));
            let point = |i: u32| {
                let place = DVec3::new(
                    0.03 * f64::from(i % 16) - 0.2,
                    0.03 * f64::from(i / 16) - 0.2,
                    2.0 + 0.01 * f64::from(view),
                );
                SurfacePoint {
                    position: place.as_vec3().to_array(),
                    direction: (place - centre).normalize().as_vec3().to_array(),
                    normal: [0.0, 0.0, -1.0],
                    noise: 0.003,
                    ..SurfacePoint::default()
                }
            };
            views.push((0..256).map(point).collect());
            poses.push(stand(centre));
        }
        Matches::from_views(&views, poses, MEASURED, 0.1)
    }
}
