//! The component of every point: the one with the nearest seed within its reach.
//!
//! Consecutive points are neighbours, so a group of them collects the seeds of the cells it touches
//! once and compares all with all: straight loops that vectors run through, where a lookup per
//! point would chase 27 buckets. A group that is torn apart by a depth edge is halved. Distance alone decides: normals or colours as further dimensions brought more
//! components and no better picture (`scene.md`, Tried and dropped).

use super::components::Components;
use super::grid::{CellBox, NONE, SeedGrid, squared_distance};
use super::spacing::Spacing;
use crate::math::simd::{Isa, Kernel, Vector};
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;

/// Points that are searched for together.
// As many as a tile of 8×8 pixels, in whose order points come.
const GROUP: usize = 64;
/// Points that are compared with a seed at once.
const WIDTH: usize = 16;
/// Most cells of a group that are looked through as one; beyond that its points are far apart.
const MAX_CELLS: f64 = 256.0;

/// Seeds near a group.
#[derive(Default)]
struct Near {
    ids: Vec<u32>,
    seeds: Vec<[f32; 3]>,
}

/// Replaces `owners` by the component of every point, which is that of the nearest seed; [`NONE`]
/// where no seed is near enough.
pub fn assign(
    grid: &SeedGrid,
    components: &Components,
    spacing: Spacing,
    points: &[SurfacePoint],
    owners: &mut Vec<u32>,
) {
    owners.clear();
    owners.resize(points.len(), NONE);
    owners.par_chunks_mut(GROUP).zip(points.par_chunks(GROUP)).for_each_init(
        Near::default,
        |near, (owners, points)| {
            assign_group(grid, spacing.h(), points, owners, near);
            if !spacing.is_even() {
                keep_within(grid, spacing, points, owners);
            }
            for owner in owners.iter_mut().filter(|owner| **owner != NONE) {
                *owner = components.of_seed(*owner);
            }
        },
    );
}

/// Leaves points without a seed that are too far from theirs for what their view tells apart.
fn keep_within(grid: &SeedGrid, spacing: Spacing, points: &[SurfacePoint], owners: &mut [u32]) {
    for (point, owner) in points.iter().zip(owners).filter(|(_, owner)| **owner != NONE) {
        let reach = spacing.reach(point);
        if squared_distance(grid.position(*owner as usize), point.position) > reach * reach {
            *owner = NONE;
        }
    }
}

/// A group that a depth edge tears apart is halved until it holds together: one point's cells are few.
fn assign_group(
    grid: &SeedGrid,
    reach: f32,
    points: &[SurfacePoint],
    owners: &mut [u32],
    near: &mut Near,
) {
    let mut around = CellBox::EMPTY;
    for point in points.iter().filter(|p| grid.reaches(p.position)) {
        let cell = grid.cell_of(point.position);
        around.include(cell.map(|c| c - 1), cell.map(|c| c + 1));
    }
    let n_cells = around.n_cells();
    if n_cells == 0.0 {
        return; // no point within reach
    }
    if n_cells > MAX_CELLS {
        let middle = points.len() / 2;
        let (first, second) = owners.split_at_mut(middle);
        assign_group(grid, reach, &points[..middle], first, near);
        assign_group(grid, reach, &points[middle..], second, near);
        return;
    }
    near.ids.clear();
    near.seeds.clear();
    // Cells are wider than a group: most of their seeds are within reach of none of its points.
    let (low, high) = corners(points, reach);
    grid.visit(around.low, around.high, |id, seed| {
        if (0..3).all(|i| seed[i] >= low[i] && seed[i] <= high[i]) {
            near.ids.push(id);
            near.seeds.push(seed);
        }
    });
    Isa::best().run(Nearest { near, limit: reach * reach, points, owners });
}

/// Lower and upper corner of the box around some points, wider by `reach` on every side.
pub fn corners(points: &[SurfacePoint], reach: f32) -> ([f32; 3], [f32; 3]) {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for point in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(point.position[axis] - reach);
            high[axis] = high[axis].max(point.position[axis] + reach);
        }
    }
    (low, high)
}

/// The nearest of some seeds, for all points of a group.
struct Nearest<'a> {
    near: &'a Near,
    limit: f32,
    points: &'a [SurfacePoint],
    owners: &'a mut [u32],
}

impl Kernel for Nearest<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { near, limit, points, owners } = self;
        let seeds = near.ids.iter().copied().zip(near.seeds.iter().copied());
        for (points, owners) in points.chunks(WIDTH).zip(owners.chunks_mut(WIDTH)) {
            let mut places = [[0.0; 3]; WIDTH];
            places.iter_mut().zip(points).for_each(|(place, point)| *place = point.position);
            let found = nearest_of::<WIDTH>(&places, seeds.clone(), limit);
            owners.copy_from_slice(&found[..owners.len()]);
        }
    }
}

/// The nearest of some seeds to each of `N` places, no farther than the root of `limit`; [`NONE`] where
/// none is.
#[inline(always)]
pub fn nearest_of<const N: usize>(
    places: &[[f32; 3]; N],
    seeds: impl Iterator<Item = (u32, [f32; 3])>,
    limit: f32,
) -> [u32; N] {
    let along: [[f32; N]; 3] = std::array::from_fn(|axis| places.map(|place| place[axis]));
    // Whole arrays even for few places: loops of constant length become vectors.
    let (mut best, mut found) = ([limit; N], [NONE; N]);
    for (id, seed) in seeds {
        for i in 0..N {
            let d2 = squared_distance([along[0][i], along[1][i], along[2][i]], seed);
            // Equal distances go to the older seed, in whatever order cells are visited.
            let closer = d2 < best[i] || (d2 == best[i] && id < found[i]);
            best[i] = if closer { d2 } else { best[i] };
            found[i] = if closer { id } else { found[i] };
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};
    use crate::model::scene::state::WHOLE;

    #[test]
    fn groups_find_what_single_searches_find() {
        let mut grid = SeedGrid::new(0.1);
        let mut stream = Rng::new(2, Purpose::Init, 0);
        let mut place = |spread: f64| [0; 3].map(|_| stream.range(-spread, spread) as f32);
        for _ in 0..3000 {
            grid.insert(place(1.0));
        }
        let mut points: Vec<SurfacePoint> = Vec::new();
        for group in 0..40 {
            let centre = place(1.0);
            let spread = if group % 4 == 0 { 1.0 } else { 0.1 };
            points.extend((0..GROUP).map(|_| {
                let offset = place(spread);
                let position = [0, 1, 2].map(|i| centre[i] + offset[i]);
                SurfacePoint { position, ..SurfacePoint::default() }
            }));
        }
        points.truncate(points.len() - 7);
        let mut owners = Vec::new();
        let mut components = Components::default();
        for seed in 0..grid.len() as u32 {
            components.born(seed, WHOLE);
        }
        assign(&grid, &components, Spacing::new(0.1, None), &points, &mut owners);
        for (point, owner) in points.iter().zip(&owners) {
            assert_eq!(*owner, grid.nearest(point.position).unwrap_or(NONE));
        }
        assert!(owners.contains(&NONE) && owners.iter().any(|&o| o != NONE));
    }
}
