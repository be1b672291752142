//! Fused search, E-step and sums of a tile in f32 (`training.md`, Candidate search).
//!
//! A point is assigned entirely to its nearest component if no other component comes within 40 nats of
//! it. A lower bound on the distances of all others proves this for nearly all points. The remaining
//! points are ranked and scored against all C candidates. The points of a tile are summed in order,
//! into one record per component and tile. So records depend only on the tile and the means.
//!
//! Stages are fused because a tile of at most 64 points and its lists fit in the first-level cache;
//! candidates and responsibilities of a whole frame do not. Fused multiply-add and lane-dependent order
//! are avoided: otherwise results would differ between instruction sets, and shards could not be
//! merged.

use crate::math::simd::{Kernel, Vector};
use crate::model::conjugate::statistics::{N_SUMS, TileRecord, add_point};
use crate::observation::points::Points;
use crate::train::candidates::{
    CHUNK, CandidateSearch, Columns, ListKind, Lists, MeanGrid, Nearest, VisitChunk,
};
use crate::train::component_elbo::{NO_OWNER, owner_of_shares};
use crate::train::estep::{Scoring, squared_distance};
use crate::train::timing::{PaperStage, StageClock};
use std::ops::Range;

// Marks an owner that refers to shares of several components. `NO_OWNER` has this bit too, so
// owners without it are slots.
const SHARED: u32 = 1 << 31;

#[derive(Clone, Copy)]
pub(super) struct FusedInputs<'a> {
    pub grid: &'a MeanGrid,
    /// For each grid entry: mean colour (three values) and weight of its component.
    pub appearance: &'a [[f32; 4]],
    pub max_weight: f32,
    pub points: &'a Points<f32>,
    pub scoring: &'a Scoring,
    /// Number of candidates per point, between 1 and the number of components.
    pub rank: usize,
    /// Binary logarithm of the number of components per shard of the totals.
    pub shard_bits: u32,
}

impl FusedInputs<'_> {
    /// Returns the squared distance beyond which no component affects a point of effective distance
    /// `q`, with a margin for rounding.
    ///
    /// The distance allows for twice the hard gap (the score difference beyond which a component
    /// receives nothing). A component between one gap and two receives nothing, whether or not it is a
    /// candidate.
    pub fn influence_radius2(&self, q: f64) -> f32 {
        let gap = 2.0 * self.scoring.hard_gap() as f32;
        // The factor covers the rounding of the sum and of the distances compared with it.
        ((q as f32 + self.max_weight) + gap) * (1.0 + 1e-5)
    }
}

pub(super) struct FusedTiles<'a> {
    pub inputs: FusedInputs<'a>,
    pub memory: &'a mut FusedMemory,
    pub tiles: Range<usize>,
    /// Output: effective distance of each point of the tiles.
    pub q: &'a mut [f64],
    /// Output: component with the largest responsibility for each point of the tiles; empty if not
    /// requested.
    pub owners: &'a mut [u32],
    /// Output: sums of the tiles by shard; `None` to compute only scores.
    pub records: Option<&'a mut [Vec<TileRecord<f32>>]>,
    pub clock: &'a mut StageClock,
}

// Initial capacity in slots: four per point of a tile.
const USUAL_SLOTS: usize = 256;

/// Scratch memory of a thread, reused between tiles. Results do not depend on earlier tiles.
#[derive(Default)]
pub(super) struct FusedMemory {
    search: CandidateSearch,
    tile: TileMemory,
    sums: Vec<[f32; N_SUMS]>,
}

impl FusedMemory {
    /// Allocates the memory that tiles of a model with `components` components usually need.
    pub fn new(components: usize) -> Self {
        // Allocated up front: the assignment of tiles to threads changes from frame to frame, and a warm
        // frame must allocate nothing (`tests/engine/allocations.rs`).
        let mut memory = Self::default();
        memory.tile.slots.begin(components);
        memory.tile.components.reserve(USUAL_SLOTS);
        memory.tile.owners.reserve(USUAL_SLOTS);
        memory.tile.shared.reserve(USUAL_SLOTS);
        memory.tile.shares.reserve(USUAL_SLOTS);
        memory.tile.candidates.reserve(USUAL_SLOTS);
        memory.tile.scores.reserve(USUAL_SLOTS);
        memory.sums.reserve(USUAL_SLOTS);
        memory
    }
}

