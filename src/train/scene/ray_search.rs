//! The surface of a point that no seed is near enough for: depth errs along the ray, so that is where its surface
//! may be (`scene.md`, Ray search).

use super::grid::SeedGrid;
use super::spacing::Spacing;
use crate::observation::surface::SurfacePoint;

/// Distance of the places that are looked at, shares of a point's reach: balls about them overlap.
const STEP: f32 = 0.7;

/// The nearest seed within reach of a place on the point's ray, the nearest such place first; of two as near
/// the one behind, since what is in front would have hidden it.
pub fn seed_along_ray(grid: &SeedGrid, spacing: Spacing, point: &SurfacePoint) -> Option<u32> {
    let (reach, far) = (spacing.reach(point), spacing.reach_along_ray(point));
    let steps = (1..).map(|i| STEP * reach * i as f32).take_while(|t| *t <= far);
    steps.flat_map(|t| [t, -t]).find_map(|t| {
        let place = [0, 1, 2].map(|i| point.position[i] + t * point.direction[i]);
        grid.nearest(place).filter(|&seed| grid.is_within(seed, place, reach))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_finds_the_surface_that_its_noise_allows() {
        let mut grid = SeedGrid::new(0.03);
        let wall = grid.insert([0.0, 0.0, 3.0]);
        let spacing = Spacing::new(0.03, None).with_ray_search(4.0);
        let found = |z: f32, x: f32, noise: f32| {
            let direction = [0.0, 0.0, 1.0];
            let point =
                SurfacePoint { position: [x, 0.0, z], direction, noise, ..Default::default() };
            seed_along_ray(&grid, spacing, &point)
        };
        assert_eq!(found(3.05, 0.0, 0.015), Some(wall), "four half-widths are 60 mm");
        assert_eq!(found(2.95, 0.01, 0.015), Some(wall), "from the front too");
        assert_eq!(found(3.05, 0.0, 0.004), None, "noise is smaller than that");
        assert_eq!(found(3.05, 0.035, 0.015), None, "beside the ray nothing is looked for");
        assert_eq!(found(3.09, 0.0, 1.0), None, "sums hold no farther points");
    }
}
