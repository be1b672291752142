//! Components of a scene: their seeds, their sums and the structural scale.

use crate::model::conjugate::prior::Hyper;
use crate::model::scene::splat_rule::{PointExtent, SplatContext};
use crate::model::scene::sums::SceneSums;
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use crate::observation::surface::SurfacePoint;
use crate::train::estep::Scoring;
use crate::train::scene::births::{FrameBirths, Limits, create_components};
use crate::train::scene::component_sums::ComponentSums;
use crate::train::scene::components::Seeds;
use crate::train::scene::config::SceneConfig;
use crate::train::scene::merge::merge_down;
use crate::train::scene::seed_groups::Reach;
use glam::DVec3;

/// Components of a scene, with everything that splats made of points derive from.
pub(in crate::train::scene) struct Scene {
    /// Configuration, with the current structural scale, which may have grown.
    pub config: SceneConfig,
    /// Configured structural scale, world units.
    pub asked_scale: f64,
    /// Number of steps by which it has grown.
    pub coarsened: u32,
    pub origin: DVec3,
    pub frames: u64,
    pub hyper: Hyper,
    pub scoring: Scoring,
    pub seeds: Seeds,
    pub sums: ComponentSums,
}

impl Scene {
    pub fn new(config: &SceneConfig, origin: DVec3) -> Self {
        let hyper = Hyper::scene(config.h);
        Self {
            config: config.clone(),
            asked_scale: config.h,
            coarsened: 0,
            origin,
            frames: 0,
            hyper,
            scoring: Scoring::new(&hyper),
            seeds: Seeds::new(config.h),
            sums: ComponentSums::default(),
        }
    }

    /// Returns all sums of a component, in world units about its seed.
    pub fn sums_of(&self, id: usize) -> SceneSums {
        SceneSums::new(&self.sums.sums(id), self.config.h)
    }

    /// Seed of a component's sums, world units from the origin.
    pub fn seed(&self, id: usize) -> DVec3 {
        DVec3::from_array(self.seeds.of(id).map(f64::from))
    }

    fn splat_context(&self, id: usize) -> SplatContext {
        let expected = self.sums.row(id).expected();
        let h = self.config.h * self.seeds.share(id);
        SplatContext { seed: self.origin + self.seed(id), h, expected, frames: self.frames }
    }

    /// Splat of a component from its points alone.
    pub fn splat(&self, id: usize) -> (Splat, Appearance) {
        self.config.splat_rule.splat(&self.sums_of(id), &self.splat_context(id))
    }

    pub fn extent(&self, id: usize) -> Option<PointExtent> {
        self.config.splat_rule.extent(&self.sums_of(id), &self.splat_context(id))
    }

    pub fn reach(&self) -> Reach {
        Reach::new(self.config.h, self.config.ray_search)
    }

    /// Creates components for points without one, within the budget.
    pub fn create_components(
        &mut self,
        points: &[SurfacePoint],
        owners: &mut [u32],
    ) -> FrameBirths {
        let limits =
            Limits { components: self.config.max_components, seeds: self.config.most_seeds() };
        create_components(self.config.h, &mut self.seeds, points, owners, limits)
    }

    /// Adds empty rows for components born since the last frame.
    pub fn grow_sums(&mut self) {
        self.sums.grow(self.seeds.components.n_rows());
    }

    /// Merges components until `target` are left, or a pass merges fewer than `worthwhile`.
    pub fn merge_down(&mut self, target: usize, worthwhile: usize) {
        merge_down(&mut self.sums, &mut self.seeds, self.config.h, target, worthwhile);
    }
}
