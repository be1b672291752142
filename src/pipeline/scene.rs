//! Settings of the scene preset: what a user may say, and what becomes of it on a dataset.

use super::plan::Plan;
use crate::dataset::Dataset;
use crate::dataset::calibration::Calibration;
use crate::dataset::surface::{Preparer, Sensor, SurfaceSettings};
use crate::math::observation::Observation;
use crate::math::points::Normalization;
use crate::train::config::ConfigError;
use crate::train::scene::config::{BirthRule, LookRule, SceneConfig};
use crate::train::scene::engine::SumForm;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Bytes of a component, by which a budget in megabytes is counted.
const COMPONENT_BYTES: usize = 200;

/// Structural scale: largest distance of a point from the seed of its component.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum StructuralScale {
    /// Pixels, at the distance beyond which one point in twenty lies: elsewhere it is more.
    Pixels(f64),
    /// World units.
    World(f64),
}

impl std::str::FromStr for StructuralScale {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (number, form): (&str, fn(f64) -> Self) = match text.strip_suffix("px") {
            Some(number) => (number, Self::Pixels),
            None => (text, Self::World),
        };
        match number.trim().parse() {
            Ok(value) if value > 0.0 && f64::is_finite(value) => Ok(form(value)),
            _ => Err(format!(
                "expected pixels such as 2.5px, or world units such as 0.02, found `{text}`"
            )),
        }
    }
}

impl TryFrom<String> for StructuralScale {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<StructuralScale> for String {
    fn from(scale: StructuralScale) -> Self {
        match scale {
            StructuralScale::Pixels(n) => format!("{n}px"),
            StructuralScale::World(h) => h.to_string(),
        }
    }
}

/// Most components of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum Budget {
    /// So many.
    Components(usize),
    /// As many as fit in so many bytes of the model.
    Bytes(usize),
}

impl Budget {
    /// In components.
    pub fn components(self) -> usize {
        match self {
            Self::Components(n) => n,
            Self::Bytes(n) => n / COMPONENT_BYTES,
        }
    }
}

impl std::str::FromStr for Budget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!("expected components such as 25000, or megabytes such as 5MB, found `{text}`")
        };
        match text.strip_suffix("MB") {
            None => text.parse().map(Self::Components).map_err(|_| wrong()),
            Some(number) => match number.trim().parse::<f64>() {
                Ok(mb) if mb > 0.0 && mb < 1e6 => Ok(Self::Bytes((mb * 1e6).round() as usize)),
                _ => Err(wrong()),
            },
        }
    }
}

impl TryFrom<String> for Budget {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Budget> for String {
    fn from(budget: Budget) -> Self {
        match budget {
            Budget::Components(n) => n.to_string(),
            Budget::Bytes(n) => format!("{}MB", n as f64 / 1e6),
        }
    }
}

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
    /// How looks are counted.
    pub looks: Option<LookRule>,
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

/// Frames looked at before training, evenly spaced.
const SAMPLED_FRAMES: usize = 8;
/// Every so-many-th point of them.
const SAMPLED_POINTS: usize = 7;
/// Share of the points that are nearer than the typical distance.
const NEARER: f64 = 0.95;
/// Returns per component of a lattice, whose cells surfaces cut through, against those of a component
/// whose points surround its seed.
const LATTICE_DENSITY: f64 = 1.2;
/// Structural scale where none is asked for.
const DEFAULT_SCALE: StructuralScale = StructuralScale::Pixels(DEFAULT_PIXELS);
/// The same in pixels.
pub const DEFAULT_PIXELS: f64 = 2.5;

/// Why a scene cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A setting out of range.
    #[error(transparent)]
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
        advice: String,
    },
    /// The structural scale is below what the data can tell apart.
    #[error(
        "--scale: expected at least {least:.2e} world units, the distance that depth noise makes of one surface here, found {found:.2e}; depths run from {near:.2} to {far:.2}: if they are in another unit, say so with --depth-scale"
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
            engine.looks = LookRule::Returned;
            engine.native.opacity.rho0 *= LATTICE_DENSITY;
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

/// Settings measured with each kind of sensor (`accuracy.md` 3 and 7).
fn engine_for(sensor: Sensor, h: f64) -> SceneConfig {
    match sensor {
        Sensor::Inverse8Ray | Sensor::Exact { .. } => SceneConfig::fine(h),
        Sensor::Kinect | Sensor::Lidar => SceneConfig::coarse(h),
    }
}

/// What some frames of a plan look like.
struct Sample {
    /// Width of a pixel at the typical distance, world units.
    footprint: f64,
    /// Distance within which depths are one surface, world units.
    tolerance: f64,
    /// Distances that a twentieth of the points lie below and above.
    depths: [f64; 2],
}

