//! Assignment of a frame's points to components, and their sums: the stages that a device can run.

use super::SceneTrainer;
use crate::model::scene::kept::FrameContribution;
use crate::observation::surface::SurfacePoint;
use crate::train::scene::accumulate::AssignedPoints;
use crate::train::scene::births::assign_to_lattice;
use crate::train::scene::config::{BirthRule, SceneConfig, VisibilityRule};
use crate::train::scene::seed_positions::SeedPositions;
use crate::train::scene::spacing::Spacing;
use crate::train::scene::sum_form::SumForm;
use crate::train::scene::sum_scalar::SumScalar;

impl<W: SumScalar> SceneTrainer<W> {
    /// True if a device can search seeds and sum points with the processor's bits: it supports whole quanta
    /// about seeds born at points, and visibility by projection, only.
    pub(super) fn can_fit_on_device(&self) -> bool {
        let SceneConfig { sums, births, visibility, .. } = &self.config;
        *sums == SumForm::Mixed
            && *births == BirthRule::Seeds
            && *visibility == VisibilityRule::Projected
    }

    /// Assigns the points of a new frame, for which the device is chosen first.
    pub(super) fn begin_and_assign(&mut self, points: &[SurfacePoint]) {
        self.fits.begin_frame(points.len(), self.config.h);
        self.assign(points);
    }

    /// Assigns the points of the current frame, possibly again.
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

    /// Adds the points to the sums; returns the contributions if frames are stored for a second alignment.
    pub(super) fn sum_up(
        &mut self,
        points: &[SurfacePoint],
        weight: u32,
        gain: [f32; 3],
    ) -> Option<FrameContribution> {
        self.component_sums.grow(self.components.n_rows());
        let (owners, shifts) = (&self.owners, &self.shifts);
        let is_noted = self.config.aligns_twice();
        let matched =
            AssignedPoints { points, owners, shifts, gain, weight, returns_contribution: is_noted };
        let (h, looks) = (self.config.h, self.config.visibility);
        let seed_positions = SeedPositions { grid: &self.grid, components: &self.components };
        let (sums, touched) = (&mut self.component_sums, &mut self.touched);
        self.fits.accumulate(sums, seed_positions, matched, h, looks, touched)
    }
}
