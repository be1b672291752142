//! What a recording says of its own cameras: where the colour camera stands, how depth is biased,
//! how bright every frame was exposed. Surfaces that several views see must be thin and of one colour
//! (`pipeline.md`, Calibration).

mod camera_search;
mod depth;
mod depth_search;
mod exposure;
mod exposure_search;
mod forms;
mod matches;
mod photometric;
mod pinhole;
mod pyramid;
mod value;

pub use value::Value;

use crate::dataset::Dataset;
use crate::dataset::calibration::{Calibration, CalibrationError, ColorCamera};
use crate::dataset::error::{DatasetError, FrameError};
use crate::dataset::frame::{DepthKind, Frame};
use crate::dataset::surface::SurfaceSettings;
use crate::pipeline::plan::{Plan, Selection};
use crate::pipeline::settings::scene::{SceneError, SceneOverrides, SceneRun};
use camera_search::LEVELS;
use matches::Matches;
use photometric::{Normal, Scene};
use pinhole::{Unknowns, registered};
use pyramid::Pyramid;
use serde::Serialize;

/// Frames where none are asked for: more say little more.
pub const DEFAULT_FRAMES: usize = 24;
/// Pixels looked at, of all frames together.
const PIXELS: f64 = 200_000.0;
/// Structural scale times the scene's at which the search begins: wrong depth parts surfaces.
const COARSE: f64 = 4.0;
/// Fewest components that several views must see.
const LEAST_COMPONENTS: usize = 100;
/// Rise of a sum of squares, relative, that keeping a value must cost for the data to determine it.
/// Errors of poses shift the minimum: on the 7-Scenes Kinect to a roll that spares 0.8 % and makes
/// held-out views worse.
const LEAST_RISE: f64 = 0.02;

/// What is searched for, and on what.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibratePlan {
    /// Split to look at; `None` takes the one that trains.
    pub split: Option<String>,
    /// Frames at most, evenly spaced.
    pub max_frames: usize,
    /// Whether every frame's exposure is searched for.
    pub exposure: bool,
    /// Where the search begins, and what the data does not determine stays.
    pub start: Calibration,
}

/// Why a dataset cannot be calibrated.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// The dataset.
    #[error("{0}")]
    Dataset(#[from] DatasetError),
    /// Its depth.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// A frame.
    #[error("{0}")]
    Frame(#[from] FrameError),
    /// The result could not be read back.
    #[error("{0}")]
    Calibration(#[from] CalibrationError),
    /// Nothing is seen twice.
    #[error(
        "{dataset}: expected at least 2 frames that see the same surface, found {found}; add frames to the recording, ask for more of its frames or name another split"
    )]
    NothingInCommon {
        /// Name of the dataset.
        dataset: String,
        /// Frames and what they share.
        found: String,
    },
    /// So many exposures would take too long.
    #[error(
        "exposures: expected a split of at most {most} frames, found {found}; name a smaller one, or leave the exposures to training, which fits them as frames come"
    )]
    TooManyExposures {
        /// Most frames.
        most: usize,
        /// Frames of the split.
        found: usize,
    },
}

/// How well the views agree under a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// Mean variance of colour inside components that several views see, channels in `[0, 1]`
    /// added up.
    pub color_variance: f64,
    /// Components born.
    pub births: usize,
    /// Those of them that several views see.
    pub components: usize,
}

/// The result.
#[derive(Clone, Debug, Serialize)]
pub struct Calibrated {
    /// Name of the dataset.
    pub dataset: String,
    /// Name of the split.
    pub split: String,
    /// Frames looked at.
    pub frames: usize,
    /// Under the calibration that the search began with.
    pub before: Agreement,
    /// Under the one that is found.
    pub after: Agreement,
    /// Every number that was searched for.
    pub values: Vec<Value>,
    /// What there is to say beside them.
    pub notes: Vec<String>,
    /// What is found; what the data does not determine is as it was.
    pub calibration: Calibration,
    /// Whether it differs from the one before.
    pub changed: bool,
    /// Frames that could not be read, with the reason.
    pub skipped: Vec<String>,
}

/// What is searched on.
struct Ground {
    frames: Vec<Frame>,
    /// Whether the files measure depth along the optical axis.
    along_z: bool,
    surface: SurfaceSettings,
    calibration: Calibration,
    /// Structural scale, world units.
    h: f64,
    /// Every so-many-th pixel of every so-many-th row is looked at.
    step: usize,
}

impl Ground {
    /// The calibration's depth and exposure, with some colour camera.
    fn settings(&self, color_camera: Option<ColorCamera>) -> SurfaceSettings {
        let calibration = Some(Calibration { color_camera, ..self.calibration.clone() });
        SurfaceSettings { calibration, ..self.surface.clone() }
    }
}

