//! Wall time of a frame by stage.
//!
//! A pass runs its stages tile by tile on all threads, so no stage has a wall time of its own. The
//! pass's time is split in proportion to thread time sampled on a few tiles ([`StageClock`]).

use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;
use std::time::Instant;

/// Wall time of training one frame by stage, milliseconds. Stored in JSON as an object with a field per
/// stage and the field `train`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageMs {
    stages: &'static [TrainStage],
    ms: [f64; MAX_STAGES],
    /// Total wall time of the frame in milliseconds, including work outside all stages.
    pub train: f64,
}

impl StageMs {
    /// Creates zero times for the stages of a preset, of which there are at most [`MAX_STAGES`].
    pub fn new(stages: &'static [TrainStage]) -> Self {
        // More stages than the arrays hold would panic at the first time added.
        Self { stages: &stages[..stages.len().min(MAX_STAGES)], ..Self::default() }
    }

    /// Adds `ms` milliseconds to the stage with index `stage`.
    pub fn add(&mut self, stage: usize, ms: f64) {
        self.ms[stage] += ms;
    }

    /// Returns the stages with their milliseconds, in the order in which they run.
    pub fn stages(&self) -> impl Iterator<Item = (&'static TrainStage, f64)> {
        self.stages.iter().zip(self.ms)
    }

    /// Returns the milliseconds by stage index.
    pub fn values(&self) -> &[f64] {
        &self.ms[..self.stages.len()]
    }

    /// Returns the stages, in the order in which they run.
    pub fn names(&self) -> &'static [TrainStage] {
        self.stages
    }

    /// Adds the wall time of a pass. It is split among search, E-step and sums in proportion to the
    /// thread time of each.
    pub fn add_pass(&mut self, wall_ms: f64, thread_nanos: [u64; 3]) {
        // A pass without points has no thread time.
        let total = thread_nanos.iter().sum::<u64>().max(1) as f64;
        for (stage, nanos) in thread_nanos.into_iter().enumerate() {
            self.add(stage, wall_ms * nanos as f64 / total);
        }
    }

    /// Combines the times of several frames of one preset, stage by stage, using `of`, for example the
    /// median.
    pub fn combine(frames: &[Self], of: impl Fn(Vec<f64>) -> f64) -> Self {
        let Some(first) = frames.first() else { return Self::default() };
        let mut combined = Self::new(first.stages);
        for stage in 0..combined.stages.len() {
            combined.ms[stage] = of(frames.iter().map(|ms| ms.ms[stage]).collect());
        }
        combined.train = of(frames.iter().map(|ms| ms.train).collect());
        combined
    }
}

impl Serialize for StageMs {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // By hand, since the names of the fields depend on the preset.
        let mut map = serializer.serialize_map(Some(self.stages.len() + 1))?;
        for (stage, ms) in self.stages() {
            map.serialize_entry(stage.key, &ms)?;
        }
        map.serialize_entry("train", &self.train)?;
        map.end()
    }
}

/// Reads the times of either preset and ignores unknown fields. Reports of scenes by version 0.1.0 use
/// the stage names of the `paper` preset.
impl<'de> Deserialize<'de> for StageMs {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let fields = BTreeMap::<String, f64>::deserialize(deserializer)?;
        // Reports do not name the preset of the times; only scenes have this stage.
        let is_scene = fields.contains_key(SCENE_STAGES[SceneStage::Assign as usize].key);
        let mut found = Self::new(if is_scene { &SCENE_STAGES } else { &PAPER_STAGES });
        for (at, stage) in found.stages.iter().enumerate() {
            found.ms[at] = fields.get(stage.key).copied().unwrap_or(0.0);
        }
        found.train = fields.get("train").copied().unwrap_or(0.0);
        Ok(found)
    }
}

/// Measures the thread time of a pass's stages on a sample of tiles. Reading the clock for every tile
/// would be too slow, as each reading takes as long as scoring a point.
#[derive(Debug, Default)]
pub struct StageClock {
    running: Option<Stopwatch>,
    /// Nanoseconds of candidate search, E-step and sums, the first stages in [`PAPER_STAGES`].
    nanos: [u64; 3],
}

impl StageClock {
    /// Begins a tile; the clock runs only if the tile is in the sample (`is_looked_at`).
    #[inline(always)]
    pub fn begin_tile(&mut self, is_looked_at: bool) {
        // A tile outside the sample must not continue the clock of the last one.
        self.running = is_looked_at.then(Stopwatch::start);
    }

    /// Adds to `stage` the time since the last lap, if the clock runs.
    #[inline(always)]
    pub fn lap(&mut self, stage: PaperStage) {
        if let Some(clock) = &mut self.running {
            self.nanos[stage as usize] += clock.lap_nanos();
        }
    }

