//! The nearest seed of many points: neighbours gather the seeds around them together, and compare all with
//! all.
//!
//! Straight loops that vectors run through, where a lookup per point would chase buckets.

use super::grid::{NONE, SeedGrid, squared_distance};
use crate::math::simd::{Isa, Kernel, Vector};

/// Most cells of a group that are looked through as one; beyond that its points are far apart.
const MAX_CELLS: f64 = 512.0;

/// Groups of consecutive points with the seeds around each.
#[derive(Default)]
pub struct SeedGroups {
    groups: Vec<Group>,
    seeds: Vec<(u32, [f32; 3])>,
}

struct Group {
    n_points: usize,
    /// Where their seeds end, and those of the next group begin.
    end: usize,
}

impl SeedGroups {
    /// Forgets all groups.
    pub fn clear(&mut self) {
        self.groups.clear();
        self.seeds.clear();
    }

    /// Adds a group of points, given by their places, with the seeds within `radius` (world units) of each, and some more.
    pub fn gather(&mut self, grid: &SeedGrid, radius: f32, points: &[[f32; 3]]) {
        // A little more, as distances are rounded.
        self.gather_halves(grid, radius * (1.0 + 1e-5), points);
    }

    /// A group that a depth edge tears apart is halved until it holds together: one point's cells are few.
    fn gather_halves(&mut self, grid: &SeedGrid, radius: f32, points: &[[f32; 3]]) {
        let near = points.iter().copied().filter(|point| grid.comes_near(*point, radius));
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

    /// Sets by point its nearest seed, no farther than `reach`; [`NONE`] where none is. The points are those
    /// that were gathered for, no farther from there than they were gathered more widely; `N` of them
    /// are compared at once.
    pub fn nearest<const N: usize>(
        &self,
        grid: &SeedGrid,
        reach: f32,
        points: &[[f32; 3]],
        owners: &mut [u32],
    ) {
        let limit = reach * reach;
        Isa::best().run(Nearest::<N> { groups: self, grid, limit, points, owners });
    }
}

/// Lower and upper corner of the box around some places, wider by `radius` on every side; `None` of none.
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

struct Nearest<'a, const N: usize> {
    groups: &'a SeedGroups,
    grid: &'a SeedGrid,
    limit: f32,
    points: &'a [[f32; 3]],
    owners: &'a mut [u32],
}

impl<const N: usize> Kernel for Nearest<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let (mut points, mut owners, mut start) = (self.points, self.owners, 0);
        for group in &self.groups.groups {
            let (these, later) = points.split_at(group.n_points);
            let (found, left) = owners.split_at_mut(group.n_points);
            let seeds = &self.groups.seeds[start..group.end];
            for (points, owners) in these.chunks(N).zip(found.chunks_mut(N)) {
                // What is beyond the grid has no seed, whoever its neighbours are.
                let mut places = [[f32::NAN; 3]; N];
                for (place, point) in places.iter_mut().zip(points) {
                    if self.grid.reaches(*point) {
                        *place = *point;
                    }
                }
                let nearest = nearest_of(&places, seeds, self.limit);
                owners.copy_from_slice(&nearest[..owners.len()]);
            }
            (points, owners, start) = (later, left, group.end);
        }
    }
}

/// The nearest of some seeds to each of some places, no farther than the root of `limit`.
#[inline(always)]
fn nearest_of<const N: usize>(
    places: &[[f32; 3]; N],
    seeds: &[(u32, [f32; 3])],
    limit: f32,
) -> [u32; N] {
    let along: [[f32; N]; 3] = std::array::from_fn(|axis| places.map(|place| place[axis]));
    // Whole arrays even for few places: loops of constant length become vectors.
    let (mut best, mut found) = ([limit; N], [NONE; N]);
    for &(id, seed) in seeds {
        for i in 0..N {
            let d2 = squared_distance([along[0][i], along[1][i], along[2][i]], seed);
            // Equal distances go to the older seed, in whatever order blocks are visited.
            let closer = d2 < best[i] || (d2 == best[i] && id < found[i]);
            best[i] = if closer { d2 } else { best[i] };
            found[i] = if closer { id } else { found[i] };
        }
    }
    found
}
