//! The kernels of the tile path and what each is bound to.

use super::buffers::{EntryBuffers, SplatBuffers, starts, tile_grid};
use super::kernel::{Bound, Grid, Kernel};
use super::shader;
use super::sort::{Keys, RadixSort, SortBuffers, SortPlan};
use crate::render::gpu::constants::{module, slot};
use crate::render::gpu::scene::GpuScene;
use crate::render::gpu::target::SplatTarget;
use crate::render::gpu::timer::Stage;

/// Workgroups of the pass over all entries that finds where tiles begin.
const RANGE_GROUPS: u32 = 1024;
/// Keys are the bits of positive floats.
const DEPTH_BITS: u32 = 32;

#[derive(Debug)]
pub(super) struct Kernels {
    /// Without and with appearance.
    preprocess: [Kernel; 2],
    sort: RadixSort,
    count: Kernel,
    offsets: Kernel,
    emit: Kernel,
    ranges: Kernel,
    /// Without and with appearance.
    raster: [Kernel; 2],
}

impl Kernels {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let variants = |source, entry| {
            let module = module(device, entry, source);
            [0.0, 1.0].map(|value| {
                Kernel::specialized(device, &module, entry, &[("has_appearance", value)])
            })
        };
        let bin = module(device, "bin", shader::BIN);
        Self {
            preprocess: variants(shader::PREPROCESS, "preprocess"),
            sort: RadixSort::new(device),
            count: Kernel::new(device, &bin, "count"),
            offsets: Kernel::new(device, &bin, "offsets"),
            emit: Kernel::new(device, &bin, "emit"),
            ranges: Kernel::new(device, &bin, "ranges"),
            raster: variants(shader::RASTER, "raster"),
        }
    }
}

/// What comes from outside; a plan is good as long as it is the same.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Inputs {
    view: wgpu::Buffer,
    splats: wgpu::Buffer,
    appearance: Option<wgpu::Buffer>,
    image: wgpu::TextureView,
    size: (u32, u32),
}

impl Inputs {
    pub(super) fn new(view: &wgpu::Buffer, scene: &GpuScene, image: &SplatTarget) -> Self {
        Self {
            view: view.clone(),
            splats: scene.splat_buffer().clone(),
            appearance: scene.appearance_buffer().cloned(),
            image: image.view().clone(),
            size: image.size(),
        }
    }
}

/// Everything bound, to be recorded every frame.
#[derive(Debug)]
pub(super) struct Plan {
    inputs: Inputs,
    preprocess: Bound,
    by_depth: SortPlan,
    count: Bound,
    offsets: Bound,
    emit: Bound,
    by_tile: SortPlan,
    ranges: Bound,
    raster: Bound,
}

impl Plan {
    pub(super) fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        kernels: &Kernels,
        inputs: Inputs,
        counts: &wgpu::Buffer,
        splats: &SplatBuffers,
        entries: &EntryBuffers,
    ) -> Self {
        let grid = tile_grid(inputs.size);
        let by_depth = kernels.sort.plan(
            device,
            queue,
            SortBuffers { keys: splats.keys.each_ref(), values: splats.order.each_ref(), counts },
            DEPTH_BITS,
            Keys::Indexed { source: slot::N_SPLATS, sink: slot::N_VISIBLE },
        );
        let by_tile = kernels.sort.plan(
            device,
            queue,
            SortBuffers {
                keys: entries.tiles.each_ref(),
                values: entries.splats.each_ref(),
                counts,
            },
            bits_of(grid.0 * grid.1),
            Keys::Valued { source: slot::N_ENTRIES },
        );
        let order = &splats.order[by_depth.result()];
        let sorted = by_tile.result();
        let starts = starts(device, grid);
        let variant = usize::from(inputs.appearance.is_some());
        let appearance = inputs.appearance.as_ref().unwrap_or(&splats.no_appearance);
        let bind = |kernel: &Kernel, buffers: &[(u32, &wgpu::Buffer)]| {
            let resources: Vec<_> = buffers
                .iter()
                .map(|(binding, buffer)| (*binding, buffer.as_entire_binding()))
                .collect();
            kernel.bind(device, &resources)
        };
        Self {
            preprocess: bind(
                &kernels.preprocess[variant],
                &[
                    (0, &inputs.view),
                    (1, counts),
                    (2, &inputs.splats),
                    (3, &splats.keys[0]),
                    (4, &splats.records),
                    (5, &splats.footprints),
                    (6, appearance),
                    (7, &splats.gradients),
                ],
            ),
            count: bind(
                &kernels.count,
                &[(1, counts), (2, order), (3, &splats.footprints), (4, &splats.blocks)],
            ),
            offsets: bind(
                &kernels.offsets,
                &[(1, counts), (4, &splats.blocks), (5, &entries.tiles[0])],
            ),
            emit: bind(
                &kernels.emit,
                &[
                    (0, &inputs.view),
                    (1, counts),
                    (2, order),
                    (3, &splats.footprints),
                    (4, &splats.blocks),
                    (5, &entries.tiles[0]),
                    (6, &entries.splats[0]),
                ],
            ),
            ranges: bind(
                &kernels.ranges,
                &[(1, counts), (7, &entries.tiles[sorted]), (8, &starts)],
            ),
            raster: kernels.raster[variant].bind(
                device,
                &[
                    (0, inputs.view.as_entire_binding()),
                    (1, starts.as_entire_binding()),
                    (2, entries.splats[sorted].as_entire_binding()),
                    (3, splats.records.as_entire_binding()),
                    (4, wgpu::BindingResource::TextureView(&inputs.image)),
                    (5, splats.gradients.as_entire_binding()),
                ],
            ),
            by_depth,
            by_tile,
            inputs,
        }
    }

    pub(super) fn inputs(&self) -> &Inputs {
        &self.inputs
    }

    /// Records one stage of an image of `n_splats` splats and `tiles` columns and rows of tiles.
    pub(super) fn record(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        stage: Stage,
        n_splats: usize,
        tiles: (u32, u32),
    ) {
        let by_splat = Grid::lanes(n_splats);
        match stage {
            Stage::Preprocess => self.preprocess.dispatch(pass, by_splat),
            Stage::Sort => {
                self.by_depth.record(pass);
                self.count.dispatch(pass, by_splat);
                self.offsets.dispatch(pass, Grid::row(1));
                self.emit.dispatch(pass, by_splat);
                self.by_tile.record(pass);
                self.ranges.dispatch(pass, Grid::row(RANGE_GROUPS));
            }
            Stage::Draw => {
                self.raster.dispatch(pass, Grid { columns: tiles.0, rows: tiles.1 });
            }
        }
    }
}

/// Bits that the numbers below `n` have.
fn bits_of(n: u32) -> u32 {
    u32::BITS - n.saturating_sub(1).leading_zeros()
}

#[cfg(test)]
mod tests {
    use super::bits_of;

    #[test]
    fn bits_hold_every_tile() {
        for (n, bits) in [(0, 0), (1, 0), (2, 1), (3, 2), (256, 8), (257, 9), (3600, 12)] {
            assert_eq!(bits_of(n), bits, "{n} tiles");
        }
    }
}