#[derive(Default)]
struct TileMemory {
    slots: Slots,
    components: Vec<Component>,
    /// Owner of each point of the tile: a slot, [`SHARED`] plus an index into `shared`, or
    /// [`NO_OWNER`].
    owners: Vec<u32>,
    shared: Vec<Range<u32>>,
    shares: Vec<(u32, f32)>,
    /// Component and grid entry of one point's candidates; `scores` holds their scores in the same
    /// order.
    candidates: Vec<(u32, u32)>,
    scores: Vec<f64>,
}

/// Copy of the data of a component that a tile uses.
#[derive(Clone, Copy)]
struct Component {
    space: [f32; 3],
    color: [f32; 3],
    weight: f32,
    id: u32,
}

impl Kernel for FusedTiles<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { inputs, memory, tiles, q, mut owners, mut records, clock } = self;
        let FusedMemory { search, tile: tile_memory, sums } = memory;
        let points = inputs.points;
        // `q` covers the points of this task only.
        let first_point = points.tiles[tiles.start] as usize;
        let color_ratio = inputs.scoring.color_ratio as f32;
        let hard_gap = inputs.scoring.hard_gap() as f32;
        for tile in tiles.clone() {
            // Reading the clock costs as much as scoring a point, so only the first tile of a task is
            // timed.
            clock.begin_tile(tile == tiles.start);
            let range = points.tile(tile);
            tile_memory.begin(inputs.grid.len(), range.len());
            let q = &mut q[range.start - first_point..range.end - first_point];
            let xyz =
                [&points.x[range.clone()], &points.y[range.clone()], &points.z[range.clone()]];
            let mut assign = OwnerAssigner {
                inputs: &inputs,
                memory: tile_memory,
                first_point: range.start,
                q,
                clock,
                color_ratio,
                hard_gap,
            };
            search.visit_tile::<V>(inputs.grid, xyz, inputs.rank, &mut assign);
            if !owners.is_empty() {
                let (own, later) = owners.split_at_mut(range.len());
                tile_memory.find_owners(own);
                owners = later;
            }
            clock.lap(PaperStage::Candidates);
            if let Some(records) = &mut records {
                tile_memory.sum(points, range, sums);
                for (component, &sums) in tile_memory.components.iter().zip(&*sums) {
                    // Every component examined has a slot, but most of those that lost receive nothing.
                    if sums[0] > 0.0 {
                        let record = TileRecord { id: component.id, tile: tile as u32, sums };
                        records[component.id as usize >> inputs.shard_bits].push(record);
                    }
                }
                clock.lap(PaperStage::Stats);
            }
        }
    }
}

impl TileMemory {
    #[inline(always)]
    fn begin(&mut self, components: usize, n_points: usize) {
        self.slots.begin(components);
        self.components.clear();
        self.shared.clear();
        self.shares.clear();
        self.owners.clear();
        self.owners.resize(n_points, NO_OWNER);
    }

    /// Writes the component with the largest responsibility for each point to `owners`.
    fn find_owners(&self, owners: &mut [u32]) {
        let id = |slot: u32| self.components[slot as usize].id;
        for (of_point, &owner) in owners.iter_mut().zip(&self.owners) {
            *of_point = if owner & SHARED == 0 {
                id(owner)
            } else if owner == NO_OWNER {
                NO_OWNER
            } else {
                let shares = self.shared[(owner & !SHARED) as usize].clone();
                let shares = &self.shares[shares.start as usize..shares.end as usize];
                owner_of_shares(shares.iter().map(|&(slot, r)| (id(slot), r.into())))
            };
        }
    }