    /// Adds the nanoseconds measured by another clock, by stage.
    pub fn add(&mut self, nanos: [u64; 3]) {
        self.nanos.iter_mut().zip(nanos).for_each(|(sum, nanos)| *sum += nanos);
    }

    /// Returns the nanoseconds measured by stage and resets them.
    pub fn take_nanos(&mut self) -> [u64; 3] {
        std::mem::take(&mut self.nanos)
    }
}

/// Stopwatch that runs from its creation and measures laps.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch(Instant);

impl Stopwatch {
    /// Creates and starts a stopwatch.
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Returns the milliseconds since the start or the last lap, and starts the next lap.
    pub fn lap_ms(&mut self) -> f64 {
        self.lap_nanos() as f64 * 1e-6
    }

    /// Returns the nanoseconds since the start or the last lap, and starts the next lap.
    pub fn lap_nanos(&mut self) -> u64 {
        let now = Instant::now();
        let elapsed = now - self.0;
        self.0 = now;
        elapsed.as_nanos() as u64
    }

    /// Returns the milliseconds since the start, ignoring laps.
    pub fn elapsed_ms(&self) -> f64 {
        self.0.elapsed().as_secs_f64() * 1e3
    }
}

/// A stage of training one frame, measured in milliseconds of wall time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrainStage {
    /// Field name in reports and column name in spreadsheets. If it is renamed, times in older reports
    /// are no longer read.
    pub key: &'static str,
    /// Label of the stage in the latency panel.
    pub label: &'static str,
    /// Tooltip of the stage in the latency panel.
    pub tooltip: &'static str,
}

/// Stages of training one frame in the `paper` preset; values are indices into [`PAPER_STAGES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaperStage {
    /// Candidate search for scoring and for the fit.
    Candidates,
    /// Scores and responsibilities for scoring passes and for the fit.
    EStep,
    /// Sums of each tile by component, not yet added to the model.
    Stats,
    /// Addition of the frame's sums to the model's totals; the only stage that changes the totals.
    Update,
    /// Selection and move of unused components, and sorting of the index of means.
    Reassign,
}

/// Stages of training one frame in the `scene` preset; values are indices into [`SCENE_STAGES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneStage {
    /// Correction of the frame's pose, unless recorded poses are treated as exact.
    Pose,
    /// Assignment of each point to the nearest seed (creation point of a component) within the
    /// structural scale.
    Assign,
    /// Creation of components for unassigned points, sequentially on one thread.
    Births,
    /// ELBO of the points, their refinement along rays, and the frame's exposure.
    Refine,
    /// Sums of sufficient statistics per component.
    Stats,
    /// Projection of every component into the frame, with counts of hits and misses.
    Visibility,
    /// Addition of the photograph to textures, and comparison of textures with a photograph.
    Textures,
    /// Gauss-Newton step that fits the splats to the photograph, if enabled.
    Photometric,
    /// Merging of components down to the budget; rarely needed.
    Merge,
}

const fn stage(key: &'static str, label: &'static str, what: &'static str) -> TrainStage {
    TrainStage { key, label, tooltip: what }
}

/// Stages of the `paper` preset, indexed by [`PaperStage`].
pub const PAPER_STAGES: [TrainStage; 5] = [
    stage("candidates", "Candidate search", "Finds the nearest components of every point"),
    stage("e_step", "E-step", "Computes scores and responsibilities of the candidates"),
    stage("stats", "Statistics", "Computes responsibility-weighted sums, tile by tile"),
    stage("update", "Update", "Adds the frame's sums to the model's"),
    stage("reassign", "Reassignment", "Moves unused components to badly explained points"),
];

/// Stages of the `scene` preset, indexed by [`SceneStage`].
pub const SCENE_STAGES: [TrainStage; 9] = [
    stage("pose", "Pose correction", "Fits the frame's pose to the scene's planes and colours"),
    stage("assign", "Assignment", "Finds the component of every point"),
    stage("births", "Births", "Creates components for points without one nearby"),
    stage(
        "refine",
        "Refine depth and exposure",
        "Moves points along their rays to their component's plane and fits the frame's exposure",
    ),
    stage("stats", "Accumulate", "Sums every component's points about its seed"),
    stage("visibility", "Visibility", "Counts components that the frame saw or saw through"),
    stage(
        "textures",
        "Textures",
        "Adds the photograph to textures and measures how well textures predict photographs",
    ),
    stage(
        "photometric",
        "Photometric step",
        "Applies a Gauss-Newton step from the photograph, weighted by earlier photographs",
    ),
    stage("merge", "Merge to budget", "Merges components down to the budget"),
];

/// Maximum number of stages in any preset: the size of timing arrays.
pub const MAX_STAGES: usize = SCENE_STAGES.len();
const _: () = assert!(PAPER_STAGES.len() <= MAX_STAGES);
