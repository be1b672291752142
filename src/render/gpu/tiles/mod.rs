//! Splats to pixels by compute: sorted by depth, sorted into tiles, blended by one workgroup a tile
//! (`rendering.md`, Tiles by compute). The path for chips with much compute and few raster units.
//!
//! 1. Preprocess: a record, a key of depth and the tiles it reaches for each splat.
//! 2. Sort: by depth, what is not drawn falls out; then, in order of depth, an entry for each tile of
//!    each splat; then by tile, which keeps the order of depth.
//! 3. Draw: one workgroup a tile blends its entries front to back until its pixels are full.
//!
//! Nothing here waits for the GPU, and no count comes back within a frame: kernels run on grids that
//! are large enough for any count and end early.

mod buffers;
mod capacity;
mod kernel;
mod plan;
pub mod sort;

use super::GpuError;
use super::constants::slot;
use super::scene::GpuScene;
use super::target::SplatTarget;
use super::timer::{Stage, StageTimer};
use buffers::{COUNTS_BYTES, EntryBuffers, SplatBuffers, most_entries, tile_grid};
use capacity::EntryDemand;
use plan::{Inputs, Kernels, Plan};

/// WGSL of each module; [`super::constants`] come in front.
pub mod shader {
    /// `tiles/sort.wgsl`.
    pub const SORT: &str = concat!(
        include_str!("../../../../shaders/tiles/stages.wgsl"),
        include_str!("../../../../shaders/tiles/sort.wgsl")
    );
    /// `tiles/preprocess.wgsl`.
    pub const PREPROCESS: &str = concat!(
        include_str!("../../../../shaders/common.wgsl"),
        include_str!("../../../../shaders/paint.wgsl"),
        include_str!("../../../../shaders/record.wgsl"),
        include_str!("../../../../shaders/tiles/stages.wgsl"),
        include_str!("../../../../shaders/tiles/packed.wgsl"),
        include_str!("../../../../shaders/tiles/footprint.wgsl"),
        include_str!("../../../../shaders/tiles/preprocess.wgsl")
    );
    /// `tiles/bin.wgsl`.
    pub const BIN: &str = concat!(
        include_str!("../../../../shaders/common.wgsl"),
        include_str!("../../../../shaders/tiles/stages.wgsl"),
        include_str!("../../../../shaders/tiles/footprint.wgsl"),
        include_str!("../../../../shaders/tiles/bin.wgsl")
    );
    /// `tiles/raster.wgsl`.
    pub const RASTER: &str = concat!(
        include_str!("../../../../shaders/common.wgsl"),
        include_str!("../../../../shaders/paint.wgsl"),
        include_str!("../../../../shaders/record.wgsl"),
        include_str!("../../../../shaders/tiles/stages.wgsl"),
        include_str!("../../../../shaders/tiles/packed.wgsl"),
        include_str!("../../../../shaders/tiles/raster.wgsl")
    );
}

/// Pixels a side of a tile.
const TILE_PIXELS: u32 = crate::render::TILE as u32;

/// One image.
#[derive(Clone, Copy)]
pub(super) struct TileFrame<'a> {
    /// Camera and options, without a cap of the extent.
    pub(super) view: &'a wgpu::Buffer,
    pub(super) scene: &'a GpuScene,
    /// Not empty.
    pub(super) image: &'a SplatTarget,
    /// A timer and its slot.
    pub(super) timer: Option<(&'a StageTimer, usize)>,
}

/// Pipelines and memory of the tile path.
#[derive(Debug)]
pub(super) struct TilePath {
    kernels: Kernels,
    counts: wgpu::Buffer,
    demand: EntryDemand,
    splats: SplatBuffers,
    entries: EntryBuffers,
    plan: Option<Plan>,
}

impl TilePath {
    pub(super) fn new(device: &wgpu::Device) -> Result<Self, GpuError> {
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
            entries: EntryBuffers::new(device, 1, 0)?,
            plan: None,
        })
    }

    /// Records an image. Needs no order.
    pub(super) fn record(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        frame: TileFrame<'_>,
    ) -> Result<(), GpuError> {
        let TileFrame { view, scene, image, timer } = frame;
        self.make_room(device, scene)?;
        let inputs = Inputs::new(view, scene, image);
        if self.plan.as_ref().is_none_or(|plan| *plan.inputs() != inputs) {
            self.plan = None;
        }
        let Self { kernels, counts, splats, entries, .. } = self;
        let plan = self.plan.get_or_insert_with(|| {
            Plan::new(device, queue, kernels, inputs, counts, splats, entries)
        });

        let mut zeroed = [0; 4];
        zeroed[slot::N_SPLATS as usize] = scene.n_splats() as u32;
        queue.write_buffer(&self.counts, 0, bytemuck::cast_slice(&zeroed));
        for stage in [Stage::Preprocess, Stage::Sort, Stage::Draw] {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("splats by tiles"),
                timestamp_writes: timer.map(|(timer, slot)| timer.of_compute(slot, stage)),
            });
            plan.record(&mut pass, stage, scene.n_splats(), tile_grid(image.size()));
        }
        self.demand.send(encoder, &self.counts);
        Ok(())
    }

    /// Why the farthest splats are left out of images, if they are and will be.
    pub(super) fn shortage(&self) -> Option<&GpuError> {
        self.demand.shortage()
    }

    fn make_room(&mut self, device: &wgpu::Device, scene: &GpuScene) -> Result<(), GpuError> {
        self.splats.check()?;
        let has_appearance = scene.appearance_buffer().is_some();
        if scene.capacity() > self.splats.capacity || has_appearance != self.splats.has_appearance {
            self.splats = SplatBuffers::new(device, scene.capacity(), has_appearance)?;
            self.plan = None;
        }
        let n_splats = scene.n_splats();
        let most = most_entries(&device.limits());
        let capacity = self.demand.capacity(self.entries.capacity, n_splats, most);
        let room = match self.entries.check() {
            Err(late) => Err(late),
            Ok(()) if capacity == self.entries.capacity => return Ok(()),
            Ok(()) => EntryBuffers::new(device, capacity, n_splats),
        };
        match room {
            Ok(entries) => {
                self.entries = entries;
                self.plan = None;
                Ok(())
            }
            Err(error) if self.entries.capacity > 1 => {
                tracing::warn!("{error}");
                self.demand.refuse(capacity, error);
                Ok(())
            }
            Err(error) => Err(error),
        }
    }
}
