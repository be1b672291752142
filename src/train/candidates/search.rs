//! Exact nearest means of all points of a tile at once (`train.md`, Candidate search).
//!
//! Shared work is done once: a list of all means that can be among the nearest of any point of a group,
//! then a shorter one per sixteen points. Bounds follow from the triangle inequality; their margins for
//! rounding admit extra candidates but never lose one.

use super::columns::{CHUNK, Columns};
use super::extent::{Extent, MAX_RADIUS};
use super::grid::MeanGrid;
use super::lists::Lists;
use crate::math::simd::Vector;
use std::ops::Range;

// Length in cells beyond which a group of points is split. Tiles across a depth edge split, tiles on one
// surface stay whole. Smaller groups gained nothing, even on stepped depth (`train.md`, Tried and dropped).
const MAX_GROUP_CELLS: f32 = 2.0;
/// First guess of the neighbours' distance, relative to the last group's.
const NEAREST_GUESS: f32 = 1.1;

/// Scratch memory of a search, reused. Only a first guess of the radius carries over between tiles.
#[derive(Debug, Default)]
pub struct CandidateSearch {
    tile: Tile,
    lists: Lists,
    pending: Vec<Range<usize>>,
    /// Distance of the last group's neighbours.
    nearest: f32,
}

/// Points of a tile, reordered by group; tags are indices in the tile.
#[derive(Debug, Default)]
struct Tile {
    points: Columns,
    swap: Vec<([f32; 3], u32)>,
}

/// Visitor of at most [`CHUNK`] points with their candidate lists.
pub(in crate::train) trait VisitChunk {
    /// Processes the points `chunk` of `points`, whose nearest entries are in `lists`. Tags are indices in
    /// the tile. Must be `#[inline(always)]`.
    fn visit<V: Vector>(&mut self, lists: &mut Lists, points: &Columns, chunk: Range<usize>);
}

impl CandidateSearch {
    /// Visits each point of a tile once, in chunks, with lists that hold its `rank` nearest entries.
    /// `rank` is between 1 and the number of means.
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
            let extent = Extent::of_points::<V>(&self.tile.points, group.clone());
            let middle = if group.len() > CHUNK && extent.length() > MAX_GROUP_CELLS * grid.cell() {
                self.tile.split(group.clone(), &extent)
            } else {
                group.start
            };
            if group.start < middle && middle < group.end {
                // The first half is next: consecutive groups are then close in space, where the last distance
                // is a good guess.
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

    /// Fills the raw list with a superset of the `rank` nearest entries of each point of a group.
    #[inline(always)]
    fn gather<V: Vector>(&mut self, grid: &MeanGrid, extent: &Extent, rank: usize) {
        let Self { lists, nearest, .. } = self;
        if !extent.is_finite() {
            return grid.gather_all(lists.raw_mut());
        }
        // Any initial radius is correct: every list is a superset and gives the same neighbours.
        let mut radius = extent.neighbour_radius(NEAREST_GUESS * *nearest);
        // For the first group, or after distances that overflowed.
        if !(radius > 0.0 && radius < MAX_RADIUS) {
            radius = grid.cell();
        }
        loop {
            grid.gather(extent.lo, extent.hi, radius, lists.raw_mut());
            if lists.raw().len >= rank {
                break;
            }
            // Doubling alone would be slow for a group far from all means.
            radius = (2.0 * radius).max(grid.gap(extent.lo, extent.hi) + grid.cell());
        }
        *nearest = lists.raw_bound2::<V>(extent.centre, rank).sqrt();
        let needed = extent.neighbour_radius(*nearest);
        if needed > radius {
            grid.gather(extent.lo, extent.hi, needed, lists.raw_mut());
        }
    }
}

impl Tile {
    /// Moves the points below the middle of the longest axis to the front, in order. Returns the index of
    /// the others.
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
