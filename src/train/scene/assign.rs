//! The component of every point: the one with the nearest seed within its reach.
//!
//! Consecutive points are neighbours, so a group of them collects the seeds of the cells it touches
//! once and compares all with all: straight loops that vectors run through, where a lookup per
//! point would chase 27 buckets. A group that is torn apart by a depth edge falls back to single
//! searches. Distance alone decides: normals or colours as further dimensions brought more
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
/// Most cells of a group that are looked through as one; beyond that its points are far apart.
// 8³: eight pixels are some 3 `h` at the default scale, and a cell is added at either side.
const MAX_CELLS: f64 = 512.0;

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
        for (point, owner) in points.iter().zip(owners) {
            *owner = grid.nearest(point.position).unwrap_or(NONE);
        }
        return;
    }
    near.ids.clear();
    near.seeds.clear();
    // Cells are wider than a group: most of their seeds are within reach of none of its points.
    let (low_corner, high_corner) = corners(points);
    grid.visit(around.low, around.high, |id, seed| {
        let is_near =
            (0..3).all(|i| seed[i] >= low_corner[i] - reach && seed[i] <= high_corner[i] + reach);
        if is_near {
            near.ids.push(id);
            near.seeds.push(seed);
        }
    });
    Isa::best().run(Nearest { near, limit: reach * reach, points, owners });
}

/// The box around some points.
fn corners(points: &[SurfacePoint]) -> ([f32; 3], [f32; 3]) {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for point in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(point.position[axis]);
            high[axis] = high[axis].max(point.position[axis]);
        }
    }
    (low, high)
}

/// The nearest of some seeds, for up to [`GROUP`] points at once.
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
        let mut place = [[0.0f32; GROUP]; 3];
        let [xs, ys, zs] = &mut place;
        for (i, point) in points.iter().enumerate() {
            [xs[i], ys[i], zs[i]] = point.position;
        }
        // Whole arrays even for a short group: loops of constant length become vectors.
        let (mut best, mut found) = ([limit; GROUP], [NONE; GROUP]);
        for (&id, seed) in near.ids.iter().zip(&near.seeds) {
            for i in 0..GROUP {
                let d2 = squared_distance([place[0][i], place[1][i], place[2][i]], *seed);
                // Equal distances go to the older seed, in whatever order cells are visited.
                let closer = d2 < best[i] || (d2 == best[i] && id < found[i]);
                best[i] = if closer { d2 } else { best[i] };
                found[i] = if closer { id } else { found[i] };
            }
        }
        owners.copy_from_slice(&found[..owners.len()]);
    }
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
