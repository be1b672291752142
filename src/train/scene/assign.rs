//! Assignment of every point to the component with the nearest seed within its reach.
//!
//! Distance alone decides: normals or colours as additional dimensions gave more components but no better
//! picture (`scene.md`, Effect of each part).

use super::components::Seeds;
use super::grid::NONE;
use super::seed_groups::{Reach, SearchRays, SeedGroups};
use crate::math::simd::Isa;
use crate::model::scene::points_device::LEFT_TO_PROCESSOR;
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;

// Points searched together: points come in tiles of eight by eight pixels.
const GROUP: usize = 64;

/// Replaces `owners` by the component of each point: the component of the nearest seed within `reach`.
/// [`NONE`] if there is no such seed.
pub fn assign(seeds: &Seeds, reach: Reach, points: &[SurfacePoint], owners: &mut Vec<u32>) {
    owners.clear();
    owners.resize(points.len(), NONE);
    owners.par_chunks_mut(GROUP).zip(points.par_chunks(GROUP)).for_each_init(
        || (SeedGroups::default(), Vec::with_capacity(GROUP)),
        |(groups, places), (owners, points)| {
            places.clear();
            places.extend(points.iter().map(|point| point.position));
            groups.clear();
            groups.gather(&seeds.grid, reach.h, places);
            groups.nearest(&seeds.grid, reach.h, places, owners);
            keep_components(seeds, reach, points, owners);
        },
    );
}

/// Completes an assignment by a device: replaces the seeds in `owners` by their components. On entry
/// `owners` holds the nearest seed of each point within the structural scale, or [`NONE`]. For points
/// with [`LEFT_TO_PROCESSOR`], the CPU first finds the seed.
pub fn assign_known(seeds: &Seeds, reach: Reach, points: &[SurfacePoint], owners: &mut [u32]) {
    owners.par_chunks_mut(GROUP).zip(points.par_chunks(GROUP)).for_each(|(owners, points)| {
        for (owner, point) in
            owners.iter_mut().zip(points).filter(|(owner, _)| **owner == LEFT_TO_PROCESSOR)
        {
            *owner = seeds.grid.nearest(point.position).unwrap_or(NONE);
        }
        keep_components(seeds, reach, points, owners);
    });
}

/// Replaces the seeds in `owners` by their components. For points without a seed, a seed is first
/// searched for along the ray, if ray search is enabled.
fn keep_components(seeds: &Seeds, reach: Reach, points: &[SurfacePoint], owners: &mut [u32]) {
    if reach.searches_rays() {
        Isa::best().run(SearchRays { grid: &seeds.grid, reach, points, seeds: owners });
    }
    for owner in owners.iter_mut().filter(|owner| **owner != NONE) {
        *owner = seeds.components.of_seed(*owner);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    /// The search by groups of points finds what a search of the grid for each point finds. In every
    /// fourth group the points lie far apart.
    #[test]
    fn groups_find_what_single_searches_find() {
        let mut seeds = Seeds::new(0.1);
        let mut stream = Rng::new(2, Purpose::Init, 0);
        let mut place = |spread: f64| [0; 3].map(|_| stream.range(-spread, spread) as f32);
        for _ in 0..3000 {
            seeds.add(place(1.0));
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
        // The last group is not full.
        points.truncate(points.len() - 7);
        let mut owners = Vec::new();
        assign(&seeds, Reach::new(0.1, 0.0), &points, &mut owners);
        for (point, owner) in points.iter().zip(&owners) {
            assert_eq!(*owner, seeds.grid.nearest(point.position).unwrap_or(NONE));
        }
        assert!(owners.contains(&NONE) && owners.iter().any(|&o| o != NONE));
    }
}
