//! Fitting of the scene settings to a dataset.
//!
//! The defaults are values measured for the kind of sensor; the user's settings take precedence. The
//! structural scale is then converted to world units, from sampled frames prepared as in training.

use super::table::SceneOverrides;
use crate::dataset::Dataset;
use crate::dataset::calibration::AspectRatioMismatch;
use crate::dataset::surface::sample::{FrameSample, NoUsableDepth};
use crate::dataset::surface::{PixelSampling, Sensor, SurfaceSettings};
use crate::dataset::wild_poses::outlier_poses;
use crate::model::scene::splat_rule::SplatKind;
use crate::pipeline::plan::Plan;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::scene::config::{DEFAULT_TEXTURE_MB, SceneConfig};
use crate::train::scene::photometric::rule::PhotometricMode;
use crate::train::scene::units::StructuralScale;
use crate::train::setting::ConfigError;
use crate::train::setting::table::SettingLayer;
use glam::DVec3;

// Kinect frames of 640 × 480 pixels are larger, a phone's of 256 × 192 are not.
const LARGE_FRAME: usize = 150_000;

impl SceneRun {
    /// Fits the settings to sampled frames of a plan. Only equal plans give equal settings, so each
    /// shard has to pass the plan of all shards together.
    ///
    /// # Errors
    /// [`SceneError`] for a setting out of range, or unusable depth.
    pub fn new(
        dataset: &Dataset,
        plan: &Plan,
        overrides: &SceneOverrides,
    ) -> Result<Self, SceneError> {
        Self::without_scale(dataset, plan, overrides)?.with_scale(dataset, plan)
    }

    /// Returns the settings without the structural scale `h`, for which frames are sampled.
    pub(in crate::pipeline) fn without_scale(
        dataset: &Dataset,
        plan: &Plan,
        overrides: &SceneOverrides,
    ) -> Result<Self, SceneError> {
        let run = Self::defaults(dataset, plan, overrides).overridden(overrides)?;
        // Checked before frames are sampled, so that a calibration for another aspect ratio is refused
        // at once.
        if let Some(camera) = run.surface.calibration.as_ref().and_then(|given| given.color_camera)
        {
            dataset.splits[plan.split].camera_scaling(&camera)?;
        }
        Ok(run)
    }

    /// Adds the structural scale `h`, from sampled frames, and checks the settings.
    pub(in crate::pipeline) fn with_scale(
        mut self,
        dataset: &Dataset,
        plan: &Plan,
    ) -> Result<Self, SceneError> {
        self.engine.h = self.scale_of_samples(dataset, plan)?;
        Ok(Self { engine: self.engine.check()?, ..self })
    }

    /// Returns the structural scale of a plan's runs for which none is chosen.
    pub fn default_scale(dataset: &Dataset, plan: &Plan) -> StructuralScale {
        let frames = &dataset.splits[plan.split].frames;
        let first = plan.frames.first().map(|&i| frames[i].camera.intrinsics.n_pixels());
        StructuralScale::default_for(first.unwrap_or(0))
    }

    /// Returns the structural scale, world units, from sampled frames prepared by the run's surface
    /// settings.
    ///
    /// # Errors
    /// [`SceneError`] for a scale out of range, or unusable depth.
    pub fn scale_of_samples(&self, dataset: &Dataset, plan: &Plan) -> Result<f64, SceneError> {
        // Further passes have the same frames.
        let sample = FrameSample::of(dataset, plan.split, &plan.first_pass(), &self.surface)?;
        scale_in_world_units(self, &sample)
    }

    /// Returns the default settings for the requested sensor, without the structural scale `h`.
    fn defaults(dataset: &Dataset, plan: &Plan, overrides: &SceneOverrides) -> Self {
        let split = &dataset.splits[plan.split];
        // An outlier pose as origin would be far from all other frames.
        let wild = outlier_poses(split);
        let is_sound = |i: &&usize| wild.iter().all(|wild| wild.index != **i);
        let first = plan.frames.iter().find(is_sound).or(plan.frames.first());
        let first = first.map(|&i| split.frames[i].camera);
        let pixels = first.map_or(0, |camera| camera.intrinsics.n_pixels());
        let origin = first.map_or(DVec3::ZERO, |camera| {
            // Whole metres, so that seeds are rounded alike in any unit of the world.
            (camera.pose.centre() / dataset.units_per_metre()).round() * dataset.units_per_metre()
        });
        let mut surface = SurfaceSettings::new(dataset, origin);
        surface.sensor = overrides.sensor.unwrap_or(surface.sensor);
        let mut run = Self::of_surface(surface, pixels, Self::default_scale(dataset, plan));
        run.engine.track = dataset.options.track;
        run
    }

    /// Returns the settings for frames from memory, whose colour is registered to depth, with structural scale
    /// `h` in world units. `n_pixels` is the size of a depth image, `origin` the world position to which the
    /// scene's positions are relative.
    ///
    /// # Errors
    /// [`ConfigError`] for a setting out of range.
    pub fn of_memory(
        sensor: Sensor,
        n_pixels: usize,
        h: f64,
        origin: DVec3,
        overrides: &SceneOverrides,
    ) -> Result<Self, ConfigError> {
        let surface = SurfaceSettings::of_sensor(overrides.sensor.unwrap_or(sensor), origin);
        let defaults = Self::of_surface(surface, n_pixels, StructuralScale::World(h));
        let mut run = defaults.overridden(overrides)?;
        run.engine.h = h;
        Ok(Self { engine: run.engine.check()?, ..run })
    }