    /// Sums the tile's points, in order, into one row per slot.
    #[inline(always)]
    fn sum(&self, points: &Points<f32>, range: Range<usize>, sums: &mut Vec<[f32; N_SUMS]>) {
        sums.clear();
        sums.resize(self.components.len(), [0.0; N_SUMS]);
        // In point order, not by search groups: those depend on the grid, and f32 sums on the order.
        for (i, &owner) in range.zip(&self.owners) {
            let (space, color) = (points.position(i), points.color(i));
            if owner & SHARED == 0 {
                self.add(owner, 1.0, space, color, sums);
            } else if owner != NO_OWNER {
                let shares = self.shared[(owner & !SHARED) as usize].clone();
                for &(slot, r) in &self.shares[shares.start as usize..shares.end as usize] {
                    self.add(slot, r, space, color, sums);
                }
            }
        }
    }

    // No closure: it would not be compiled for the kernel's instruction set.
    #[inline(always)]
    fn add(&self, slot: u32, r: f32, space: [f32; 3], color: [f32; 3], sums: &mut [[f32; N_SUMS]]) {
        let mean = self.components[slot as usize].space;
        let d = [space[0] - mean[0], space[1] - mean[1], space[2] - mean[2]];
        add_point(&mut sums[slot as usize], r, d, color);
    }
}

struct OwnerAssigner<'a> {
    inputs: &'a FusedInputs<'a>,
    memory: &'a mut TileMemory,
    first_point: usize,
    q: &'a mut [f64],
    clock: &'a mut StageClock,
    color_ratio: f32,
    hard_gap: f32,
}

impl VisitChunk for OwnerAssigner<'_> {
    #[inline(always)]
    fn visit<V: Vector>(&mut self, lists: &mut Lists, points: &Columns, chunk: Range<usize>) {
        let nearest: [Nearest; CHUNK] = lists.nearest::<V>(points, chunk.clone());
        self.clock.lap(PaperStage::Candidates);
        for (i, nearest) in chunk.zip(nearest) {
            let place = points.tag[i] as usize;
            let (space, color) =
                (points.position(i), self.inputs.points.color(self.first_point + place));
            let slot = self.slot(nearest.entry);
            let q = self.distance(slot, space, color);
            if self.is_sole_owner(slot, space, q, nearest.second2) {
                // A share of 1 needs no entry in the list of shares.
                self.memory.owners[place] = slot as u32;
                self.q[place] = q.into();
            } else {
                self.assign_shares::<V>(lists, place, q, space, color);
            }
        }
        self.clock.lap(PaperStage::EStep);
    }
}

