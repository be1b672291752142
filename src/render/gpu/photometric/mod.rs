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

use super::adapters::GpuCaps;
use super::constants::{N_QUARTERS, module};
use super::error::{GpuError, GpuFaults};
use super::kernel::{BoundKernel, ComputeKernel, Grid};
use super::readback::{release_result, wait_for_result};
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::render::cpu::photometric::{
    ComparerError, PackedView, PhotometricComparer, PhotometricSums, PixelRule, PreparedView,
    RowSubset,
};
use layout::{
    Comparison, ComparisonSizes, Memory, Part, SUM_BYTES, UPLOADED, ensure_capacity, offset,
    tile_grid,
};
use std::time::Instant;

/// Compares photographs on its own device.
pub struct GpuComparer {
    device: wgpu::Device,
    queue: wgpu::Queue,
    faults: GpuFaults,
    name: String,
    kernels: Kernels,
    memory: Memory,
    packed: PackedView,
    /// Mapped result of the last comparison.
    answer: Option<wgpu::BufferView>,
}

impl GpuComparer {
    /// Creates the kernels on a device that reports to `faults`.
    pub fn new(
        device: wgpu::Device,
        queue: wgpu::Queue,
        faults: GpuFaults,
        caps: &GpuCaps,
    ) -> Self {
        Self {
            kernels: Kernels::new(&device),
            memory: Memory::new(&device),
            device,
            queue,
            faults,
            name: caps.to_string(),
            packed: PackedView::default(),
            answer: None,
        }
    }

    /// Runs a comparison and keeps its result mapped. Returns squared error and number of pixels.
    fn run(&mut self, comparison: Comparison<'_>) -> Result<(f64, f64), GpuError> {
        let Self { device, queue, kernels, memory, .. } = self;
        let started = Instant::now();
        let load = comparison.sizes();
        ensure_capacity(memory, device, &load)?;
        let upload = memory.buffer(Part::Upload);
        let mut mapped = upload.get_mapped_range_mut(..load.bytes(Part::Upload)).map_err(failed)?;
        comparison.write(mapped.slice(..), &load);
        drop(mapped);
        upload.unmap();
        let grid = tile_grid(comparison.photograph);
        let commands = kernels.bind(device, memory, load, grid);
        let mut encoder = device.create_command_encoder(&Default::default());
        commands.record(&mut encoder, memory);
        let submission = queue.submit([encoder.finish()]);
        let submitted = started.elapsed();
        let errors = load.bytes(Part::Errors) as usize;
        let answer = self.wait(submission, load.bytes(Part::Readback))?;
        let tiles: &[[f32; 2]] = bytemuck::cast_slice(&answer[..errors]);
        let sum = |k: usize| -> f64 { tiles.iter().map(|tile| f64::from(tile[k])).sum() };
        let found = (sum(0), sum(1));
        self.answer = Some(answer);
        let answered = started.elapsed() - submitted;
        tracing::trace!(?load, ?submitted, ?answered, "photograph compared");
        Ok(found)
    }

    /// Waits for a submission, maps `bytes` bytes of the result, and maps the staging buffer for the next
    /// upload.
    fn wait(
        &self,
        submission: wgpu::SubmissionIndex,
        bytes: u64,
    ) -> Result<wgpu::BufferView, GpuError> {
        let readback = self.memory.buffer(Part::Readback);
        let upload = self.memory.buffer(Part::Upload);
        wait_for_result(&self.device, &self.faults, submission, (readback, bytes), [upload])
            .map_err(failed)
    }

    /// Releases the mapped result.
    fn release_result(&mut self) {
        release_result(&mut self.answer, self.memory.buffer(Part::Readback));
    }
}

fn failed(reason: impl ToString) -> GpuError {
    GpuError::NoComparison { reason: reason.to_string() }
}

impl PhotometricComparer for GpuComparer {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn compare<'a>(
        &'a mut self,
        view: &PreparedView<'a>,
        photograph: &Image<MeasuredPixel>,
        rule: PixelRule,
        rows: RowSubset,
    ) -> Result<PhotometricSums<'a>, ComparerError> {
        self.release_result();
        let mut packed = std::mem::take(&mut self.packed);
        packed.fill(view, tile_grid(photograph));
        let comparison = Comparison { packed: &packed, photograph, rule, rows };
        // Empty buffers cannot be bound.
        let is_empty = packed.entries.is_empty();
        let found = if is_empty { Ok((0.0, 0.0)) } else { self.run(comparison) };
        self.packed = packed;
        let (squared_error, pixels) = found.map_err(|error| ComparerError {
            device: self.name.clone(),
            reason: error.to_string(),
        })?;
        let Some(answer) = self.answer.as_deref() else {
            // No splat is visible, so no work was submitted.
            return Ok(PhotometricSums::from_splat_sums(view.clone(), &[], squared_error, pixels));
        };
        // The errors of the tiles precede the sums.
        let sums = &answer[answer.len() - view.n_drawn() * SUM_BYTES..];
        let sums: &[f32] = bytemuck::cast_slice(sums);
        let (sums, _) = sums.as_chunks();
        Ok(PhotometricSums::from_splat_sums(view.clone(), sums, squared_error, pixels))
    }
}

