//! Births: points without a component nearby become seeds of new components, in the order of the
//! points.

use super::components::Seeds;
use super::grid::{NONE, SeedGrid};
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameBirths {
    pub born: usize,
    /// Number of points without a component because the budget is exhausted.
    pub refused: usize,
    /// Number of points too far from the origin for f32 positions to distinguish neighbours.
    pub out_of_reach: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    pub components: usize,
    pub seeds: usize,
}

/// Assigns components to the points whose owner is [`NONE`]. If a seed created in this frame is within
/// the structural scale `h` (world units), the point gets the component of that seed. Otherwise, within
/// the limits, the point becomes the seed of a new component.
pub fn create_components(
    h: f64,
    seeds: &mut Seeds,
    points: &[SurfacePoint],
    owners: &mut [u32],
    limits: Limits,
) -> FrameBirths {
    // Found in parallel first: they are few, and the loop over them is not parallel.
    let lone = owners.par_iter().enumerate().with_min_len(4096);
    let lone: Vec<usize> = lone.filter(|(_, owner)| **owner == NONE).map(|(i, _)| i).collect();
    // Older seeds were searched before and are out of reach.
    let (mut fresh, first) = (SeedGrid::new(h), seeds.grid.len() as u32);
    // Sequential: every birth affects the following points.
    let mut births = FrameBirths::default();
    for i in lone {
        let place = points[i].position;
        owners[i] = match fresh.nearest(place) {
            Some(seed) => seeds.components.of_seed(first + seed),
            // Checked before the budget: such a place has no grid cell for a seed.
            None if !seeds.grid.has_cell(place) => {
                births.out_of_reach += 1;
                NONE
            }
            // Seeds have a limit of their own, since merged components retain theirs.
            None if seeds.components.used() < limits.components
                && seeds.grid.len() < limits.seeds =>
            {
                births.born += 1;
                fresh.insert(place);
                seeds.add(place)
            }
            None => {
                births.refused += 1;
                NONE
            }
        };
    }
    births
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lone_points_become_seeds_until_a_limit() {
        let mut seeds = Seeds::new(1.0);
        let mut born = |x: [f32; 6], limits: Limits| {
            let at = |x| SurfacePoint { position: [x, 0.0, 0.0], ..SurfacePoint::default() };
            // The first point has an owner already.
            let mut owners = [7, NONE, NONE, NONE, NONE, NONE];
            let births = create_components(1.0, &mut seeds, &x.map(at), &mut owners, limits);
            (owners, [births.born, births.refused, births.out_of_reach])
        };
        let limits = Limits { components: 3, seeds: 9 };
        let found = born([90.0, 0.0, 0.5, 5.0, 1e9, 10.0], limits);
        assert_eq!(found, ([7, 0, 0, 1, NONE, 2], [3, 0, 1]));
        let found = born([90.0, 20.0, 20.5, 30.0, -1e9, 40.0], limits);
        assert_eq!(found, ([7, NONE, NONE, NONE, NONE, NONE], [0, 4, 1]));
        let found = born([90.0, 20.0, 20.5, 30.0, 40.0, 50.0], Limits { components: 9, seeds: 5 });
        assert_eq!(found, ([7, 3, 3, 4, NONE, NONE], [2, 2, 0]));
        assert_eq!((seeds.grid.len(), seeds.of(4)), (5, [30.0, 0.0, 0.0]));
    }
}
