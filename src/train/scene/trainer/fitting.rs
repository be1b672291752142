//! Which components the points of a frame belong to, and their sums: what a device can do too.

use super::SceneTrainer;
use crate::model::scene::kept::Taught;
use crate::observation::surface::SurfacePoint;
use crate::train::scene::accumulate::Matched;
use crate::train::scene::births::assign_to_lattice;
use crate::train::scene::config::{BirthRule, SceneConfig, VisibilityRule};
use crate::train::scene::seed_positions::SeedPositions;
use crate::train::scene::spacing::Spacing;
use crate::train::scene::sum_form::SumForm;
use crate::train::scene::sum_scalar::SumScalar;

impl<W: SumScalar> SceneTrainer<W> {
    /// Whether a device can find the seeds of points and sum these to the processor's bits: whole quanta
    /// about seeds that are points, and no more than that.
    pub(super) fn can_fit_on_device(&self) -> bool {
        let SceneConfig { sums, births, visibility, .. } = &self.config;
        *sums == SumForm::Mixed
            && *births == BirthRule::Seeds
            && *visibility == VisibilityRule::Projected
    }

    /// Finds the components of the points of a frame that is to be learnt.
    pub(super) fn assign_anew(&mut self, points: &[SurfacePoint]) {
        self.fits.begin_frame(points.len(), self.config.h);
        self.assign(points);
    }

    /// Finds the component of every point, as far as it has one, once more in this frame.
    pub(super) fn assign(&mut self, points: &[SurfacePoint]) {
        let (rule, spacing) = (self.config.births, self.spacing());
        let Self { fits, grid, components, owners, .. } = self;
        match rule {
            BirthRule::Seeds => fits.assign(grid, components, spacing, points, owners),
            BirthRule::Lattice | BirthRule::BodyCentred => {
                assign_to_lattice(rule, spacing.h(), grid, components, points, owners);
            }
        }
    }

    pub(super) fn spacing(&self) -> Spacing {
        Spacing::new(self.config.h, self.config.near).with_ray_search(self.config.ray_search)
    }

    /// Adds the points to the sums of their components; what they added, where frames are kept.
    pub(super) fn sum_up(
        &mut self,
        points: &[SurfacePoint],
        weight: u32,
        gain: [f32; 3],
    ) -> Option<Taught> {
        self.component_sums.grow(self.components.n_rows());
        let (owners, shifts) = (&self.owners, &self.shifts);
        let is_noted = self.config.looks_twice();
        let matched = Matched { points, owners, shifts, gain, weight, is_noted };
        let (h, looks) = (self.config.h, self.config.visibility);
        let seed_positions = SeedPositions { grid: &self.grid, components: &self.components };
        let (sums, touched) = (&mut self.component_sums, &mut self.touched);
        self.fits.accumulate(sums, seed_positions, matched, h, looks, touched)
    }
}
