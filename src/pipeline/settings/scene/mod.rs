//! Settings of the scene preset: what a user may say, and what becomes of it on a dataset.

pub use crate::pipeline::settings::units::{Budget, StructuralScale};

use crate::dataset::Dataset;
use crate::dataset::calibration::Calibration;
use crate::dataset::surface::{Sensor, SurfaceSettings};
use crate::math::normalization::Normalization;
use crate::pipeline::plan::Plan;
use crate::pipeline::settings::sample::Sample;
use crate::train::scene::config::{BirthRule, SceneConfig, VisibilityRule};
use crate::train::scene::sum_form::SumForm;
use crate::train::setting::ConfigError;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// What a user may say of a scene; `None` keeps the preset's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SceneOverrides {
    /// Seed of the order of frames.
    pub seed: Option<u64>,
    /// Structural scale.
    pub scale: Option<StructuralScale>,
    /// Where components are born.
    pub births: Option<BirthRule>,
    /// Most components.
    pub budget: Option<Budget>,
    /// Whether points are moved along their rays towards their component's plane.
    pub refine: Option<bool>,
    /// Whether each frame's pose is corrected to fit the scene.
    pub align: Option<bool>,
    /// Whether each frame's exposure is fitted to the scene's.
    pub gain: Option<bool>,
    /// Whether cracks between splats are closed when they are drawn.
    pub closing: Option<bool>,
    /// How hits and misses are counted.
    pub looks: Option<VisibilityRule>,
    /// Whether colour varies over a splat.
    pub gradient: Option<bool>,
    /// Whether colour depends on the view direction.
    pub directional: Option<bool>,
    /// How sums are kept.
    pub sums: Option<SumForm>,
    /// Whether depth is that of the plane fitted around the pixel.
    pub plane_fit: Option<bool>,
    /// Whether pixels that no plane explains are dropped.
    pub flying_pixels: Option<bool>,
    /// Whether surfaces seen at a slant are dropped.
    pub cosine: Option<bool>,
    /// What the depth is from.
    pub sensor: Option<Sensor>,
    /// Corrections of the cameras.
    pub calibration: Option<Calibration>,
}

impl SceneOverrides {
    /// These settings where present, `fallback`'s elsewhere.
    pub fn or(self, fallback: Self) -> Self {
        Self {
            seed: self.seed.or(fallback.seed),
            scale: self.scale.or(fallback.scale),
            births: self.births.or(fallback.births),
            budget: self.budget.or(fallback.budget),
            refine: self.refine.or(fallback.refine),
            align: self.align.or(fallback.align),
            gain: self.gain.or(fallback.gain),
            closing: self.closing.or(fallback.closing),
            looks: self.looks.or(fallback.looks),
            gradient: self.gradient.or(fallback.gradient),
            directional: self.directional.or(fallback.directional),
            sums: self.sums.or(fallback.sums),
            plane_fit: self.plane_fit.or(fallback.plane_fit),
            flying_pixels: self.flying_pixels.or(fallback.flying_pixels),
            cosine: self.cosine.or(fallback.cosine),
            sensor: self.sensor.or(fallback.sensor),
            calibration: self.calibration.or(fallback.calibration),
        }
    }
}

/// Every setting of a scene on one dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneRun {
    /// Seed of the order of frames.
    pub seed: u64,
    /// The structural scale as it was asked for.
    pub scale: StructuralScale,
    /// Most components, as it was asked for.
    pub budget: Option<Budget>,
    /// Settings of the engine, the structural scale in world units among them.
    #[serde(flatten)]
    pub engine: SceneConfig,
    /// How frames are prepared.
    pub surface: SurfaceSettings,
}

/// Structural scale where none is asked for.
const DEFAULT_SCALE: StructuralScale = StructuralScale::Pixels(DEFAULT_PIXELS);
/// The same in pixels.
pub const DEFAULT_PIXELS: f64 = 2.5;
/// Share of the points that are nearer than the distance at which pixels are taken for lengths.
pub const NEARER_SHARE: f64 = 0.95;

/// What to do about depth of which nothing is usable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthAdvice {
    /// The images hold none at all.
    CheckImages,
    /// It looks like another unit, taken for metres.
    OtherUnit {
        /// That unit.
        unit: &'static str,
        /// What the depth scale has to be multiplied by.
        factor: f64,
    },
    /// No usual unit brings it into the trusted range.
    SetUnit,
}

