//! Exact nearest means of all points of a tile at once (`engine.md` section 4).
//!
//! What the means near a tile have in common is found once: a list of all that can be among the
//! nearest of any of its points, then a shorter one for every sixteen points. Bounds follow from the
//! triangle inequality and carry margins for rounding, which cost candidates, never correctness.

use super::columns::{Columns, STEP, key};
use super::grid::Grid;
use super::kernel::{
    LANES, Neighbours, bounding_box, distances, load, neighbours, ranked, reach2, within,
};
use std::num::NonZero;
use std::ops::Range;
use wide::bytemuck::cast;
use wide::f32x8;

/// Points that share a list of candidates.
const CHUNK: usize = 16;
/// A group of points that is longer than this many cells is split.
const MAX_GROUP_CELLS: f32 = 2.0;
/// Longest list whose entries fit in the low bits of a key.
const MAX_KERNEL_LIST: usize = 1024;
/// Relative margin of every radius: a hundred roundings.
const RELATIVE_MARGIN: f32 = 1.0 + 1e-5;
/// Margin of every radius per unit of the largest coordinate: ten roundings.
const COORDINATE_MARGIN: f32 = 1e-6;
/// Margin of every radius against underflow of its square.
const LEAST_MARGIN: f32 = 1e-18;
/// Radius whose square is safely finite.
const MAX_RADIUS: f32 = 1e18;
/// The first guess of a radius, as a multiple of the last one.
const RADIUS_GUESS: f32 = 1.1;

/// Memory of a search, grow-only. It carries nothing from tile to tile but a first guess.
#[derive(Debug, Default)]
pub struct Scratch {
    tile: Tile,
    lists: Lists,
    pending: Vec<Range<usize>>,
    radius: f32,
}

/// Points of a tile group by group; `id` is their place in the tile.
#[derive(Debug, Default)]
struct Tile {
    points: Columns,
    swap: Columns,
}

#[derive(Debug, Default)]
struct Lists {
    /// All means that can matter to a group.
    raw: Columns,
    /// Those of `raw` that can matter to a chunk.
    near: Columns,
    work: Work,
}

#[derive(Debug, Default)]
struct Work {
    /// Squared distances of a list.
    distance2: Vec<f32>,
    /// Entries selected from a list.
    entries: Vec<u32>,
    /// Squared distances, for sorting.
    sorted: Vec<f32>,
    /// Squared distance in the high half, id in the low half.
    keys: Vec<u64>,
}

/// The points of a group or chunk from outside.
#[derive(Clone, Copy)]
struct Extent {
    lo: [f32; 3],
    hi: [f32; 3],
    /// Middle of the box.
    centre: [f32; 3],
    /// Largest distance of a point to the middle.
    reach: f32,
    /// Part of the margin that does not depend on the radius.
    slack: f32,
}

impl Scratch {
    /// Appends the ids of the nearest means of every point.
    pub(super) fn nearest(
        &mut self,
        grid: &Grid,
        tile: [&[f32]; 3],
        n: NonZero<usize>,
        ids: &mut Vec<u32>,
    ) {
        let (n_points, rank) = (tile[0].len(), n.get().min(grid.len()));
        if n_points == 0 || rank == 0 {
            return;
        }
        let first = ids.len();
        ids.resize(first + n_points * rank, 0);
        let ids = &mut ids[first..];
        self.tile.load(tile);
        self.pending.push(0..n_points);
        while let Some(group) = self.pending.pop() {
            let extent = self.tile.extent(group.clone());
            let middle = if group.len() > CHUNK && extent.length() > MAX_GROUP_CELLS * grid.cell() {
                self.tile.split(group.clone(), &extent)
            } else {
                group.start
            };
            if group.start < middle && middle < group.end {
                self.pending.extend([middle..group.end, group.start..middle]);
            } else {
                self.search_group(grid, group, &extent, rank, ids);
            }
        }
    }

    fn search_group(
        &mut self,
        grid: &Grid,
        group: Range<usize>,
        extent: &Extent,
        rank: usize,
        ids: &mut [u32],
    ) {
        let Self { tile, lists, radius, .. } = self;
        if extent.is_finite() {
            *radius = RADIUS_GUESS * lists.gather(grid, extent, rank, *radius);
        } else {
            grid.gather_all(&mut lists.raw);
        }
        for start in group.clone().step_by(CHUNK) {
            let chunk = start..(start + CHUNK).min(group.end);
            lists.search_chunk(&tile.points, chunk, rank, ids);
        }
    }
}

