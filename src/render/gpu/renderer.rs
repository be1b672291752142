//! The renderer that the window and the benches see: a scene and a camera to an image.

use super::GpuError;
use super::layout::View;
use super::quads::QuadPath;
use super::scene::GpuScene;
use super::target::SplatTarget;
use super::timer::PassTimer;
use crate::math::camera::Camera;
use crate::render::RenderOptions;

/// Milliseconds on the GPU of the stages of one image; `None` where a path has no such stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpuTimes {
    /// Splats to records.
    pub preprocess: Option<f64>,
    /// Records into their order.
    pub sort: Option<f64>,
    /// Records to pixels; with quads, splats to pixels.
    pub draw: f64,
}

/// Draws scenes into an image of its own; several renderers may share a scene.
#[derive(Debug)]
pub struct SplatRenderer {
    quads: QuadPath,
    view: wgpu::Buffer,
    target: SplatTarget,
    timer: Option<PassTimer>,
    extent_cap: f32,
}

impl SplatRenderer {
    /// Builds the pipelines; the image starts empty.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Self, GpuError> {
        Ok(Self {
            quads: QuadPath::new(device),
            view: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("view"),
                size: size_of::<View>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            target: SplatTarget::new(device, 0, 0)?,
            timer: PassTimer::new(device, queue),
            extent_cap: f32::INFINITY,
        })
    }

    /// Largest support of a splat in its standard deviations: 3 is faster while the camera moves,
    /// infinity (what a renderer starts with) keeps everything that passes the alpha cut.
    pub fn set_extent_cap(&mut self, extent_cap: f32) {
        self.extent_cap = extent_cap;
    }

    /// Records the drawing of a scene into `encoder`, the image as large as the camera's. The scene's
    /// order must be that of the same camera and options ([`super::sort::back_to_front`]); the
    /// background belongs to [`super::composite::Compositor`]. One render per submission: the camera
    /// reaches the GPU with the submission, not with the encoder.
    pub fn render(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Result<(), GpuError> {
        let view = View::new(camera, options, self.extent_cap)?;
        let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
        if self.target.size() != (width, height) {
            self.target = SplatTarget::new(device, width, height)?;
        }
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

    /// Measured a few frames ago; `None` where the adapter cannot tell or no measurement is back yet.
    pub fn gpu_times(&self) -> Option<GpuTimes> {
        let draw = self.timer.as_ref().and_then(PassTimer::latest)?;
        Some(GpuTimes { preprocess: None, sort: None, draw: draw.as_secs_f64() * 1e3 })
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
        if scene.n_drawn() > 0 && !self.target.is_empty() {
            self.quads.draw(device, &mut pass, &self.view, scene);
        }
    }
}