impl Sample {
    fn of(dataset: &Dataset, plan: &Plan, surface: &SurfaceSettings) -> Result<Self, SceneError> {
        let mut preparer = Preparer::new();
        let mut observation = Observation::empty();
        let (mut footprints, mut depths, mut seen) = (Vec::new(), Vec::new(), Vec::new());
        let mut trusted = [0.0; 2];
        let mut n = 0;
        for index in sampled(&plan.frames) {
            if n == SAMPLED_FRAMES {
                break;
            }
            let Ok(frame) = dataset.load(plan.split, index) else { continue };
            let Some(depth) = &frame.depth else { continue };
            n += 1;
            trusted = depth.trusted;
            let (width, height) = depth.size();
            let pixels = (0..width * height).step_by(SAMPLED_POINTS);
            seen.extend(pixels.filter_map(|i| depth.value_at(i % width, i / width)));
            if preparer.prepare(&frame, surface, &mut observation).is_ok() {
                let points = observation.points.iter().step_by(SAMPLED_POINTS);
                footprints.extend(points.clone().map(|p| f64::from(p.footprint)));
                depths.extend(points.map(|p| f64::from(p.range)));
            }
        }
        match (quantile(&mut footprints, NEARER), quantile(&mut depths, 0.05)) {
            (Some(footprint), Some(near)) => {
                let far = quantile(&mut depths, 0.95).unwrap_or(near);
                let tolerance = f64::from(observation.tolerance.refinement);
                Ok(Self { footprint, tolerance, depths: [near, far] })
            }
            _ => Err(no_points(dataset, trusted, &mut seen, n)),
        }
    }

    /// In world units; at least what noise allows.
    fn scale(&self, asked: StructuralScale) -> Result<f64, SceneError> {
        match asked {
            StructuralScale::Pixels(n) => Ok((n * self.footprint).max(self.tolerance)),
            StructuralScale::World(h) if h >= 0.5 * self.tolerance => Ok(h),
            StructuralScale::World(found) => {
                let [near, far] = self.depths;
                Err(SceneError::BelowNoise { least: 0.5 * self.tolerance, found, near, far })
            }
        }
    }
}

/// All of some frames, the evenly spaced ones first: the others stand in for those that cannot be
/// read.
fn sampled(frames: &[usize]) -> impl Iterator<Item = usize> {
    let n = frames.len().min(SAMPLED_FRAMES);
    let is_chosen = move |at: &usize| (0..n).any(|i| i * frames.len() / n == *at);
    let chosen = (0..frames.len()).filter(is_chosen);
    chosen.chain((0..frames.len()).filter(move |at| !is_chosen(at))).map(|at| frames[at])
}

fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    Some(*values.select_nth_unstable_by((last as f64 * share) as usize, f64::total_cmp).1)
}

/// Says what depth there is, and which unit it seems to have.
fn no_points(dataset: &Dataset, trusted: [f64; 2], seen: &mut [f64], frames: usize) -> SceneError {
    let interval = |[a, b]: [f64; 2]| match b.is_finite() {
        true => format!("range {a:.3} to {b:.3}"),
        false => format!("range from {a:.3} on"),
    };
    let (near, far) = (quantile(seen, 0.05), quantile(seen, 0.95));
    let found = match (near, far) {
        (Some(near), Some(far)) => interval([near, far]),
        _ => "no depth at all".to_owned(),
    };
    let advice = match quantile(seen, 0.5) {
        None => "check that the depth images belong to this dataset".to_owned(),
        Some(middle) => unit_advice(trusted, middle),
    };
    SceneError::NoPoints {
        dataset: dataset.name.clone(),
        trusted: interval(trusted),
        found,
        frames,
        advice,
    }
}

/// The power of ten that brings a depth into the trusted interval, if one does.
fn unit_advice(trusted: [f64; 2], middle: f64) -> String {
    let factors = [
        (1e-3, "millimetres"),
        (1e3, "kilometres"),
        (1e-2, "centimetres"),
        (1e-4, "tenths of millimetres"),
    ];
    let likely =
        factors.iter().find(|(factor, _)| (trusted[0]..trusted[1]).contains(&(middle * factor)));
    match likely {
        Some((factor, unit)) => format!(
            "the depths look like {unit} taken for metres: multiply --depth-scale by {factor}, or widen --depth-range"
        ),
        None => "set the unit with --depth-scale, or widen --depth-range".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_are_pixels_or_world_units() {
        assert_eq!("2.5px".parse(), Ok(StructuralScale::Pixels(2.5)));
        assert_eq!("0.02".parse(), Ok(StructuralScale::World(0.02)));
        for wrong in ["", "px", "-1", "0px", "nan", "inf", "2 metres"] {
            assert!(wrong.parse::<StructuralScale>().is_err(), "{wrong}");
        }
        let back: StructuralScale = String::from(StructuralScale::Pixels(3.0)).parse().unwrap();
        assert_eq!(back, StructuralScale::Pixels(3.0));
    }

    #[test]
    fn budgets_come_back_as_they_were() {
        for text in ["25000", "5MB", "20.3MB", "0.1MB"] {
            let budget: Budget = text.parse().unwrap();
            assert_eq!(String::from(budget), text);
        }
    }

    #[test]
    fn every_frame_is_sampled_once_the_evenly_spaced_first() {
        let frames: Vec<usize> = (100..120).collect();
        let order: Vec<usize> = sampled(&frames).collect();
        assert_eq!(order[..8], [100, 102, 105, 107, 110, 112, 115, 117]);
        assert_eq!(order[8..11], [101, 103, 104]);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, frames);
        assert_eq!(sampled(&frames[..3]).collect::<Vec<_>>(), frames[..3]);
        assert_eq!(sampled(&[]).count(), 0);
    }

    #[test]
    fn a_wrong_unit_is_guessed() {
        assert!(unit_advice([0.3, 4.0], 1500.0).contains("millimetres"));
        assert!(unit_advice([0.3, 4.0], 1e9).contains("--depth-scale"));
    }
}