impl Tile {
    fn load(&mut self, [x, y, z]: [&[f32]; 3]) {
        let n = x.len();
        self.points.reserve(n);
        self.points.len = n;
        self.points.x[..n].copy_from_slice(x);
        self.points.y[..n].copy_from_slice(y);
        self.points.z[..n].copy_from_slice(z);
        self.points.id[..n].iter_mut().zip(0..).for_each(|(id, place)| *id = place);
    }

    fn extent(&self, range: Range<usize>) -> Extent {
        Extent::of(&self.points, range)
    }

    /// Moves the points below the middle of the longest axis to the front, keeping their order;
    /// returns where the others start.
    fn split(&mut self, group: Range<usize>, extent: &Extent) -> usize {
        let Self { points, swap } = self;
        let length = |axis: usize| extent.hi[axis] - extent.lo[axis];
        let axis =
            (0..3).fold(0, |best, axis| if length(axis) > length(best) { axis } else { best });
        swap.len = 0;
        let mut middle = group.start;
        for is_low in [true, false] {
            for i in group.clone() {
                if (points.position(i)[axis] < extent.centre[axis]) == is_low {
                    swap.append(points, i..i + 1);
                }
            }
            if is_low {
                middle += swap.len;
            }
        }
        let n = swap.len;
        points.x[group.clone()].copy_from_slice(&swap.x[..n]);
        points.y[group.clone()].copy_from_slice(&swap.y[..n]);
        points.z[group.clone()].copy_from_slice(&swap.z[..n]);
        points.id[group].copy_from_slice(&swap.id[..n]);
        middle
    }
}

impl Extent {
    fn of(points: &Columns, range: Range<usize>) -> Self {
        let [lo, hi] = bounding_box(points, range.clone());
        let centre: [f32; 3] = std::array::from_fn(|i| 0.5 * lo[i] + 0.5 * hi[i]);
        let reach2 = reach2(points, range, centre);
        let largest = lo.iter().chain(&hi).fold(0f32, |largest, v| largest.max(v.abs()));
        let slack = COORDINATE_MARGIN * largest + LEAST_MARGIN;
        Self { lo, hi, centre, reach: reach2.sqrt(), slack }
    }

    fn length(&self) -> f32 {
        (0..3).fold(0f32, |length, axis| length.max(self.hi[axis] - self.lo[axis]))
    }

    /// Whether bounds mean anything: coordinates are finite and their squares do not overflow.
    fn is_finite(&self) -> bool {
        self.reach.is_finite() && self.slack.is_finite()
    }
}

impl Lists {
    /// Fills `raw` with a superset of the `rank` nearest means of every point of a group; returns
    /// the radius that was needed.
    fn gather(&mut self, grid: &Grid, extent: &Extent, rank: usize, guess: f32) -> f32 {
        let mut radius = if guess > 0.0 { guess } else { grid.cell() };
        loop {
            grid.gather(extent.lo, extent.hi, radius, &mut self.raw);
            if self.raw.len >= rank {
                break;
            }
            radius = (2.0 * radius).max(grid.gap(extent.lo, extent.hi) + grid.cell());
        }
        let nearest = self.work.bound2(&self.raw, extent.centre, rank).sqrt();
        let needed = (nearest + extent.reach) * RELATIVE_MARGIN + extent.slack;
        if needed > radius {
            grid.gather(extent.lo, extent.hi, needed, &mut self.raw);
        }
        needed
    }

