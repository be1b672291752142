//! One parallel pass over a frame's points: search, E-step and per-tile sums.
//!
//! Work is split by tiles, and a tile's sums depend on its points alone, so the records, and the
//! fixed-point totals they end in, are the same for any number of threads.

use super::candidates::Scalar;
use super::config::Candidates;
use super::estep::Scoring;
use super::timing::Stopwatch;
use crate::math::points::Points;
use crate::model::mixture::InitialModel;
use crate::model::statistics::Record;
use rayon::prelude::*;
use std::num::NonZero;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Tiles one task takes: about a thousand points, a few hundred microseconds of search.
const TILES_PER_GROUP: usize = 16;

/// What a pass is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// Per-point ELBO only: the pre-pass of reassignment.
    Elbo,
    /// ELBO and sums.
    ElboAndSums,
}

/// Buffers of a pass, reused from frame to frame.
#[derive(Default)]
pub struct Pass<R: Scalar> {
    groups: Vec<Group<R>>,
    n_groups: usize,
    /// One per thread: what a group leaves there never changes what the next one finds.
    workers: Vec<Mutex<Worker<R>>>,
}

/// The fixed inputs of a pass.
pub struct Inputs<'a, R: Scalar> {
    /// Initial model.
    pub model: &'a InitialModel<R>,
    /// Index over its spatial means.
    pub index: &'a R::Index,
    /// Constants of the score.
    pub scoring: Scoring<R>,
    /// Components each point is compared with.
    pub candidates: Candidates,
}

/// What the tiles of one task give.
#[derive(Debug, Default)]
struct Group<R> {
    records: Vec<Record<R>>,
    elbo: Vec<f64>,
    nanos: [u64; 3],
}

/// Memory of one thread. Candidates and responsibilities are those of one tile, equally many for
/// each of its points.
#[derive(Default)]
struct Worker<R: Scalar> {
    search: R::Scratch,
    ids: Vec<u32>,
    responsibilities: Vec<R>,
    slots: SlotTable,
}

impl<R: Scalar> Pass<R> {
    /// Runs over all points.
    pub fn run(&mut self, inputs: &Inputs<R>, points: &Points<R>, output: Output) {
        self.n_groups = points.n_tiles().div_ceil(TILES_PER_GROUP);
        if self.groups.len() < self.n_groups {
            self.groups.resize_with(self.n_groups, Group::default);
        }
        self.workers
            .resize_with(rayon::current_num_threads().max(self.workers.len()), Mutex::default);
        let workers = &self.workers;
        self.groups[..self.n_groups].par_iter_mut().with_max_len(1).enumerate().for_each(
            |(index, group)| {
                let first = index * TILES_PER_GROUP;
                let tiles = first..(first + TILES_PER_GROUP).min(points.n_tiles());
                let worker = &workers[rayon::current_thread_index().unwrap_or(0) % workers.len()];
                let mut worker = worker.lock().unwrap_or_else(PoisonError::into_inner);
                group.run(&mut worker, inputs, points, tiles, output);
            },
        );
    }

    /// Per point its candidates and their responsibilities.
    pub fn responsibilities(inputs: &Inputs<R>, points: &Points<R>) -> Vec<Vec<(u32, f64)>> {
        let mut worker = Worker::default();
        let (mut found, mut elbo) = (Vec::with_capacity(points.len()), Vec::new());
        for tile in 0..points.n_tiles() {
            let range = points.tile(tile);
            worker.find_candidates(inputs, points, range.clone());
            worker.score(inputs, points, range.clone(), &mut elbo);
            let per_point = (worker.ids.len() / range.len()).max(1);
            let pairs = worker.ids.chunks(per_point).zip(worker.responsibilities.chunks(per_point));
            let of_point = |(ids, r): (&[u32], &[R])| {
                ids.iter().zip(r).map(|(&id, r)| (id, r.to_f64())).collect::<Vec<_>>()
            };
            found.extend(pairs.map(of_point));
        }
        found
    }

    /// Sums of the last pass, tile by tile.
    pub fn records(&self) -> impl Iterator<Item = &Record<R>> {
        self.groups[..self.n_groups].iter().flat_map(|g| &g.records)
    }

    /// ELBO of every point of the last pass, in point order.
    pub fn elbo_into(&self, elbo: &mut Vec<f64>) {
        elbo.clear();
        for group in &self.groups[..self.n_groups] {
            elbo.extend_from_slice(&group.elbo);
        }
    }

    /// Time all threads together spent in search, E-step and sums of the last pass.
    pub fn thread_nanos(&self) -> [u64; 3] {
        self.groups[..self.n_groups]
            .iter()
            .fold([0; 3], |sum, g| std::array::from_fn(|i| sum[i] + g.nanos[i]))
    }
}

