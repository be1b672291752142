//! Kernels of the comparison and the recording of its commands.

use super::memory::{ComparisonSizes, Memory, Part, UPLOADED};
use super::shader;
use super::upload::offset;
use crate::render::gpu::constants::{N_QUARTERS, module};
use crate::render::gpu::kernel::{BoundKernel, ComputeKernel, Grid};

/// Pipelines. Walks are specialised by the number of chosen pixels per tile.
#[derive(Debug)]
pub(super) struct Kernels {
    draw: wgpu::ShaderModule,
    walk: wgpu::ShaderModule,
    add: ComputeKernel,
    /// Created on first use.
    walks: Vec<(u64, [ComputeKernel; 2])>,
}

/// Bound kernels of one comparison.
pub(super) struct Commands {
    draw: BoundKernel,
    walk: BoundKernel,
    add: BoundKernel,
    tiles: Grid,
    load: ComparisonSizes,
}

impl Kernels {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let add = module(device, "add", shader::ADD);
        Self {
            draw: module(device, "draw", shader::DRAW),
            walk: module(device, "walk", shader::WALK),
            add: ComputeKernel::new(device, &add, "add"),
            walks: Vec::new(),
        }
    }

    /// Binds a comparison to a grid of tile columns and rows, at least one of each.
    pub(super) fn bind(
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
    pub(super) fn record(&self, encoder: &mut wgpu::CommandEncoder, memory: &Memory) {
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
