//! Candidate lists of a group of points, and the search for the nearest entries in these lists.
//!
//! There are two levels: a raw list, gathered from the grid once per group, and a near list for each
//! chunk of sixteen points. A near list has only a few dozen entries, so every point can be compared
//! with all of them.

use super::extent::{Extent, RELATIVE_MARGIN};
use super::kernel::{
    CHUNK, Columns, Neighbours, STEP, distances, neighbours, nth_smallest, select,
};
use crate::math::simd::{LANES, Vector};
use crate::train::estep::squared_distance;
use std::ops::Range;

// Longest list whose entries fit in the low bits of a key: 13 of the 23 mantissa bits. Fewer bits of
// distance would leave more points to be ranked individually.
const MAX_KERNEL_LIST: usize = 1 << 13;

// Initial capacity of the lists; few tiles need more.
const USUAL_LEN: usize = 4096;

/// Candidate lists of a group of points and of a chunk of it, with scratch memory. Candidates are grid
/// entries.
#[derive(Debug)]
pub(in crate::train) struct Lists {
    /// Candidates of a group of points.
    raw: Columns,
    near: Columns,
    /// Centre of the chunk. `near` contains every grid entry within `near_limit` of this centre.
    near_centre: [f32; 3],
    near_limit: f32,
    distance2: Vec<f32>,
    sorted: Vec<f32>,
    /// Sort key of each candidate (squared distance in the high half, component in the low half), and
    /// its grid entry.
    keys: Vec<(u64, u32)>,
    /// Squared distance of each candidate in f64, and the candidate's component.
    f64_keys: Vec<(f64, u32)>,
}

/// Grid entry nearest to a point, with a lower bound on the squared distances of all other entries.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct Nearest {
    /// Index of the nearest grid entry. If `second2` is negative infinity, another entry may be nearer.
    pub entry: u32,
    /// Lower bound on the squared distances from the point to all other entries; negative infinity if
    /// unknown.
    pub second2: f32,
}

/// Returns a sort key that orders by squared distance, then by component id.
fn key(distance2: f32, id: u32) -> u64 {
    // Squares are not negative, so their bits sort like their values.
    u64::from(distance2.to_bits()) << 32 | u64::from(id)
}

impl Default for Lists {
    fn default() -> Self {
        let columns = || {
            let mut columns = Columns::default();
            columns.reserve(USUAL_LEN);
            columns
        };
        Self {
            raw: columns(),
            near: columns(),
            near_centre: [0.0; 3],
            near_limit: 0.0,
            distance2: vec![0.0; USUAL_LEN],
            sorted: Vec::new(),
            keys: Vec::with_capacity(USUAL_LEN),
            f64_keys: Vec::new(),
        }
    }
}

impl Lists {
    /// Returns the candidates of the group of points.
    pub fn raw(&self) -> &Columns {
        &self.raw
    }

    pub(super) fn raw_mut(&mut self) -> &mut Columns {
        &mut self.raw
    }

    /// Returns an upper bound on the squared distance from `centre` to its `rank`-th nearest raw entry.
    #[inline(always)]
    pub(super) fn raw_bound2<V: Vector>(&mut self, centre: [f32; 3], rank: usize) -> f32 {
        let least = distances::<V>(&self.raw, centre, &mut self.distance2);
        if rank <= STEP {
            return nth_smallest(least, rank);
        }
        // Selection reorders, but the distances must stay in the order of the entries.
        self.sorted.clear();
        self.sorted.extend_from_slice(&self.distance2[..self.raw.len]);
        *self.sorted.select_nth_unstable_by(rank - 1, f32::total_cmp).1
    }

    /// Fills the near list with a superset of the `rank` nearest entries of each point of a chunk.
    /// Returns true if the list is short enough for [`Lists::neighbours`].
    #[inline(always)]
    pub(super) fn fill_near<V: Vector>(
        &mut self,
        points: &Columns,
        chunk: Range<usize>,
        rank: usize,
    ) -> bool {
        // Until the list is filled it covers nothing, so `covering` returns the raw list.
        self.near_limit = 0.0;
        let extent = Extent::of_points::<V>(points, chunk);
        let bound2 = self.raw_bound2::<V>(extent.centre, rank);
        // Without a finite radius, every entry must stay a candidate.
        let Some(limit) = extent.centre_radius(bound2) else { return false };
        let Self { raw, near, distance2, .. } = self;
        select::<V>(raw, distance2, limit * limit, near);
        (self.near_centre, self.near_limit) = (extent.centre, limit);
        near.len <= MAX_KERNEL_LIST
    }

    pub(super) fn near(&self) -> &Columns {
        &self.near
    }

    /// Returns the mask of the low bits of a key, which hold the index of an entry in the near list.
    pub(super) fn place_bits(&self) -> u32 {
        self.near.len.next_power_of_two() as u32 - 1
    }

