//! Kernels for drawing splats by tiles, and their bindings.
//!
//! Bind groups are created once and reused while the buffers stay the same, so a frame only records passes.
//! The two buffers of a sort alternate. Which of them holds the result depends only on the number of passes,
//! so the result is bound here.

use super::buffers;
use super::buffers::{COUNTS_BYTES, EntryBuffers, PAIR, SplatBuffers, tile_grid};
use super::sort::{Keys, RadixSort, SortBuffers, SortPlan};
use crate::render::gpu::constants::{module, slot};
use crate::render::gpu::error::GpuError;
use crate::render::gpu::pipeline::{BoundKernel, ComputeKernel, Grid};
use crate::render::gpu::renderer::SplatTarget;
use crate::render::gpu::scene::GpuScene;
use crate::render::gpu::task::IN;
use crate::render::gpu::timer::{GpuStage, ReadbackRing};
use std::sync::OnceLock;

/// Number of workgroups of the pass over all entries that finds each tile's range of entries.
const RANGE_GROUPS: u32 = 1024;
// Bits of the depth range between the nearest and the farthest splat. Keys are the bits of positive floats,
// with 2²³ values per doubling. No bit is lost up to a depth ratio of 4, one bit up to 16, and two up to
// 256. 24 bits save one sort pass; splats closer than the lost bits are closer than f32 can place them.
const DEPTH_BITS: u32 = 24;

#[derive(Debug)]
pub(super) struct Kernels {
    /// Kernels that convert splats to records, for scenes without and with appearance.
    preprocess: [ComputeKernel; 2],
    sort: RadixSort,
    count: ComputeKernel,
    offsets: ComputeKernel,
    emit: ComputeKernel,
    ranges: ComputeKernel,
    /// Kernels that blend the entries of a tile, for scenes without and with appearance.
    raster: [ComputeKernel; 2],
    /// The same kernels with textures.
    // Compiled when first used, because many scenes have no textures.
    textured: [OnceLock<ComputeKernel>; 2],
}

impl Kernels {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let preprocess = module(device, "preprocess", buffers::PREPROCESS);
        let bin = module(device, "bin", buffers::BIN);
        Self {
            preprocess: [0.0, 1.0].map(|value| {
                let flags = [("has_appearance", value)];
                ComputeKernel::specialized(device, &preprocess, "preprocess", &flags)
            }),
            sort: RadixSort::new(device),
            count: ComputeKernel::new(device, &bin, "count"),
            offsets: ComputeKernel::new(device, &bin, "offsets"),
            emit: ComputeKernel::new(device, &bin, "emit"),
            ranges: ComputeKernel::new(device, &bin, "ranges"),
            raster: [0, 1].map(|appearance| raster(device, appearance, 0)),
            textured: Default::default(),
        }
    }

    fn raster(&self, device: &wgpu::Device, inputs: &Inputs) -> &ComputeKernel {
        let appearance = usize::from(inputs.appearance.is_some());
        match inputs.textures {
            Some(_) => self.textured[appearance].get_or_init(|| raster(device, appearance, 1)),
            None => &self.raster[appearance],
        }
    }
}

/// Creates the kernel that blends the entries of a tile. Each flag is 0 or 1.
fn raster(device: &wgpu::Device, has_appearance: usize, has_textures: usize) -> ComputeKernel {
    let module = module(device, "raster", buffers::RASTER);
    let flags = [("has_appearance", has_appearance), ("has_textures", has_textures)];
    let flags = flags.map(|(name, value)| (name, value as f64));
    ComputeKernel::specialized(device, &module, "raster", &flags)
}

/// Resources of the scene and the renderer that a [`TilePlan`] binds. The plan is valid while they stay
/// the same.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Inputs {
    view: wgpu::Buffer,
    splats: wgpu::Buffer,
    appearance: Option<wgpu::Buffer>,
    /// Textures to draw, if any.
    textures: Option<wgpu::Buffer>,
    image: wgpu::TextureView,
    size: (u32, u32),
}

impl Inputs {
    /// Other paints than the stored colours show no textures: `shows_textures` is false.
    pub(super) fn new(
        view: &wgpu::Buffer,
        scene: &GpuScene,
        image: &SplatTarget,
        shows_textures: bool,
    ) -> Self {
        Self {
            view: view.clone(),
            splats: scene.buffers.splats.clone(),
            appearance: scene.buffers.appearance.clone(),
            textures: scene.textures.buffer.clone().filter(|_| shows_textures),
            image: image.view().clone(),
            size: image.size(),
        }
    }
}

#[derive(Debug)]
pub(super) struct TilePlan {
    pub(super) inputs: Inputs,
    preprocess: BoundKernel,
    by_depth: SortPlan,
    count: BoundKernel,
    offsets: BoundKernel,
    emit: BoundKernel,
    by_tile: SortPlan,
    ranges: BoundKernel,
    raster: BoundKernel,
    tile_ranges: wgpu::Buffer,
}

