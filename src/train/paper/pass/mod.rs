//! Parallel pass over a frame's points: search, E-step and per-tile sums (records).
//!
//! Work is split by tiles, and the sums of a tile depend only on its points. So records and fixed-point
//! totals do not depend on the number of threads. There are two implementations: fused (f32, all stages
//! of a tile at once) and plain (any precision and number of candidates, stage by stage).
//!
//! Each thread has its own buffers, reused from task to task. So memory is allocated only in the first
//! passes.

mod tiles;

use super::config::{Candidates, Operations, PaperConfig, Width};
use super::fused::{FusedInputs, FusedMemory, FusedTiles};
use super::index::{Index, PaperScalar, SortedMeans, narrow};
use super::plain::{PlainInputs, PlainMemory};
use crate::math::simd::Isa;
use crate::model::conjugate::statistics::TileRecord;
use crate::model::paper::state::InitialModel;
use crate::model::paper::totals::Statistics;
use crate::observation::points::Points;
use crate::train::component_elbo::NO_OWNER;
use crate::train::estep::Scoring;
use crate::train::timing::{PaperStage, StageClock};
use rayon::prelude::*;
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use tiles::{Columns, ReachMemory, RerunTiles, for_each_part, for_each_task};

/// Results requested from a pass over a frame's points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// ELBO of each point only, for reassignment.
    Elbo,
    /// ELBO of each point, and sums by component.
    ElboAndSums,
}

/// Model between two frames: the data that passes read.
pub struct Mixture<R: PaperScalar> {
    pub config: PaperConfig,
    /// Initial model, which scores the points.
    pub model: InitialModel<R>,
    /// Index over the initial spatial means of `model`.
    pub index: Index,
    pub scoring: Scoring,
    /// Totals over all frames, relative to the initial means of `model`.
    pub statistics: Statistics,
}

#[derive(Clone, Copy)]
pub struct PassInputs<'a, R: PaperScalar> {
    pub mixture: &'a Mixture<R>,
    /// Components that each point is compared with.
    pub candidates: Candidates,
}

/// Buffers of a pass over a frame's points, reused from frame to frame.
#[derive(Default)]
pub struct Pass {
    /// Scratch memory by thread. Results do not depend on earlier tasks.
    pub(super) workers: Vec<RwLock<Worker>>,
    again: RerunTiles,
}

#[derive(Default)]
pub(super) struct Worker {
    fused: FusedMemory,
    plain: PlainMemory,
    ids: Vec<u32>,
    scores: Vec<f64>,
    /// Sums of tiles (records), by shard of the totals: `narrow` in f32, `wide` in f64.
    pub(super) narrow: Vec<Vec<TileRecord<f32>>>,
    wide: Vec<Vec<TileRecord<f64>>>,
    /// For each shard, the number of records in `narrow` before tiles were run again; empty if none
    /// were.
    first_run: Vec<usize>,
    reach: ReachMemory,
    pub(super) clock: StageClock,
}

impl Worker {
    fn records_of(&self, shard: usize) -> [usize; 2] {
        [self.narrow.get(shard).map_or(0, Vec::len), self.wide.get(shard).map_or(0, Vec::len)]
    }

    /// Clears a shard's records and ensures capacity for a quarter more than in the last pass. `seen`
    /// holds the numbers of f32 and f64 records of that pass. A capacity that is too small becomes at
    /// least three times that number.
    fn clear_records(&mut self, shard: usize, seen: [usize; 2]) {
        if self.narrow.len() <= shard {
            self.narrow.resize_with(shard + 1, Vec::new);
            self.wide.resize_with(shard + 1, Vec::new);
        }
        let room = |capacity: usize, seen: usize| {
            if capacity < seen + seen / 4 + 16 { 3 * seen + 64 } else { 0 }
        };
        let (narrow, wide) = (&mut self.narrow[shard], &mut self.wide[shard]);
        narrow.clear();
        narrow.reserve(room(narrow.capacity(), seen[0]));
        wide.clear();
        // Most runs never sum in f64, so no memory is reserved for it.
        wide.reserve(if seen[1] == 0 { 0 } else { room(wide.capacity(), seen[1]) });
    }
}

