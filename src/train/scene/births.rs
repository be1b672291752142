//! Births: points without a component nearby become seeds, in the order of the points.

use super::components::Components;
use super::config::BirthRule;
use super::grid::{NONE, SeedGrid, squared_distance};
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;

/// Counts of one frame's births.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameBirths {
    /// New components.
    pub born: usize,
    /// Points without a component because the budget is exhausted.
    pub refused: usize,
    /// Points too far from the origin to be distinguished from their neighbours.
    pub out_of_reach: usize,
}

/// Limits of births.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Maximum number of components.
    pub components: usize,
    /// Maximum number of seeds.
    pub seeds: usize,
}

/// Assigns an owner to the points with [`NONE`]: the component of a seed born in this frame within the
/// structural scale `h`, else a new component within the limits.
pub fn create_components(
    rule: BirthRule,
    h: f64,
    grid: &mut SeedGrid,
    components: &mut Components,
    points: &[SurfacePoint],
    owners: &mut [u32],
    limits: Limits,
) -> FrameBirths {
    let lone = owners.par_iter().enumerate().with_min_len(4096);
    let lone: Vec<usize> = lone.filter(|(_, owner)| **owner == NONE).map(|(i, _)| i).collect();
    // Older seeds were searched before and are out of reach.
    let (mut fresh, first) = (SeedGrid::new(h), grid.len() as u32);
    // Sequential: every birth affects the following points.
    let mut births = FrameBirths::default();
    for i in lone {
        let (point, owner) = (&points[i], &mut owners[i]);
        let place = seed_of(rule, h as f32, point.position);
        let nearest = match rule {
            BirthRule::Seeds => fresh.nearest(place).map(|seed| first + seed),
            BirthRule::Lattice | BirthRule::BodyCentred => grid.at(place),
        };
        *owner = match nearest {
            Some(seed) => components.of_seed(seed),
            // Checked before the budget: such a place has no grid cell for a seed.
            None if !grid.has_cell(place) => {
                births.out_of_reach += 1;
                NONE
            }
            None if components.used() < limits.components && grid.len() < limits.seeds => {
                births.born += 1;
                fresh.insert(place);
                components.add_seed(grid.insert(place))
            }
            None => {
                let near = (rule == BirthRule::Seeds).then(|| grid.nearest(place)).flatten();
                births.refused += usize::from(near.is_none());
                near.map_or(NONE, |seed| components.of_seed(seed))
            }
        };
    }
    births
}

/// Assigns owners by a fixed lattice, where its points are seeds already.
pub fn assign_to_lattice(
    rule: BirthRule,
    h: f32,
    grid: &SeedGrid,
    components: &Components,
    points: &[SurfacePoint],
    owners: &mut Vec<u32>,
) {
    let owner = |p: &SurfacePoint| {
        grid.at(seed_of(rule, h, p.position)).map_or(NONE, |seed| components.of_seed(seed))
    };
    points.par_iter().with_min_len(256).map(owner).collect_into_vec(owners);
}

/// Seed of the component that owns a position.
#[inline(always)]
fn seed_of(rule: BirthRule, h: f32, position: [f32; 3]) -> [f32; 3] {
    match rule {
        BirthRule::Seeds => position,
        BirthRule::Lattice => cubic(position, h),
        BirthRule::BodyCentred => body_centred(position, h),
    }
}

/// Returns the centre of the cell that contains `position` in the cubic lattice of edge `a`.
#[inline(always)]
pub fn cubic(position: [f32; 3], a: f32) -> [f32; 3] {
    position.map(|x| ((x / a).floor() + 0.5) * a)
}

/// Returns the nearest point of the body-centred lattice with cubes of edge `a`: corners and centres of the
/// cubes. A cell has half the volume of a cube, so equal density to [`cubic`] requires an `a` larger by ∛2.
#[inline(always)]
pub fn body_centred(position: [f32; 3], a: f32) -> [f32; 3] {
    let centre = cubic(position, a);
    // Adding 0 removes the sign of negative zeros, which would depend on the first point of the cell.
    let corner = position.map(|x| (x / a).round() * a + 0.0);
    let nearer = squared_distance(position, centre) <= squared_distance(position, corner);
    if nearer { centre } else { corner }
}

#[cfg(test)]
mod lattice_tests {
    use super::*;

    #[test]
    fn lattice_points_are_the_nearest_ones() {
        assert_eq!(cubic([0.3, -0.1, 2.0], 1.0), [0.5, -0.5, 2.5]);
        assert_eq!(body_centred([0.4, 0.4, 0.4], 1.0), [0.5; 3]);
        assert_eq!(body_centred([0.1, 0.2, 0.1], 1.0), [0.0; 3]);
        let corner = body_centred([0.9, 1.1, -0.1], 1.0);
        assert_eq!(corner.map(f32::to_bits), [1.0f32, 1.0, 0.0].map(f32::to_bits));
    }
}