#[derive(Clone, Copy)]
pub(super) struct TileMemory<'a> {
    /// Counters of splats and entries, indexed by [`slot`].
    pub(super) counts: &'a wgpu::Buffer,
    pub(super) splats: &'a SplatBuffers,
    pub(super) entries: &'a EntryBuffers,
}

impl Kernels {
    /// Binds the kernels that count the entries, compute their offsets and write them, in this order.
    /// `order` holds the splats sorted by depth.
    fn bind_bin(
        &self,
        device: &wgpu::Device,
        inputs: &Inputs,
        TileMemory { counts, splats, entries }: TileMemory<'_>,
        order: &wgpu::Buffer,
    ) -> [BoundKernel; 3] {
        let SplatBuffers { footprints, entry_counts: blocks, small_footprints: fews, .. } = splats;
        let all = [&inputs.view, counts, order, footprints, blocks, &entries.pairs[0], fews];
        let bind = |kernel: &ComputeKernel, used: &[u32]| {
            let buffers: Vec<_> = used.iter().map(|&i| (i, all[i as usize])).collect();
            kernel.bind_buffers(device, &buffers)
        };
        [
            bind(&self.count, &[1, 2, 3, 4, 6]),
            bind(&self.offsets, &[1, 4, 5]),
            bind(&self.emit, &[0, 1, 2, 3, 4, 5, 6]),
        ]
    }
}

impl TilePlan {
    pub(super) fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        kernels: &Kernels,
        inputs: Inputs,
        memory: TileMemory<'_>,
    ) -> Self {
        let TileMemory { counts, splats, entries } = memory;
        let variant = usize::from(inputs.appearance.is_some());
        let appearance = inputs.appearance.as_ref().unwrap_or(&splats.no_appearance);
        let preprocess = [
            (0, &inputs.view),
            (1, counts),
            (2, &inputs.splats),
            (3, &splats.keys),
            (4, &splats.records),
            (5, &splats.footprints),
            (6, appearance),
            (7, &splats.gradients),
            (8, &splats.small_footprints),
        ];
        // Drops invisible splats.
        let keys = Keys::Indexed {
            keys: &splats.keys,
            source: slot::N_SPLATS,
            sink: slot::N_VISIBLE,
            range: [slot::NEAREST, slot::FARTHEST],
        };
        let pairs = SortBuffers { pairs: splats.order.each_ref(), counts };
        let by_depth = kernels.sort.plan(device, queue, pairs, DEPTH_BITS, keys);
        let order = &splats.order[by_depth.result()];
        let [count, offsets, emit] = kernels.bind_bin(device, &inputs, memory, order);
        // The sort is stable, so each tile's entries keep the depth order.
        let (columns, rows) = tile_grid(inputs.size);
        let pairs = SortBuffers { pairs: entries.pairs.each_ref(), counts };
        let keys = Keys::Valued { source: slot::N_ENTRIES };
        let by_tile = kernels.sort.plan(device, queue, pairs, bits_of(columns * rows), keys);
        let sorted = &entries.pairs[by_tile.result()];
        // First entry of each tile, and one past its last.
        let tile_ranges = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("ends of tiles"),
            size: u64::from(columns) * u64::from(rows) * PAIR,
            // Cleared before every image.
            usage: IN,
            mapped_at_creation: false,
        });
        let raster = [
            (0, inputs.view.as_entire_binding()),
            (1, tile_ranges.as_entire_binding()),
            (2, sorted.as_entire_binding()),
            (3, splats.records.as_entire_binding()),
            (4, wgpu::BindingResource::TextureView(&inputs.image)),
            (5, splats.gradients.as_entire_binding()),
            (6, inputs.splats.as_entire_binding()),
            (7, appearance.as_entire_binding()),
            // Without textures any buffer of words serves as placeholder.
            (8, inputs.textures.as_ref().unwrap_or(&splats.keys).as_entire_binding()),
        ];
        let ranges = [(1, counts), (7, sorted), (8, &tile_ranges)];
        Self {
            preprocess: kernels.preprocess[variant].bind_buffers(device, &preprocess),
            by_depth,
            count,
            offsets,
            emit,
            by_tile,
            ranges: kernels.ranges.bind_buffers(device, &ranges),
            raster: kernels.raster(device, &inputs).bind(device, &raster),
            tile_ranges,
            inputs,
        }
    }

    /// Clears the tiles' ranges of entries before an image, because kernels write only the ranges of
    /// tiles with entries.
    pub(super) fn clear(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.clear_buffer(&self.tile_ranges, 0, None);
    }

    /// Records one stage of an image of `n_splats` splats; `tiles` is the number of tile columns and
    /// rows.
    pub(super) fn record(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        stage: GpuStage,
        n_splats: usize,
        tiles: (u32, u32),
    ) {
        let by_splat = Grid::lanes(n_splats);
        match stage {
            GpuStage::Preprocess => self.preprocess.dispatch(pass, by_splat),
            GpuStage::Sort => {
                self.by_depth.record(pass);
                self.count.dispatch(pass, by_splat);
                self.offsets.dispatch(pass, Grid::row(1));
                self.emit.dispatch(pass, by_splat);
                self.by_tile.record(pass);
                // A fixed number of groups, because only the GPU knows the number of entries.
                self.ranges.dispatch(pass, Grid::row(RANGE_GROUPS));
            }
            GpuStage::Draw => {
                self.raster.dispatch(pass, Grid { columns: tiles.0, rows: tiles.1 });
            }
        }
    }
}

