//! Sorts component means into grid cells on the GPU.

use super::layout::Index;
use super::memory::{Memory, Part, PassSizes};
use super::shader;
use crate::model::paper::mixture_device::GridShape;
use crate::render::gpu::constants::{STRIP_CELLS, module};
use crate::render::gpu::kernel::{BoundKernel, ComputeKernel, Grid};

/// Kernels of a counting sort in execution order, with their bindings.
pub(super) struct IndexKernels([(ComputeKernel, &'static [(u32, Part)]); 5]);

/// The kernels of [`IndexKernels`] with bound buffers.
pub(super) struct BoundIndex([BoundKernel; 5]);

const RENEW: [(u32, Part); 3] = [(0, Part::Index), (1, Part::Moved), (2, Part::Components)];
const COUNT: [(u32, Part); 4] =
    [(0, Part::Index), (2, Part::Components), (3, Part::Starts), (4, Part::Places)];
const ADD: [(u32, Part); 3] = [(0, Part::Index), (3, Part::Starts), (5, Part::Strips)];
const PLACE: [(u32, Part); 6] = [
    (0, Part::Index),
    (2, Part::Components),
    (3, Part::Starts),
    (4, Part::Places),
    (6, Part::Means),
    (7, Part::Appearance),
];

impl IndexKernels {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let shader = module(device, "index over means", shader::INDEX);
        let kernel = |entry| ComputeKernel::new(device, &shader, entry);
        Self([
            (kernel("renew"), &RENEW),
            (kernel("count"), &COUNT),
            (kernel("add"), &ADD),
            (kernel("scan"), &ADD),
            (kernel("place"), &PLACE),
        ])
    }

    /// Binds the buffers of every kernel.
    pub(super) fn bind(&self, device: &wgpu::Device, memory: &Memory) -> BoundIndex {
        BoundIndex(self.0.each_ref().map(|(kernel, parts)| {
            let resource = |&(at, part)| (at, memory.buffer(part).as_entire_binding());
            kernel.bind(device, &parts.iter().map(resource).collect::<Vec<_>>())
        }))
    }
}

impl BoundIndex {
    /// Records the commands that apply the moved means and sort all means.
    pub(super) fn record(
        &self,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        memory: &Memory,
        load: &PassSizes,
        shape: &GridShape,
    ) {
        let settings = Index::new(shape, [load.means, load.moved]);
        queue.write_buffer(memory.buffer(Part::Index), 0, bytemuck::bytes_of(&settings));
        encoder.clear_buffer(memory.buffer(Part::Starts), 0, Some(load.bytes(Part::Starts)));
        let strips = (load.cells + 1).div_ceil(STRIP_CELLS.into()) as u32;
        let [moved, means] = [load.moved, load.means].map(|n| Grid::lanes(n as usize));
        let strips = Grid::row(strips);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("index over means"),
            timestamp_writes: None,
        });
        for (bound, grid) in self.0.iter().zip([moved, means, strips, strips, means]) {
            bound.dispatch(&mut pass, grid);
        }
    }
}
