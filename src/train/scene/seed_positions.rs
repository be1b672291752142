//! Where components stand.

use super::components::Components;
use super::grid::SeedGrid;

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
}
