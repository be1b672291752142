//! What a recording says of its own cameras: where the colour camera stands, how depth is biased,
//! how bright every frame was exposed. Surfaces that several views see must be thin and look
//! alike (`pipeline.md`, Calibration).
//!
//! Depth and colour camera are one robust least-squares problem (`evidence`, `fit`) with what is known of such
//! sensors (`unknowns`); what is found must hold in frames that it was not fitted to (`verdict`); what
//! the data does not determine is given back ([`CalibratedValue`]). Then exposures.

mod camera;
mod color;
mod covariance;
mod evidence;
mod exposure;
mod exposure_search;
mod fit;
mod input;
mod matches;
mod normal_equations;
mod pyramid;
mod report;
mod scatter;
mod search;
#[cfg(test)]
mod test_views;
mod thickness;
mod unknowns;
mod value;
mod verdict;

pub use report::{Agreement, Calibrated};
pub use value::CalibratedValue;

use crate::dataset::Dataset;
use crate::dataset::calibration::{Calibration, CalibrationError, ColorCamera};
use crate::dataset::error::{DatasetError, FrameError};
use crate::dataset::frame::DepthKind;
use crate::pipeline::plan::{Plan, Selection};
use crate::pipeline::settings::scene::{SceneError, SceneOverrides, SceneRun};
use camera::registered;
use evidence::{Evidence, Kind};
use exposure_search::MAX_FRAMES;
use input::CalibrationInput;
use pyramid::Pyramid;
use search::{LEVELS, STEPS, Views, search};
use unknowns::{DEPTH, Estimate, N, SensorPrior, Unknowns};
use verdict::Judge;

/// Frames where none are asked for: more say little more.
pub const DEFAULT_FRAMES: usize = 24;
/// Pixels looked at, of all frames together.
const PIXELS: f64 = 120_000.0;
/// Fewest components that several views must see.
const MIN_COMPONENTS: usize = 100;
/// Structural scale times the scene's at which frames must have surfaces in common: views of wrong depth
/// still share such.
const COARSE: f64 = 4.0;

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

