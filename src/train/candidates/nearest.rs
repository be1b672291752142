//! Finds the nearest means of all points of a tile, in f32 or f64.
//!
//! For up to eight neighbours, sorted keys suffice for nearly all points. For more neighbours, or if
//! rounding hides the order, candidates are ranked point by point. In f64, candidates are found with
//! the means rounded to f32, then ranked by f64 distances. The margins of the candidate lists cover the
//! rounding.

use super::extent::{Extent, MAX_RADIUS};
use super::grid::MeanGrid;
use super::kernel::{CHUNK, Columns, Neighbours};
use super::lists::{ListKind, Lists};
use crate::math::real::Real;
use crate::math::simd::{Isa, Kernel, Vector};
use crate::observation::points::Points;
use crate::train::estep::squared_distance;
use std::num::NonZero;
use std::ops::Range;

/// Appends the ids of the `n` means nearest to each point of `tile`, point by point; all means if there
/// are fewer. `tile` holds columns of equal length.
///
/// Means are ordered by squared distance `(dx² + dy²) + dz²` in f32; at equal distance, the lower id
/// comes first. The search is fast if the points of the tile are close together.
pub fn nearest_in_tile(
    isa: Isa,
    grid: &MeanGrid,
    search: &mut CandidateSearch,
    tile: [&[f32]; 3],
    n: NonZero<usize>,
    ids: &mut Vec<u32>,
) {
    let rank = n.get().min(grid.len());
    let first = ids.len();
    ids.resize(first + tile[0].len() * rank, 0);
    if rank > 0 {
        let visitor = NarrowVisitor { grid, rank, ids: &mut ids[first..], found: Vec::new() };
        isa.run(TileSearch { grid, search, tile, rank, visitor });
    }
}

/// As [`nearest_in_tile`], but with squared distances in f64, for points and means of precision `R`.
/// The grid holds the means rounded to f32.
pub fn nearest_in_tile_wide<R: Real>(
    grid: &MeanGrid,
    search: &mut CandidateSearch,
    means: &[[R; 3]],
    points: &Points<R>,
    range: Range<usize>,
    n: NonZero<usize>,
    ids: &mut Vec<u32>,
) {
    let rank = n.get().min(grid.len());
    let first = ids.len();
    ids.resize(first + range.len() * rank, 0);
    if rank == 0 {
        return;
    }
    // The grid is over means in f32, so its searches take points in f32.
    let narrow = |column: &[R]| -> Vec<f32> {
        column[range.clone()].iter().map(|v| v.to_f64() as f32).collect()
    };
    let [x, y, z] = [narrow(&points.x), narrow(&points.y), narrow(&points.z)];
    let position = |place: usize| points.position(range.start + place);
    let visitor = WideVisitor { grid, rank, means, position, ids: &mut ids[first..] };
    Isa::best().run(TileSearch { grid, search, tile: [&x, &y, &z], rank, visitor });
}

struct TileSearch<'a, T> {
    grid: &'a MeanGrid,
    search: &'a mut CandidateSearch,
    tile: [&'a [f32]; 3],
    rank: usize,
    visitor: T,
}

impl<T: VisitChunk> Kernel for TileSearch<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { grid, search, tile, rank, mut visitor } = self;
        search.visit_tile::<V>(grid, tile, rank, &mut visitor);
    }
}

struct NarrowVisitor<'a> {
    grid: &'a MeanGrid,
    rank: usize,
    ids: &'a mut [u32],
    found: Vec<(u64, u32)>,
}

impl VisitChunk for NarrowVisitor<'_> {
    #[inline(always)]
    fn visit<V: Vector>(&mut self, lists: &mut Lists, points: &Columns, chunk: Range<usize>) {
        if !lists.fill_near::<V>(points, chunk.clone(), self.rank) {
            return chunk.for_each(|i| self.rank::<V>(lists, ListKind::Raw, points, i));
        }
        // One extra key shows whether the last neighbour has a tie. Sizes are constants so that keys stay
        // in registers.
        match self.rank {
            1 => self.visit_near::<V, 2>(lists, points, chunk),
            2 => self.visit_near::<V, 3>(lists, points, chunk),
            3 => self.visit_near::<V, 4>(lists, points, chunk),
            4 => self.visit_near::<V, 5>(lists, points, chunk),
            5 => self.visit_near::<V, 6>(lists, points, chunk),
            6 => self.visit_near::<V, 7>(lists, points, chunk),
            7 => self.visit_near::<V, 8>(lists, points, chunk),
            8 => self.visit_near::<V, 9>(lists, points, chunk),
            // The kernel is not measured beyond eight; `benches/candidates.rs` times 8 and 9.
            _ => chunk.for_each(|i| self.rank::<V>(lists, ListKind::Near, points, i)),
        }
    }
}