/// Returns the number of bits needed for the values `0..n`.
fn bits_of(n: u32) -> u32 {
    u32::BITS - n.saturating_sub(1).leading_zeros()
}

// Initial estimate of entries per splat: most cover at most 2×2 tiles.
const PER_SPLAT: u64 = 4;
const MIN_ENTRIES: u64 = 1 << 16;

#[derive(Debug)]
pub(in crate::render::gpu) struct EntryDemand {
    ring: ReadbackRing,
    /// Maximum number of entries that an image needed since the last call of [`Self::capacity`].
    needed: u64,
    /// Smallest capacity for which allocation failed.
    refused: u64,
    /// Error if the farthest splats are permanently left out, because GPU memory holds too few entries.
    pub(in crate::render::gpu) shortage: Option<GpuError>,
}

impl EntryDemand {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let ring = ReadbackRing::new(device, "needed entries", COUNTS_BYTES);
        Self { ring, needed: 0, refused: u64::MAX, shortage: None }
    }

    /// Returns the capacity, in entries, for the next image. `now` is the current capacity and `most`
    /// the adapter's limit.
    pub(super) fn capacity(&mut self, now: u64, n_splats: usize, most: u64) -> u64 {
        let needed = std::mem::take(&mut self.needed);
        let wanted = capacity_for(needed, now, n_splats, most);
        if needed > 0 {
            // Any capacity below the one that failed may still be available.
            let is_short = needed > most.min(self.refused - 1);
            let shortage =
                is_short.then_some(GpuError::TooManyEntries { needed, capacity: wanted.max(now) });
            // Once per shortage, because the number needed differs from frame to frame.
            if let (Some(error), None) = (&shortage, &self.shortage) {
                tracing::warn!("{error}");
            }
            self.shortage = shortage;
        }
        if wanted < self.refused { wanted } else { now }
    }

    /// Records that buffers of this capacity could not be allocated, so that it is not requested again.
    pub(super) fn record_failure(&mut self, capacity: u64, error: GpuError) {
        self.refused = capacity;
        self.shortage = Some(error);
    }

    /// Reads the counters of earlier images and copies those of this image for the CPU. Must be
    /// recorded after the image in the same encoder.
    pub(super) fn send(&mut self, encoder: &mut wgpu::CommandEncoder, counts: &wgpu::Buffer) {
        let needed = &mut self.needed;
        let free = self.ring.collect_and_reserve(|bytes| {
            let counts: [u32; slot::N_SLOTS] = bytemuck::pod_read_unaligned(bytes);
            *needed = (*needed).max(u64::from(counts[slot::N_NEEDED as usize]));
        });
        if let Some(slot) = free {
            self.ring.send(encoder, slot, counts, COUNTS_BYTES);
        }
    }
}

/// Returns the capacity, in entries, for images that need `needed` entries: the current capacity `now`,
/// or 1.5 times `needed` if `now` is too small. The result is at least an estimate for `n_splats` and at
/// most `most`.
fn capacity_for(needed: u64, now: u64, n_splats: usize, most: u64) -> u64 {
    let guess = MIN_ENTRIES.max(PER_SPLAT * n_splats as u64);
    // Extra capacity, because approaching the scene raises the demand frame by frame, and each growth
    // rebuilds the plan.
    let grown = if needed > now { needed + needed / 2 } else { 0 };
    guess.max(grown).max(now).min(most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_hold_every_tile() {
        for (n, bits) in [(0, 0), (1, 0), (2, 1), (3, 2), (256, 8), (257, 9), (3600, 12)] {
            assert_eq!(bits_of(n), bits, "{n} tiles");
        }
    }

    #[test]
    fn capacity_follows_what_is_needed_up_to_the_limit() {
        for (needed, now, n_splats, expected) in [
            (0, 0, 0, MIN_ENTRIES),
            (0, 0, 100_000, 400_000),
            (400_000, 400_000, 100_000, 400_000),
            (400_002, 400_000, 100_000, 600_003),
            (10, 600_003, 100_000, 600_003),
            (900_000, 600_003, 100_000, 1_000_000),
            (u64::from(u32::MAX), 1_000_000, 100_000, 1_000_000),
        ] {
            assert_eq!(capacity_for(needed, now, n_splats, 1_000_000), expected);
        }
    }
}
