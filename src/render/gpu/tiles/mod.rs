//! Draws splats by compute shaders: sorted by depth, then by tile, and blended by one workgroup per tile
//! (`rendering.md`, Tiles by compute).
//!
//! 1. Preprocess: computes a record, a depth key and the covered tiles of each splat.
//! 2. Sort: sorts by depth and drops invisible splats. Then writes, in depth order, one entry per tile of
//!    each splat, and sorts the entries by tile, which preserves the depth order.
//! 3. Draw: one workgroup per tile blends its entries front to back until its pixels are full.
//!
//! No stage waits for the GPU, and no counter is read back within a frame: kernels run on grids
//! large enough for any count and exit early.

pub mod buffers;
mod plan;
pub mod sort;

use super::constants::slot;
use super::error::GpuError;
use super::renderer::SplatTarget;
use super::scene::GpuScene;
use super::timer::{GpuStage, StageTimer};
use buffers::{COUNTS_BYTES, EntryBuffers, SplatBuffers, max_entries, tile_grid};
use plan::{EntryDemand, Inputs, Kernels, TileMemory, TilePlan};

#[derive(Clone, Copy)]
pub(super) struct TileFrame<'a> {
    pub(in crate::render::gpu) view: &'a wgpu::Buffer,
    pub(in crate::render::gpu) scene: &'a GpuScene,
    /// Output image, at least one pixel per side.
    pub(in crate::render::gpu) image: &'a SplatTarget,
    pub(in crate::render::gpu) timer: Option<(&'a StageTimer, usize)>,
    pub(in crate::render::gpu) shows_textures: bool,
}

/// Pipelines and buffers for drawing splats by tiles.
#[derive(Debug)]
pub(super) struct TilePath {
    kernels: Kernels,
    counts: wgpu::Buffer,
    pub(super) demand: EntryDemand,
    splats: SplatBuffers,
    entries: EntryBuffers,
    plan: Option<TilePlan>,
}

impl TilePath {
    pub(in crate::render::gpu) fn new(device: &wgpu::Device) -> Result<Self, GpuError> {
        Ok(Self {
            kernels: Kernels::new(device),
            counts: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("counts"),
                size: COUNTS_BYTES,
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_SRC
                    | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            demand: EntryDemand::new(device),
            splats: SplatBuffers::new(device, 0, false)?,
            // Grown by the first frame, which knows the number of splats.
            entries: EntryBuffers::new(device, 1, 0)?,
            plan: None,
        })
    }

    pub(in crate::render::gpu) fn record(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        frame: TileFrame<'_>,
    ) -> Result<(), GpuError> {
        let TileFrame { view, scene, image, timer, shows_textures } = frame;
        self.ensure_capacity(device, scene)?;
        let inputs = Inputs::new(view, scene, image, shows_textures);
        // After a resize or growth the bound resources no longer exist.
        if self.plan.as_ref().is_none_or(|plan| plan.inputs != inputs) {
            // A plan binds specific buffers: any replacement makes it stale.
            self.plan = None;
        }
        let Self { kernels, counts, splats, entries, .. } = self;
        let plan = self.plan.get_or_insert_with(|| {
            let memory = TileMemory { counts, splats, entries };
            TilePlan::new(device, queue, kernels, inputs, memory)
        });

        let mut first = [0; slot::N_SLOTS];
        first[slot::N_SPLATS as usize] = scene.n_splats() as u32;
        first[slot::NEAREST as usize] = u32::MAX;
        // Written by the CPU, because kernels modify these counters and only the number of splats is known
        // in advance.
        queue.write_buffer(&self.counts, 0, bytemuck::cast_slice(&first));
        plan.clear(encoder);
        for stage in [GpuStage::Preprocess, GpuStage::Sort, GpuStage::Draw] {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("splats by tiles"),
                timestamp_writes: timer.map(|(timer, slot)| timer.of_compute(slot, stage)),
            });
            plan.record(&mut pass, stage, scene.n_splats(), tile_grid(image.size()));
        }
        self.demand.send(encoder, &self.counts);
        Ok(())
    }

    fn ensure_capacity(&mut self, device: &wgpu::Device, scene: &GpuScene) -> Result<(), GpuError> {
        let has_appearance = scene.buffers.appearance.is_some();
        if scene.capacity() > self.splats.capacity || has_appearance != self.splats.has_appearance {
            // As many as the scene's own buffers hold: growing scenes rarely rebuild the plan.
            self.splats = SplatBuffers::new(device, scene.capacity(), has_appearance)?;
            self.plan = None;
        }
        let n_splats = scene.n_splats();
        let most = max_entries(&device.limits());
        let capacity = self.demand.capacity(self.entries.capacity, n_splats, most);
        if capacity == self.entries.capacity {
            return Ok(());
        }
        match EntryBuffers::new(device, capacity, n_splats) {
            Ok(entries) => {
                self.entries = entries;
                self.plan = None;
                Ok(())
            }
            // The previous capacity still draws most of the image, so only the very first failure is
            // fatal.
            Err(error) if self.entries.capacity > 1 => {
                tracing::warn!("{error}");
                self.demand.record_failure(capacity, error);
                Ok(())
            }
            Err(error) => Err(error),
        }
    }
}
