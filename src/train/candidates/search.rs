//! Exact nearest means of all points of a tile at once (`train.md`, Candidate search).
//!
//! What the means near a tile have in common is found once: a list of all that can be among the
//! nearest of any of its points, then a shorter one for every sixteen points. Bounds follow from
//! the triangle inequality and carry margins for rounding, which cost candidates, never
//! correctness.

use super::columns::{CHUNK, Columns};
use super::extent::{Extent, MAX_RADIUS};
use super::grid::MeanGrid;
use super::lists::Lists;
use crate::math::simd::Vector;
use std::ops::Range;

/// A group of points that is longer than this many cells is split.
// Tiles across a depth edge split, tiles of one surface stay whole. Smaller groups brought nothing,
// not even on stepped depth (`train.md`, Tried and dropped).
const MAX_GROUP_CELLS: f32 = 2.0;
/// The first guess of the distance of the neighbours, as a multiple of the last one.
const NEAREST_GUESS: f32 = 1.1;

/// Memory of a search, grow-only. It carries nothing from tile to tile but a first guess.
#[derive(Debug, Default)]
pub struct CandidateSearch {
    tile: Tile,
    lists: Lists,
    pending: Vec<Range<usize>>,
    /// Distance of the last group's neighbours.
    nearest: f32,
}

/// Points of a tile group by group; the tag is their place in the tile.
#[derive(Debug, Default)]
struct Tile {
    points: Columns,
    swap: Vec<([f32; 3], u32)>,
}

/// What is done with at most [`CHUNK`] points and the lists their neighbours are in.
pub(in crate::train) trait VisitChunk {
    /// `lists` holds the nearest entries of the points `chunk` of `points`, whose tag is their
    /// place in the tile. Must be `#[inline(always)]`.
    fn visit<V: Vector>(&mut self, lists: &mut Lists, points: &Columns, chunk: Range<usize>);
}

impl CandidateSearch {
    /// Visits the points of a tile in chunks, each point once, with lists that hold its `rank`
    /// nearest entries; `rank` is at most the number of means and more than 0.
    #[inline(always)]
    pub(in crate::train) fn visit_tile<V: Vector>(
        &mut self,
        grid: &MeanGrid,
        tile: [&[f32]; 3],
        rank: usize,
        visitor: &mut impl VisitChunk,
    ) {
        if tile[0].is_empty() {
            return;
        }
        self.tile.points.load(tile);
        self.pending.push(0..tile[0].len());
        while let Some(group) = self.pending.pop() {
            let extent = Extent::of::<V>(&self.tile.points, group.clone());
            let middle = if group.len() > CHUNK && extent.length() > MAX_GROUP_CELLS * grid.cell() {
                self.tile.split(group.clone(), &extent)
            } else {
                group.start
            };
            if group.start < middle && middle < group.end {
                // The first half is taken next: groups follow each other in space, where the last
                // distance is a good guess.
                self.pending.push(middle..group.end);
                self.pending.push(group.start..middle);
            } else {
                self.gather::<V>(grid, &extent, rank);
                let Self { tile, lists, .. } = self;
                for start in group.clone().step_by(CHUNK) {
                    let chunk = start..(start + CHUNK).min(group.end);
                    visitor.visit::<V>(lists, &tile.points, chunk);
                }
            }
        }
    }

    /// Fills the raw list with a superset of the `rank` nearest entries of every point of a group.
    #[inline(always)]
    fn gather<V: Vector>(&mut self, grid: &MeanGrid, extent: &Extent, rank: usize) {
        let Self { lists, nearest, .. } = self;
        if !extent.is_finite() {
            return grid.gather_all(lists.raw_mut());
        }
        // Any start is right: every list is a superset, and what is found in it is the same.
        let mut radius = extent.reach_of(NEAREST_GUESS * *nearest);
        // The first group, or one after distances that overflowed.
        if !(radius > 0.0 && radius < MAX_RADIUS) {
            radius = grid.cell();
        }
        loop {
            grid.gather(extent.lo, extent.hi, radius, lists.raw_mut());
            if lists.raw().len >= rank {
                break;
            }
            // Doubling alone would creep where a group lies far from all means.
            radius = (2.0 * radius).max(grid.gap(extent.lo, extent.hi) + grid.cell());
        }
        *nearest = lists.raw_bound2::<V>(extent.centre, rank).sqrt();
        let needed = extent.reach_of(*nearest);
        if needed > radius {
            grid.gather(extent.lo, extent.hi, needed, lists.raw_mut());
        }
    }
}

impl Tile {
    /// Moves the points below the middle of the longest axis to the front, keeping their order;
    /// returns where the others start.
    fn split(&mut self, group: Range<usize>, extent: &Extent) -> usize {
        let Self { points, swap } = self;
        let length = |axis: usize| extent.hi[axis] - extent.lo[axis];
        let axis =
            (0..3).fold(0, |best, axis| if length(axis) > length(best) { axis } else { best });
        swap.clear();
        let mut next = group.start;
        for i in group {
            let (position, tag) = (points.position(i), points.tag[i]);
            if position[axis] < extent.centre[axis] {
                points.set(next, position, tag);
                next += 1;
            } else {
                swap.push((position, tag));
            }
        }
        for (i, &(position, tag)) in (next..).zip(swap.iter()) {
            points.set(i, position, tag);
        }
        next
    }
}