    /// Finds the `KEYS` nearest entries of the near list for each point of a chunk, with the branch-free
    /// kernel.
    #[inline(always)]
    pub(super) fn neighbours<V: Vector, const KEYS: usize>(
        &self,
        points: &Columns,
        chunk: Range<usize>,
    ) -> Neighbours<KEYS> {
        neighbours::<V, KEYS>(&self.near, points, chunk, self.place_bits())
    }

    /// Finds the nearest raw entry of each point of a chunk.
    #[inline(always)]
    pub fn nearest<V: Vector>(
        &mut self,
        points: &Columns,
        chunk: Range<usize>,
    ) -> [Nearest; CHUNK] {
        let mut nearest = [Nearest { entry: self.raw.tag[0], second2: f32::NEG_INFINITY }; CHUNK];
        // With a single mean there is no second: its key remains infinite, which is a correct bound.
        if !self.fill_near::<V>(points, chunk.clone(), self.raw.len.min(2)) {
            return nearest;
        }
        let place_bits = self.place_bits();
        let Neighbours { keys: [keys, seconds], .. } = self.neighbours::<V, 2>(points, chunk);
        for ((nearest, key), second) in nearest.iter_mut().zip(keys).zip(seconds) {
            let place = (key.to_bits() & place_bits) as usize;
            nearest.entry = self.near.tag[place];
            // With the index bits cleared, a key is a lower bound of its squared distance.
            nearest.second2 = f32::from_bits(second.to_bits() & !place_bits);
        }
        nearest
    }

    /// Finds the `rank` entries nearest to one point, or all if there are fewer. At equal squared
    /// distance, the lower component is preferred. Entries beyond the squared distance `within2` may be
    /// skipped. `ids` maps entries to components.
    #[inline(always)]
    pub fn rank<V: Vector>(
        &mut self,
        among: ListKind,
        position: [f32; 3],
        ids: &[u32],
        rank: usize,
        within2: f32,
    ) -> &[(u64, u32)] {
        let Self { raw, near, distance2, keys, .. } = self;
        let list = match among {
            ListKind::Raw => &*raw,
            ListKind::Near => &*near,
        };
        let least = distances::<V>(list, position, distance2);
        // Sixteen lane minima are distances of sixteen entries, so they bound at most sixteen neighbours.
        let limit = if rank <= STEP { nth_smallest(least, rank) } else { f32::INFINITY };
        keys.clear();
        let mut take = |place: usize| {
            let entry = list.tag[place];
            keys.push((key(distance2[place], ids[entry as usize]), entry));
        };
        if limit.is_finite() {
            let limit = V::splat(limit.min(within2));
            for (first, d2) in (0..).step_by(LANES).zip(distance2.chunks_exact(LANES)) {
                if first >= list.len {
                    break;
                }
                let mut inside = V::load(d2).at_most(limit);
                while inside != 0 {
                    take(first + inside.trailing_zeros() as usize);
                    inside &= inside - 1;
                }
            }
        } else {
            // Unbounded, so that NaN points have neighbours too.
            (0..list.len).for_each(take);
        }
        if keys.len() > rank {
            keys.select_nth_unstable(rank - 1);
            keys.truncate(rank);
        }
        keys
    }

    /// Selects a list that contains every entry within the given squared distance of `position`, a
    /// point of the chunk.
    #[inline(always)]
    pub fn complete_list_for(&self, position: [f32; 3], distance2: f32) -> ListKind {
        // The near list is complete within a ball about the chunk's centre, not about the point.
        let off = squared_distance(position, self.near_centre).sqrt();
        let reach = (off + distance2.sqrt()) * RELATIVE_MARGIN;
        // A NaN distance fails the comparison and uses the complete list.
        if reach < self.near_limit { ListKind::Near } else { ListKind::Raw }
    }

    /// Finds the `rank` components nearest to one point, nearest first. At equal squared distance, the
    /// lower component comes first. `of` returns the squared distance of a component.
    pub(super) fn rank_by(
        &mut self,
        among: ListKind,
        ids: &[u32],
        rank: usize,
        of: impl Fn(u32) -> f64,
    ) -> impl ExactSizeIterator<Item = u32> {
        let Self { raw, near, f64_keys: wide, .. } = self;
        let list = match among {
            ListKind::Raw => &*raw,
            ListKind::Near => &*near,
        };
        let components = list.tag[..list.len].iter().map(|&entry| ids[entry as usize]);
        wide.clear();
        wide.extend(components.map(|id| (of(id), id)));
        let order = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if wide.len() > rank {
            wide.select_nth_unstable_by(rank - 1, order);
            wide.truncate(rank);
        }
        wide.sort_unstable_by(order);
        wide.iter().map(|&(_, id)| id)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::train) enum ListKind {
    Raw,
    Near,
}