/// Searches for depth, then the colour camera, then exposures; tells `progress` the steps done and
/// those there are.
pub fn run(
    dataset: &Dataset,
    plan: &CalibratePlan,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Calibrated, CalibrateError> {
    let selection = Selection { split: plan.split.clone(), ..Selection::everything() };
    let all = Plan::new(dataset, &selection, 0)?;
    let n_frames = plan.max_frames.min(all.frames.len());
    let n_exposures = if plan.exposure { all.frames.len() } else { 0 };
    let (mut done, steps) = (0, n_frames + 3 + LEVELS + n_exposures);
    let mut tick = || {
        done += 1;
        progress(done, steps);
    };
    let (mut ground, skipped) = survey(dataset, &all, plan, &mut tick)?;
    let images: Vec<Pyramid> =
        ground.frames.iter().map(|f| Pyramid::new(f.color.clone(), LEVELS)).collect();
    let before = agreement(&ground, &images)?;
    tick();
    let mut values = depth_search::search(&mut ground)?;
    tick();
    let found = camera_search::search(&ground, &images, &mut tick)?;
    ground.calibration.color_camera = found.camera;
    values.extend(found.values);
    if plan.exposure {
        let settings = ground.settings(found.camera);
        let scale = (ground.h, ground.step);
        let (gains, value) = exposure_search::search(dataset, &all, &settings, scale, &mut tick)?;
        if value.determined {
            ground.calibration.exposure = gains;
        }
        values.push(value);
    }
    ground.calibration.check()?;
    let after = agreement(&ground, &images)?;
    tick();
    Ok(Calibrated {
        dataset: dataset.name.clone(),
        split: dataset.splits[all.split].name.clone(),
        frames: ground.frames.len(),
        before,
        after,
        values,
        notes: found.note.into_iter().collect(),
        changed: ground.calibration != plan.start,
        calibration: ground.calibration,
        skipped,
    })
}

/// Reads evenly spaced frames, which must see the same surfaces; with the reasons why some cannot be
/// read.
fn survey(
    dataset: &Dataset,
    all: &Plan,
    plan: &CalibratePlan,
    mut tick: impl FnMut(),
) -> Result<(Ground, Vec<String>), CalibrateError> {
    let nothing =
        |found: String| CalibrateError::NothingInCommon { dataset: dataset.name.clone(), found };
    let total = all.frames.len();
    let n = plan.max_frames.min(total);
    let (mut frames, mut skipped) = (Vec::new(), Vec::new());
    for i in 0..n {
        match dataset.load(all.split, all.frames[i * total / n]) {
            Ok(frame) => frames.push(frame),
            Err(error) => skipped.push(error.to_string()),
        }
        tick();
    }
    if frames.len() < 2 {
        return Err(nothing(format!("{} usable of {n} chosen", frames.len())));
    }
    let start = Some(plan.start.clone());
    let overrides = SceneOverrides { calibration: start, ..SceneOverrides::default() };
    let run = SceneRun::new(dataset, all, &overrides)?;
    let pixels: usize = frames.iter().map(|f| f.color.width * f.color.height).sum();
    let along_z = frames[0].depth.as_ref().is_some_and(|depth| depth.kind == DepthKind::Z);
    let ground = Ground {
        along_z,
        surface: run.surface,
        calibration: plan.start.clone(),
        h: run.engine.h,
        step: (pixels as f64 / PIXELS).sqrt().ceil() as usize,
        frames,
    };
    let matches =
        Matches::new(&ground.frames, &ground.settings(None), COARSE * ground.h, ground.step)?;
    if matches.len() < LEAST_COMPONENTS {
        let (frames, n) = (ground.frames.len(), matches.len());
        return Err(nothing(format!("{frames} frames with {n} patches of surface in common")));
    }
    Ok((ground, skipped))
}

/// How well the views agree under the calibration as it is.
fn agreement(ground: &Ground, images: &[Pyramid]) -> Result<Agreement, FrameError> {
    let camera = ground.calibration.color_camera;
    let settings = ground.settings(camera);
    let matches = Matches::new(&ground.frames, &settings, ground.h, ground.step)?;
    let gains: Vec<[f64; 3]> =
        ground.frames.iter().map(|frame| ground.calibration.gain(&frame.name)).collect();
    let camera = camera.unwrap_or_else(|| registered(&ground.frames[0].camera.intrinsics));
    let scene = Scene { matches: &matches, images, gains: &gains, level: 0 };
    Ok(Agreement {
        color_variance: Normal::total(&scene.normals(&Unknowns::of(camera))).variance(),
        births: matches.births,
        components: matches.len(),
    })
}
