//! Frames on a graphics adapter, without a window.

use super::painter::{FrameMs, PaintError, Painter, Path, ms_since};
use crate::math::camera::Camera;
use crate::model::splats::Splat;
use crate::render::gpu::headless::{AdapterChoice, HeadlessError, HeadlessGpu};
use crate::render::gpu::projected::{ProjectedRenderer, RenderSettings};
use crate::render::gpu::scene::GpuScene;
use crate::render::gpu::sort::{SortScratch, back_to_front};
use crate::render::{RenderOptions, Renderer};
use std::time::Instant;

/// The quads of one adapter.
pub struct GpuPainter {
    gpu: HeadlessGpu,
    renderer: ProjectedRenderer,
    scene: GpuScene,
    scratch: SortScratch,
}

impl GpuPainter {
    /// On the adapter chosen.
    pub fn new(choice: AdapterChoice) -> Result<Self, HeadlessError> {
        let gpu = HeadlessGpu::new(choice)?;
        Ok(Self {
            renderer: ProjectedRenderer::new(&gpu.device, &gpu.queue)?,
            scene: GpuScene::new(&gpu.device, &gpu.queue, &[])?,
            scratch: SortScratch::default(),
            gpu,
        })
    }
}

impl Painter for GpuPainter {
    fn path(&self) -> Path {
        Path::Quads
    }

    fn adapter(&self) -> Option<String> {
        Some(self.gpu.caps.to_string())
    }

    fn draws(&self, renderer: Renderer) -> bool {
        renderer == Renderer::Projected
    }

    fn load(&mut self, splats: &[Splat]) -> Result<(), PaintError> {
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        // Two scenes need not fit at once.
        self.scene = GpuScene::new(device, queue, &[])?;
        self.scene = GpuScene::new(device, queue, splats)?;
        Ok(self.gpu.wait()?)
    }

    /// The order is found beside the frame and is no part of its total; the time of drawing is the
    /// GPU's own, of the frame before.
    fn frame(
        &mut self,
        splats: &[Splat],
        camera: &Camera,
        options: &RenderOptions,
    ) -> Result<FrameMs, PaintError> {
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        let settings = RenderSettings { near: options.near as f32, extent_cap: f32::INFINITY };
        let started = Instant::now();
        let order = back_to_front(splats, camera, settings.near, &mut self.scratch);
        let sort = ms_since(started);
        let started = Instant::now();
        self.scene.set_order(queue, order)?;
        let mut encoder = device.create_command_encoder(&Default::default());
        self.renderer.render(device, queue, &mut encoder, &self.scene, camera, settings)?;
        queue.submit([encoder.finish()]);
        self.gpu.wait()?;
        let total = ms_since(started);
        let draw = self.renderer.gpu_time().map(|time| time.as_secs_f64() * 1e3);
        Ok(FrameMs { total, stages: [None, Some(sort), None, draw] })
    }
}
