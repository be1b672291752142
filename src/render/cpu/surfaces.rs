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
    /// Returns the drawn colour of a pixel without textures, not premultiplied, and its coverage.
    pub fn drawn(&self, column: usize, row: usize) -> ([f32; 3], f32) {
        let planes = self.canvas.tiles[column / TILE].planes();
        let [t, r, g, b, _] = planes.map(|plane| {
            let pixels: &[f32] = plane.as_flattened();
            pixels[(row - self.top) * TILE + column % TILE]
        });
        let covered = 1.0 - t.abs();
        ([r, g, b].map(|c| c / covered.max(f32::MIN_POSITIVE)), covered)
    }

    /// Returns the surfaces of a pixel of the image, largest weight first.
    pub fn at(&self, column: usize, row: usize) -> [Option<ShownSurface>; 2] {
        let tile = &self.canvas.tiles[column / TILE];
        let Some(owners) = tile.owners() else { return [None; 2] };
        let ray = self.inputs.ray(column, row);
        owners.of(row - self.top, column % TILE).map(|(number, weight)| {
            if weight <= 0.0 {
                return None;
            }
            let plane = &self.inputs.records.planes[number as usize];
            let (place, depth) = plane.meet(ray)?;
            Some(ShownSurface { splat: plane.splat, weight, place, depth, shift: plane.shift })
        })
    }
}

impl CpuRenderer {
    /// Draws a view and calls `visit` for every row of tiles that `shown` selects by its number from the top.
    /// `lattices` returns the lattice of a splat's texture. Returns the results from top to bottom.
    pub fn visit_surfaces<T: Send>(
        &mut self,
        splats: SplatView<'_>,
        lattices: &(dyn Fn(usize) -> Option<Lattice> + Sync),
        camera: &Camera,
        options: &RenderOptions,
        shown: impl Fn(usize) -> bool,
        visit: impl Fn(&SurfaceRow<'_>) -> T + Sync,
    ) -> Vec<T> {
        let view = CpuView::new(camera, options);
        if view.width == 0 || view.height == 0 {
            return Vec::new();
        }
        self.lists.prepare(splats, &view, Some(lattices));
        self.lists.bin(view.height);
        self.lists.sort();
        let rows = &self.lists.rows;
        let inputs = RowInputs {
            records: &self.lists.records,
            intrinsics: camera.intrinsics,
            method: options.method,
            background: options.background,
            finish: Finish::NONE,
            textures: None,
        };
        let n_rows = view.height.div_ceil(TILE);
        self.canvases.resize_with(n_rows, RowCanvas::default);
        let mut results: Vec<Option<T>> = (0..n_rows).map(|_| None).collect();
        let tasks = self.canvases.iter_mut().zip(&mut results).enumerate();
        let tasks = tasks.filter(|(row, _)| shown(*row));
        let tasks = tasks.map(|(row, task)| (rows.get(row).len(), (row, task)));
        longest_first(tasks, |(row, (canvas, result))| {
            let (top, list) = (row * TILE, rows.get(row));
            Isa::best().run(DrawRow { sheet: inputs, canvas: &mut *canvas, top, list });
            *result = Some(visit(&SurfaceRow { canvas, inputs: &inputs, top }));
        });
        results.into_iter().flatten().collect()
    }
}
