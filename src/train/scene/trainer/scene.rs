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

/// Components of a scene, with all data from which splats are computed before photometric training.
pub(in crate::train::scene) struct Scene {
    /// Configuration. Its structural scale is the current one, which may have grown.
    pub config: SceneConfig,
    /// Structural scale as configured, world units.
    pub asked_scale: f64,
    /// Number of steps by which the structural scale has grown.
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

    /// Returns all sums over the points of a component, with offsets from its seed in world units.
    pub fn sums_of(&self, id: usize) -> SceneSums {
        SceneSums::new(&self.sums.sums(id), self.config.h)
    }

    /// Returns the seed from which a component's sums measure offsets, world units from the scene's
    /// origin.
    pub fn seed(&self, id: usize) -> DVec3 {
        DVec3::from_array(self.seeds.of(id).map(f64::from))
    }

    fn splat_context(&self, id: usize) -> SplatContext {
        let expected = self.sums.row(id).expected();
        let h = self.config.h * self.seeds.share(id);
        SplatContext { seed: self.origin + self.seed(id), h, expected, frames: self.frames }
    }

    /// Returns the splat of a component computed from its points alone, without photometric training.
    pub fn splat(&self, id: usize) -> (Splat, Appearance) {
        self.config.splat_rule.splat(&self.sums_of(id), &self.splat_context(id))
    }

    pub fn extent(&self, id: usize) -> Option<PointExtent> {
        self.config.splat_rule.extent(&self.sums_of(id), &self.splat_context(id))
    }

    pub fn reach(&self) -> Reach {
        Reach::new(self.config.h, self.config.ray_search)
    }

    /// Creates components for points that have none, within the budget.
    pub fn create_components(
        &mut self,
        points: &[SurfacePoint],
        owners: &mut [u32],
    ) -> FrameBirths {
        let limits =
            Limits { components: self.config.max_components, seeds: self.config.most_seeds() };
        create_components(self.config.h, &mut self.seeds, points, owners, limits)
    }

    /// Adds empty rows of sums for components created since the last call.
    pub fn grow_sums(&mut self) {
        self.sums.grow(self.seeds.components.n_rows());
    }

    /// Merges components until `target` components are left, or until one pass merges fewer than
    /// `worthwhile` pairs.
    pub fn merge_down(&mut self, target: usize, worthwhile: usize) {
        merge_down(&mut self.sums, &mut self.seeds, self.config.h, target, worthwhile);
    }
}
