//! Public interface of the CPU renderer: one image from splats, a camera and options.
//!
//! Buffers are reused between images, because successive views have similar sizes. Lists are stored per row
//! of tiles: lists per tile grow long when splats cover the whole image (`rendering.md`, Tried and
//! dropped).

use super::raster::{DrawRow, RowCanvas, RowInputs};
use super::rows::{ViewLists, longest_first};
use super::textures::LatticeOf;
use super::view::CpuView;
use crate::math::camera::Camera;
use crate::math::image::{Image, RgbImage};
use crate::math::simd::Isa;
use crate::model::splat::appearance::SplatView;
use crate::render::finish::{Finish, MARKER_COLOR};
use crate::render::options::{Paint, RenderOptions, TILE};

/// Rendered image; all planes have the size of the camera's image.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// sRGB-encoded colour over the background, clamped to `[0, 1]`.
    pub color: RgbImage,
    /// Coverage `A = 1 − T` in `[0, 1]`, with transmittance `T`.
    pub coverage: Image<f32>,
    /// Depth in world units, averaged with the blending weights. View depth `z` (projected) or
    /// distance along the pixel's ray at the largest response (exact); 0 where `A` is 0.
    pub depth: Image<f32>,
    /// Number of splats dropped because the splat or its appearance is invalid
    /// ([`crate::model::splat::splats::Splat::is_valid`]). Empty slots and invisible splats are not
    /// counted.
    pub n_invalid: usize,
}

/// Stage of rendering an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CpuStage {
    /// Converts splats to records.
    Prepare,
    /// Sorts every list by depth.
    Sort,
    /// Lists the visible records per row of tiles, before sorting.
    Bin,
    /// Bins the records to tiles, blends them and writes the pixels.
    Raster,
}

impl CpuStage {
    /// All stages.
    pub const ALL: [Self; 4] = [Self::Prepare, Self::Sort, Self::Bin, Self::Raster];
}

/// Renders splats by the projected or the exact method. Reuses its buffers between images, so keep one
/// renderer per view instead of creating one per image.
#[derive(Default)]
pub struct CpuRenderer {
    pub(super) lists: ViewLists,
    /// One per thread.
    pub(super) canvases: Vec<RowCanvas>,
}

impl CpuRenderer {
    /// Creates a renderer with empty buffers.
    pub fn new() -> Self {
        Self::default()
    }

    /// Renders one image on the current rayon pool. Pixels beyond 65,535 per side show only background.
    /// Never fails: invalid splats are skipped, and an image without pixels is returned empty.
    ///
    /// ```
    /// use glam::DVec3;
    /// use vbgs_studio::math::{camera::{Camera, Intrinsics}, pose::Pose};
    /// use vbgs_studio::model::splat::splats::Splat;
    /// use vbgs_studio::render::{RenderMethod, RenderOptions, cpu::CpuRenderer};
    ///
    /// let camera = Camera {
    ///     intrinsics: Intrinsics::from_horizontal_fov(65, 65, 0.8),
    ///     pose: Pose::IDENTITY,
    /// };
    /// let red = Splat {
    ///     mean: [0.0, 0.0, 4.0],
    ///     opacity: 0.8,
    ///     color: [1.0, 0.0, 0.0],
    ///     scale: [0.1; 3],
    ///     rotation: [1.0, 0.0, 0.0, 0.0],
    /// };
    /// for method in [RenderMethod::PROJECTED, RenderMethod::EXACT] {
    ///     let options = RenderOptions::evaluation(method, [1.0; 3]);
    ///     let image = CpuRenderer::new().render(&[red], &camera, &options);
    ///     assert!((image.coverage.at(32, 32) - 0.8).abs() < 1e-6);
    ///     assert!((image.color.at(32, 32)[1] - 0.2).abs() < 1e-6);
    ///     assert!((image.depth.at(32, 32) - 4.0).abs() < 1e-5);
    ///     assert_eq!(*image.color.at(0, 0), [1.0; 3]);
    /// }
    /// ```
    pub fn render<'a>(
        &mut self,
        splats: impl Into<SplatView<'a>>,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Rendered {
        self.render_observed(splats.into(), camera, options, |_| ())
    }

    /// Renders like [`Self::render`] and calls `observer` after each stage, for benchmarks.
    pub fn render_observed(
        &mut self,
        splats: SplatView<'_>,
        camera: &Camera,
        options: &RenderOptions,
        mut observer: impl FnMut(CpuStage),
    ) -> Rendered {
        let is_antialiased = splats.finishing().is_antialiased;
        let view = CpuView { is_antialiased, ..CpuView::new(camera, options) };
        let (width, height) = (view.width, view.height);
        let mut image = Rendered {
            color: Image::filled(width, height, [0.0; 3]),
            coverage: Image::filled(width, height, 0.0),
            depth: Image::filled(width, height, 0.0),
            n_invalid: 0,
        };
        // Chunks of size 0 would panic, and there is nothing to draw.
        if width == 0 || height == 0 {
            return image;
        }
        // Other paints show no texture.
        let textures = splats.textures().filter(|_| options.style.paint == Paint::Stored);
        let lattice = |splat: usize| {
            // A marked splat keeps its colour.
            let is_marked = splats.splats()[splat].color == MARKER_COLOR;
            textures?.lattice(splat).filter(|_| !is_marked).copied()
        };
        let lattices = textures.map(|_| &lattice as LatticeOf<'_>);
        image.n_invalid = self.lists.prepare(splats, &view, lattices);
        observer(CpuStage::Prepare);
        self.lists.bin(height);
        observer(CpuStage::Bin);
        self.lists.sort();
        observer(CpuStage::Sort);
        let finish = Finish::new(splats.finishing(), camera, options);
        let rows = &self.lists.rows;
        let sheet = RowInputs {
            records: &self.lists.records,
            intrinsics: camera.intrinsics,
            method: options.method,
            background: options.background,
            finish,
            textures,
            is_for_textures: false,
        };
        let pixels_per_row = width * TILE;
        let pixels = image.color.data.chunks_mut(pixels_per_row);
        let pixels = pixels.zip(image.coverage.data.chunks_mut(pixels_per_row));
        let pixels = pixels.zip(image.depth.data.chunks_mut(pixels_per_row));
        // Rows differ widely in their number of splats.
        let tasks = pixels.enumerate().map(|(row, task)| (rows.get(row).len(), (row, task)));
        longest_first(tasks, &mut self.canvases, |(row, ((color, coverage), depth)), canvas| {
            let (top, list) = (row * TILE, rows.get(row));
            let columns = 0..width.div_ceil(TILE);
            Isa::best().run(DrawRow { sheet, canvas: &mut *canvas, top, columns, list });
            canvas.finish_pixels(&sheet, top, color, coverage, depth);
        });
        observer(CpuStage::Raster);
        image
    }
}
