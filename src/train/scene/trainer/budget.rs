//! Births within the budget, which may require merging components or coarsening the scale.

use super::SceneTrainer;
use crate::observation::surface::SurfacePoint;
use crate::train::scene::births::{FrameBirths, Limits, create_components};
use crate::train::scene::component_sums::ComponentSums;
use crate::train::scene::config::SceneConfig;
use crate::train::scene::merge::{coarsened, factor, merge_down};
use crate::train::timing::SceneStage;

impl SceneTrainer {
    /// Creates components for points without one. If the budget is exhausted, others are merged first; if
    /// merging cannot free enough, the structural scale grows. Returns the numbers of births and of merged
    /// components.
    pub(super) fn create_within_budget(
        &mut self,
        points: &[SurfacePoint],
        mut lap: impl FnMut(SceneStage),
    ) -> [usize; 2] {
        let mut births = self.give_birth(points);
        lap(SceneStage::Births);
        let mut merged = 0;
        while births.refused > 0
            && let Some(freed) = self.free_components(births.refused)
        {
            merged += freed;
            lap(SceneStage::Merge);
            // Components of this frame's points may have been merged.
            self.assign(points);
            let more = self.give_birth(points);
            births = FrameBirths { born: births.born + more.born, ..more };
            lap(SceneStage::Births);
        }
        self.unassigned.budget += births.refused as u64;
        self.unassigned.reach += births.out_of_reach as u64;
        [births.born, merged]
    }

    /// Creates components for points without one, within the budget.
    fn give_birth(&mut self, points: &[SurfacePoint]) -> FrameBirths {
        let h = self.config.h;
        let limits =
            Limits { components: self.config.max_components, seeds: self.config.most_seeds() };
        let Self { grid, components, owners, .. } = self;
        create_components(h, grid, components, points, owners, limits)
    }

    /// Merges components to allow `refused` births, an eighth of the budget at most, and coarsens the scale
    /// if that frees less than half of it. Returns the number of merged components, `None` if nothing can be
    /// done. It runs before births, so that the budget holds at all times.
    fn free_components(&mut self, refused: usize) -> Option<usize> {
        let (most, used) = (self.config.max_components, self.components.used());
        // More than this frame needs, since merging takes longer than a frame.
        let room = (most / 16).max(refused.min(most / 8)).max(1);
        // Below the budget the number of seeds is at its limit, and merging retains those. A pass that finds
        // few pairs indicates that the next ones would find fewer.
        let freed = if used < most { 0 } else { self.merge_worthwhile(most - room, room / 16) };
        let is_too_little = freed < room.div_ceil(2);
        if is_too_little && !self.coarsen() && freed == 0 { None } else { Some(freed) }
    }

    /// Grows the scale by one step; returns false if it cannot.
    fn coarsen(&mut self) -> bool {
        let steps = self.coarsened + 1;
        if !(self.scale * factor(steps)).is_finite() {
            return false;
        }
        self.component_sums.grow(self.components.n_rows());
        let asked = SceneConfig { h: self.scale, ..self.config.clone() };
        let wider = coarsened(self.state(), steps)
            .and_then(|state| Self::restore(&asked, state, self.frames));
        let Some(wider) = wider else { return false };
        // The photometric state is in world units, and the remaining fields are independent of the scale.
        self.config = wider.config;
        self.coarsened = wider.coarsened;
        (self.hyper, self.scoring) = (wider.hyper, wider.scoring);
        self.component_elbo.set_scoring(wider.scoring);
        (self.grid, self.components) = (wider.grid, wider.components);
        self.component_sums = wider.component_sums;
        self.fits.forget_seeds();
        true
    }

    /// Merges components until `target` are left or none can be merged; returns the number of merged
    /// components.
    pub(in crate::train::scene) fn merge_to(&mut self, target: usize) -> usize {
        self.merge_worthwhile(target, 1)
    }

    /// The same, until a pass merges fewer than `worthwhile`.
    fn merge_worthwhile(&mut self, target: usize, worthwhile: usize) -> usize {
        let used = self.components.used();
        self.component_sums.grow(self.components.n_rows());
        let photographed = self.config.photometric.is_some();
        let count = |sums: &ComponentSums, id: usize| sums.sums(id)[0];
        let n = if photographed { self.component_sums.len() } else { 0 };
        let before: Vec<f64> = (0..n).map(|id| count(&self.component_sums, id)).collect();
        let Self { component_sums, components, grid, .. } = self;
        merge_down(component_sums, components, grid, self.config.h, target, worthwhile);
        // Estimates of two splats do not describe their union, which is reinitialised.
        for (id, before) in before.into_iter().enumerate() {
            if count(&self.component_sums, id) != before {
                self.photometric.remove_splat(id);
            }
        }
        used - self.components.used()
    }
}