impl NarrowVisitor<'_> {
    /// Ranks the neighbours of all points by the sorted keys. Points whose order is uncertain are
    /// ranked again by their exact distances.
    #[inline(always)]
    fn visit_near<V: Vector, const KEYS: usize>(
        &mut self,
        lists: &mut Lists,
        points: &Columns,
        chunk: Range<usize>,
    ) {
        let rank = KEYS - 1;
        let place_bits = lists.place_bits();
        let found: Neighbours<KEYS> = lists.neighbours::<V, KEYS>(points, chunk.clone());
        for (i, point) in chunk.enumerate() {
            if (found.set_uncertain | found.order_uncertain) >> i & 1 == 1 {
                self.rank::<V>(lists, ListKind::Near, points, point);
                continue;
            }
            let place = points.tag[point] as usize * rank;
            for (id, keys) in self.ids[place..place + rank].iter_mut().zip(&found.keys) {
                let entry = lists.near().tag[(keys[i].to_bits() & place_bits) as usize];
                *id = self.grid.ids()[entry as usize];
            }
        }
    }

    #[inline(always)]
    fn rank<V: Vector>(
        &mut self,
        lists: &mut Lists,
        among: ListKind,
        points: &Columns,
        point: usize,
    ) {
        let (position, all) = (points.position(point), self.grid.ids());
        let found = lists.rank::<V>(among, position, all, self.rank, f32::INFINITY);
        self.found.clear();
        self.found.extend_from_slice(found);
        self.found.sort_unstable();
        let place = points.tag[point] as usize * self.rank;
        let ids = &mut self.ids[place..place + self.rank];
        ids.iter_mut().zip(&self.found).for_each(|(id, &(key, _))| *id = key as u32);
    }
}

struct WideVisitor<'a, R, P> {
    grid: &'a MeanGrid,
    rank: usize,
    means: &'a [[R; 3]],
    /// Returns the position of a point, given the point's index in the tile.
    position: P,
    ids: &'a mut [u32],
}

impl<R: Real, P: Fn(usize) -> [R; 3]> VisitChunk for WideVisitor<'_, R, P> {
    #[inline(always)]
    fn visit<V: Vector>(&mut self, lists: &mut Lists, points: &Columns, chunk: Range<usize>) {
        let is_short = lists.fill_near::<V>(points, chunk.clone(), self.rank);
        // The near list is incomplete if bounds overflow.
        let among = if is_short { ListKind::Near } else { ListKind::Raw };
        for i in chunk {
            let place = points.tag[i] as usize;
            let point = (self.position)(place).map(R::to_f64);
            let distance2 =
                |id: u32| squared_distance(self.means[id as usize].map(R::to_f64), point);
            let found = lists.rank_by(among, self.grid.ids(), self.rank, distance2);
            let ids = &mut self.ids[place * self.rank..(place + 1) * self.rank];
            ids.iter_mut().zip(found).for_each(|(id, found)| *id = found);
        }
    }
}

// Length in cells beyond which a group of points is split. Tiles across a depth edge split, tiles on one
// surface stay whole. Smaller groups gained nothing, even on stepped depth (`training.md`, Tried and
// dropped).
const MAX_GROUP_CELLS: f32 = 2.0;
/// First guess of the distance to the nearest means, as a multiple of that distance in the last group
/// of points.
const NEAREST_GUESS: f32 = 1.1;

/// Scratch memory of a search, reused between tiles. Earlier tiles affect only the first guess of the
/// search radius, not the results.
#[derive(Debug, Default)]
pub struct CandidateSearch {
    tile: Tile,
    lists: Lists,
    pending: Vec<Range<usize>>,
    /// Distance from the centre of the last group of points to its `rank`-th nearest mean.
    nearest: f32,
}

/// Points of a tile, reordered by group. Each tag is the point's index in the tile.
#[derive(Debug, Default)]
struct Tile {
    points: Columns,
    swap: Vec<([f32; 3], u32)>,
}

/// Processes at most [`CHUNK`] points with their candidate lists.
pub(in crate::train) trait VisitChunk {
    /// Processes the points `chunk` of `points`, whose nearest entries are in `lists`. Tags of points
    /// are indices in the tile. Implementations must be `#[inline(always)]`.
    fn visit<V: Vector>(&mut self, lists: &mut Lists, points: &Columns, chunk: Range<usize>);
}

impl CandidateSearch {
    /// Visits every point of a tile once, in chunks. Passes each chunk to `visitor` with candidate
    /// lists that contain the `rank` nearest means of every point. `rank` is between 1 and the number
    /// of means.
    #[inline(always)]
    pub(in crate::train) fn visit_tile<V: Vector>(
        &mut self,
        grid: &MeanGrid,
        tile: [&[f32]; 3],
        rank: usize,
        visitor: &mut impl VisitChunk,
    ) {
        // An empty group has no extent.
        if tile[0].is_empty() {
            return;
        }
        self.tile.points.load(tile);
        self.pending.push(0..tile[0].len());
        while let Some(group) = self.pending.pop() {
            let extent = Extent::of_points::<V>(&self.tile.points, group.clone());
            // A group of one chunk gains nothing from being split.
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
    /// `extent` is the extent of the group.
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
    /// Reorders a group: the points below the middle of its longest axis move to the front, in order.
    /// Returns the index of the first of the other points.
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
