//! Where a frame's time goes.
//!
//! Stages have the names that their preset gives them. A pass runs its stages tile by tile on all
//! threads, so that none has a wall time of its own: the pass's is split among them in proportion
//! to what threads spent in each, seen on a few tiles ([`StageClock`]).

use super::stages::{MAX_STAGES, PAPER_STAGES, PaperStage, SCENE_STAGES, SceneStage, TrainStage};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;
use std::time::Instant;

/// Milliseconds of one frame by the stages of its preset. As JSON an object with a field for every
/// stage, and `train`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageMs {
    stages: &'static [TrainStage],
    ms: [f64; MAX_STAGES],
    /// The learner's own wall time of the frame; what is not in any stage is in it too.
    pub train: f64,
}

impl StageMs {
    /// No time in any of a preset's stages, at most [`MAX_STAGES`].
    pub fn new(stages: &'static [TrainStage]) -> Self {
        Self { stages: &stages[..stages.len().min(MAX_STAGES)], ..Self::default() }
    }

    /// Books time on the stage at a position.
    pub fn add(&mut self, stage: usize, ms: f64) {
        self.ms[stage] += ms;
    }

    /// Stages and their milliseconds, in the order they run.
    pub fn stages(&self) -> impl Iterator<Item = (&'static TrainStage, f64)> {
        self.stages.iter().zip(self.ms)
    }

    /// Milliseconds by position of the stage.
    pub fn values(&self) -> &[f64] {
        &self.ms[..self.stages.len()]
    }

    /// The stages, in the order they run.
    pub fn names(&self) -> &'static [TrainStage] {
        self.stages
    }

    /// Adds a pass of `wall_ms`, split among search, E-step and sums in proportion to the time all
    /// threads spent in each.
    pub fn add_pass(&mut self, wall_ms: f64, thread_nanos: [u64; 3]) {
        let total = thread_nanos.iter().sum::<u64>().max(1) as f64;
        let laps = [PaperStage::Candidates, PaperStage::EStep, PaperStage::Stats];
        for (stage, nanos) in laps.into_iter().zip(thread_nanos) {
            self.add(stage as usize, wall_ms * nanos as f64 / total);
        }
    }

    /// Value by value what `of` makes of several frames of one preset.
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
        let mut map = serializer.serialize_map(Some(self.stages.len() + 1))?;
        for (stage, ms) in self.stages() {
            map.serialize_entry(stage.key, &ms)?;
        }
        map.serialize_entry("train", &self.train)?;
        map.end()
    }
}

/// Fields that no preset has are passed over: what wrote them measured something else. Reports of
/// scenes by version 0.1.0 have the published algorithm's names.
impl<'de> Deserialize<'de> for StageMs {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let fields = BTreeMap::<String, f64>::deserialize(deserializer)?;
        let is_scene = fields.contains_key(SCENE_STAGES[SceneStage::Assign as usize].key);
        let mut found = Self::new(if is_scene { &SCENE_STAGES } else { &PAPER_STAGES });
        for (at, stage) in found.stages.iter().enumerate() {
            found.ms[at] = fields.get(stage.key).copied().unwrap_or(0.0);
        }
        found.train = fields.get("train").copied().unwrap_or(0.0);
        Ok(found)
    }
}

/// The stages a pass is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lap {
    /// Candidate search.
    Candidates,
    /// Scores and responsibilities.
    EStep,
    /// Sums per tile.
    Stats,
}

/// Splits the time of a pass among its stages by looking at some tiles only: reading the clock
/// costs as much as scoring a point.
#[derive(Debug, Default)]
pub struct StageClock {
    running: Option<Stopwatch>,
    nanos: [u64; 3],
}

impl StageClock {
    /// Starts with a tile, which is looked at or not.
    #[inline(always)]
    pub fn begin_tile(&mut self, is_looked_at: bool) {
        self.running = is_looked_at.then(Stopwatch::start);
    }

    /// Books the time since the last lap.
    #[inline(always)]
    pub fn lap(&mut self, lap: Lap) {
        if let Some(clock) = &mut self.running {
            self.nanos[lap as usize] += clock.lap_nanos();
        }
    }

    /// Books what another clock has taken.
    pub fn add(&mut self, nanos: [u64; 3]) {
        self.nanos.iter_mut().zip(nanos).for_each(|(sum, nanos)| *sum += nanos);
    }

    /// What was booked, by stage; starts over.
    pub fn take(&mut self) -> [u64; 3] {
        std::mem::take(&mut self.nanos)
    }
}

/// A running clock.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts now.
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Milliseconds since the start or the last lap; starts the next lap.
    pub fn lap_ms(&mut self) -> f64 {
        self.lap_nanos() as f64 * 1e-6
    }

    /// Nanoseconds since the start or the last lap; starts the next lap.
    pub fn lap_nanos(&mut self) -> u64 {
        let now = Instant::now();
        let elapsed = now - self.0;
        self.0 = now;
        elapsed.as_nanos() as u64
    }

    /// Milliseconds since the start.
    pub fn elapsed_ms(&self) -> f64 {
        self.0.elapsed().as_secs_f64() * 1e3
    }
}
