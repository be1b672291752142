//! What the tile path keeps on the GPU between its stages.

use super::constants::TILE_PIXELS;
use crate::render::gpu::allocation::Allocation;
use crate::render::gpu::constants::{GROUP, slot};
use crate::render::gpu::context::max_buffer_bytes;
use crate::render::gpu::error::GpuError;
use crate::render::gpu::kernel::storage;
use crate::render::gpu::layout::GpuAppearance;

const WORD: u64 = size_of::<u32>() as u64;
const PAIR: u64 = 2 * WORD;
/// Sizes of the structs of `packed.wgsl` and `footprint.wgsl`.
const RECORD_BYTES: u64 = 64;
const GRADIENT_BYTES: u64 = 48;
const FOOTPRINT_BYTES: u64 = 16;
/// Of one appearance; a binding holds one at least.
const APPEARANCE_BYTES: u64 = size_of::<GpuAppearance>() as u64;
const MIB: u64 = 1 << 20;

/// Bytes of the buffer of counts.
pub(super) const COUNTS_BYTES: u64 = slot::N_SLOTS as u64 * WORD;

/// Buffers with one entry per splat: keys and order of the sort, records, tiles.
#[derive(Debug)]
pub(super) struct SplatBuffers {
    pub(super) keys: wgpu::Buffer,
    /// Pairs of key and splat.
    pub(super) order: [wgpu::Buffer; 2],
    pub(super) records: wgpu::Buffer,
    /// The tiles of those that reach few, a word each.
    pub(super) fews: wgpu::Buffer,
    pub(super) footprints: wgpu::Buffer,
    pub(super) blocks: wgpu::Buffer,
    /// By splat where the scene has appearance, else a single one that nobody reads.
    pub(super) gradients: wgpu::Buffer,
    /// In place of the scene's where it has none.
    pub(super) no_appearance: wgpu::Buffer,
    pub(super) capacity: usize,
    pub(super) has_appearance: bool,
    allocation: Allocation,
}

impl SplatBuffers {
    /// Room for `capacity` splats.
    pub(super) fn new(
        device: &wgpu::Device,
        capacity: usize,
        has_appearance: bool,
    ) -> Result<Self, GpuError> {
        // A binding cannot be empty, and the first frame may have no splat.
        let n = capacity.max(1) as u64;
        // A binding cannot be empty, so plain scenes bind one that nobody reads.
        let n_gradients = if has_appearance { n } else { 1 };
        let n_bytes = n * (2 * WORD + 2 * PAIR + RECORD_BYTES + FOOTPRINT_BYTES)
            + n_gradients * GRADIENT_BYTES;
        let refused = GpuError::OutOfMemory { n_splats: capacity, mib: n_bytes.div_ceil(MIB) };
        let pairs = |label| storage(device, label, n * PAIR);
        let (buffers, allocation) = Allocation::new(device, refused, || {
            (
                storage(device, "depths", n * WORD),
                [pairs("depth order"), pairs("depth order, other side")],
                storage(device, "records", n * RECORD_BYTES),
                storage(device, "few tiles", n * WORD),
                storage(device, "footprints", n * FOOTPRINT_BYTES),
                storage(device, "entries by 256 splats", n.div_ceil(u64::from(GROUP)) * WORD),
                storage(device, "gradients", n_gradients * GRADIENT_BYTES),
            )
        })?;
        let (keys, order, records, fews, footprints, blocks, gradients) = buffers;
        let no_appearance = storage(device, "no appearance", APPEARANCE_BYTES);
        Ok(Self {
            keys,
            order,
            records,
            fews,
            footprints,
            blocks,
            gradients,
            no_appearance,
            capacity,
            has_appearance,
            allocation,
        })
    }

    /// A backend's late answer to the allocation.
    pub(super) fn check(&mut self) -> Result<(), GpuError> {
        self.allocation.check()
    }
}

/// Entries, pairs of tile and splat.
#[derive(Debug)]
pub(super) struct EntryBuffers {
    pub(super) pairs: [wgpu::Buffer; 2],
    pub(super) capacity: u64,
    allocation: Allocation,
}

impl EntryBuffers {
    /// Room for `capacity` entries; `n_splats` is for the message if there is none.
    pub(super) fn new(
        device: &wgpu::Device,
        capacity: u64,
        n_splats: usize,
    ) -> Result<Self, GpuError> {
        let mib = (2 * capacity * PAIR).div_ceil(MIB);
        let refused = GpuError::OutOfMemory { n_splats, mib };
        let (pairs, allocation) = Allocation::new(device, refused, || {
            ["entries", "entries, other side"].map(|label| storage(device, label, capacity * PAIR))
        })?;
        Ok(Self { pairs, capacity, allocation })
    }

    /// A backend's late answer to the allocation.
    pub(super) fn check(&mut self) -> Result<(), GpuError> {
        self.allocation.check()
    }
}

/// Entries that the adapter's buffers hold.
pub(super) fn max_entries(limits: &wgpu::Limits) -> u64 {
    max_buffer_bytes(limits) / PAIR
}

/// Columns and rows of tiles of an image.
pub(super) fn tile_grid((width, height): (u32, u32)) -> (u32, u32) {
    (width.div_ceil(TILE_PIXELS), height.div_ceil(TILE_PIXELS))
}

/// First entry of each tile, and the one after its last.
pub(super) fn ends_of_tiles(device: &wgpu::Device, (columns, rows): (u32, u32)) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("ends of tiles"),
        size: u64::from(columns) * u64::from(rows) * PAIR,
        // Cleared before every image.
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}
