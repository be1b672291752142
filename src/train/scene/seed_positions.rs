//! Seed positions by component.

use super::components::Components;
use super::grid::SeedGrid;
use crate::model::scene::state::WHOLE;

/// Seeds and the components they belong to.
#[derive(Clone, Copy)]
pub struct SeedPositions<'a> {
    /// Seeds by position.
    pub grid: &'a SeedGrid,
    /// Component of every seed.
    pub components: &'a Components,
}

impl SeedPositions<'_> {
    /// Returns the seed of a component's sums, world units from the scene's origin.
    #[inline(always)]
    pub fn of(self, component: usize) -> [f32; 3] {
        self.grid.position(self.components.reference_seed(component))
    }

    /// Returns the maximum distance of a component's points from its seed, in structural scales.
    pub fn share(self, component: usize) -> f64 {
        let share = self.components.share(self.components.reference_seed(component));
        f64::from(share) / f64::from(WHOLE)
    }
}
