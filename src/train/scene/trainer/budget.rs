//! Creates components within the budget. This may require merging components or increasing the
//! structural scale.

use super::{FrameClock, SceneTrainer};
use crate::model::scene::state::SceneState;
use crate::model::splat::splats::Splat;
use crate::observation::surface::SurfacePoint;
use crate::train::scene::births::FrameBirths;
use crate::train::scene::config::SceneConfig;
use crate::train::scene::merge::{coarsened, factor};
use crate::train::timing::SceneStage;

/// Numbers of points that received no component, by reason.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct UnassignedPoints {
    /// Number of points for which the budget had no room.
    pub budget: u64,
    /// Number of points too far from the origin for f32 positions to distinguish neighbours.
    pub reach: u64,
}

/// Numbers of components created and merged for one frame.
pub(super) struct FrameComponents {
    pub born: usize,
    /// Number of components merged to make room for new ones.
    pub merged: usize,
    /// True if components were merged or the structural scale grew.
    pub is_rebuilt: bool,
}

impl SceneTrainer {
    /// Creates components for points that have none. If the budget is exhausted, existing components are
    /// merged first. If merging cannot free enough, the structural scale grows.
    pub(super) fn create_within_budget(
        &mut self,
        points: &[SurfacePoint],
        clock: &mut FrameClock,
    ) -> FrameComponents {
        let coarsened = self.scene.coarsened;
        let is_empty = self.scene.seeds.components.used() == 0;
        let empty = is_empty.then(|| self.state());
        let mut births = self.scene.create_components(points, &mut self.points.owners);
        clock.lap(SceneStage::Births);
        let mut merged = 0;
        while births.refused > 0 {
            let freed = match &empty {
                // Components without points cannot be merged. Those of the first rows would take the whole
                // budget, and the scale would grow until they reach the last row.
                Some(empty) => self.coarsen_from(empty.clone()).then_some(0),
                None => self.free_components(births.refused),
            };
            let Some(freed) = freed else { break };
            merged += freed;
            clock.lap(SceneStage::Merge);
            // Components of this frame's points may have been merged.
            self.points.assign(&self.scene, points);
            let born = if empty.is_some() { 0 } else { births.born };
            let more = self.scene.create_components(points, &mut self.points.owners);
            births = FrameBirths { born: born + more.born, ..more };
            clock.lap(SceneStage::Births);
        }
        self.unassigned.budget += births.refused as u64;
        self.unassigned.reach += births.out_of_reach as u64;
        let is_rebuilt = merged > 0 || self.scene.coarsened != coarsened;
        if is_rebuilt {
            // Components without points in the frame have changed too.
            self.changes.add_all();
        }
        FrameComponents { born: births.born, merged, is_rebuilt }
    }

    /// Merges components to make room for `refused` new ones, but for at most an eighth of the budget.
    /// If merging frees less than half of that room, the structural scale grows. Returns the number of
    /// merged components; `None` if no room can be made. Merging precedes the creation of components,
    /// so that the budget holds at all times.
    fn free_components(&mut self, refused: usize) -> Option<usize> {
        let most = self.scene.config.max_components;
        let used = self.scene.seeds.components.used();
        // More than this frame needs, since merging takes longer than a frame.
        let room = (most / 16).max(refused.min(most / 8)).max(1);
        // Below the budget the number of seeds is at its limit, and merging retains those. A pass that finds
        // few pairs indicates that the next ones would find fewer.
        let freed = if used < most { 0 } else { self.merge_worthwhile(most - room, room / 16) };
        let is_too_little = freed < room.div_ceil(2);
        if is_too_little && !self.coarsen() && freed == 0 { None } else { Some(freed) }
    }

    /// Grows the structural scale by one step. Returns false if it cannot grow.
    fn coarsen(&mut self) -> bool {
        // Components born in this frame need rows before they can be merged or stored.
        self.scene.grow_sums();
        self.coarsen_from(self.state())
    }

    /// Continues from `state` with the structural scale one step above the present one. Returns false if it
    /// cannot grow.
    fn coarsen_from(&mut self, state: SceneState) -> bool {
        let steps = self.scene.coarsened + 1;
        let h = self.scene.asked_scale;
        if !(h * factor(steps)).is_finite() {
            return false;
        }
        let asked = SceneConfig { h, ..self.scene.config.clone() };
        let wider = coarsened(state, steps)
            .and_then(|state| Self::restore(&asked, state, self.scene.frames));
        let Some(wider) = wider else { return false };
        // The photometric state is in world units, and the remaining fields are independent of the scale.
        self.scene = wider.scene;
        self.component_elbo.set_scoring(self.scene.scoring);
        self.points.fits.forget_seeds();
        true
    }

    /// Merges components until `target` components are left. Where no pair can be merged, the structural scale
    /// grows as far as it can.
    pub(in crate::train::scene) fn merge_to(&mut self, target: usize) {
        self.merge_worthwhile(target, 1);
        while self.scene.seeds.components.used() > target && self.coarsen() {
            self.merge_worthwhile(target, 1);
        }
    }

    /// Merges components until `target` components are left, or until one pass merges fewer than
    /// `worthwhile` pairs. Returns the number of merged components.
    fn merge_worthwhile(&mut self, target: usize, worthwhile: usize) -> usize {
        let used = self.scene.seeds.components.used();
        self.scene.grow_sums();
        let n = if self.scene.config.photometric.is_some() { self.scene.sums.len() } else { 0 };
        let before: Vec<f64> = (0..n).map(|id| self.scene.sums.sums(id)[0]).collect();
        let textured = self.reference_seeds_of_textured();
        self.scene.merge_down(target, worthwhile);
        self.merge_textures(&textured);
        // Estimates of two splats do not describe their union, which is reinitialised.
        for (id, before) in before.into_iter().enumerate() {
            if self.scene.sums.sums(id)[0] != before
                && let Some(splat) = self.photographs.learner.state.splats.get_mut(id)
            {
                *splat = Splat::default();
            }
        }
        used - self.scene.seeds.components.used()
    }

    /// Returns components that have a texture, each with its reference seed.
    fn reference_seeds_of_textured(&self) -> Vec<(usize, u32)> {
        let components = &self.scene.seeds.components;
        let textures = self.photographs.learner.state.textures.iter().enumerate();
        let textured = textures.filter(|(_, texture)| texture.is_some());
        textured.map(|(id, _)| (id, components.reference_seed(id) as u32)).collect()
    }

    /// Adds textures of merged components to those of the components that their seeds now belong to.
    /// `textured` lists component and reference seed of each texture before the merge.
    fn merge_textures(&mut self, textured: &[(usize, u32)]) {
        let components = &self.scene.seeds.components;
        let kept = textured.iter().map(|&(id, seed)| (components.of_seed(seed) as usize, id));
        let mut merged = kept.filter(|(kept, id)| kept != id).peekable();
        if merged.peek().is_some() {
            // New components may get the rows of merged ones.
            self.photographs.learner.textures.forget_drawn();
        }
        let state = &mut self.photographs.learner.state;
        merged.for_each(|(kept, id)| state.merge_texture(kept, id));
    }
}