    fn overridden(mut self, overrides: &SceneOverrides) -> Result<Self, ConfigError> {
        check_plain_splats(overrides)?;
        overrides.apply(&mut self);
        SceneOverrides::check(&self)?;
        check_photometric(overrides, &self.engine)?;
        // Plain splats are exported without loss, which textures would be.
        let is_plain = overrides.splats == Some(SplatKind::Plain);
        if overrides.textures.is_none() && (self.engine.photometric.is_none() || is_plain) {
            self.engine.texture_mb = 0;
        }
        Ok(self)
    }

    fn of_surface(mut surface: SurfaceSettings, n_pixels: usize, scale: StructuralScale) -> Self {
        // Computed depth has no mixed pixels. At a crease, where no plane fits, it is still correct.
        surface.flying_pixels = !matches!(surface.sensor, Sensor::Exact { .. });
        surface.sampling = sampling(surface.sensor, n_pixels);
        let mut engine = sensor_defaults(surface.sensor);
        engine.photometric = PhotometricMode::Light.rule();
        engine.texture_mb = DEFAULT_TEXTURE_MB;
        Self { seed: 0, scale, budget: None, engine, surface }
    }
}

fn sampling(sensor: Sensor, pixels: usize) -> PixelSampling {
    match sensor {
        // Real cameras observe every surface many times, with errors that neighbouring pixels share, so a
        // quarter of a large frame suffices (`scene.md`, Sampling).
        Sensor::Kinect | Sensor::Lidar if pixels >= LARGE_FRAME => PixelSampling::Quarter,
        _ => PixelSampling::Every,
    }
}

fn check_plain_splats(overrides: &SceneOverrides) -> Result<(), ConfigError> {
    let asked = [(overrides.gradient, "gradient"), (overrides.crack_filling, "crack_filling")];
    let asked = asked.into_iter().find(|(asked, _)| *asked == Some(true));
    match (overrides.splats, asked) {
        (Some(SplatKind::Plain), Some((_, part))) => Err(ConfigError {
            setting: "splats",
            expected: format!("native with {part}, which plain splats do not support"),
            found: "plain".to_owned(),
        }),
        _ => Ok(()),
    }
}

/// Refuses settings that only have an effect with photometric training.
fn check_photometric(overrides: &SceneOverrides, engine: &SceneConfig) -> Result<(), ConfigError> {
    let asked = [("shuffle_buffer", overrides.shuffle_buffer), ("textures", overrides.textures)];
    let asked = asked.into_iter().find_map(|(setting, n)| Some((setting, n.filter(|&n| n > 0)?)));
    match asked.filter(|_| engine.photometric.is_none()) {
        None => Ok(()),
        Some((setting, n)) => Err(ConfigError {
            setting,
            expected: "0 without photometric training (`--photometric off`)".to_owned(),
            found: n.to_string(),
        }),
    }
}

/// Returns the default settings measured for each kind of sensor (`scene.md`, Settings by sensor),
/// without the structural scale `h`.
fn sensor_defaults(sensor: Sensor) -> SceneConfig {
    // `h` follows from the sampled frames; NaN would fail every check.
    match sensor {
        Sensor::Inverse8Ray => SceneConfig::fine(f64::NAN),
        Sensor::Exact { .. } => SceneConfig::exact(f64::NAN),
        Sensor::Kinect | Sensor::Lidar => SceneConfig::coarse(f64::NAN),
    }
}

/// Converts the structural scale to world units and checks it against the depth noise.
fn scale_in_world_units(run: &SceneRun, sample: &FrameSample) -> Result<f64, SceneError> {
    let scale = run.scale;
    let least = scale.min_length(sample.tolerance, run.engine.ray_search > 0.0);
    // Beyond this maximum, one component would cover the whole scene.
    let (asked, most) = match scale {
        StructuralScale::Pixels(n) => (n, sample.depths[1] / sample.footprint),
        StructuralScale::World(h) => (h, sample.depths[1]),
    };
    if asked > most {
        let unit = if matches!(scale, StructuralScale::Pixels(_)) { "px" } else { " world units" };
        return Err(SceneError::Config(ConfigError {
            setting: "scale (`--scale`)",
            expected: format!("at most the depth of the scene, {most:.3}{unit}"),
            found: format!("{asked:?}{unit}"),
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

/// Reason why a scene cannot start.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A setting is out of range.
    #[error("{0}")]
    Config(#[from] ConfigError),
    /// No pixel of the sampled frames gives a point.
    #[error(transparent)]
    NoPoints(#[from] NoUsableDepth),
    /// The calibration is for photographs of another aspect ratio.
    #[error("{0}")]
    Photographs(#[from] AspectRatioMismatch),
    /// The structural scale is below the depth noise.
    #[error(
        "scale (`--scale`): expected at least {least:.2e} world units, the apparent thickness of a surface due to depth noise, found {found:.2e}; depths run from {near:.2} to {far:.2}: if they are in another unit, set the depth scale and range (`--depth-scale`, `--depth-range`)"
    )]
    BelowNoise { least: f64, found: f64, near: f64, far: f64 },
}
