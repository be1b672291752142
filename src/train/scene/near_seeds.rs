//! Candidate seeds of points that move slightly and repeatedly, gathered once for many moves.

use super::components::Components;
use super::grid::{NONE, SeedGrid, squared_distance};
use super::seed_groups::SeedGroups;
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;

const CHUNK: usize = 64;
/// Number of points that share candidates: consecutive points are neighbours in the image.
pub const GROUP: usize = 8;
/// Movement after which candidates are gathered again, relative to the reach.
const MARGIN: f32 = 0.25;

/// Candidate seeds within reach of points that move; refreshed after large movements.
pub struct NearSeeds<'a> {
    grid: &'a SeedGrid,
    reach: f32,
    /// Chunks of [`CHUNK`] points.
    chunks: Vec<Chunk>,
}

#[derive(Default)]
struct Chunk {
    /// Current positions.
    places: Vec<[f32; 3]>,
    /// Positions at the last gathering.
    gathered: Vec<[f32; 3]>,
    groups: SeedGroups,
}

impl<'a> NearSeeds<'a> {
    /// Prepares for `n_points` points; `reach` is at most one cell width.
    pub fn new(grid: &'a SeedGrid, reach: f32, n_points: usize) -> Self {
        let mut chunks = Vec::new();
        chunks.resize_with(n_points.div_ceil(CHUNK), Chunk::default);
        Self { grid, reach, chunks }
    }

    /// Replaces `owners` by the component of each point moved by `place`, that of the nearest seed; [`NONE`]
    /// if no seed is near enough. The points must be the same in every call. Returns the results of `look`
    /// for each [`CHUNK`] of points and owners, in order.
    pub fn assign<T: Send>(
        &mut self,
        components: &Components,
        points: &[SurfacePoint],
        place: impl Fn(&SurfacePoint) -> [f32; 3] + Sync,
        owners: &mut Vec<u32>,
        look: impl Fn(&[SurfacePoint], &[u32]) -> T + Sync,
    ) -> Vec<T> {
        owners.clear();
        owners.resize(points.len(), NONE);
        let (grid, reach) = (self.grid, self.reach);
        let parts = owners.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK));
        let parts = parts.zip(&mut self.chunks).map(|((owners, points), chunk)| {
            chunk.move_to(points.iter().map(&place));
            if chunk.has_moved_beyond(MARGIN * reach) {
                chunk.gather(grid, reach);
            }
            chunk.groups.nearest(grid, reach, &chunk.places, owners);
            for owner in owners.iter_mut().filter(|owner| **owner != NONE) {
                *owner = components.of_seed(*owner);
            }
            look(points, owners)
        });
        parts.collect()
    }
}

impl Chunk {
    fn move_to(&mut self, places: impl Iterator<Item = [f32; 3]>) {
        self.places.clear();
        self.places.extend(places);
    }

    /// True if a point moved more than `margin` since the last gathering, or none has taken place.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};
    use crate::model::scene::state::WHOLE;

    #[test]
    fn moved_points_find_what_searches_of_the_grid_find() {
        let mut grid = SeedGrid::new(0.1);
        let mut stream = Rng::new(5, Purpose::Init, 0);
        let mut place = |spread: f64| [0; 3].map(|_| stream.range(-spread, spread) as f32);
        let mut components = Components::default();
        for _ in 0..3000 {
            let seed = grid.insert(place(1.0));
            components.add_seed(seed, WHOLE);
        }
        // At the boundary of the grid.
        let rim = 0.1 * (1 << 20) as f32;
        components.add_seed(grid.insert([rim - 0.05, 0.0, 0.0]), WHOLE);
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
