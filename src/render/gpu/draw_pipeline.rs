//! Render pipelines with one colour target and no depth.

/// Varying parameters of such a pipeline.
pub(super) struct DrawPipeline<'a> {
    pub label: &'a str,
    pub module: &'a wgpu::ShaderModule,
    /// Entry points of the vertex and the fragment shader.
    pub entries: [&'a str; 2],
    pub buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    pub topology: wgpu::PrimitiveTopology,
    pub target: wgpu::ColorTargetState,
}

impl DrawPipeline<'_> {
    pub(super) fn create(&self, device: &wgpu::Device) -> wgpu::RenderPipeline {
        let Self { label, module, entries: [vertex, fragment], buffers, topology, target } = self;
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
            primitive: wgpu::PrimitiveState { topology: *topology, ..Default::default() },
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module,
                entry_point: Some(fragment),
                compilation_options: Default::default(),
                targets: &[Some(target.clone())],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}
