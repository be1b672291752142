//! Offscreen frames on a graphics adapter.

use super::painter::{FramePath, FrameStageMs, TimedPaintError, TimedPainter, ms_since};
use crate::math::camera::Camera;
use crate::model::splat::splats::Splat;
use crate::render::RenderOptions;
use crate::render::gpu::GpuTimes;
use crate::render::gpu::adapters::AdapterChoice;
use crate::render::gpu::headless::{HeadlessError, HeadlessGpu};
use crate::render::gpu::renderer::SplatRenderer;
use crate::render::gpu::scene::GpuScene;
use std::time::Instant;

/// Number of warm-up frames before the first timed one. During these frames, clock rates rise and tile
/// lists grow to the size that the scene needs.
const WARM_UP: usize = 8;

pub struct TimedGpu {
    gpu: HeadlessGpu,
    /// One renderer per `Renderer` variant, because a shared renderer would mix their timestamps.
    methods: [TimedMethod; 2],
    scene: GpuScene,
}

struct TimedMethod {
    renderer: SplatRenderer,
    is_warm: bool,
}

impl TimedGpu {
    pub fn new(choice: &AdapterChoice) -> Result<Self, HeadlessError> {
        let gpu = HeadlessGpu::new(choice)?;
        let (device, queue) = (&gpu.device, &gpu.queue);
        let method = || -> Result<TimedMethod, HeadlessError> {
            Ok(TimedMethod { renderer: SplatRenderer::new(device, queue)?, is_warm: false })
        };
        // Empty until `load`.
        Ok(Self { methods: [method()?, method()?], scene: GpuScene::new(device, queue, &[])?, gpu })
    }

    /// Draws a frame, waits for it, and returns its time in milliseconds.
    fn draw(&mut self, camera: &Camera, options: &RenderOptions) -> Result<f64, TimedPaintError> {
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        let method = &mut self.methods[options.method.renderer() as usize];
        let frames = if method.is_warm { 1 } else { 1 + WARM_UP };
        let mut total = 0.0;
        for _ in 0..frames {
            let started = Instant::now();
            let mut encoder = device.create_command_encoder(&Default::default());
            method.renderer.render(device, queue, &mut encoder, &self.scene, camera, options)?;
            queue.submit([encoder.finish()]);
            self.gpu.wait()?;
            total = ms_since(started);
        }
        method.is_warm = true;
        // A frame whose tile lists overflowed is incomplete, so its time is not that of a frame.
        match method.renderer.shortage() {
            Some(shortage) => Err(shortage.clone().into()),
            None => Ok(total),
        }
    }
}

impl TimedPainter for TimedGpu {
    fn path(&self) -> FramePath {
        FramePath::Gpu
    }

    fn adapter(&self) -> Option<String> {
        Some(self.gpu.caps.to_string())
    }

    fn load(&mut self, splats: &[Splat]) -> Result<(), TimedPaintError> {
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        // Free the old scene first: two scenes may not fit in memory.
        self.scene = GpuScene::new(device, queue, &[])?;
        self.scene = GpuScene::new(device, queue, splats)?;
        // Tile lists grow again for every scene.
        self.methods.iter_mut().for_each(|method| method.is_warm = false);
        // Wait for the upload, which must not count towards the first frame.
        Ok(self.gpu.wait()?)
    }

    /// Draws and times a frame. Stage times are GPU timestamps of an earlier frame, one or two frames
    /// old.
    fn frame(
        &mut self,
        _: &[Splat],
        camera: &Camera,
        options: &RenderOptions,
    ) -> Result<FrameStageMs, TimedPaintError> {
        let total = self.draw(camera, options)?;
        let method = &self.methods[options.method.renderer() as usize];
        let stages =
            method.renderer.gpu_times().map_or([None; 4], |GpuTimes { preprocess, sort, draw }| {
                [Some(preprocess), Some(sort), None, Some(draw)]
            });
        Ok(FrameStageMs { total, stages })
    }
}