fn add(a: [usize; 2], b: [usize; 2]) -> [usize; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

impl Pass {
    /// Scores all points and, if requested, sums them by component.
    ///
    /// `q` receives each point's effective distance (see [`Scoring::elbo`]). Points whose score is NaN
    /// are left out and receive NaN. `owners`, if given, receives the component with the largest
    /// responsibility for each point, or `u32::MAX` for points left out.
    pub fn run<R: PaperScalar>(
        &mut self,
        inputs: &PassInputs<R>,
        points: &Points<R>,
        output: Output,
        q: &mut Vec<f64>,
        mut owners: Option<&mut Vec<u32>>,
    ) {
        // Sorted here, on all threads, and not by the first task that needs it.
        inputs.mixture.sorted();
        q.resize(points.len(), 0.0);
        if let Some(owners) = &mut owners {
            owners.resize(points.len(), NO_OWNER);
        }
        self.begin(&inputs.mixture.statistics);
        let owners = owners.map_or(&mut [][..], |owners| owners);
        let columns = Columns { q, owners };
        match inputs.fused(points) {
            Some(inputs) => self.run_fused(inputs, output, columns),
            None => self.run_plain(PlainInputs { pass: *inputs, points }, output, columns),
        }
    }

    fn run_fused(&self, inputs: FusedInputs, output: Output, columns: Columns) {
        let all = 0..inputs.points.n_tiles();
        for_each_task(inputs.points, all, columns, &|tiles, columns| {
            let mut worker = self.worker();
            let Worker { fused, narrow, clock, .. } = &mut *worker;
            let records = (output == Output::ElboAndSums).then_some(&mut narrow[..]);
            Isa::best().run(FusedTiles {
                inputs,
                memory: fused,
                tiles,
                q: columns.q,
                owners: columns.owners,
                records,
                clock,
            });
        });
    }

    fn run_plain<R: PaperScalar>(&self, inputs: PlainInputs<R>, output: Output, columns: Columns) {
        let all: Vec<u32> = (0..inputs.points.n_tiles() as u32).collect();
        for_each_part(inputs.points, &all, 0, columns, &|tile, columns| {
            let mut worker = self.worker();
            let Worker { plain, ids, scores, narrow, wide, clock, .. } = &mut *worker;
            let range = inputs.points.tile(tile);
            // Stages are slow in this implementation, so every tile can be timed.
            clock.begin_tile(true);
            inputs.find(plain, range.clone(), ids);
            clock.lap(PaperStage::Candidates);
            scores.resize(ids.len(), 0.0);
            inputs.score(range, ids, scores);
            inputs.normalise(scores, columns.q);
            inputs.find_owners(ids, scores, columns.owners);
            clock.lap(PaperStage::EStep);
            if output == Output::ElboAndSums {
                let pairs = (&ids[..], &scores[..]);
                let PlainMemory { slots, ids_by_slot, narrow_sums, wide_sums, .. } = plain;
                match inputs.operations().moments {
                    Width::F32 => inputs.sum(slots, ids_by_slot, narrow_sums, tile, pairs, narrow),
                    Width::F64 => inputs.sum(slots, ids_by_slot, wide_sums, tile, pairs, wide),
                }
                clock.lap(PaperStage::Stats);
            }
        });
    }

    /// Computes the candidates of each point with their responsibilities.
    pub fn responsibilities<R: PaperScalar>(
        inputs: &PassInputs<R>,
        points: &Points<R>,
    ) -> Vec<Vec<(u32, f64)>> {
        let inputs = PlainInputs { pass: *inputs, points };
        let (mut memory, mut ids) = (PlainMemory::default(), Vec::new());
        let per_point = inputs.per_point();
        let mut found = Vec::with_capacity(points.len());
        for tile in 0..points.n_tiles() {
            let range = points.tile(tile);
            inputs.find(&mut memory, range.clone(), &mut ids);
            let (mut scores, mut q) = (vec![0.0; ids.len()], vec![0.0; range.len()]);
            inputs.score(range, &ids, &mut scores);
            inputs.normalise(&mut scores, &mut q);
            let pairs: Vec<(u32, f64)> = ids.iter().copied().zip(scores).collect();
            found.extend(pairs.chunks(per_point.max(1)).map(<[_]>::to_vec));
        }
        found
    }

    /// Prepares a pass on the CPU: clears the records. Every thread reserves space for all records of
    /// the last pass, as each frame divides the tiles differently among the threads.
    pub(super) fn begin(&mut self, statistics: &Statistics) {
        self.make_workers(statistics);
        for shard in 0..statistics.shards() {
            let seen = self.read_workers().map(|w| w.records_of(shard)).fold([0; 2], add);
            self.clear_records(shard, seen);
        }
    }

    /// Prepares a pass on a device: clears the records. The device's records are divided equally among
    /// the threads, so reserving space for all of them in each thread would waste memory.
    pub(super) fn begin_device_pass(&mut self, statistics: &Statistics) {
        self.make_workers(statistics);
        (0..statistics.shards()).for_each(|shard| self.clear_records(shard, [0; 2]));
    }

    fn make_workers(&mut self, statistics: &Statistics) {
        self.again.is_again.clear();
        // Never fewer than before: a temporarily smaller pool must not free memory.
        let n_workers = rayon::current_num_threads().max(self.workers.len());
        self.workers.resize_with(n_workers, || {
            let fused = FusedMemory::new(statistics.len());
            RwLock::new(Worker { fused, ..Worker::default() })
        });
    }

    fn clear_records(&mut self, shard: usize, seen: [usize; 2]) {
        for worker in &mut self.workers {
            let worker = worker.get_mut().unwrap_or_else(PoisonError::into_inner);
            worker.first_run.clear();
            worker.clear_records(shard, seen);
        }
    }

    pub(super) fn worker(&self) -> RwLockWriteGuard<'_, Worker> {
        // Each thread uses the memory of its own index, so the lock is never contended; it only proves
        // exclusive access in safe code.
        let thread = rayon::current_thread_index().unwrap_or(0) % self.workers.len();
        self.workers[thread].write().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn read_workers(&self) -> impl Iterator<Item = RwLockReadGuard<'_, Worker>> {
        self.workers.iter().map(|w| w.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Adds the sums of the last pass to the totals.
    pub fn commit(&self, statistics: &mut Statistics, moments: Width) {
        // Any order of threads works: integer sums do not depend on it.
        match moments {
            Width::F32 => statistics.add_frame(|shard, add| {
                self.read_workers().for_each(|w| {
                    let n_first = w.first_run.get(shard).map_or(0, |n| *n);
                    self.again.valid_records(&w.narrow[shard], n_first).for_each(&mut *add);
                });
            }),
            Width::F64 => statistics.add_frame(|shard, add| {
                self.read_workers().for_each(|w| add(&w.wide[shard]));
            }),
        }
    }

    /// Returns the thread time of search, E-step and sums in the last pass, in nanoseconds, and resets
    /// the times. Tiles are sampled, so only the proportions are meaningful.
    pub fn take_stage_nanos(&mut self) -> [u64; 3] {
        let mut sum = [0; 3];
        for worker in &mut self.workers {
            let worker = worker.get_mut().unwrap_or_else(PoisonError::into_inner);
            let own = worker.clock.take_nanos();
            sum = std::array::from_fn(|i| sum[i] + own[i]);
        }
        sum
    }
}

impl<R: PaperScalar> Mixture<R> {
    /// Returns the initial spatial means of the current model, sorted by grid cell.
    pub fn sorted(&self) -> &SortedMeans {
        self.index.sorted(&self.model)
    }
}

impl<'a, R: PaperScalar> PassInputs<'a, R> {
    /// Returns the inputs of the fused kernels; `None` if the kernels do not support the configuration.
    pub fn fused(&self, points: &'a Points<R>) -> Option<FusedInputs<'a>> {
        let Mixture { model, scoring, statistics, .. } = self.mixture;
        let rank = self.fused_rank()?;
        let SortedMeans { grid, appearance, .. } = self.mixture.sorted();
        Some(FusedInputs {
            rank,
            points: narrow(points)?,
            grid,
            appearance,
            max_weight: narrow::<_, InitialModel<f32>>(model)?.max_weight,
            scoring,
            shard_bits: statistics.shard_bits(),
        })
    }

    /// Returns the number of candidates per point; `None` if the fused kernels do not support the
    /// configuration.
    pub fn fused_rank(&self) -> Option<usize> {
        let PaperConfig { operations, is_plain, .. } = self.mixture.config;
        let Operations { distance, log_score, normaliser, moments, .. } = operations;
        let is_narrow = [distance, log_score, normaliser, moments].iter().all(|&w| w == Width::F32);
        match self.candidates {
            Candidates::Nearest(n) if is_narrow && !is_plain => {
                // There may be fewer components than candidates: all are candidates then.
                Some(n.min(self.mixture.model.len())).filter(|&rank| rank > 0)
            }
            _ => None,
        }
    }
}

const PART: usize = 64;

impl Pass {
    /// Runs some tiles of the last pass again: those within reach of `places`, the positions that means
    /// have since left or moved to. Returns the number of these tiles. Afterwards the results equal
    /// those of a full pass.
    pub fn run_reached(
        &mut self,
        inputs: &FusedInputs<'_>,
        places: &[[f32; 3]],
        q: &mut [f64],
        owners: Option<&mut Vec<u32>>,
    ) -> usize {
        // Taken out of `self`, whose workers the search borrows.
        let mut again = std::mem::take(&mut self.again);
        self.find_reached(inputs, places, q, &mut again);
        for worker in &mut self.workers {
            let worker = worker.get_mut().unwrap_or_else(PoisonError::into_inner);
            worker.first_run.clear();
            // Records up to here are those of the first run.
            worker.first_run.extend(worker.narrow.iter().map(Vec::len));
        }
        let owners = owners.map_or(&mut [][..], |owners| owners);
        self.run_some(inputs, &again.tiles, Output::ElboAndSums, q, owners);
        self.again = again;
        self.again.tiles.len()
    }

    fn find_reached(
        &self,
        inputs: &FusedInputs<'_>,
        places: &[[f32; 3]],
        q: &[f64],
        again: &mut RerunTiles,
    ) {
        let RerunTiles { is_again, tiles, places: grid } = again;
        is_again.clear();
        // If no grid can hold the places, all tiles count as reached.
        is_again.resize(inputs.points.n_tiles(), grid.rebuild(places).is_err());
        let parts = is_again.par_chunks_mut(PART).enumerate();
        parts.for_each(|(part, is_again)| {
            let mut worker = self.worker();
            for (tile, is_again) in (part * PART..).zip(is_again) {
                *is_again = *is_again || worker.reach.reaches(inputs, tile, q, grid);
            }
        });
        tiles.clear();
        tiles.reserve(is_again.len());
        tiles
            .extend((0..).zip(&*is_again).filter(|(_, is_again)| **is_again).map(|(tile, _)| tile));
    }

    /// Scores the points of the given tiles and, if requested, sums them. The tiles are ascending and
    /// unique. `q` covers all points, as does `owners` unless it is empty.
    pub fn run_some(
        &self,
        inputs: &FusedInputs<'_>,
        tiles: &[u32],
        output: Output,
        q: &mut [f64],
        owners: &mut [u32],
    ) {
        let columns = Columns { q, owners };
        for_each_part(inputs.points, tiles, 0, columns, &|tile, columns| {
            let mut worker = self.worker();
            let Worker { fused: memory, narrow, clock, .. } = &mut *worker;
            let records = (output == Output::ElboAndSums).then_some(&mut narrow[..]);
            let (inputs, tiles, Columns { q, owners }) = (*inputs, tile..tile + 1, columns);
            Isa::best().run(FusedTiles { inputs, memory, tiles, q, owners, records, clock });
        });
    }
}
