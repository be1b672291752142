//! Nearest seeds of many points: the seeds around neighbouring points are gathered once, and each point
//! is compared with all of them.
//!
//! This gives simple SIMD loops, while a lookup per point would follow chains of buckets.

use super::components::Components;
use super::grid::{NONE, SeedGrid};
use crate::math::simd::{Isa, Kernel, LANES, SET_LANE, Vector, load_rows};
use crate::model::scene::sums::MAX_OFFSET;
use crate::observation::surface::SurfacePoint;
use crate::train::estep::squared_distance;
use rayon::prelude::*;

// Maximum number of cells of a group searched as one; larger groups have points that are far apart.
const MAX_CELLS: f64 = 512.0;

#[derive(Default)]
pub struct SeedGroups {
    groups: Vec<Group>,
    seeds: Vec<(u32, [f32; 3])>,
}

struct Group {
    n_points: usize,
    /// Index at which the group's seeds end in the list of all groups' seeds.
    end: usize,
}

impl SeedGroups {
    pub fn clear(&mut self) {
        self.groups.clear();
        self.seeds.clear();
    }

    /// Adds points as one or more groups. The seeds of a group include all seeds within `radius` (world
    /// units) of each of its points.
    pub fn gather(&mut self, grid: &SeedGrid, radius: f32, points: &[[f32; 3]]) {
        // Slightly larger, since distances are rounded.
        self.gather_halves(grid, radius * (1.0 + 1e-5), points);
    }

    /// Adds points as one group with the seeds around them. Points that span a depth edge are halved
    /// until each group is compact.
    fn gather_halves(&mut self, grid: &SeedGrid, radius: f32, points: &[[f32; 3]]) {
        let near = points.iter().copied().filter(|point| grid.may_reach_seed(*point, radius));
        if let Some(corners) = corners(near, radius) {
            if grid.cells_between(corners).n_cells() > MAX_CELLS && points.len() > 1 {
                // Points come in the order of the image, so halves are closer together.
                let (first, second) = points.split_at(points.len() / 2);
                self.gather_halves(grid, radius, first);
                self.gather_halves(grid, radius, second);
                return;
            }
            grid.gather(corners, &mut self.seeds);
        }
        self.groups.push(Group { n_points: points.len(), end: self.seeds.len() });
    }

    /// Stores the nearest seed within `reach` (world units) of each point in `owners`, or [`NONE`]. The
    /// points must be the ones passed to [`Self::gather`]. Each may have moved by at most the radius of
    /// that call minus `reach`.
    pub fn nearest(&self, grid: &SeedGrid, reach: f32, points: &[[f32; 3]], owners: &mut [u32]) {
        let limit = reach * reach;
        Isa::best().run(Nearest { groups: self, grid, limit, points, owners });
    }
}

/// Returns the corners of the bounding box of `places`, enlarged by `radius` on every side; `None` if
/// there are no places.
fn corners(places: impl Iterator<Item = [f32; 3]>, radius: f32) -> Option<[[f32; 3]; 2]> {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for place in places {
        for axis in 0..3 {
            low[axis] = low[axis].min(place[axis]);
            high[axis] = high[axis].max(place[axis]);
        }
    }
    let wider = [low.map(|x| x - radius), high.map(|x| x + radius)];
    // Without places the corners are still infinite and in reverse order.
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

/// Returns the nearest of `seeds` to each of eight positions, or [`NONE`]. `limit` is the maximum
/// squared distance.
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
        // Both masks hold only for equal distances, and neither for NaN.
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

/// Returns the nearest of `seeds` to one position, or [`NONE`]; among equally near seeds, the oldest.
fn oldest_nearest(place: [f32; 3], seeds: &[(u32, [f32; 3])], limit: f32) -> u32 {
    let near = seeds.iter().map(|&(id, seed)| (squared_distance(place, seed), id));
    let near = near.filter(|(squared, _)| *squared <= limit);
    near.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).map_or(NONE, |(_, id)| id)
}

const CHUNK: usize = 64;
/// Number of consecutive points, neighbours in the image, that share candidate seeds.
pub const GROUP: usize = 8;
/// Movement of a point, relative to the reach, after which candidate seeds are gathered again.
const MARGIN: f32 = 0.25;

