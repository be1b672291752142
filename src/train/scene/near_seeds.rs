//! Seeds near points that move a little again and again, gathered once for many moves.

use super::assign::{corners, nearest_of};
use super::components::Components;
use super::grid::{CellBox, NONE, SeedGrid, squared_distance};
use crate::math::simd::{Isa, Kernel, Vector};
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;

/// Points that are gathered for by one thread at a time.
const CHUNK: usize = 256;
/// Most points that share their seeds: consecutive ones are neighbours in the picture.
const GROUP: usize = 8;
/// Most cells of a group that are looked through as one, beyond that its points are far apart.
const MAX_CELLS: f64 = 256.0;
/// How far points may move before the seeds near them are gathered anew, units of what is in reach.
const MARGIN: f32 = 0.25;

/// The seeds that each of some points has within reach as it moves, gathered anew where it moves far.
pub struct NearSeeds<'a> {
    grid: &'a SeedGrid,
    reach: f32,
    /// Of [`CHUNK`] points each.
    chunks: Vec<Chunk>,
}

#[derive(Default)]
struct Chunk {
    /// Where the points were gathered for.
    places: Vec<[f32; 3]>,
    groups: Vec<Group>,
    seeds: Vec<(u32, [f32; 3])>,
}

/// Consecutive points of a chunk.
struct Group {
    n_points: usize,
    /// Where their seeds end, and those of the next group begin.
    end: usize,
}

impl<'a> NearSeeds<'a> {
    /// Those of so many points; `reach` is the width of a cell at most.
    pub fn new(grid: &'a SeedGrid, reach: f32, n_points: usize) -> Self {
        let mut chunks = Vec::new();
        chunks.resize_with(n_points.div_ceil(CHUNK), Chunk::default);
        Self { grid, reach, chunks }
    }

    /// Replaces `owners` by the component of each of the points, which is that of the nearest seed;
    /// [`NONE`] where no seed is near enough. The points are the same ones every time, wherever they
    /// have moved to.
    pub fn assign(
        &mut self,
        components: &Components,
        points: &[SurfacePoint],
        owners: &mut Vec<u32>,
    ) {
        owners.clear();
        owners.resize(points.len(), NONE);
        let (grid, reach, isa) = (self.grid, self.reach, Isa::best());
        let parts = owners.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK));
        parts.zip(&mut self.chunks).for_each(|((owners, points), chunk)| {
            if chunk.has_left(points, MARGIN * reach) {
                chunk.gather(grid, reach, points);
            }
            isa.run(MovedChunk { reach, chunk, points, owners });
            for owner in owners.iter_mut().filter(|owner| **owner != NONE) {
                *owner = components.of_seed(*owner);
            }
        });
    }
}

impl Chunk {
    /// Whether a point is farther than `margin` from where it was gathered for, or never was.
    fn has_left(&self, points: &[SurfacePoint], margin: f32) -> bool {
        let has_stayed = |(point, place): (&SurfacePoint, &[f32; 3])| {
            squared_distance(point.position, *place) <= margin * margin
        };
        self.places.len() != points.len() || !points.iter().zip(&self.places).all(has_stayed)
    }

    /// Gathers seeds for points where they are now.
    fn gather(&mut self, grid: &SeedGrid, reach: f32, points: &[SurfacePoint]) {
        self.places.clear();
        self.groups.clear();
        self.seeds.clear();
        // A little more, as distances are rounded.
        let radius = (1.0 + MARGIN) * reach * (1.0 + 1e-5);
        points.chunks(GROUP).for_each(|group| self.gather_group(grid, radius, group));
    }

    /// Takes in a group of points; one whose points lie too far apart is halved.
    fn gather_group(&mut self, grid: &SeedGrid, radius: f32, points: &[SurfacePoint]) {
        let mut around = CellBox::EMPTY;
        let mut is_reached = true;
        for point in points {
            match cells(grid, radius, point.position) {
                Some([low, high]) => around.include(low, high),
                None => is_reached = false,
            }
        }
        if points.len() > 1 && (!is_reached || around.n_cells() > MAX_CELLS) {
            let (first, second) = points.split_at(points.len() / 2);
            self.gather_group(grid, radius, first);
            self.gather_group(grid, radius, second);
            return;
        }
        let places = points.iter().map(|point| point.position);
        // What no cell holds has no seeds, and is looked at anew wherever it moves to.
        if is_reached {
            let (low, high) = corners(points, radius);
            grid.visit(around.low, around.high, |id, seed| {
                if (0..3).all(|i| seed[i] >= low[i] && seed[i] <= high[i]) {
                    self.seeds.push((id, seed));
                }
            });
        }
        self.places.extend(places);
        self.groups.push(Group { n_points: points.len(), end: self.seeds.len() });
    }
}

/// Points of a chunk, not far from where its seeds were gathered for.
struct MovedChunk<'a> {
    reach: f32,
    chunk: &'a Chunk,
    points: &'a [SurfacePoint],
    /// By point its nearest seed.
    owners: &'a mut [u32],
}

impl Kernel for MovedChunk<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { reach, chunk, points, owners } = self;
        let (mut first, mut start) = (0, 0);
        for group in &chunk.groups {
            let seeds = chunk.seeds[start..group.end].iter().copied();
            let range = first..first + group.n_points;
            let mut places = [[0.0; 3]; GROUP];
            for (place, point) in places.iter_mut().zip(&points[range.clone()]) {
                *place = point.position;
            }
            let found = nearest_of::<GROUP>(&places, seeds, reach * reach);
            owners[range].copy_from_slice(&found[..group.n_points]);
            (first, start) = (first + group.n_points, group.end);
        }
    }
}

/// First and last of the cells around a place; `None` beyond the reach of the grid.
fn cells(grid: &SeedGrid, radius: f32, place: [f32; 3]) -> Option<[[i32; 3]; 2]> {
    let corners = [place.map(|x| x - radius), place.map(|x| x + radius)];
    let is_reached = corners.iter().all(|corner| grid.reaches(*corner));
    is_reached.then(|| corners.map(|corner| grid.cell_of(corner)))
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
            components.born(seed, WHOLE);
        }
        let at = |position| SurfacePoint { position, ..SurfacePoint::default() };
        let mut points: Vec<SurfacePoint> = (0..1000).map(|_| at(place(1.0))).collect();
        // One that no cell holds.
        points.push(at([1e30, 0.0, 0.0]));
        let mut near = NearSeeds::new(&grid, 0.1, points.len());
        let mut owners = Vec::new();
        // Less far than the margin, about as far, and much farther.
        for spread in [0.0, 0.005, 0.02, 0.3] {
            let moved = points.iter().map(|point| {
                let way = place(spread);
                at([0, 1, 2].map(|i| point.position[i] + way[i]))
            });
            let moved: Vec<SurfacePoint> = moved.collect();
            near.assign(&components, &moved, &mut owners);
            for (point, owner) in moved.iter().zip(&owners) {
                assert_eq!(*owner, grid.nearest(point.position).unwrap_or(NONE));
            }
            assert!(owners.contains(&NONE) && owners.iter().any(|&o| o != NONE));
        }
    }
}
