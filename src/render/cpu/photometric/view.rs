//! Splats of a view, prepared for comparison with its photograph on any device.

use super::super::lists::ViewLists;
use super::super::view::CpuView;
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatView;
use crate::render::constants::EVALUATION_NEAR;
use crate::render::options::{RenderMethod, RenderOptions};

/// Reusable buffers for prepared views.
pub struct ViewBuffers {
    lists: ViewLists,
    /// Near plane, world units.
    pub near: f64,
}

impl Default for ViewBuffers {
    fn default() -> Self {
        Self { lists: ViewLists::default(), near: EVALUATION_NEAR }
    }
}

/// Splats of a view: projected, listed by row of tiles and sorted by depth.
#[derive(Clone)]
pub struct PreparedView<'a> {
    pub(super) view: CpuView,
    pub(super) lists: &'a ViewLists,
}

impl ViewBuffers {
    /// Prepares the splats visible in a photograph of `height` pixels, with the projected renderer that
    /// evaluation and other programs use.
    pub fn prepare(
        &mut self,
        splats: SplatView<'_>,
        camera: &Camera,
        height: usize,
    ) -> PreparedView<'_> {
        let plain = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let view = CpuView::new(camera, &RenderOptions { near: self.near, ..plain });
        let lists = &mut self.lists;
        lists.prepare(splats, &view);
        lists.bin(height);
        lists.sort();
        PreparedView { view, lists }
    }
}

impl PreparedView<'_> {
    /// Number of splats that may be visible in some pixel.
    pub fn n_drawn(&self) -> usize {
        self.lists.n_visible()
    }
}
