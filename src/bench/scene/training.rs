//! Trains several configurations on the same frames. Each frame is decoded and prepared once per group
//! of configurations with equal preparation. Sufficient statistics are computed once for configurations
//! that differ only in drawing.
//!
//! The dozens of rows of a table share this work. Otherwise, three orders of 200 frames would be too
//! expensive.

use crate::bench::findings::BenchError;
use crate::bench::{each_frame, spaced};
use crate::dataset::Dataset;
use crate::dataset::splits::HoldOut;
use crate::dataset::surface::SurfaceSettings;
use crate::eval::choices::{GroundTruth, ViewPoses};
use crate::eval::views::EvalOptions;
use crate::math::rng::{Purpose, Rng};
use crate::model::splat::appearance::SplatSet;
use crate::pipeline::any_preset::AnyPreset;
use crate::pipeline::error::SessionError;
use crate::pipeline::plan::{Plan, Selection};
use crate::pipeline::settings::scene::{SceneOverrides, SceneRun};
use crate::render::{RenderMethod, RenderOptions};
use crate::train::learner::{Learner, Learns};
use crate::train::scene::config::SceneConfig;
use crate::train::scene::trainer::SceneTrainer;
use std::sync::Arc;

pub struct Trained {
    pub splats: SplatSet,
    pub born: usize,
    pub model_bytes: usize,
    pub train_ms: Vec<f64>,
    /// Preparation time of each frame on the decoding thread, milliseconds.
    pub prepare_ms: Vec<f64>,
}

impl Trained {
    pub fn drawn(&self) -> usize {
        self.splats.view().splats().iter().filter(|splat| splat.opacity > 0.0).count()
    }
}

/// Prepares a bench on a dataset. Returns the frames to train on, the default preset for them, and
/// evaluation options with the preset's colour camera.
pub fn prepare(
    dataset: &Dataset,
    max_frames: usize,
    seed: u64,
) -> Result<(Plan, SceneRun, EvalOptions), BenchError> {
    prepare_held_out(dataset, HoldOut::default(), max_frames, seed)
}

/// As [`prepare`], training on the frames that a method leaves.
pub fn prepare_held_out(
    dataset: &Dataset,
    hold_out: HoldOut,
    max_frames: usize,
    seed: u64,
) -> Result<(Plan, SceneRun, EvalOptions), BenchError> {
    let selection = Selection { hold_out, ..Selection::all_frames() };
    let all = Plan::new(dataset, &selection, seed).map_err(SessionError::from)?;
    let plan = Plan { frames: spaced(&all.frames, max_frames), ..all };
    let base = SceneRun::new(dataset, &plan, &SceneOverrides::default());
    let base = base.map_err(SessionError::from)?;
    let render = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let plain = EvalOptions::plain(GroundTruth::Composited, render);
    // One camera for all rows, including those trained without calibration. Poses are predicted, as in `train` and
    // `eval`: errors of recorded poses would hide what rows differ in.
    let (color_camera, poses) = (base.color_camera(), ViewPoses::Corrected);
    let options = EvalOptions { color_camera, poses, ..plain };
    Ok((plan, base, options))
}

/// Returns a plan with its frames as listed (order 0), reversed (1) or shuffled (2 and above).
pub fn ordered(plan: &Plan, order: usize, seed: u64) -> Plan {
    let mut frames = plan.frames.clone();
    match order {
        0 => {}
        1 => frames.reverse(),
        _ => Rng::new(seed, Purpose::Order, order as u64).shuffle(&mut frames),
    }
    Plan { frames, ..plan.clone() }
}

/// Trains every run from scratch on the frames of a plan, in the plan's order. Runs with equal frame
/// preparation share one sweep over the frames. Calls `done` after each sweep.
pub fn train(
    dataset: &Arc<Dataset>,
    plan: &Plan,
    runs: &[SceneRun],
    done: &mut dyn FnMut(),
) -> Result<Vec<Trained>, BenchError> {
    let mut trained: Vec<Option<Trained>> = runs.iter().map(|_| None).collect();
    while let Some(first) = trained.iter().position(Option::is_none) {
        let surface = runs[first].prepared_surface();
        // Runs with equal surface settings share one sweep over the frames.
        let alike: Vec<usize> =
            (first..runs.len()).filter(|&i| runs[i].prepared_surface() == surface).collect();
        let group: Vec<&SceneRun> = alike.iter().map(|&i| &runs[i]).collect();
        for (i, found) in alike.into_iter().zip(train_alike(dataset, plan, &group)?) {
            trained[i] = Some(found);
        }
        done();
    }
    Ok(trained.into_iter().flatten().collect())
}

pub fn n_sweeps(runs: &[SceneRun]) -> usize {
    let surfaces: Vec<SurfaceSettings> = runs.iter().map(SceneRun::prepared_surface).collect();
    (0..runs.len()).filter(|&i| !surfaces[..i].contains(&surfaces[i])).count()
}

/// Engine shared by configurations whose sufficient statistics are equal.
struct TrainedSums {
    config: SceneConfig,
    engine: SceneTrainer,
    train_ms: Vec<f64>,
}

/// Trains runs with equal frame preparation in turns, frame by frame. Returns one trained model per run.
fn train_alike(
    dataset: &Arc<Dataset>,
    plan: &Plan,
    runs: &[&SceneRun],
) -> Result<Vec<Trained>, BenchError> {
    let Some(first) = runs.first() else { return Ok(Vec::new()) };
    let surface = first.prepared_surface();
    let mut courses: Vec<TrainedSums> = Vec::new();
    for run in runs {
        // Runs that differ only in drawing share their sums.
        if !courses.iter().any(|course| course.has_sums_of(run)) {
            let engine = SceneTrainer::new(&run.engine, surface.origin);
            courses.push(TrainedSums { config: run.engine.clone(), engine, train_ms: Vec::new() });
        }
    }
    let mut prepare_ms = Vec::with_capacity(plan.frames.len());
    each_frame(dataset, plan, surface, |_, _, prepared| {
        prepare_ms.push(prepared.prepare_ms);
        for course in &mut courses {
            course.train_ms.push(course.engine.learn(&prepared.observation)?.ms.train);
        }
        Ok(())
    })?;
    let drawn = |run: &&SceneRun| {
        let course = courses.iter_mut().find(|course| course.has_sums_of(run))?;
        // Splat rules do not affect sums, so each rule draws the same model.
        course.engine.set_splat_rule(run.engine.splat_rule);
        course.engine.settle();
        Some(Trained {
            splats: course.engine.splats(),
            born: course.engine.status().components,
            model_bytes: course.engine.memory().bytes,
            train_ms: course.train_ms.clone(),
            prepare_ms: prepare_ms.clone(),
        })
    };
    // Never `None`: an engine was created for every run.
    Ok(runs.iter().filter_map(drawn).collect())
}

impl TrainedSums {
    fn has_sums_of(&self, run: &SceneRun) -> bool {
        // Photometric training starts from splats as the rule draws them, so all settings must
        // match.
        if run.engine.photometric.is_some() {
            return run.engine == self.config;
        }
        // Alignment also reads the ridge of the splat rule. No table varies it; one that did would
        // need separate sums.
        SceneConfig { splat_rule: self.config.splat_rule, ..run.engine.clone() } == self.config
    }
}
