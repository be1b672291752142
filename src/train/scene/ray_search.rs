//! Search for a seed along a point's ray if none is near enough, as depth errs along the ray (`scene.md`, Ray
//! search).

use super::grid::{NONE, SeedGrid};
use super::spacing::Spacing;
use crate::math::simd::{Kernel, Vector};
use crate::observation::surface::SurfacePoint;

/// Distance of the searched places, as a share of the point's reach, so that the searched spheres overlap.
const STEP: f32 = 0.7;

/// Assigns points without a seed the nearest seed within reach of a place on their ray, nearest places first.
/// Of two equally near places the farther from the camera is preferred, since a surface in front would have
/// occluded the point.
pub struct SearchRays<'a> {
    pub grid: &'a SeedGrid,
    pub spacing: Spacing,
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
                *seed = seed_along_ray::<V>(self.grid, self.spacing, point);
            }
        }
    }
}

#[inline(always)]
fn seed_along_ray<V: Vector>(grid: &SeedGrid, spacing: Spacing, point: &SurfacePoint) -> u32 {
    let (reach, far) = (spacing.reach(point), spacing.reach_along_ray(point));
    let ([x, y, z], [right, down, ahead]) = (point.position, point.direction);
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
mod tests {
    use super::*;
    use crate::math::simd::Isa;

    #[test]
    fn a_point_finds_the_surface_that_its_noise_allows() {
        let mut grid = SeedGrid::new(0.03);
        let wall = grid.insert([0.0, 0.0, 3.0]);
        let spacing = Spacing::new(0.03, None).with_ray_search(4.0);
        let found = |z: f32, x: f32, noise: f32| {
            let direction = [0.0, 0.0, 1.0];
            let point =
                SurfacePoint { position: [x, 0.0, z], direction, noise, ..Default::default() };
            let mut seeds = [NONE];
            Isa::best().run(SearchRays {
                grid: &grid,
                spacing,
                points: &[point],
                seeds: &mut seeds,
            });
            (seeds[0] != NONE).then_some(seeds[0])
        };
        assert_eq!(found(3.05, 0.0, 0.015), Some(wall), "four half-widths are 60 mm");
        assert_eq!(found(2.95, 0.01, 0.015), Some(wall), "from the front too");
        assert_eq!(found(3.05, 0.0, 0.004), None, "noise is smaller than that");
        assert_eq!(found(3.05, 0.035, 0.015), None, "beside the ray nothing is searched");
        assert_eq!(found(3.09, 0.0, 1.0), None, "sums hold no farther points");
    }
}
