//! Draws splats as instanced quads, back to front, for both renderers and both lenses.

use super::constants::module;
use super::draw_pipeline::DrawPipeline;
use super::layout::shader;
use super::renderer;
use super::scene::{ComparedImage, GpuScene};

/// Pipelines for drawing a scene into one attachment of the splat image's format.
#[derive(Debug)]
pub(super) struct QuadPath {
    /// For scenes without appearance.
    plain: wgpu::RenderPipeline,
    shaded: wgpu::RenderPipeline,
}

impl QuadPath {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let module = module(device, "quads", shader::QUADS);
        Self {
            plain: pipeline(device, &module, ["vertex", "fragment"]),
            shaded: pipeline(device, &module, ["vertex_shaded", "fragment_shaded"]),
        }
    }

    /// Draws the splats of the scene's order through the camera in `view`. Order and viewport must not be
    /// empty.
    pub(super) fn draw(
        &self,
        device: &wgpu::Device,
        pass: &mut wgpu::RenderPass<'_>,
        view: &wgpu::Buffer,
        scene: &GpuScene,
        of: ComparedImage,
    ) {
        let buffers = [view, scene.splat_buffer(), scene.order_buffer(of)];
        let entries: Vec<wgpu::BindGroupEntry<'_>> = buffers
            .into_iter()
            .chain(scene.appearance_buffer())
            .zip(0..)
            .map(|(buffer, binding)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        // Scenes without appearance pass fewer varyings from vertex to fragment.
        let pipeline = if scene.appearance_buffer().is_some() { &self.shaded } else { &self.plain };
        let bindings = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("splats"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        pass.draw(0..4, 0..scene.n_drawn(of) as u32);
    }
}

/// Premultiplied source over destination.
const OVER: wgpu::BlendComponent = wgpu::BlendComponent {
    src_factor: wgpu::BlendFactor::One,
    dst_factor: wgpu::BlendFactor::OneMinusSrcAlpha,
    operation: wgpu::BlendOperation::Add,
};

fn pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    entries: [&str; 2],
) -> wgpu::RenderPipeline {
    let target = wgpu::ColorTargetState {
        format: renderer::FORMAT,
        blend: Some(wgpu::BlendState { color: OVER, alpha: OVER }),
        write_mask: wgpu::ColorWrites::ALL,
    };
    let topology = wgpu::PrimitiveTopology::TriangleStrip;
    DrawPipeline { label: "quads", module, entries, buffers: &[], topology, target }.create(device)
}
