//! Grouping of points by nearest seed, without a model.

use super::assign::assign;
use super::births::{Limits, create_components};
use super::components::Components;
use super::config::{BirthRule, DEFAULT_MAX_COMPONENTS};
use super::grid::{NONE, SeedGrid};
use super::spacing::Spacing;
use crate::observation::surface::SurfacePoint;

/// Seeds to which points are assigned and from which seeds are born, as in training.
///
/// ```
/// use vbgs_studio::observation::surface::SurfacePoint;
/// use vbgs_studio::train::scene::partition::Partition;
///
/// let at = |x: f32| SurfacePoint { position: [x, 0.0, 0.0], ..SurfacePoint::default() };
/// let mut partition = Partition::new(0.5);
/// assert_eq!(partition.assign(&[at(0.0), at(0.2), at(3.0)]), [Some(0), Some(0), Some(1)]);
/// assert_eq!(partition.assign(&[at(2.8)]), [Some(1)]);
/// assert_eq!(partition.components(), 2);
/// ```
pub struct Partition {
    spacing: Spacing,
    grid: SeedGrid,
    components: Components,
    owners: Vec<u32>,
}

impl Partition {
    /// Creates a partition without seeds; `h` is the structural scale, world units.
    pub fn new(h: f64) -> Self {
        Self {
            spacing: Spacing::new(h, None),
            grid: SeedGrid::new(h),
            components: Components::default(),
            owners: Vec::new(),
        }
    }

    /// Returns the component of every point; new ones are born where none is near. `None` beyond the limit.
    pub fn assign(&mut self, points: &[SurfacePoint]) -> Vec<Option<u32>> {
        let Self { spacing, grid, components, owners } = self;
        assign(grid, components, *spacing, points, owners);
        let limits = Limits { components: DEFAULT_MAX_COMPONENTS, seeds: DEFAULT_MAX_COMPONENTS };
        create_components(BirthRule::Seeds, *spacing, grid, components, points, owners, limits);
        owners.iter().map(|&owner| (owner != NONE).then_some(owner)).collect()
    }

    /// Number of components born so far.
    pub fn components(&self) -> usize {
        self.components.used()
    }
}
