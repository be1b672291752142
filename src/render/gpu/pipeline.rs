//! Helpers for pipelines: creation, binding, dispatch.

use super::constants::GROUP;

/// Compute pipeline whose binding layout is derived from its shader.
#[derive(Debug)]
pub(super) struct ComputeKernel(wgpu::ComputePipeline);

/// Kernel with bound buffers, to be dispatched repeatedly.
#[derive(Clone, Debug)]
pub(super) struct BoundKernel {
    pipeline: wgpu::ComputePipeline,
    bindings: wgpu::BindGroup,
}

/// Two-dimensional grid of workgroups; a single dimension is limited to 65,535 workgroups.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Grid {
    pub(super) columns: u32,
    pub(super) rows: u32,
}

impl ComputeKernel {
    pub(super) fn new(device: &wgpu::Device, module: &wgpu::ShaderModule, entry: &str) -> Self {
        Self::specialized(device, module, entry, &[])
    }

    /// Creates a pipeline with values for the shader's override constants.
    pub(super) fn specialized(
        device: &wgpu::Device,
        module: &wgpu::ShaderModule,
        entry: &str,
        constants: &[(&str, f64)],
    ) -> Self {
        Self(device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: None,
            module,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions {
                // Every kernel writes its workgroup memory before reading it. Some drivers would let
                // one lane clear all of it in every workgroup.
                zero_initialize_workgroup_memory: false,
                constants,
            },
            cache: None,
        }))
    }

    /// Binds whole buffers to the kernel, by binding number.
    pub(super) fn bind_buffers(
        &self,
        device: &wgpu::Device,
        buffers: &[(u32, &wgpu::Buffer)],
    ) -> BoundKernel {
        let resources: Vec<_> = buffers
            .iter()
            .map(|(binding, buffer)| (*binding, buffer.as_entire_binding()))
            .collect();
        self.bind(device, &resources)
    }

    /// Binds whole buffers and textures to the kernel, by binding number.
    pub(super) fn bind(
        &self,
        device: &wgpu::Device,
        resources: &[(u32, wgpu::BindingResource<'_>)],
    ) -> BoundKernel {
        let bindings = bind_group(device, &self.0.get_bind_group_layout(0), resources);
        BoundKernel { pipeline: self.0.clone(), bindings }
    }
}

impl BoundKernel {
    pub(super) fn dispatch(&self, pass: &mut wgpu::ComputePass<'_>, grid: Grid) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bindings, &[]);
        pass.dispatch_workgroups(grid.columns, grid.rows, 1);
    }
}

impl Grid {
    /// Returns a grid with one row of `columns` workgroups, at most 65,535.
    pub(super) fn row(columns: u32) -> Self {
        Self { columns, rows: 1 }
    }

    /// Returns a grid of workgroups with at least one lane per item.
    pub(super) fn lanes(n: usize) -> Self {
        Self::groups(n.div_ceil(GROUP as usize))
    }

    /// Returns a grid of at least `n_groups` workgroups.
    pub(super) fn groups(n_groups: usize) -> Self {
        // Each dimension of a dispatch is limited to 65,535 groups.
        let columns = n_groups.clamp(1, 65_535);
        Self { columns: columns as u32, rows: n_groups.div_ceil(columns).max(1) as u32 }
    }
}

pub(super) fn bind_group(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    resources: &[(u32, wgpu::BindingResource<'_>)],
) -> wgpu::BindGroup {
    let entries: Vec<_> = resources
        .iter()
        .map(|(binding, resource)| wgpu::BindGroupEntry {
            binding: *binding,
            resource: resource.clone(),
        })
        .collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}

/// Creates a pipeline that draws triangles into one colour target without depth. `entries` are the entry
/// points of the vertex and the fragment shader.
pub(super) fn draw_pipeline(
    device: &wgpu::Device,
    label: &str,
    module: &wgpu::ShaderModule,
    [vertex, fragment]: [&str; 2],
    buffers: &[Option<wgpu::VertexBufferLayout<'_>>],
    target: wgpu::ColorTargetState,
) -> wgpu::RenderPipeline {
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(label),
        // Derived from the shader, which declares each binding once.
        layout: None,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: Default::default(),
            buffers,
        },
        primitive: Default::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(fragment),
            compilation_options: Default::default(),
            targets: &[Some(target)],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Creates a buffer that only kernels read and write.
pub(super) fn storage(device: &wgpu::Device, label: &str, bytes: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes,
        usage: wgpu::BufferUsages::STORAGE,
        mapped_at_creation: false,
    })
}

#[cfg(test)]
mod tests {
    use super::Grid;

    #[test]
    fn grids_cover_everything_within_the_limit() {
        for n in [0, 1, 255, 256, 257, 65_535 * 256, 65_535 * 256 + 1, 40_000_000] {
            let grid = Grid::lanes(n);
            assert!(grid.columns <= 65_535 && grid.rows >= 1);
            let lanes = 256 * grid.columns as usize * grid.rows as usize;
            assert!(lanes >= n && lanes < n + 256 * (grid.columns as usize + 1), "{n}");
        }
    }
}