/// Candidate seeds within reach of points that move; gathered again after large movements.
pub struct NearSeeds<'a> {
    grid: &'a SeedGrid,
    reach: f32,
    /// Chunks of [`CHUNK`] points.
    chunks: Vec<Chunk>,
}

#[derive(Default)]
struct Chunk {
    places: Vec<[f32; 3]>,
    /// Positions of the points when the groups were last formed.
    gathered: Vec<[f32; 3]>,
    groups: SeedGroups,
}

impl<'a> NearSeeds<'a> {
    /// Creates a search for `n_points` points. `reach` is the maximum distance of a seed, world units,
    /// at most one cell width of the grid.
    pub fn new(grid: &'a SeedGrid, reach: f32, n_points: usize) -> Self {
        let mut chunks = Vec::new();
        chunks.resize_with(n_points.div_ceil(CHUNK), Chunk::default);
        Self { grid, reach, chunks }
    }

    /// Replaces `owners` by the component of the seed nearest to each point at the position that
    /// `place` returns. [`NONE`] if no seed is within reach. The points must be the same in every call.
    /// Returns the results of `of_chunk` for each [`CHUNK`] of points and owners, in order.
    pub fn assign<T: Send>(
        &mut self,
        components: &Components,
        points: &[SurfacePoint],
        place: impl Fn(&SurfacePoint) -> [f32; 3] + Sync,
        owners: &mut Vec<u32>,
        of_chunk: impl Fn(&[SurfacePoint], &[u32]) -> T + Sync,
    ) -> Vec<T> {
        owners.clear();
        owners.resize(points.len(), NONE);
        let (grid, reach) = (self.grid, self.reach);
        let parts = owners.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK));
        let parts = parts.zip(&mut self.chunks).map(|((owners, points), chunk)| {
            chunk.places.clear();
            chunk.places.extend(points.iter().map(&place));
            if chunk.has_moved_beyond(MARGIN * reach) {
                chunk.gather(grid, reach);
            }
            chunk.groups.nearest(grid, reach, &chunk.places, owners);
            for owner in owners.iter_mut().filter(|owner| **owner != NONE) {
                *owner = components.of_seed(*owner);
            }
            of_chunk(points, owners)
        });
        parts.collect()
    }
}

impl Chunk {
    /// True if a point has moved by more than `margin` (world units) since seeds were last gathered, or
    /// if none have been gathered yet.
    fn has_moved_beyond(&self, margin: f32) -> bool {
        let has_stayed = |(place, gathered): (&[f32; 3], &[f32; 3])| {
            squared_distance(*place, *gathered) <= margin * margin
        };
        let Self { places, gathered, .. } = self;
        gathered.len() != places.len() || !places.iter().zip(gathered).all(has_stayed)
    }

    fn gather(&mut self, grid: &SeedGrid, reach: f32) {
        self.gathered.clone_from(&self.places);
        self.groups.clear();
        // Wider by the margin, so that points moved by less still find every seed within reach.
        for places in self.places.chunks(GROUP) {
            self.groups.gather(grid, (1.0 + MARGIN) * reach, places);
        }
    }
}

/// Maximum distances of points from their seeds: directly, and in a search along rays.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Structural scale, world units.
    pub h: f32,
    /// Maximum distance of the search along rays, in half-widths of the depth noise; 0 disables the
    /// search.
    half_widths: f32,
}

impl Reach {
    pub fn new(h: f64, half_widths: f64) -> Self {
        Self { h: h as f32, half_widths: half_widths as f32 }
    }

    /// True if seeds are searched for along the rays of points that have no seed.
    pub fn searches_rays(self) -> bool {
        self.half_widths > 0.0
    }

    /// Returns the distance along a point's ray, in either direction, within which a seed is searched
    /// for, world units.
    #[inline(always)]
    pub fn along_ray(self, point: &SurfacePoint) -> f32 {
        // Limited by the maximum offset in sums.
        // The seed found may lie one `h` from the ray.
        (self.half_widths * point.noise).min((MAX_OFFSET - 1.0) * self.h)
    }
}

// Distance of the searched places, as a share of the point's reach, so that the searched spheres overlap.
const STEP: f32 = 0.7;

/// Kernel that searches for seeds along the rays of points that have no seed. Positions on the ray are
/// tried in order of their distance from the point. The search ends at the first position with a seed
/// within reach and uses the nearest such seed. Of two positions at equal distance, the one farther
/// from the camera is tried first. A surface in front of the point would have hidden the point.
pub struct SearchRays<'a> {
    pub grid: &'a SeedGrid,
    pub reach: Reach,
    pub points: &'a [SurfacePoint],
    /// Seed of each point, or [`NONE`].
    pub seeds: &'a mut [u32],
}