/// Pipelines. Walks are specialised by the number of chosen pixels per tile.
#[derive(Debug)]
struct Kernels {
    draw: wgpu::ShaderModule,
    walk: wgpu::ShaderModule,
    add: ComputeKernel,
    /// Created on first use.
    walks: Vec<(u64, [ComputeKernel; 2])>,
}

/// Bound kernels of one comparison.
struct Commands {
    draw: BoundKernel,
    walk: BoundKernel,
    add: BoundKernel,
    tiles: Grid,
    load: ComparisonSizes,
}

impl Kernels {
    fn new(device: &wgpu::Device) -> Self {
        let add = module(device, "add", layout::ADD);
        Self {
            draw: module(device, "draw", layout::DRAW),
            walk: module(device, "walk", layout::WALK),
            add: ComputeKernel::new(device, &add, "add"),
            walks: Vec::new(),
        }
    }

    /// Binds a comparison to a grid of tile columns and rows, at least one of each.
    fn bind(
        &mut self,
        device: &wgpu::Device,
        memory: &Memory,
        load: ComparisonSizes,
        (columns, rows): (usize, usize),
    ) -> Commands {
        use Part::*;
        let bind = |kernel: &ComputeKernel, parts: &[(u32, Part)]| {
            let resource =
                |&(at, part): &(u32, Part)| (at, memory.buffer(part).as_entire_binding());
            kernel.bind(device, &parts.iter().map(resource).collect::<Vec<_>>())
        };
        let add =
            bind(&self.add, &[(0, Frame), (4, Places), (5, Shown), (6, PartialSums), (7, Totals)]);
        let [draw, walk] = self.walks(device, load.lanes);
        let tile = [(0, Frame), (1, Splats), (2, Entries), (3, Starts)];
        let of_draw = [&tile[..], &[(4, Photograph), (5, Pixels), (6, Errors)]].concat();
        let of_walk =
            [&tile[..], &[(4, Places), (5, Pixels), (6, Shown), (7, PartialSums)]].concat();
        Commands {
            draw: bind(draw, &of_draw),
            walk: bind(walk, &of_walk),
            add,
            tiles: Grid { columns: columns as u32, rows: rows as u32 },
            load,
        }
    }

    fn walks(&mut self, device: &wgpu::Device, lanes: u64) -> &[ComputeKernel; 2] {
        let at = self.walks.iter().position(|(of, _)| *of == lanes).unwrap_or_else(|| {
            let value = [("LANES", lanes as f64)];
            let kernels = [(&self.draw, "draw"), (&self.walk, "walk")]
                .map(|(module, entry)| ComputeKernel::specialized(device, module, entry, &value));
            self.walks.push((lanes, kernels));
            self.walks.len() - 1
        });
        &self.walks[at].1
    }
}

impl Commands {
    /// Records the comparison of the data in [`Part::Upload`]. [`Part::Readback`] then holds the errors of
    /// the tiles, followed by the sums of the splats.
    fn record(&self, encoder: &mut wgpu::CommandEncoder, memory: &Memory) {
        let Self { load, .. } = self;
        let copy = |encoder: &mut wgpu::CommandEncoder, from, at, to, by, bytes| {
            let (from, to) = (memory.buffer(from), memory.buffer(to));
            encoder.copy_buffer_to_buffer(from, at, to, by, bytes);
        };
        for part in UPLOADED {
            copy(encoder, Part::Upload, offset(part, load), part, 0, load.bytes(part));
        }
        encoder.clear_buffer(memory.buffer(Part::Shown), 0, Some(load.bytes(Part::Shown)));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("comparison with a photograph"),
            timestamp_writes: None,
        });
        self.draw.dispatch(&mut pass, self.tiles);
        self.walk.dispatch(&mut pass, self.tiles);
        let quarters = load.splats as usize * N_QUARTERS as usize;
        self.add.dispatch(&mut pass, Grid::lanes(quarters));
        drop(pass);
        let errors = load.bytes(Part::Errors);
        copy(encoder, Part::Errors, 0, Part::Readback, 0, errors);
        let totals = load.bytes(Part::Totals);
        copy(encoder, Part::Totals, 0, Part::Readback, errors, totals);
    }
}