/// Searches for depth and the colour camera, then for exposures; tells `progress` the steps done and those
/// there are.
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
    let (mut done, steps) = (0, n_frames + 3 + 2 * STEPS + n_exposures);
    let mut tick = || {
        done += 1;
        progress(done, steps);
    };
    let (mut input, skipped) = survey(dataset, &all, plan, &mut tick)?;
    let images: Vec<Pyramid> =
        input.frames.iter().map(|f| Pyramid::new(f.color.as_ref().clone(), LEVELS)).collect();
    let before = agreement(&input, &images)?;
    tick();
    let known = dataset.known_calibration().and_then(|known| known.color_camera);
    let found = cameras(&input, &images, (known, dataset.metre()), &mut tick)?;
    tick();
    let mut values = found.values;
    input.calibration = found.calibration;
    if plan.exposure {
        let frames = all.frames.len();
        if frames > MAX_FRAMES {
            return Err(CalibrateError::TooManyExposures { most: MAX_FRAMES, found: frames });
        }
        let calibration = &input.calibration;
        let depth = [calibration.depth_offset, calibration.depth_scale];
        let settings = input.settings(depth, calibration.color_camera);
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

/// What is found of depth and the colour camera.
struct FoundCameras {
    calibration: Calibration,
    values: Vec<CalibratedValue>,
    /// What there is to say of the colour camera as a whole.
    note: Option<String>,
}

/// Everything together; where no other colour camera is worth taking, depth alone again.
fn cameras(
    input: &CalibrationInput,
    images: &[Pyramid],
    (known, metre): (Option<ColorCamera>, f64),
    mut tick: impl FnMut(),
) -> Result<FoundCameras, FrameError> {
    let views = Views { frames: &input.frames, images };
    let given = input.calibration.color_camera;
    let as_registered = registered(&input.frames[0].camera.intrinsics);
    let start = Unknowns::of(&input.calibration, given.unwrap_or(as_registered));
    let known = known.or(given).unwrap_or(as_registered);
    let prior = SensorPrior::new(known, &start, metre);
    let free: Vec<usize> = (0..N).collect();
    let (mut best, mut evidence) = search(input, views, &prior, &start, &free, &mut tick)?;
    let mut judge = Judge::new(input, views, &prior, (start, best.unknowns), &free)?;
    judge.temper(&mut evidence, &mut best, &free);
    let verdict = judge.camera(&best.unknowns);
    let of = |best: &Unknowns, color_camera| Calibration {
        color_camera,
        depth_offset: best.depth[0],
        depth_scale: best.depth[1],
        ..input.calibration.clone()
    };
    if verdict.is_other {
        let values = judge.settle(&mut evidence, &mut best, &free);
        // The second search is not needed.
        (0..STEPS).for_each(|_| tick());
        let calibration = of(&best.unknowns, Some(best.unknowns.camera.camera()));
        return Ok(FoundCameras { calibration, values, note: None });
    }
    let staying = if given.is_some() { judge.staying_camera(&evidence, &best) } else { Vec::new() };
    // Poses and depths that are slightly wrong can always be traded for a slightly other camera: what depth
    // is beside that is not what it is beside the one that stays.
    let free = DEPTH.to_vec();
    let (mut best, mut evidence) = search(input, views, &prior, &start, &free, &mut tick)?;
    let mut judge = Judge::new(input, views, &prior, (start, best.unknowns), &free)?;
    judge.temper(&mut evidence, &mut best, &free);
    let mut values = judge.settle(&mut evidence, &mut best, &free);
    values.extend(staying);
    let kept = if given.is_some() {
        "the colour camera stays"
    } else {
        "the colour images are registered to depth"
    };
    let note = Some(format!("{kept}: {}", verdict.found));
    Ok(FoundCameras { calibration: of(&best.unknowns, given), values, note })
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
    // Every other one first: halves that see the same places.
    for i in (0..n).step_by(2).chain((1..n).step_by(2)) {
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
    let overrides = SceneOverrides {
        calibration: start,
        // Points are matched by where they are, so that their cells have to hold the noise.
        ray_search: Some(false),
        ..SceneOverrides::default()
    };
    let run = SceneRun::new(dataset, all, &overrides)?;
    // Few large frames are thinned out, many small ones are not: time is what is held.
    let pixels: usize = frames.iter().map(|f| f.color.width * f.color.height).sum();
    let size = [frames[0].color.width, frames[0].color.height].map(|n| n as u32);
    let along_z = frames[0].depth.as_ref().is_some_and(|depth| depth.kind == DepthKind::Z);
    let input = CalibrationInput {
        along_z,
        surface: run.surface,
        calibration: Calibration {
            color_camera: plan.start.color_camera.map(|camera| match camera.size {
                Some(_) => camera.at_size(size),
                None => camera,
            }),
            ..plan.start.clone()
        },
        h: run.engine.h,
        step: (pixels as f64 / PIXELS).sqrt().ceil() as usize,
        frames,
    };
    let depth = [plan.start.depth_offset, plan.start.depth_scale];
    let matches = input.matched(&input.frames, depth, None, COARSE)?;
    if matches.len() < MIN_COMPONENTS {
        let (frames, n) = (input.frames.len(), matches.len());
        return Err(nothing(format!("{frames} frames with {n} patches of surface in common")));
    }
    Ok((input, skipped))
}

/// How well the views agree under the calibration as it is.
fn agreement(input: &CalibrationInput, images: &[Pyramid]) -> Result<Agreement, FrameError> {
    let Calibration { depth_offset, depth_scale, color_camera: camera, .. } = input.calibration;
    let matches = input.matched(&input.frames, [depth_offset, depth_scale], camera, 1.0)?;
    let gains = input.frames.iter().map(|frame| input.calibration.gain(&frame.name)).collect();
    let camera = camera.unwrap_or_else(|| registered(&input.frames[0].camera.intrinsics));
    let at = Unknowns::of(&input.calibration, camera);
    let (births, components) = (matches.births, matches.len());
    let evidence = Evidence::new(matches, images, gains, 0);
    let at = Estimate::as_recorded(at, input.frames.len());
    Ok(Agreement { color_variance: evidence.variance(&at, Kind::Color), births, components })
}