impl<R: Scalar> Group<R> {
    fn run(
        &mut self,
        worker: &mut Worker<R>,
        inputs: &Inputs<R>,
        points: &Points<R>,
        tiles: Range<usize>,
        output: Output,
    ) {
        self.records.clear();
        self.elbo.clear();
        self.nanos = [0; 3];
        let mut clock = Stopwatch::start();
        for tile in tiles {
            let range = points.tile(tile);
            worker.find_candidates(inputs, points, range.clone());
            self.nanos[0] += clock.lap_nanos();
            worker.score(inputs, points, range.clone(), &mut self.elbo);
            self.nanos[1] += clock.lap_nanos();
            if output == Output::ElboAndSums {
                worker.sum(inputs.model, points, range, &mut self.records);
            }
            self.nanos[2] += clock.lap_nanos();
        }
    }
}

impl<R: Scalar> Worker<R> {
    fn find_candidates(&mut self, inputs: &Inputs<R>, points: &Points<R>, range: Range<usize>) {
        self.ids.clear();
        match inputs.candidates {
            Candidates::Dense => {
                let all = 0..inputs.model.len() as u32;
                range.for_each(|_| self.ids.extend(all.clone()));
            }
            Candidates::Nearest(n) => {
                if let Some(n) = NonZero::new(n) {
                    let Self { search, ids, .. } = self;
                    R::nearest_in_tile(inputs.index, search, points, range, n, ids);
                }
            }
        }
    }

    fn score(
        &mut self,
        inputs: &Inputs<R>,
        points: &Points<R>,
        range: Range<usize>,
        elbo: &mut Vec<f64>,
    ) {
        let per_point = self.ids.len() / range.len().max(1);
        self.responsibilities.clear();
        for (local, point) in range.enumerate() {
            let (space, color) = (points.position(point), points.color(point));
            let own = local * per_point..(local + 1) * per_point;
            let distance =
                |&id: &u32| inputs.scoring.distance(inputs.model, id as usize, space, color);
            self.responsibilities.extend(self.ids[own.clone()].iter().map(distance));
            elbo.push(inputs.scoring.responsibilities(&mut self.responsibilities[own]));
        }
    }

    /// Appends one record per component the tile touches, points in order.
    fn sum(
        &mut self,
        model: &InitialModel<R>,
        points: &Points<R>,
        range: Range<usize>,
        records: &mut Vec<Record<R>>,
    ) {
        let per_point = self.ids.len() / range.len().max(1);
        self.slots.begin(self.ids.len());
        let tile_start = records.len();
        for (local, point) in range.enumerate() {
            let (space, color) = (points.position(point), points.color(point));
            for pair in local * per_point..(local + 1) * per_point {
                let r = self.responsibilities[pair];
                if r == R::ZERO {
                    continue;
                }
                let id = self.ids[pair];
                let next = records.len() - tile_start;
                let slot = tile_start + self.slots.find_or_insert(id, next as u32) as usize;
                if slot == records.len() {
                    records.push(Record::empty(id));
                }
                let mean = model.space[id as usize];
                let offset = std::array::from_fn(|i| space[i] - mean[i]);
                records[slot].add(r, offset, color);
            }
        }
    }
}

/// Maps the component ids of one tile to consecutive slots: open addressing with a generation stamp
/// instead of clearing.
#[derive(Debug, Default)]
struct SlotTable {
    entries: Vec<SlotEntry>,
    generation: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct SlotEntry {
    generation: u32,
    id: u32,
    slot: u32,
}

impl SlotTable {
    /// Forgets all ids and makes room for `n_pairs` of them at half load.
    fn begin(&mut self, n_pairs: usize) {
        let capacity = (2 * n_pairs).next_power_of_two();
        if self.entries.len() < capacity || self.generation == u32::MAX {
            self.entries.clear();
            self.entries.resize(
                capacity.max(self.entries.capacity()).next_power_of_two(),
                SlotEntry::default(),
            );
            self.generation = 0;
        }
        self.generation += 1;
    }

    /// The slot of `id`, or `next` if it is new.
    #[inline(always)]
    fn find_or_insert(&mut self, id: u32, next: u32) -> u32 {
        let mask = self.entries.len() - 1;
        let mut position = id.wrapping_mul(0x9E37_79B1) as usize >> 7 & mask;
        loop {
            let entry = &mut self.entries[position];
            if entry.generation != self.generation {
                *entry = SlotEntry { generation: self.generation, id, slot: next };
                return next;
            }
            if entry.id == id {
                return entry.slot;
            }
            position = (position + 1) & mask;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slot_table_numbers_ids_in_order_of_appearance() {
        let mut table = SlotTable::default();
        for _ in 0..3 {
            table.begin(6);
            let mut next = 0;
            let slots: Vec<u32> = [7, 9, 7, 100_000, 9, 0]
                .iter()
                .map(|&id| {
                    let slot = table.find_or_insert(id, next);
                    next += u32::from(slot == next);
                    slot
                })
                .collect();
            assert_eq!(slots, [0, 1, 0, 2, 1, 3]);
        }
    }
}