    /// Writes the ids of the `rank` nearest of `raw` for at most [`CHUNK`] points.
    fn search_chunk(
        &mut self,
        points: &Columns,
        chunk: Range<usize>,
        rank: usize,
        ids: &mut [u32],
    ) {
        let Self { raw, near, work } = self;
        let extent = Extent::of(points, chunk.clone());
        let nearest = work.bound2(raw, extent.centre, rank).sqrt();
        let limit = (nearest + 2.0 * extent.reach) * RELATIVE_MARGIN + extent.slack;
        if !(extent.is_finite() && limit + extent.reach < MAX_RADIUS) {
            return chunk.for_each(|i| work.rank_all(raw, points, i, rank, ids));
        }
        near.copy(raw, within(raw, &work.distance2, limit * limit, &mut work.entries));
        if near.len > MAX_KERNEL_LIST {
            return chunk.for_each(|i| work.rank_all(near, points, i, rank, ids));
        }
        match rank {
            1 => work.rank_chunk::<2>(near, points, chunk, ids),
            2 => work.rank_chunk::<3>(near, points, chunk, ids),
            3 => work.rank_chunk::<4>(near, points, chunk, ids),
            4 => work.rank_chunk::<5>(near, points, chunk, ids),
            5 => work.rank_chunk::<6>(near, points, chunk, ids),
            6 => work.rank_chunk::<7>(near, points, chunk, ids),
            7 => work.rank_chunk::<8>(near, points, chunk, ids),
            8 => work.rank_chunk::<9>(near, points, chunk, ids),
            // The kernel has not been measured beyond eight; `benches/candidates.rs` times 8 and 9.
            _ => chunk.for_each(|i| work.rank_all(near, points, i, rank, ids)),
        }
    }
}

impl Work {
    /// An upper bound on the squared distance of the `rank`-th nearest entry; leaves all squared
    /// distances in `distance2`.
    #[inline(always)]
    fn bound2(&mut self, list: &Columns, centre: [f32; 3], rank: usize) -> f32 {
        let least = distances(list, centre, &mut self.distance2);
        if rank <= STEP {
            return ranked(least, rank);
        }
        self.sorted.clear();
        self.sorted.extend_from_slice(&self.distance2[..list.len]);
        *self.sorted.select_nth_unstable_by(rank - 1, f32::total_cmp).1
    }

    /// The nearest entries of a short list for a chunk, by the branch-free kernel; points for
    /// which rounding hides the order are done again.
    fn rank_chunk<const KEYS: usize>(
        &mut self,
        list: &Columns,
        points: &Columns,
        chunk: Range<usize>,
        ids: &mut [u32],
    ) {
        let rank = KEYS - 1;
        let entry_bits = list.len.next_power_of_two() as u32 - 1;
        for first in chunk.clone().step_by(LANES) {
            let lanes = [&points.x, &points.y, &points.z].map(|column| load(column, first));
            let found: Neighbours<KEYS> = neighbours(list, lanes, entry_bits);
            let keys = found.keys.map(cast::<f32x8, [u32; LANES]>);
            for (lane, point) in (first..chunk.end).take(LANES).enumerate() {
                if found.set_uncertain >> lane & 1 == 1 {
                    self.rank_all(list, points, point, rank, ids);
                    continue;
                }
                let place = points.id[point] as usize * rank;
                let ids = &mut ids[place..place + rank];
                for (id, keys) in ids.iter_mut().zip(&keys) {
                    *id = keys[lane] & entry_bits;
                }
                if found.order_uncertain >> lane & 1 == 1 {
                    let position = points.position(point);
                    ids.sort_unstable_by_key(|&entry| list.key(entry as usize, position));
                }
                for id in ids {
                    *id = list.id[*id as usize];
                }
            }
        }
    }

    /// The nearest entries of any list for one point, in the order (squared distance, id).
    #[inline(never)]
    fn rank_all(
        &mut self,
        list: &Columns,
        points: &Columns,
        point: usize,
        rank: usize,
        ids: &mut [u32],
    ) {
        let least = distances(list, points.position(point), &mut self.distance2);
        let limit = if rank <= STEP { ranked(least, rank) } else { f32::INFINITY };
        let Self { distance2, entries, keys, .. } = self;
        keys.clear();
        if limit.is_finite() {
            let near = within(list, distance2, limit, entries);
            keys.extend(near.iter().map(|&i| key(distance2[i as usize], list.id[i as usize])));
        } else {
            // Nothing is left out, so that a point that is no number has neighbours, too.
            let all = distance2.iter().zip(&list.id[..list.len]);
            keys.extend(all.map(|(&d2, &id)| key(d2, id)));
        }
        if self.keys.len() > rank {
            self.keys.select_nth_unstable(rank - 1);
            self.keys.truncate(rank);
        }
        self.keys.sort_unstable();
        let place = points.id[point] as usize * rank;
        for (id, key) in ids[place..place + rank].iter_mut().zip(&self.keys) {
            *id = *key as u32;
        }
    }
}
