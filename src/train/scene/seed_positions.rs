//! Where components stand.

use super::components::Components;
use super::grid::SeedGrid;

/// The seeds with the components they belong to.
#[derive(Clone, Copy)]
pub struct SeedPositions<'a> {
    /// The seeds.
    pub grid: &'a SeedGrid,
    /// Their components.
    pub components: &'a Components,
}

impl SeedPositions<'_> {
    /// The seed that a component's sums are about, world units from the scene's origin.
    #[inline(always)]
    pub fn of(self, component: usize) -> [f32; 3] {
        self.grid.position(self.components.reference(component))
    }
}
