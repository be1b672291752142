//! Where components stand.

use super::components::Components;
use super::grid::SeedGrid;
use crate::model::scene::state::WHOLE;

/// The seeds with the components they belong to.
#[derive(Clone, Copy)]
pub struct SeedPositions<'a> {
    /// Seeds by place.
    pub grid: &'a SeedGrid,
    /// Component of every seed.
    pub components: &'a Components,
}

impl SeedPositions<'_> {
    /// The seed that a component's sums are about, world units from the scene's origin.
    #[inline(always)]
    pub fn of(self, component: usize) -> [f32; 3] {
        self.grid.position(self.components.reference(component))
    }

    /// How far points of a component may be from its seed, in structural scales.
    pub fn share(self, component: usize) -> f64 {
        let share = self.components.share(self.components.reference(component));
        f64::from(share) / f64::from(WHOLE)
    }
}
