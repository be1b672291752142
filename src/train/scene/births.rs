//! Births: points that no component is near become seeds, in the order of the points.

use super::components::Components;
use super::config::BirthRule;
use super::grid::{NONE, SeedGrid};
use super::lattice;
use super::spacing::Spacing;
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;

/// What the births of one frame were.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameBirths {
    /// Components that came into being.
    pub born: usize,
    /// Points that found no component because there may be no more.
    pub refused: usize,
    /// Points too far from the origin to be told from their neighbours.
    pub out_of_reach: usize,
}

/// What bounds births.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Components at most.
    pub components: usize,
    /// Seeds at most.
    pub seeds: usize,
}

/// Gives the points of [`NONE`] an owner: the component of a seed of this frame within their reach, one of
/// their own within the limits, or beyond these that of a seed within the structural scale.
pub fn give_birth(
    rule: BirthRule,
    spacing: Spacing,
    grid: &mut SeedGrid,
    components: &mut Components,
    points: &[SurfacePoint],
    owners: &mut [u32],
    limits: Limits,
) -> FrameBirths {
    let lone = owners.par_iter().enumerate().with_min_len(4096);
    let lone: Vec<usize> = lone.filter(|(_, owner)| **owner == NONE).map(|(i, _)| i).collect();
    // Older seeds are out of their reach: that is why they have none.
    let (mut fresh, first) = (SeedGrid::new(spacing.h().into()), grid.len() as u32);
    // One point after the other, on one thread: every birth decides who is born after it.
    let mut births = FrameBirths::default();
    for i in lone {
        let (point, owner) = (&points[i], &mut owners[i]);
        let place = seed_of(rule, spacing.h(), point.position);
        let nearest = match rule {
            BirthRule::Seeds => fresh.nearest(place).map(|seed| first + seed),
            BirthRule::Lattice | BirthRule::BodyCentred => grid.at(place),
        };
        *owner = match nearest.filter(|&seed| grid.is_within(seed, place, spacing.reach(point))) {
            Some(seed) => components.of_seed(seed),
            // Before the budget: such a place has no cell that a seed could be filed under.
            None if !grid.reaches(place) => {
                births.out_of_reach += 1;
                NONE
            }
            None if components.used() < limits.components && grid.len() < limits.seeds => {
                births.born += 1;
                fresh.insert(place);
                components.born(grid.insert(place), spacing.share(point))
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

/// Owners by a fixed lattice, as far as its points are seeds already.
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

/// Where a component that owns a place would stand.
#[inline(always)]
fn seed_of(rule: BirthRule, h: f32, position: [f32; 3]) -> [f32; 3] {
    match rule {
        BirthRule::Seeds => position,
        BirthRule::Lattice => lattice::cubic(position, h),
        BirthRule::BodyCentred => lattice::body_centred(position, h),
    }
}
