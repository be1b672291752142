//! Nearest seeds of many points: neighbouring points gather the seeds around them together and are compared
//! with all of them.
//!
//! This gives straight SIMD loops, while a lookup per point would follow chains of buckets.

use super::grid::{NONE, SeedGrid, squared_distance};
use crate::math::simd::{Isa, Kernel, LANES, SET_LANE, Vector, load_rows};

/// Maximum number of cells of a group searched as one; larger groups have points that are far apart.
const MAX_CELLS: f64 = 512.0;

#[derive(Default)]
pub struct SeedGroups {
    groups: Vec<Group>,
    seeds: Vec<(u32, [f32; 3])>,
}

struct Group {
    n_points: usize,
    /// End of the group's seeds in the common list.
    end: usize,
}

impl SeedGroups {
    pub fn clear(&mut self) {
        self.groups.clear();
        self.seeds.clear();
    }

    /// Adds a group of points with at least all seeds within `radius` (world units) of each.
    pub fn gather(&mut self, grid: &SeedGrid, radius: f32, points: &[[f32; 3]]) {
        // Slightly larger, since distances are rounded.
        self.gather_halves(grid, radius * (1.0 + 1e-5), points);
    }

    /// Halves a group that spans a depth edge until it is compact; a single point always covers few cells.
    fn gather_halves(&mut self, grid: &SeedGrid, radius: f32, points: &[[f32; 3]]) {
        let near = points.iter().copied().filter(|point| grid.may_reach_seed(*point, radius));
        if let Some(corners) = corners(near, radius) {
            if grid.cells_between(corners).n_cells() > MAX_CELLS && points.len() > 1 {
                let (first, second) = points.split_at(points.len() / 2);
                self.gather_halves(grid, radius, first);
                self.gather_halves(grid, radius, second);
                return;
            }
            grid.gather(corners, &mut self.seeds);
        }
        self.groups.push(Group { n_points: points.len(), end: self.seeds.len() });
    }

    /// Sets the nearest seed within `reach` of each point, or [`NONE`]. The points must be those passed to
    /// `gather`, moved by at most the difference between its radius and `reach`.
    pub fn nearest(&self, grid: &SeedGrid, reach: f32, points: &[[f32; 3]], owners: &mut [u32]) {
        let limit = reach * reach;
        Isa::best().run(Nearest { groups: self, grid, limit, points, owners });
    }
}

/// Corners of the bounding box of some places, enlarged by `radius` on every side; `None` without places.
fn corners(places: impl Iterator<Item = [f32; 3]>, radius: f32) -> Option<[[f32; 3]; 2]> {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for place in places {
        for axis in 0..3 {
            low[axis] = low[axis].min(place[axis]);
            high[axis] = high[axis].max(place[axis]);
        }
    }
    let wider = [low.map(|x| x - radius), high.map(|x| x + radius)];
    (low[0] <= high[0]).then_some(wider)
}

struct Nearest<'a> {
    groups: &'a SeedGroups,
    grid: &'a SeedGrid,
    limit: f32,
    points: &'a [[f32; 3]],
    owners: &'a mut [u32],
}

impl Kernel for Nearest<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let (mut points, mut owners, mut start) = (self.points, self.owners, 0);
        for group in &self.groups.groups {
            let (these, later) = points.split_at(group.n_points);
            let (found, left) = owners.split_at_mut(group.n_points);
            let seeds = &self.groups.seeds[start..group.end];
            for (points, owners) in these.chunks(LANES).zip(found.chunks_mut(LANES)) {
                // NaN marks unused lanes and places outside the grid, so that they find no seed.
                let mut along = [[f32::NAN; LANES]; 3];
                for (lane, point) in points.iter().enumerate() {
                    if self.grid.has_cell(*point) {
                        for (along, x) in along.iter_mut().zip(point) {
                            along[lane] = *x;
                        }
                    }
                }
                let nearest = nearest_of::<V>(&along, seeds, self.limit);
                owners.copy_from_slice(&nearest[..owners.len()]);
            }
            (points, owners, start) = (later, left, group.end);
        }
    }
}

/// Nearest of some seeds to each of eight places; `limit` is the maximum squared distance.
#[inline(always)]
fn nearest_of<V: Vector>(
    along: &[[f32; LANES]; 3],
    seeds: &[(u32, [f32; 3])],
    limit: f32,
) -> [u32; LANES] {
    let places: [V; 3] = load_rows(along);
    let (mut best, mut found) = (V::splat(limit), V::splat(f32::from_bits(NONE)));
    let mut doubtful = V::splat(0.0);
    for &(id, seed) in seeds {
        let x = places[0] - V::splat(seed[0]);
        let y = places[1] - V::splat(seed[1]);
        let z = places[2] - V::splat(seed[2]);
        let squared = x * x + y * y + z * z;
        let is_closer = squared.mask_at_most(best);
        let is_farther = best.mask_at_most(squared);
        doubtful = V::select(is_closer.and(is_farther), V::splat(SET_LANE), doubtful);
        best = squared.min(best);
        found = V::select(is_closer, V::splat(f32::from_bits(id)), found);
    }
    let mut nearest = [NONE; LANES];
    for (nearest, found) in nearest.iter_mut().zip(found.to_array()) {
        *nearest = found.to_bits();
    }
    // Ties are resolved for the older seed, independently of the order of blocks.
    let mut doubtful = doubtful.sign_bits();
    while doubtful != 0 {
        let lane = doubtful.trailing_zeros() as usize % LANES;
        doubtful &= doubtful - 1;
        nearest[lane] =
            oldest_nearest([along[0][lane], along[1][lane], along[2][lane]], seeds, limit);
    }
    nearest
}

/// Scalar version for one place, which resolves ties.
fn oldest_nearest(place: [f32; 3], seeds: &[(u32, [f32; 3])], limit: f32) -> u32 {
    let near = seeds.iter().map(|&(id, seed)| (squared_distance(place, seed), id));
    let near = near.filter(|(squared, _)| *squared <= limit);
    near.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).map_or(NONE, |(_, id)| id)
}
