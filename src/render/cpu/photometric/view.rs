//! What a view shows of splats, ready to be compared with its photograph by any device.

use super::super::lists::ViewLists;
use super::super::view::CpuView;
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatView;
use crate::render::constants::EVALUATION_NEAR;
use crate::render::options::{RenderMethod, RenderOptions};

/// Buffers of prepared views, kept between them.
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

/// Splats of a view, projected, sorted by depth and listed by row of tiles.
#[derive(Clone)]
pub struct PreparedView<'a> {
    pub(super) view: CpuView,
    pub(super) lists: &'a ViewLists,
}

impl ViewBuffers {
    /// Prepares the splats that a photograph `height` pixels high shows, as the projected renderer
    /// draws them: it is what evaluation and other programs draw with.
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
    /// Splats that some pixel may show.
    pub fn n_drawn(&self) -> usize {
        self.lists.n_visible()
    }
}
