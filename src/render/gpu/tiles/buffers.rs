//! Buffers that pass data between the stages of drawing by tiles.

use crate::render::gpu::adapters::max_buffer_bytes;
use crate::render::gpu::constants::{GROUP, slot, wgsl};
use crate::render::gpu::error::GpuError;
use crate::render::gpu::growing::{MIB, allocate};
use crate::render::gpu::layout::GpuAppearance;
use crate::render::gpu::pipeline::storage;
use crate::render::gpu::task::WORD;

pub(super) const PAIR: u64 = 2 * WORD;
/// Size in bytes of a record in `packed.wgsl`. The following constants are the sizes of a gradient in
/// `packed.wgsl` and of a footprint in `footprint.wgsl`.
const RECORD_BYTES: u64 = 64;
const GRADIENT_BYTES: u64 = 48;
const FOOTPRINT_BYTES: u64 = 16;
/// Bytes per appearance; a binding must hold at least one.
const APPEARANCE_BYTES: u64 = size_of::<GpuAppearance>() as u64;

pub(super) const COUNTS_BYTES: u64 = slot::N_SLOTS as u64 * WORD;

/// Buffers with one entry per splat: sort keys and order, records, tiles.
#[derive(Debug)]
pub(super) struct SplatBuffers {
    pub(super) keys: wgpu::Buffer,
    /// Pairs of depth key and splat, in two buffers between which the sort alternates.
    pub(super) order: [wgpu::Buffer; 2],
    pub(super) records: wgpu::Buffer,
    /// Packed list of the tiles of each splat, one word per splat; only for splats on at most 2×2
    /// tiles.
    pub(super) small_footprints: wgpu::Buffer,
    pub(super) footprints: wgpu::Buffer,
    pub(super) entry_counts: wgpu::Buffer,
    /// Colour gradients: one per splat if the scene has appearance, otherwise a single unused one.
    pub(super) gradients: wgpu::Buffer,
    /// Placeholder for the appearance buffer of a scene without appearance.
    pub(super) no_appearance: wgpu::Buffer,
    pub(super) capacity: usize,
    pub(super) has_appearance: bool,
}

impl SplatBuffers {
    pub(super) fn new(
        device: &wgpu::Device,
        capacity: usize,
        has_appearance: bool,
    ) -> Result<Self, GpuError> {
        // A binding cannot be empty, and the first frame may have no splats.
        let n = capacity.max(1) as u64;
        // A binding cannot be empty, so scenes without appearance bind an unused entry.
        let n_gradients = if has_appearance { n } else { 1 };
        let n_bytes = n * (2 * WORD + 2 * PAIR + RECORD_BYTES + FOOTPRINT_BYTES)
            + n_gradients * GRADIENT_BYTES;
        let refused = GpuError::OutOfMemory { n_splats: capacity, mib: n_bytes.div_ceil(MIB) };
        let pairs = |label| storage(device, label, n * PAIR);
        allocate(device, refused, || Self {
            keys: storage(device, "depths", n * WORD),
            order: [pairs("depth order"), pairs("depth order, other side")],
            records: storage(device, "records", n * RECORD_BYTES),
            small_footprints: storage(device, "few tiles", n * WORD),
            footprints: storage(device, "footprints", n * FOOTPRINT_BYTES),
            entry_counts: storage(
                device,
                "entries by 256 splats",
                n.div_ceil(u64::from(GROUP)) * WORD,
            ),
            gradients: storage(device, "gradients", n_gradients * GRADIENT_BYTES),
            no_appearance: storage(device, "no appearance", APPEARANCE_BYTES),
            capacity,
            has_appearance,
        })
    }
}

/// Entries (pairs of tile and splat), in two buffers between which the sort alternates.
#[derive(Debug)]
pub(super) struct EntryBuffers {
    pub(super) pairs: [wgpu::Buffer; 2],
    pub(super) capacity: u64,
}

impl EntryBuffers {
    /// Allocates buffers for `capacity` entries. `n_splats` only appears in the error.
    pub(super) fn new(
        device: &wgpu::Device,
        capacity: u64,
        n_splats: usize,
    ) -> Result<Self, GpuError> {
        let mib = (2 * capacity * PAIR).div_ceil(MIB);
        let refused = GpuError::OutOfMemory { n_splats, mib };
        allocate(device, refused, || Self {
            pairs: ["entries", "entries, other side"]
                .map(|label| storage(device, label, capacity * PAIR)),
            capacity,
        })
    }
}

/// Returns the maximum number of entries that fit in one of the adapter's buffers.
pub(super) fn max_entries(limits: &wgpu::Limits) -> u64 {
    max_buffer_bytes(limits) / PAIR
}

/// Returns the number of tile columns and rows of an image, given its size in pixels.
pub(super) fn tile_grid((width, height): (u32, u32)) -> (u32, u32) {
    (width.div_ceil(TILE_PIXELS), height.div_ceil(TILE_PIXELS))
}

const TILE_PIXELS: u32 = crate::render::TILE as u32;

/// `tiles/sort.wgsl`: stable radix sort, applied by depth and then by tile.
pub const SORT: &str = wgsl!("tiles/stages", "tiles/sort");
/// `tiles/preprocess.wgsl`: converts splats to records, depth keys and tile footprints.
pub const PREPROCESS: &str = wgsl!(
    "common",
    "record",
    "tiles/stages",
    "tiles/packed",
    "tiles/footprint",
    "tiles/preprocess"
);
/// `tiles/bin.wgsl`: writes an entry for each tile that a splat reaches, and later finds each tile's
/// range of entries.
pub const BIN: &str = wgsl!("common", "tiles/stages", "tiles/footprint", "tiles/bin");
/// `tiles/raster.wgsl`: blends the entries of a tile, one workgroup per tile.
pub const RASTER: &str = wgsl!("common", "record", "tiles/stages", "tiles/packed", "tiles/raster");
