//! Births within the budget: what becomes one component, and how coarse, so that others can be born.

use super::SceneTrainer;
use crate::observation::surface::SurfacePoint;
use crate::train::scene::births::{FrameBirths, Limits, give_birth};
use crate::train::scene::coarsening::{coarsened, factor};
use crate::train::scene::component_sums::ComponentSums;
use crate::train::scene::config::SceneConfig;
use crate::train::scene::merge::merge_down;
use crate::train::scene::sum_scalar::SumScalar;
use crate::train::stages::SceneStage;

impl<W: SumScalar> SceneTrainer<W> {
    /// Gives points without a component one of their own. Where the budget leaves no room, others are
    /// merged before; where merging cannot keep up, the structural scale grows. How many were born and how
    /// many became part of others.
    pub(super) fn bear(
        &mut self,
        points: &[SurfacePoint],
        mut lap: impl FnMut(SceneStage),
    ) -> [usize; 2] {
        let mut births = self.give_birth(points);
        lap(SceneStage::Births);
        let mut merged = 0;
        while births.refused > 0
            && let Some(freed) = self.make_room(births.refused)
        {
            merged += freed;
            lap(SceneStage::Merge);
            // Components of this frame's points may have become parts of others.
            self.assign(points);
            let more = self.give_birth(points);
            births = FrameBirths { born: births.born + more.born, ..more };
            lap(SceneStage::Births);
        }
        self.unassigned.budget += births.refused as u64;
        self.unassigned.reach += births.out_of_reach as u64;
        [births.born, merged]
    }

    /// Gives points without a component one of their own, as far as the budget allows.
    fn give_birth(&mut self, points: &[SurfacePoint]) -> FrameBirths {
        let (rule, spacing) = (self.config.births, self.spacing());
        let seeds = self.config.most_seeds();
        let limits = match rule.is_order_invariant() {
            true => Limits { components: seeds, seeds },
            false => Limits { components: self.config.max_components, seeds },
        };
        let Self { grid, components, owners, .. } = self;
        give_birth(rule, spacing, grid, components, points, owners, limits)
    }

    /// Merges components until so many may be born, an eighth of the budget at most, and goes on at a
    /// wider scale if that frees less than half of it; how many became part of others, `None` if nothing
    /// can be done. Before births and not after them: so the budget holds at every moment. Components of a
    /// lattice may not depend on when the budget was reached: they are merged when they are drawn.
    fn make_room(&mut self, refused: usize) -> Option<usize> {
        if self.config.births.is_order_invariant() {
            return None;
        }
        let (most, used) = (self.config.max_components, self.components.used());
        // More than this frame needs: merging takes longer than a frame.
        let room = (most / 16).max(refused.min(most / 8)).max(1);
        // Below the budget it is seeds that are too many, and merging keeps those. A pass that finds few
        // pairs says that the next ones would find fewer.
        let freed = if used < most { 0 } else { self.merge_worthwhile(most - room, room / 16) };
        let is_too_little = freed < room.div_ceil(2);
        if is_too_little && !self.coarsen() && freed == 0 { None } else { Some(freed) }
    }

    /// Goes on at the next wider scale; whether there is one.
    fn coarsen(&mut self) -> bool {
        let steps = self.coarsened + 1;
        if !(self.scale * factor(steps)).is_finite() {
            return false;
        }
        self.component_sums.grow(self.components.n_rows());
        let asked = SceneConfig { h: self.scale, ..self.config.clone() };
        let wider = coarsened::<W>(self.state(), steps)
            .and_then(|state| Self::restore(&asked, state, self.frames));
        let Some(wider) = wider else { return false };
        // What photographs taught is in world units, and the rest does not know the scale.
        self.config = wider.config;
        self.coarsened = wider.coarsened;
        (self.hyper, self.scoring) = (wider.hyper, wider.scoring);
        self.component_elbo.score_by(wider.scoring);
        (self.grid, self.components) = (wider.grid, wider.components);
        self.component_sums = wider.component_sums;
        self.kept = wider.kept;
        self.fits.forget_seeds();
        true
    }

    /// Merges components until so many are left, or none may be merged; how many became part of
    /// others.
    pub(in crate::train::scene) fn merge_to(&mut self, target: usize) -> usize {
        self.merge_worthwhile(target, 1)
    }

    /// The same until a pass merges fewer than `worthwhile`.
    fn merge_worthwhile(&mut self, target: usize, worthwhile: usize) -> usize {
        let used = self.components.used();
        self.component_sums.grow(self.components.n_rows());
        let photographed = self.config.photometric.is_some();
        let count = |sums: &ComponentSums<W>, id: usize| sums.sums(id)[0];
        let n = if photographed { self.component_sums.len() } else { 0 };
        let before: Vec<f64> = (0..n).map(|id| count(&self.component_sums, id)).collect();
        let Self { component_sums, components, grid, .. } = self;
        merge_down(component_sums, components, grid, self.config.h, target, worthwhile);
        // What frames taught of components that are parts of others stays where it is.
        let has_points = |id: u32| component_sums.plane_sums(id as usize).0 > 0.0;
        self.kept.iter_mut().for_each(|kept| kept.taught.retain(has_points));
        // What photographs taught of two splats says nothing of their union: it begins anew.
        for (id, before) in before.into_iter().enumerate() {
            if count(&self.component_sums, id) != before {
                self.photometric.forget(id);
            }
        }
        used - self.components.used()
    }
}
