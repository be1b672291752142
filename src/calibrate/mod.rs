//! What a recording says of its own cameras: where the colour camera stands, how depth is biased,
//! how bright every frame was exposed. Surfaces that several views see must be thin and of one
//! colour (`pipeline.md`, Calibration).
//!
//! Depth first, because colours are looked up where depth says; then the colour camera; then
//! exposures. Each search starts from what is known and gives back what the data does not
//! determine ([`CalibratedValue`]).
//!
//! Known limits. Depth scale, offset and focal length make up for one another: on a Kinect
//! sequence of 50 frames a scale of 1.18 with an offset of −.14 counted as determined, while
//! births and depth error rose. Offset y and principal point y of the colour camera are
//! determined only together. Births and colour variance are reported before and after, so that
//! such a result can be recognised.

mod camera_search;
mod depth;
mod depth_search;
mod exposure;
mod exposure_search;
mod input;
mod matches;
mod normal_equations;
mod photometric;
mod pinhole;
mod pyramid;
mod report;
mod value;

pub use report::{Agreement, Calibrated};
pub use value::CalibratedValue;

use crate::dataset::Dataset;
use crate::dataset::calibration::{Calibration, CalibrationError};
use crate::dataset::error::{DatasetError, FrameError};
use crate::dataset::frame::DepthKind;
use crate::pipeline::plan::{Plan, Selection};
use crate::pipeline::settings::scene::{SceneError, SceneOverrides, SceneRun};
use camera_search::LEVELS;
use exposure_search::MAX_FRAMES;
use input::{COARSE, CalibrationInput};
use matches::Matches;
use normal_equations::NormalEquations;
use photometric::PhotometricCost;
use pinhole::{CameraUnknowns, registered};
use pyramid::Pyramid;

/// Frames where none are asked for: more say little more.
pub const DEFAULT_FRAMES: usize = 24;
/// Pixels looked at, of all frames together.
const PIXELS: f64 = 200_000.0;
/// Fewest components that several views must see.
const MIN_COMPONENTS: usize = 100;

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
    /// The dataset has no such split, or none with depth.
    #[error("{0}")]
    Dataset(#[from] DatasetError),
    /// The scene preset cannot work on its depth.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// A frame that points cannot be made of.
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
        /// Frames that a search for exposures takes at most.
        most: usize,
        /// Frames of the split.
        found: usize,
    },
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
    // Exposures look at every frame, because every frame has its own.
    let n_exposures = if plan.exposure { all.frames.len() } else { 0 };
    let (mut done, steps) = (0, n_frames + 3 + LEVELS + n_exposures);
    let mut tick = || {
        done += 1;
        progress(done, steps);
    };
    let (mut input, skipped) = survey(dataset, &all, plan, &mut tick)?;
    let images: Vec<Pyramid> =
        input.frames.iter().map(|f| Pyramid::new(f.color.clone(), LEVELS)).collect();
    let before = agreement(&input, &images)?;
    tick();
    let mut values = depth_search::search(&mut input)?;
    tick();
    let found = camera_search::search(&input, &images, &mut tick)?;
    input.calibration.color_camera = found.camera;
    values.extend(found.values);
    if plan.exposure {
        let frames = all.frames.len();
        if frames > MAX_FRAMES {
            return Err(CalibrateError::TooManyExposures { most: MAX_FRAMES, found: frames });
        }
        let settings = input.settings(found.camera);
        let scale = (input.h, input.step);
        let (gains, value) = exposure_search::search(dataset, &all, &settings, scale, &mut tick);
        if value.determined {
            input.calibration.exposure = gains;
        }
        values.push(value);
    }
    input.calibration.check()?;
    let after = agreement(&input, &images)?;
    tick();
    Ok(Calibrated {
        dataset: dataset.name.clone(),
        split: dataset.splits[all.split].name.clone(),
        frames: input.frames.len(),
        before,
        after,
        values,
        notes: found.note.into_iter().collect(),
        changed: input.calibration != plan.start,
        calibration: input.calibration,
        skipped,
    })
}

/// Reads evenly spaced frames, which must have surfaces in common; with the reasons why some cannot be
/// read.
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
    // As training would prepare them, so that what is found holds there.
    let overrides = SceneOverrides { calibration: start, ..SceneOverrides::default() };
    let run = SceneRun::new(dataset, all, &overrides)?;
    // Few large frames are thinned out, many small ones are not: time is what is held.
    let pixels: usize = frames.iter().map(|f| f.color.width * f.color.height).sum();
    let along_z = frames[0].depth.as_ref().is_some_and(|depth| depth.kind == DepthKind::Z);
    let input = CalibrationInput {
        along_z,
        surface: run.surface,
        calibration: plan.start.clone(),
        h: run.engine.h,
        step: (pixels as f64 / PIXELS).sqrt().ceil() as usize,
        frames,
    };
    let matches = Matches::new(&input.frames, &input.settings(None), COARSE * input.h, input.step)?;
    // With coarse components: views of wrong depth still share those.
    if matches.len() < MIN_COMPONENTS {
        let (frames, n) = (input.frames.len(), matches.len());
        return Err(nothing(format!("{frames} frames with {n} patches of surface in common")));
    }
    Ok((input, skipped))
}

/// How well the views agree under the calibration as it is.
fn agreement(input: &CalibrationInput, images: &[Pyramid]) -> Result<Agreement, FrameError> {
    let camera = input.calibration.color_camera;
    let settings = input.settings(camera);
    let matches = Matches::new(&input.frames, &settings, input.h, input.step)?;
    let gains: Vec<[f64; 3]> =
        input.frames.iter().map(|frame| input.calibration.gain(&frame.name)).collect();
    let camera = camera.unwrap_or_else(|| registered(&input.frames[0].camera.intrinsics));
    let cost = PhotometricCost { matches: &matches, images, gains: &gains, level: 0 };
    Ok(Agreement {
        color_variance: NormalEquations::total(&cost.by_view(&CameraUnknowns::of(camera)))
            .variance(),
        births: matches.births,
        components: matches.len(),
    })
}
