//! The projected renderer (`rendering.md` (b)) as one pass of instanced quads.

use super::GpuError;
use super::layout::{View, shader};
use super::scene::GpuScene;
use super::target::{self, SplatTarget};
use super::timer::PassTimer;
use crate::math::camera::Camera;
use crate::render::{Method, RenderOptions};
use std::time::Duration;

/// What a picture depends on besides splats and camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderSettings {
    /// Splats whose centre has `z ≤ near` are not drawn; world units, at least 0.
    pub near: f32,
    /// Largest support of a splat in its standard deviations: 3 is faster while the camera moves;
    /// infinity keeps everything that passes the alpha cut.
    pub extent_cap: f32,
}

/// Draws a [`GpuScene`] into an image of its own.
#[derive(Debug)]
pub struct ProjectedRenderer {
    pipeline: wgpu::RenderPipeline,
    view: wgpu::Buffer,
    target: SplatTarget,
    timer: Option<PassTimer>,
}

impl ProjectedRenderer {
    /// Builds the pipeline; the image starts empty.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Self, GpuError> {
        Ok(Self {
            pipeline: pipeline(device),
            view: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("view"),
                size: size_of::<View>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            target: SplatTarget::new(device, 0, 0)?,
            timer: PassTimer::new(device, queue),
        })
    }

    /// Records the splat pass into `encoder`, the image as large as the camera's. One render per
    /// submission: the camera reaches the GPU with the submission, not with the encoder.
    pub fn render(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        camera: &Camera,
        settings: RenderSettings,
    ) -> Result<(), GpuError> {
        let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
        if self.target.size() != (width, height) {
            self.target = SplatTarget::new(device, width, height)?;
        }
        let options = RenderOptions {
            near: f64::from(settings.near),
            ..RenderOptions::evaluation(Method::PROJECTED, [0.0; 3])
        };
        let view = View::new(camera, &options, settings.extent_cap)?;
        queue.write_buffer(&self.view, 0, bytemuck::bytes_of(&view));
        let slot = self.timer.as_mut().and_then(PassTimer::begin);
        self.record(device, encoder, scene, slot);
        if let (Some(timer), Some(slot)) = (&mut self.timer, slot) {
            timer.end(encoder, slot);
        }
        Ok(())
    }

    /// The image of the last render.
    pub fn target(&self) -> &SplatTarget {
        &self.target
    }

    /// Duration of the splat pass on the GPU, measured a few frames ago; `None` where the adapter
    /// cannot tell or no measurement is back yet.
    pub fn gpu_time(&self) -> Option<Duration> {
        self.timer.as_ref().and_then(PassTimer::latest)
    }

    fn record(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        timer_slot: Option<usize>,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("splats"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: self.target.view(),
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            timestamp_writes: timer_slot
                .and_then(|slot| self.timer.as_ref().map(|timer| timer.writes(slot))),
            ..Default::default()
        });
        if scene.n_drawn() == 0 || self.target.is_empty() {
            return;
        }
        let bindings = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("splats"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: self.view.as_entire_binding() },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: scene.splat_buffer().as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: scene.order_buffer().as_entire_binding(),
                },
            ],
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        pass.draw(0..4, 0..scene.n_drawn() as u32);
    }
}

/// Back to front, premultiplied: source over destination.
const OVER: wgpu::BlendComponent = wgpu::BlendComponent {
    src_factor: wgpu::BlendFactor::One,
    dst_factor: wgpu::BlendFactor::OneMinusSrcAlpha,
    operation: wgpu::BlendOperation::Add,
};

fn pipeline(device: &wgpu::Device) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("projected"),
        source: wgpu::ShaderSource::Wgsl(shader::PROJECTED.into()),
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("projected"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState {
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            ..Default::default()
        },
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format: target::FORMAT,
                blend: Some(wgpu::BlendState { color: OVER, alpha: OVER }),
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}
