//! Measured pixels of a tile, eight at a time, and the depth error of splats relative to them.

use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::math::simd::{LANES, Vector};
use crate::model::splat::appearance::SplatView;
use crate::render::cpu::record::ConicRecord;
use crate::render::cpu::rows::ViewLists;
use crate::render::cpu::tile::{GROUPS, Plane};
use crate::render::cpu::view::CpuView;
use crate::render::options::{RenderMethod, RenderOptions, TILE};

/// Tile of a photograph. One instance is reused for all tiles of a row, so pixel rows that are not
/// compared hold stale values.
#[derive(Default)]
pub(super) struct TargetTile {
    pub color: [Plane; 3],
    pub coverage: Plane,
    pub depth: Plane,
    pub per_tolerance: Plane,
    /// True if depth is compared and known in at least one pixel.
    pub has_depth: bool,
}

impl TargetTile {
    /// Loads the tile at pixel `(left, top)`: the pixel rows whose bits are set in `mask`. Pixels
    /// outside the image have coverage 0.
    pub(super) fn fill(
        &mut self,
        photograph: &Image<MeasuredPixel>,
        [left, top]: [usize; 2],
        mask: u32,
        compares_depth: bool,
    ) {
        let beyond = MeasuredPixel { coverage: 0.0, ..MeasuredPixel::UNKNOWN };
        self.has_depth = false;
        for row in set_bits(mask) {
            let pixels = &photograph.data[(top + row) * photograph.width..];
            let pixels = &pixels[left..photograph.width.min(left + TILE)];
            for column in 0..TILE {
                let pixel = pixels.get(column).unwrap_or(&beyond);
                let (group, lane) = (row * GROUPS + column / LANES, column % LANES);
                for (plane, color) in self.color.iter_mut().zip(pixel.color) {
                    plane[group][lane] = color;
                }
                self.coverage[group][lane] = pixel.coverage;
                self.depth[group][lane] = pixel.depth;
                self.per_tolerance[group][lane] = pixel.per_tolerance;
                self.has_depth |= compares_depth && pixel.per_tolerance > 0.0;
            }
        }
    }

    /// Returns the depth error of a splat in eight pixels, at offsets in px from the splat's centre. The
    /// error is 0 at the measured depth, or if no depth is measured. It is ½ at the tolerance and close
    /// to 1 far beyond it (`photographs.md`, Depth).
    #[inline(always)]
    pub(super) fn depth_error<V: Vector>(
        &self,
        group: usize,
        splat: &ConicRecord,
        [x, y]: [V; 2],
    ) -> V {
        let across = V::splat(splat.linear[0]) * x + V::splat(splat.linear[1]) * y;
        let far = V::splat(splat.reach) + across - V::load(&self.depth[group]);
        let far = far * V::load(&self.per_tolerance[group]);
        let squared = far * far;
        squared / (V::splat(1.0) + squared)
    }
}

/// Iterates over the indices of the bits set in `mask`, ascending.
#[inline(always)]
pub(super) fn set_bits(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let row = (mask != 0).then(|| mask.trailing_zeros() as usize)?;
        mask &= mask - 1;
        Some(row)
    })
}

/// Reusable buffers for prepared views.
#[derive(Default)]
pub struct ViewBuffers {
    lists: ViewLists,
}

/// Splats of a view: projected, listed by row of tiles and sorted by depth.
#[derive(Clone)]
pub struct PreparedView<'a> {
    pub(super) view: CpuView,
    pub(super) lists: &'a ViewLists,
}

impl ViewBuffers {
    /// Projects, lists and sorts the splats of a photograph for the projected renderer. Splats with a
    /// view depth of at most `near` (world units) are dropped. `height` is the height of the photograph
    /// in pixels.
    pub fn prepare(
        &mut self,
        splats: SplatView<'_>,
        camera: &Camera,
        near: f64,
        height: usize,
    ) -> PreparedView<'_> {
        let plain = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let view = CpuView::new(camera, &RenderOptions { near, ..plain });
        let lists = &mut self.lists;
        lists.prepare(splats, &view, None);
        lists.bin(height);
        lists.sort();
        PreparedView { view, lists }
    }
}

impl PreparedView<'_> {
    /// Number of splats that can be visible in at least one pixel.
    pub fn n_drawn(&self) -> usize {
        self.lists.n_visible()
    }
}
