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

/// Replaces `owners` by the component of each point: the component of the nearest seed within `reach`. A
/// point without such a seed has [`NONE`].
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
/// `owners` holds the nearest seed of each point within the structural scale, or [`NONE`]. Points with
/// [`LEFT_TO_PROCESSOR`] are searched here.
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

/// Replaces the seeds in `owners` by their components. Points without a seed are first searched along
/// their rays, if ray search is on.
fn keep_components(seeds: &Seeds, reach: Reach, points: &[SurfacePoint], owners: &mut [u32]) {
    if reach.searches_rays() {
        Isa::best().run(SearchRays { grid: &seeds.grid, reach, points, seeds: owners });
    }
    for owner in owners.iter_mut().filter(|owner| **owner != NONE) {
        *owner = seeds.components.of_seed(*owner);
    }
}
