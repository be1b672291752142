//! Sparse uploads: a compact list of (record, index), scattered by a compute pass.

use super::constants::{SCATTER_GROUP, module};
use super::layout::{SparseAppearance, SparseSplat, shader};
use std::marker::PhantomData;

/// Record with its index.
pub(super) trait Sparse: bytemuck::NoUninit {
    /// Entry point of `scatter.wgsl`.
    const ENTRY_POINT: &'static str;
}

impl Sparse for SparseSplat {
    const ENTRY_POINT: &'static str = "scatter_splats";
}

impl Sparse for SparseAppearance {
    const ENTRY_POINT: &'static str = "scatter_appearances";
}

/// Compute pass that scatters changed records into their buffer.
#[derive(Debug)]
pub(super) struct Scatter<T> {
    pipeline: wgpu::ComputePipeline,
    records: PhantomData<T>,
}

impl<T: Sparse> Scatter<T> {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let module = module(device, "scatter", shader::SCATTER);
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(T::ENTRY_POINT),
            layout: None,
            module: &module,
            entry_point: Some(T::ENTRY_POINT),
            compilation_options: Default::default(),
            cache: None,
        });
        Self { pipeline, records: PhantomData }
    }

    /// Writes `changed` into `target`, which must contain every index. Returns the number of bytes
    /// uploaded.
    pub(super) fn run(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        target: &wgpu::Buffer,
        changed: &[T],
    ) -> u64 {
        // An empty buffer cannot be bound.
        if changed.is_empty() {
            return 0;
        }
        let bytes: &[u8] = bytemuck::cast_slice(changed);
        let list = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("changed records"),
            size: bytes.len() as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        queue.write_buffer(&list, 0, bytes);
        let bindings = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("scatter"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: list.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: target.as_entire_binding() },
            ],
        });
        // Each dimension of a dispatch is limited to 65,535 groups, so large lists need a second one.
        let widest = device.limits().max_compute_workgroups_per_dimension;
        let (columns, rows) = grid(changed.len().div_ceil(SCATTER_GROUP as usize), widest);
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        pass.dispatch_workgroups(columns, rows, 1);
        drop(pass);
        queue.submit([encoder.finish()]);
        bytes.len() as u64
    }
}

/// Columns and rows, each at most `widest`, of a grid of at least `n_groups` workgroups.
fn grid(n_groups: usize, widest: u32) -> (u32, u32) {
    let columns = n_groups.clamp(1, widest as usize);
    (columns as u32, n_groups.div_ceil(columns) as u32)
}

#[cfg(test)]
mod tests {
    use super::grid;

    #[test]
    fn grids_cover_every_group_within_the_limit() {
        for n_groups in [1, 2, 65_535, 65_536, 131_070, 131_071, 4_000_000] {
            let (columns, rows) = grid(n_groups, 65_535);
            assert!(columns <= 65_535 && rows <= 65_535);
            let covered = columns as usize * rows as usize;
            assert!((n_groups..n_groups + columns as usize).contains(&covered), "{n_groups}");
        }
    }
}