impl std::fmt::Display for DepthAdvice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::CheckImages => f.write_str("check that the depth images belong to this dataset"),
            Self::OtherUnit { unit, factor } => write!(
                f,
                "the depths look like {unit} taken for metres: multiply the depth scale by {factor}, or widen the depth range"
            ),
            Self::SetUnit => {
                f.write_str("set the depth scale to its unit, or widen the depth range")
            }
        }
    }
}

/// Why a scene cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A setting out of range.
    #[error("{0}")]
    Config(#[from] ConfigError),
    /// No pixel of the sampled frames is a point.
    #[error(
        "{dataset}: expected depth within the trusted {trusted}, found {found} in {frames} sampled frames and not one usable pixel; {advice}"
    )]
    NoPoints {
        /// Name of the dataset.
        dataset: String,
        /// Interval of lengths that training uses, world units.
        trusted: String,
        /// What the depth images hold, world units.
        found: String,
        /// Frames looked at.
        frames: usize,
        /// What to do.
        advice: DepthAdvice,
    },
    /// The structural scale is below what the data can tell apart.
    #[error(
        "structural scale: expected at least {least:.2e} world units, the distance that depth noise makes of one surface here, found {found:.2e}; depths run from {near:.2} to {far:.2}: if they are in another unit, set the depth scale"
    )]
    BelowNoise {
        /// Least scale.
        least: f64,
        /// Scale asked for.
        found: f64,
        /// Depth below which a twentieth of the points lie.
        near: f64,
        /// Depth above which a twentieth of the points lie.
        far: f64,
    },
}

impl SceneRun {
    /// World to model coordinates: a shift alone.
    pub fn normalization(&self) -> Normalization {
        Normalization { offset: self.surface.origin.to_array(), scale: [1.0; 3] }
    }

    /// Settings for the frames of a plan; looks at some of them. Runs over shards or in other orders
    /// start alike with the plan of all their frames in one order.
    pub fn new(
        dataset: &Dataset,
        plan: &Plan,
        overrides: &SceneOverrides,
    ) -> Result<Self, SceneError> {
        let first = plan.frames.first().map(|&i| dataset.splits[plan.split].frames[i].camera);
        let origin = first.map_or(DVec3::ZERO, |camera| camera.pose.centre().round());
        let mut surface = SurfaceSettings::new(dataset, origin);
        surface.sensor = overrides.sensor.unwrap_or(surface.sensor);
        surface.plane_fit = overrides.plane_fit.unwrap_or(surface.plane_fit);
        // Computed depth has no pixels between two surfaces: at a crease, where no plane fits, it is
        // right all the same.
        let is_computed = matches!(surface.sensor, Sensor::Exact { .. });
        surface.flying_pixels = overrides.flying_pixels.unwrap_or(!is_computed);
        surface.cosine = overrides.cosine.unwrap_or(surface.cosine);
        if let Some(calibration) = &overrides.calibration {
            surface.calibration = Some(calibration.clone());
        }
        let sample = Sample::of(dataset, plan, &surface)?;
        let scale = overrides.scale.unwrap_or(DEFAULT_SCALE);
        let mut engine = engine_for(surface.sensor, sample.scale(scale)?);
        engine.births = overrides.births.unwrap_or(engine.births);
        if engine.births.is_order_invariant() {
            engine.refine = false;
            engine.align = false;
            engine.gain = false;
            engine.looks = VisibilityRule::Returned;
        }
        engine.refine = overrides.refine.unwrap_or(engine.refine);
        engine.align = overrides.align.unwrap_or(engine.align);
        engine.gain = overrides.gain.unwrap_or(engine.gain);
        if overrides.closing == Some(false) {
            engine.native.closing = 1.0;
        }
        engine.looks = overrides.looks.unwrap_or(engine.looks);
        engine.sums = overrides.sums.unwrap_or(engine.sums);
        engine.most = overrides.budget.map_or(engine.most, Budget::components);
        engine.native.gradient = overrides.gradient.unwrap_or(engine.native.gradient);
        engine.native.directional = overrides.directional.unwrap_or(engine.native.directional);
        let (seed, budget) = (overrides.seed.unwrap_or(0), overrides.budget);
        Ok(Self { seed, scale, budget, engine: engine.check()?, surface })
    }
}

/// Settings measured with each kind of sensor (`scene.md`, Settings by sensor).
fn engine_for(sensor: Sensor, h: f64) -> SceneConfig {
    match sensor {
        Sensor::Inverse8Ray => SceneConfig::fine(h),
        Sensor::Exact { .. } => SceneConfig::exact(h),
        Sensor::Kinect | Sensor::Lidar => SceneConfig::coarse(h),
    }
}
