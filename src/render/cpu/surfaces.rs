//! Surfaces that a view shows: for every pixel the splats with the largest weights, and where its ray meets
//! their planes. Training adds photographs to textures there.

use super::raster::{DrawRow, RowCanvas, RowInputs};
use super::renderer::CpuRenderer;
use super::rows::longest_first;
use super::view::CpuView;
use crate::math::camera::Camera;
use crate::math::simd::Isa;
use crate::model::splat::appearance::SplatView;
use crate::model::splat::texture::Lattice;
use crate::render::finish::Finish;
use crate::render::options::{RenderOptions, TILE};
use glam::Vec3;

/// A textured splat in a pixel.
#[derive(Clone, Copy, Debug)]
pub struct ShownSurface {
    /// Number of the splat.
    pub splat: u32,
    /// Blending weight of the splat.
    pub weight: f32,
    /// Place in the splat's lattice where the ray meets it, in texels from the corner; may lie outside.
    pub place: [f32; 2],
    /// Depth of the surface along the optical axis, world units.
    pub depth: f32,
    /// Colour of the splat in this view minus its colour seen from the mean of the observed directions.
    pub shift: [f32; 3],
}

/// One drawn row of tiles.
pub struct SurfaceRow<'a> {
    canvas: &'a RowCanvas,
    inputs: &'a RowInputs<'a>,
    /// First pixel row of the row of tiles.
    pub top: usize,
}

impl SurfaceRow<'_> {
    /// Returns the coverage of a pixel of the image.
    #[inline(always)]
    pub fn coverage(&self, column: usize, row: usize) -> f32 {
        1.0 - self.value(0, column, row).abs()
    }

    /// Returns the drawn colour of a pixel without textures, not premultiplied.
    #[inline(always)]
    pub fn color(&self, column: usize, row: usize) -> [f32; 3] {
        let per = 1.0 / self.coverage(column, row).max(f32::MIN_POSITIVE);
        [1, 2, 3].map(|plane| self.value(plane, column, row) * per)
    }

    #[inline(always)]
    fn value(&self, plane: usize, column: usize, row: usize) -> f32 {
        let pixels: &[f32] = self.canvas.tiles[column / TILE].planes()[plane].as_flattened();
        pixels[(row - self.top) * TILE + column % TILE]
    }

    /// Returns the ray of a pixel in camera axes, of any length.
    #[inline(always)]
    pub fn ray(&self, column: usize, row: usize) -> Vec3 {
        self.inputs.ray(column, row)
    }

    /// Returns one of the two surfaces of a pixel if its weight is at least `least`; `which` is 0 for the
    /// largest weight. `ray` is the pixel's ray.
    #[inline(always)]
    pub fn at(
        &self,
        [column, row]: [usize; 2],
        which: usize,
        ray: Vec3,
        least: f32,
    ) -> Option<ShownSurface> {
        let owners = self.canvas.tiles[column / TILE].owners()?;
        let (number, weight) = owners.of(row - self.top, column % TILE, which);
        // Number and weight are 0 where no splat was drawn.
        if weight < least || weight <= 0.0 {
            return None;
        }
        let plane = &self.inputs.records.planes[number as usize];
        let (place, depth) = plane.meet(ray)?;
        Some(ShownSurface { splat: plane.splat, weight, place, depth, shift: plane.shift })
    }
}

impl CpuRenderer {
    /// Draws the tiles of a view that textured splats touch, and calls `visit` for some rows of tiles. `rows` lists their numbers from the top, ascending,
    /// each with a value for `visit`. `lattices` returns the lattice of a splat's texture.
    pub fn visit_surfaces<T: Send>(
        &mut self,
        splats: SplatView<'_>,
        lattices: &(dyn Fn(usize) -> Option<Lattice> + Sync),
        camera: &Camera,
        options: &RenderOptions,
        rows: impl Iterator<Item = (usize, T)>,
        visit: impl Fn(&SurfaceRow<'_>, T) + Sync,
    ) {
        let view = CpuView::new(camera, options);
        if view.width == 0 || view.height == 0 {
            return;
        }
        self.lists.prepare(splats, &view, Some(lattices));
        self.lists.bin(view.height);
        self.lists.sort();
        let lists = &self.lists.rows;
        let inputs = RowInputs {
            records: &self.lists.records,
            intrinsics: camera.intrinsics,
            method: options.method,
            background: options.background,
            finish: Finish::NONE,
            textures: None,
            is_for_textures: true,
        };
        self.canvases.resize_with(view.height.div_ceil(TILE), RowCanvas::default);
        let mut canvases = self.canvases.iter_mut().enumerate();
        let tasks = rows.filter_map(|(row, value)| {
            let (_, canvas) = canvases.find(|(number, _)| *number == row)?;
            Some((lists.get(row).len(), (row, canvas, value)))
        });
        longest_first(tasks, |(row, canvas, value)| {
            let (top, list) = (row * TILE, lists.get(row));
            Isa::best().run(DrawRow { sheet: inputs, canvas: &mut *canvas, top, list });
            visit(&SurfaceRow { canvas, inputs: &inputs, top }, value);
        });
    }
}