impl Kernel for SearchRays<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        for (point, seed) in self.points.iter().zip(self.seeds) {
            if *seed == NONE {
                *seed = seed_along_ray::<V>(self.grid, self.reach, point);
            }
        }
    }
}

#[inline(always)]
fn seed_along_ray<V: Vector>(grid: &SeedGrid, reach: Reach, point: &SurfacePoint) -> u32 {
    let (far, reach) = (reach.along_ray(point), reach.h);
    let ([x, y, z], [right, down, ahead]) = (point.position, point.direction);
    // The point itself was searched before.
    let mut step = 1.0;
    while STEP * reach * step <= far {
        let t = STEP * reach * step;
        for t in [t, -t] {
            let place = [x + t * right, y + t * down, z + t * ahead];
            let seed = grid.nearest_within::<V>(place, reach);
            if seed != NONE {
                return seed;
            }
        }
        step += 1.0;
    }
    NONE
}

#[cfg(test)]
mod near_seeds_tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    #[test]
    fn moved_points_find_what_searches_of_the_grid_find() {
        let mut grid = SeedGrid::new(0.1);
        let mut stream = Rng::new(5, Purpose::Init, 0);
        let mut place = |spread: f64| [0; 3].map(|_| stream.range(-spread, spread) as f32);
        let mut components = Components::default();
        for _ in 0..3000 {
            let seed = grid.insert(place(1.0));
            components.add_seed(seed);
        }
        // At the boundary of the grid.
        let rim = 0.1 * (1 << 20) as f32;
        components.add_seed(grid.insert([rim - 0.05, 0.0, 0.0]));
        let at = |position| SurfacePoint { position, ..SurfacePoint::default() };
        let mut points: Vec<SurfacePoint> = (0..1000).map(|_| at(place(1.0))).collect();
        // Points outside the grid, and points that enter or leave it.
        points.push(at([1e30, 0.0, 0.0]));
        points.extend((0..20).map(|i| at([rim + 0.01 * (i - 10) as f32, 0.0, 0.0])));
        let mut near = NearSeeds::new(&grid, 0.1, points.len());
        let mut owners = Vec::new();
        // Movements below the margin, close to it and far beyond.
        for spread in [0.0, 0.005, 0.02, 0.3] {
            let moved = points.iter().map(|point| {
                let way = place(spread);
                at([0, 1, 2].map(|i| point.position[i] + way[i]))
            });
            let moved: Vec<SurfacePoint> = moved.collect();
            near.assign(&components, &moved, |point| point.position, &mut owners, |_, _| ());
            for (point, owner) in moved.iter().zip(&owners) {
                assert_eq!(*owner, grid.nearest(point.position).unwrap_or(NONE));
            }
            assert!(owners.contains(&NONE) && owners.iter().any(|&o| o != NONE));
        }
    }
}

#[cfg(test)]
mod ray_search_tests {
    use super::*;
    use crate::math::simd::Isa;

    #[test]
    fn a_point_finds_the_surface_that_its_noise_allows() {
        let mut grid = SeedGrid::new(0.03);
        let wall = grid.insert([0.0, 0.0, 3.0]);
        let reach = Reach::new(0.03, 4.0);
        let found = |z: f32, x: f32, noise: f32| {
            let direction = [0.0, 0.0, 1.0];
            let point =
                SurfacePoint { position: [x, 0.0, z], direction, noise, ..Default::default() };
            let mut seeds = [NONE];
            Isa::best().run(SearchRays { grid: &grid, reach, points: &[point], seeds: &mut seeds });
            (seeds[0] != NONE).then_some(seeds[0])
        };
        assert_eq!(found(3.05, 0.0, 0.015), Some(wall), "four half-widths are 60 mm");
        assert_eq!(found(2.95, 0.01, 0.015), Some(wall), "from the front too");
        assert_eq!(found(3.05, 0.0, 0.004), None, "noise is smaller than that");
        assert_eq!(found(3.05, 0.035, 0.015), None, "beside the ray nothing is searched");
        assert_eq!(found(3.09, 0.0, 1.0), None, "sums hold no farther points");
    }
}