impl OwnerAssigner<'_> {
    #[inline(always)]
    fn slot(&mut self, entry: u32) -> usize {
        let slot = self.memory.slots.find(entry);
        if slot == self.memory.components.len() {
            let [r, g, b, weight] = self.inputs.appearance[entry as usize];
            self.memory.components.push(Component {
                space: self.inputs.grid.mean(entry),
                color: [r, g, b],
                weight,
                id: self.inputs.grid.ids()[entry as usize],
            });
        }
        slot
    }

    /// Computes the score `q` of a point for the component of a slot.
    #[inline(always)]
    fn distance(&self, slot: usize, space: [f32; 3], color: [f32; 3]) -> f32 {
        let component = &self.memory.components[slot];
        squared_distance(space, component.space)
            + self.color_ratio * squared_distance(color, component.color)
            - component.weight
    }

    /// True if no other component can come within the hard gap of the score `q` of this slot's
    /// component.
    ///
    /// Any other component has a score of at least `second2 − w_max`, also in f32, since rounding is
    /// monotone. With a single candidate per point it suffices that this component is the nearest.
    #[inline(always)]
    fn is_sole_owner(&self, slot: usize, space: [f32; 3], q: f32, second2: f32) -> bool {
        if self.inputs.rank == 1 {
            return second2 > squared_distance(space, self.memory.components[slot].space);
        }
        self.is_out_of_reach(q, second2)
    }

    /// True if a component at this squared distance cannot come within the hard gap (see
    /// [`Scoring::hard_gap`]) of the score `q`.
    #[inline(always)]
    fn is_out_of_reach(&self, q: f32, distance2: f32) -> bool {
        (distance2 - self.inputs.max_weight) - q > self.hard_gap
    }

    /// Divides a point among all candidates that may come within the hard gap of the score `q`.
    /// Candidates are scored in ascending order of components; the other components would receive
    /// nothing.
    #[inline(always)]
    fn assign_shares<V: Vector>(
        &mut self,
        lists: &mut Lists,
        place: usize,
        q: f32,
        space: [f32; 3],
        color: [f32; 3],
    ) {
        let (ids, rank) = (self.inputs.grid.ids(), self.inputs.rank);
        // Beyond this distance `is_out_of_reach` holds, including rounding.
        let reach2 = ((q + self.inputs.max_weight) + self.hard_gap) * (1.0 + 1e-5);
        let (among, within2) = match rank {
            // A single candidate receives the point however far away it is.
            1 => (ListKind::Raw, f32::INFINITY),
            _ => (lists.complete_list_for(space, reach2), reach2),
        };
        let found = lists.rank::<V>(among, space, ids, rank, within2);
        // Taken out of `self` because `slot` borrows it mutably; put back at the end.
        let mut candidates = std::mem::take(&mut self.memory.candidates);
        candidates.clear();
        // The low half of a key is the component.
        candidates.extend(found.iter().map(|&(key, entry)| (key as u32, entry)));
        // Sorted by component, not by distance, so that sums and ties do not depend on the order of the
        // index.
        candidates.sort_unstable();
        let mut scores = std::mem::take(&mut self.memory.scores);
        scores.clear();
        for &(_, entry) in &candidates {
            let slot = self.slot(entry);
            scores.push(self.distance(slot, space, color).into());
        }
        let q = self.inputs.scoring.responsibilities::<f32>(&mut scores);
        self.q[place] = q;
        if q.is_finite() {
            let first = self.memory.shares.len() as u32;
            for (&(_, entry), &r) in candidates.iter().zip(&scores).filter(|(_, r)| **r > 0.0) {
                let slot = self.slot(entry) as u32;
                self.memory.shares.push((slot, r as f32));
            }
            self.memory.owners[place] = SHARED | self.memory.shared.len() as u32;
            self.memory.shared.push(first..self.memory.shares.len() as u32);
        } else {
            // A NaN point has candidates, but must not reach any sum.
            self.q[place] = f64::NAN;
        }
        (self.memory.candidates, self.memory.scores) = (candidates, scores);
    }
}

/// Numbers the distinct keys of a tile, such as grid entries, consecutively from 0; these numbers are
/// called slots. Each tile has its own stamp, so the table need not be cleared between tiles.
#[derive(Debug, Default)]
pub(super) struct Slots {
    /// For each key: the last tile that used it, and its slot there.
    stamps: Vec<(u32, u32)>,
    tile: u32,
    n: u32,
}

impl Slots {
    /// Begins a tile without slots. The keys of the tile are below `bound`.
    #[inline(always)]
    pub fn begin(&mut self, bound: usize) {
        // When the stamp wraps, slots of early tiles could be mistaken for this one's, so it is reset.
        if self.stamps.len() < bound || self.tile == u32::MAX {
            self.stamps.clear();
            self.stamps.resize(bound, (0, 0));
            self.tile = 0;
        }
        self.tile += 1;
        self.n = 0;
    }

    /// Returns the slot of `key` in this tile. A new key gets the next slot.
    #[inline(always)]
    pub fn find(&mut self, key: u32) -> usize {
        let seen = &mut self.stamps[key as usize];
        if seen.0 != self.tile {
            *seen = (self.tile, self.n);
            self.n += 1;
        }
        seen.1 as usize
    }
}

#[cfg(test)]
mod slots_tests {
    use super::*;

    #[test]
    fn keys_are_numbered_in_order_of_appearance() {
        let mut slots = Slots::default();
        for tile in 0..3 {
            if tile == 2 {
                slots.tile = u32::MAX; // the stamp starts over
            }
            slots.begin(100_001);
            let found = [7, 9, 7, 100_000, 9, 0].map(|key| slots.find(key));
            assert_eq!(found, [0, 1, 0, 2, 1, 3]);
        }
    }
}
