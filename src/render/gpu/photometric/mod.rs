//! Comparison of photographs with splats on a GPU (`photographs.md`, On a GPU).
//!
//! Splats are projected, sorted and listed by tile on the CPU, by the same code as for the CPU's own
//! walk. The expensive part, the walks over pixels, runs here:
//!
//! 1. Draw: one workgroup per tile, one lane per pixel. Also compares each finished pixel.
//! 2. Walk: one workgroup per tile, one lane per splat, with the pixels passing from lane to lane. Computes
//!    the sums of each splat in each tile.
//! 3. Add: sums of each splat over its tiles.
//!
//! The order of all additions is independent of timing. Training owns the device and the window draws on
//! another, so neither blocks the other.

pub mod layout;

use super::constants::{N_QUARTERS, module};
use super::headless::HeadlessGpu;
use super::pipeline::Grid;
use super::task::{GpuTask, TaskPart};
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::model::inspection::DeviceError;
use crate::render::cpu::photometric::{
    PackedView, PhotometricComparer, PhotometricSums, PixelRule, PreparedView, RowSubset,
};
use layout::{ADDED, Comparison, DRAWN, Part, WALKED, tile_grid};

/// Compares photographs with rendered splats on a GPU device of its own.
pub struct GpuComparer {
    task: GpuTask<Part>,
    draw: wgpu::ShaderModule,
    walk: wgpu::ShaderModule,
    add: usize,
    /// Indices of the kernels that draw and walk, specialised by the number of compared pixels per
    /// tile. The kernels are created on first use.
    walks: Vec<(u64, [usize; 2])>,
    packed: PackedView,
}

impl GpuComparer {
    /// Creates the kernels on the device `gpu`.
    pub fn new(gpu: HeadlessGpu) -> Self {
        let mut task = GpuTask::new(gpu);
        let [draw, walk, add] =
            [("draw", layout::DRAW), ("walk", layout::WALK), ("add", layout::ADD)]
                .map(|(label, shader)| module(&task.device, label, shader));
        let add = task.add_kernel(&add, "add", &[], ADDED);
        Self { task, draw, walk, add, walks: Vec::new(), packed: PackedView::default() }
    }

    /// Runs a comparison. The task's result then holds the errors of the tiles, followed by the sums of
    /// the splats.
    fn run(&mut self, comparison: &Comparison<'_>) -> Result<(), DeviceError> {
        let sizes = comparison.sizes();
        let [draw, walk] = self.walks(sizes.lanes);
        self.task.sizes = sizes;
        self.task.ensure_capacity(Part::ALL.iter().map(|(part, ..)| *part))?;
        self.task.write(Part::Frame, &comparison.frame());
        self.task.stage_upload(0, 0, comparison.pieces())?;
        let (columns, rows) = tile_grid(comparison.photograph);
        let tiles = Grid { columns: columns as u32, rows: rows as u32 };
        let quarters = Grid::lanes(sizes.splats as usize * N_QUARTERS as usize);
        let dispatches = [(draw, tiles), (walk, tiles), (self.add, quarters)];
        self.task.run(&[Part::Shown], &dispatches, &[Part::Errors, Part::Totals])
    }

    fn walks(&mut self, lanes: u64) -> [usize; 2] {
        if let Some((_, kernels)) = self.walks.iter().find(|(of, _)| *of == lanes) {
            return *kernels;
        }
        let value = [("LANES", lanes as f64)];
        let kernels = [(&self.draw, "draw", DRAWN), (&self.walk, "walk", WALKED)]
            .map(|(module, entry, parts)| self.task.add_kernel(module, entry, &value, parts));
        self.walks.push((lanes, kernels));
        kernels
    }
}

impl PhotometricComparer for GpuComparer {
    fn name(&self) -> String {
        self.task.name.clone()
    }

    fn compare<'a>(
        &'a mut self,
        view: &PreparedView<'a>,
        photograph: &Image<MeasuredPixel>,
        rule: PixelRule,
        rows: RowSubset,
    ) -> Result<PhotometricSums<'a>, DeviceError> {
        let mut packed = std::mem::take(&mut self.packed);
        packed.fill(view, tile_grid(photograph));
        // Empty buffers cannot be bound.
        let is_empty = packed.entries.is_empty();
        let comparison = Comparison { packed: &packed, photograph, rule, rows };
        let found = if is_empty { Ok(()) } else { self.run(&comparison) };
        self.packed = packed;
        found?;
        if is_empty {
            return Ok(PhotometricSums::from_splat_sums(view.clone(), &[], 0.0, 0.0));
        }
        let n_errors = Part::Errors.bytes(&self.task.sizes) as usize;
        let (errors, sums) = self.task.result().split_at(n_errors);
        let errors: &[[f32; 2]] = bytemuck::cast_slice(errors);
        let sum = |k: usize| -> f64 { errors.iter().map(|tile| f64::from(tile[k])).sum() };
        let sums: &[f32] = bytemuck::cast_slice(sums);
        Ok(PhotometricSums::from_splat_sums(view.clone(), sums.as_chunks().0, sum(0), sum(1)))
    }
}
