//! From what a user asks for to settings that fit a dataset.
//!
//! Defaults come in three layers, each over the one before: those measured with the kind of sensor,
//! those that components on a lattice need so that the order of frames cannot matter, and what the
//! user asks for. Only then is the structural scale turned into world units, by a look at some
//! frames as they will be prepared.

use super::error::SceneError;
use super::run::SceneRun;
use super::table::SceneOverrides;
use crate::dataset::Dataset;
use crate::dataset::surface::sample::FrameSample;
use crate::dataset::surface::{PixelSampling, Sensor, SurfaceSettings};
use crate::dataset::wild_poses::wild_poses;
use crate::model::scene::splat_rule::SplatKind;
use crate::pipeline::plan::Plan;
use crate::train::scene::config::{SceneConfig, VisibilityRule};
use crate::train::scene::photometric::rule::PhotometricMode;
use crate::train::scene::units::{DEFAULT_PIXELS, StructuralScale};
use crate::train::setting::ConfigError;
use crate::train::setting::table::SettingLayer;
use glam::DVec3;

/// Pixels of depth from which on a quarter of them is enough.
const LARGE_FRAME: usize = 150_000;

impl SceneRun {
    /// Settings for the frames of a plan; looks at some of them. Runs over shards or in other orders
    /// start alike with the plan of all their frames in one order.
    ///
    /// # Errors
    /// [`SceneError`] for a setting out of range, and for depth that is none.
    pub fn new(
        dataset: &Dataset,
        plan: &Plan,
        overrides: &SceneOverrides,
    ) -> Result<Self, SceneError> {
        let mut run = Self::defaults(dataset, plan, overrides);
        nothing_native_of_plain(overrides)?;
        overrides.apply(&mut run);
        SceneOverrides::check(&run)?;
        no_photographs_wait_unlearnt(overrides, &run.engine)?;
        if let Some(camera) = run.surface.calibration.as_ref().and_then(|given| given.color_camera)
        {
            dataset.splits[plan.split].scaling(&camera)?;
        }
        let sample = FrameSample::of(dataset, plan.split, &plan.first_pass(), &run.surface)?;
        run.engine.h = in_world_units(&run, &sample)?;
        Ok(Self { engine: run.engine.check()?, ..run })
    }

    /// What is not asked for, given the sensor and the birth rule that are; `h` is not known yet.
    fn defaults(dataset: &Dataset, plan: &Plan, overrides: &SceneOverrides) -> Self {
        let split = &dataset.splits[plan.split];
        // About a wild pose all other frames would be far away.
        let wild = wild_poses(split);
        let is_sound = |i: &&usize| wild.iter().all(|wild| wild.index != **i);
        let first = plan.frames.iter().find(is_sound).or(plan.frames.first());
        let first = first.map(|&i| split.frames[i].camera);
        let pixels = first.map_or(0, |camera| {
            camera.intrinsics.width as usize * camera.intrinsics.height as usize
        });
        let origin = first.map_or(DVec3::ZERO, |camera| {
            // Whole metres: the phase of a lattice must not depend on the unit of the world.
            (camera.pose.centre() / dataset.metre()).round() * dataset.metre()
        });
        let mut surface = SurfaceSettings::new(dataset, origin);
        surface.sensor = overrides.sensor.unwrap_or(surface.sensor);
        // Computed depth has no pixels between two surfaces: at a crease, where no plane fits, it is
        // right all the same.
        surface.flying_pixels = !matches!(surface.sensor, Sensor::Exact { .. });
        surface.sampling = sampling(surface.sensor, pixels);
        let mut engine = measured_with(surface.sensor);
        engine.photometric = PhotometricMode::Light.rule();
        engine.births = overrides.births.unwrap_or(engine.births);
        engine.track = dataset.options.track;
        if engine.births.is_order_invariant() {
            engine.refine = false;
            engine.align = false;
            engine.gain = false;
            engine.near = None;
            engine.ray_search = 0.0;
            engine.photometric = None;
            engine.visibility = VisibilityRule::Returned;
        }
        let scale = StructuralScale::Pixels(DEFAULT_PIXELS);
        Self { seed: 0, scale, budget: None, engine, surface }
    }
}

/// Which pixels of frames of so many become points. Real cameras see everything many times over, with errors
/// that neighbours share: a quarter of large frames serves as well (`scene.md`, Sampling).
fn sampling(sensor: Sensor, pixels: usize) -> PixelSampling {
    match sensor {
        Sensor::Kinect | Sensor::Lidar if pixels >= LARGE_FRAME => PixelSampling::Quarter,
        _ => PixelSampling::Every,
    }
}

/// Refuses what plain splats are asked for and cannot have.
fn nothing_native_of_plain(overrides: &SceneOverrides) -> Result<(), ConfigError> {
    let asked = [(overrides.gradient, "gradient"), (overrides.crack_filling, "crack-filling")];
    let asked = asked.into_iter().find(|(asked, _)| *asked == Some(true));
    match (overrides.splats, asked) {
        (Some(SplatKind::Plain), Some((_, part))) => Err(ConfigError {
            setting: "splats",
            expected: format!("native beside {part}, which plain splats cannot have"),
            found: "plain".to_owned(),
        }),
        _ => Ok(()),
    }
}

/// Refuses to let photographs wait that nothing learns.
fn no_photographs_wait_unlearnt(
    overrides: &SceneOverrides,
    engine: &SceneConfig,
) -> Result<(), ConfigError> {
    match overrides.shuffle_buffer.filter(|&n| n > 0 && engine.photometric.is_none()) {
        None => Ok(()),
        Some(n) => Err(ConfigError {
            setting: "shuffle_buffer",
            expected: "0 where photographs are not learnt (--photometric off)".to_owned(),
            found: n.to_string(),
        }),
    }
}

/// Settings measured with each kind of sensor (`scene.md`, Settings by sensor), all but `h`.
fn measured_with(sensor: Sensor) -> SceneConfig {
    match sensor {
        Sensor::Inverse8Ray => SceneConfig::fine(f64::NAN),
        Sensor::Exact { .. } => SceneConfig::exact(f64::NAN),
        Sensor::Kinect | Sensor::Lidar => SceneConfig::coarse(f64::NAN),
    }
}

/// The structural scale as a length; at least what noise allows.
fn in_world_units(run: &SceneRun, sample: &FrameSample) -> Result<f64, SceneError> {
    let scale = run.scale;
    let least = scale.least(sample.tolerance, run.engine.ray_search > 0.0);
    // Of which one component would be the whole scene, whatever the data.
    let (asked, most) = match scale {
        StructuralScale::Pixels(n) => (n, sample.depths[1] / sample.footprint),
        StructuralScale::World(h) => (h, sample.depths[1]),
    };
    if asked > most {
        let unit = if matches!(scale, StructuralScale::Pixels(_)) { "px" } else { " world units" };
        return Err(SceneError::Config(ConfigError {
            setting: "scale",
            expected: format!("at most the depth of the scene, {most:.3}{unit}"),
            found: String::from(scale),
        }));
    }
    match scale {
        StructuralScale::Pixels(n) => Ok((n * sample.footprint).max(least)),
        StructuralScale::World(h) if h >= least => Ok(h),
        StructuralScale::World(found) => {
            let [near, far] = sample.depths;
            Err(SceneError::BelowNoise { least, found, near, far })
        }
    }
}
