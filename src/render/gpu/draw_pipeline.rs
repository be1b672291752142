//! Pipelines that draw into one colour target, without depth.

/// What distinguishes them.
pub(super) struct DrawPipeline<'a> {
    pub label: &'a str,
    pub module: &'a wgpu::ShaderModule,
    /// Functions of vertex and fragment.
    pub entries: [&'a str; 2],
    pub buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    pub topology: wgpu::PrimitiveTopology,
    pub target: wgpu::ColorTargetState,
}

impl DrawPipeline<'_> {
    /// The pipeline.
    pub(super) fn made(&self, device: &wgpu::Device) -> wgpu::RenderPipeline {
        let Self { label, module, entries: [vertex, fragment], buffers, topology, target } = self;
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(label),
            // Derived from the shader, where each binding is declared once.
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
