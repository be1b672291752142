//! Seeds near points that are about to move a little, gathered once for all their moves.

use super::components::Components;
use super::grid::{CellBox, NONE, SeedGrid, squared_distance};
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;

/// Points that are gathered for by one thread at a time.
const CHUNK: usize = 256;
/// Consecutive points whose cells are looked through together: they are neighbours in the picture.
const GROUP: usize = 8;
/// Most cells of a group that are looked through as one, beyond that its points are far apart.
const MAX_CELLS: f64 = 256.0;
/// How far points may move before they are searched for one by one, units of what is in reach.
const MARGIN: f32 = 0.25;

/// The seeds that each of some points has within reach wherever it moves to, if that is not far.
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
    /// By point the end of its seeds.
    ends: Vec<u32>,
    seeds: Vec<(u32, [f32; 3])>,
}

impl<'a> NearSeeds<'a> {
    /// Those of points where they are now; `reach` is the width of a cell at most.
    pub fn new(grid: &'a SeedGrid, reach: f32, points: &[SurfacePoint]) -> Self {
        let chunks = points.par_chunks(CHUNK).map(|points| Chunk::new(grid, reach, points));
        Self { grid, reach, chunks: chunks.collect() }
    }

    /// Replaces `owners` by the component of each of the points, moved from where they were, which is
    /// that of the nearest seed; [`NONE`] where no seed is near enough.
    pub fn assign(&self, components: &Components, points: &[SurfacePoint], owners: &mut Vec<u32>) {
        owners.clear();
        owners.resize(points.len(), NONE);
        let parts = owners.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).zip(&self.chunks);
        parts.for_each(|((owners, points), chunk)| {
            for (i, (owner, point)) in owners.iter_mut().zip(points).enumerate() {
                let seed = self.nearest(chunk, i, point.position);
                *owner = seed.map_or(NONE, |seed| components.of_seed(seed));
            }
        });
    }

    fn nearest(&self, chunk: &Chunk, i: usize, position: [f32; 3]) -> Option<u32> {
        let margin = MARGIN * self.reach;
        let has_stayed = squared_distance(position, chunk.places[i]) <= margin * margin;
        if !has_stayed {
            return self.grid.nearest(position);
        }
        let (mut best, mut found) = (self.reach * self.reach, NONE);
        for &(id, seed) in chunk.seeds(i) {
            let d2 = squared_distance(position, seed);
            // Equal distances go to the older seed.
            if d2 < best || (d2 == best && id < found) {
                (best, found) = (d2, id);
            }
        }
        (found != NONE).then_some(found)
    }
}

impl Chunk {
    fn new(grid: &SeedGrid, reach: f32, points: &[SurfacePoint]) -> Self {
        let mut chunk = Self::default();
        // A little more, as distances are rounded.
        let radius = (1.0 + MARGIN) * reach * (1.0 + 1e-5);
        let mut shared = Vec::new();
        for group in points.chunks(GROUP) {
            let is_shared = gather(grid, radius, group, &mut shared);
            for point in group {
                let place = point.position;
                let near = |seed: [f32; 3]| squared_distance(place, seed) <= radius * radius;
                if is_shared {
                    chunk.seeds.extend(shared.iter().filter(|(_, seed)| near(*seed)));
                    chunk.places.push(place);
                } else if let Some([low, high]) = cells(grid, radius, place) {
                    grid.visit(low, high, |id, seed| {
                        if near(seed) {
                            chunk.seeds.push((id, seed));
                        }
                    });
                    chunk.places.push(place);
                } else {
                    // Never near to itself, so that the grid is asked.
                    chunk.places.push([f32::NAN; 3]);
                }
                chunk.ends.push(chunk.seeds.len() as u32);
            }
        }
        chunk
    }

    fn seeds(&self, i: usize) -> &[(u32, [f32; 3])] {
        let start = if i == 0 { 0 } else { self.ends[i - 1] };
        &self.seeds[start as usize..self.ends[i] as usize]
    }
}

/// First and last of the cells around a place; `None` beyond the reach of the grid.
fn cells(grid: &SeedGrid, radius: f32, place: [f32; 3]) -> Option<[[i32; 3]; 2]> {
    let corners = [place.map(|x| x - radius), place.map(|x| x + radius)];
    let is_reached = corners.iter().all(|corner| grid.reaches(*corner));
    is_reached.then(|| corners.map(|corner| grid.cell_of(corner)))
}

/// Replaces `seeds` by those of all cells around some points; `false` where they lie too far apart for it.
fn gather(
    grid: &SeedGrid,
    radius: f32,
    points: &[SurfacePoint],
    seeds: &mut Vec<(u32, [f32; 3])>,
) -> bool {
    let mut around = CellBox::EMPTY;
    for point in points {
        let Some([low, high]) = cells(grid, radius, point.position) else { return false };
        around.include(low, high);
    }
    if around.n_cells() > MAX_CELLS {
        return false;
    }
    seeds.clear();
    grid.visit(around.low, around.high, |id, seed| seeds.push((id, seed)));
    true
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
        let near = NearSeeds::new(&grid, 0.1, &points);
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
