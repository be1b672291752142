//! Where a frame's time goes.

use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Milliseconds of one frame by stage. `train` is the trainer's own wall time: candidates, E-step,
/// statistics, update and reassignment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageMs {
    /// Candidate search.
    pub candidates: f64,
    /// Scores and responsibilities.
    pub e_step: f64,
    /// Sums per tile.
    pub stats: f64,
    /// Addition of the frame's sums to the scene's.
    pub update: f64,
    /// Choosing and moving components, and rebuilding the index.
    pub reassign: f64,
    /// Wall time of the frame.
    pub train: f64,
}

/// Names and values of the stages, in the order they run.
impl StageMs {
    /// Names of [`StageMs::stages`].
    pub const NAMES: [&'static str; 5] = ["candidates", "e_step", "stats", "update", "reassign"];

    /// The stages without their total.
    pub fn stages(&self) -> [f64; 5] {
        [self.candidates, self.e_step, self.stats, self.update, self.reassign]
    }

    /// Adds a pass of `wall_ms`, split among search, E-step and sums in proportion to the time all
    /// threads spent in each.
    pub fn add_pass(&mut self, wall_ms: f64, thread_nanos: [u64; 3]) {
        let total = thread_nanos.iter().sum::<u64>().max(1) as f64;
        let share = thread_nanos.map(|n| wall_ms * n as f64 / total);
        self.candidates += share[0];
        self.e_step += share[1];
        self.stats += share[2];
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
