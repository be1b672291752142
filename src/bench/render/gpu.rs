//! Offscreen frames on a graphics adapter.

use super::painter::{FramePath, FrameStageMs, TimedPaintError, TimedPainter, ms_since};
use crate::math::camera::Camera;
use crate::model::splat::splats::Splat;
use crate::render::gpu::DrawPath;
use crate::render::gpu::adapters::AdapterChoice;
use crate::render::gpu::headless::{HeadlessError, HeadlessGpu};
use crate::render::gpu::renderer::SplatRenderer;
use crate::render::gpu::scene::{ComparedImage, GpuScene};
use crate::render::gpu::sort::{SortScratch, back_to_front};
use crate::render::{RenderOptions, Renderer};
use std::rc::Rc;
use std::time::Instant;

/// Warm-up frames before the first timed one: clocks rise, and tile lists grow to what the scene
/// needs.
const WARM_UP: usize = 8;

/// Timed drawing path of one adapter.
pub struct TimedGpu {
    gpu: Rc<HeadlessGpu>,
    path: DrawPath,
    /// One renderer per method, so that each has its own timestamps.
    projected: TimedMethod,
    exact: TimedMethod,
    scene: GpuScene,
    scratch: SortScratch,
}

struct TimedMethod {
    renderer: SplatRenderer,
    is_warm: bool,
}

impl TimedGpu {
    /// Creates a painter for each path on the chosen adapter.
    pub fn all(choice: &AdapterChoice, paths: &[DrawPath]) -> Result<Vec<Self>, HeadlessError> {
        // Share one device between all paths: some drivers fail when several devices are created
        // and dropped.
        let gpu = Rc::new(HeadlessGpu::new(choice)?);
        paths.iter().map(|&path| Self::new(gpu.clone(), path)).collect()
    }

    fn new(gpu: Rc<HeadlessGpu>, path: DrawPath) -> Result<Self, HeadlessError> {
        let (device, queue) = (&gpu.device, &gpu.queue);
        let method = || -> Result<TimedMethod, HeadlessError> {
            let mut renderer = SplatRenderer::new(device, queue, ComparedImage::First)?;
            renderer.set_path(path);
            Ok(TimedMethod { renderer, is_warm: false })
        };
        Ok(Self {
            path,
            projected: method()?,
            exact: method()?,
            scene: GpuScene::new(device, queue, &[])?,
            scratch: SortScratch::default(),
            gpu,
        })
    }

    /// Draws a frame, waits for it, and returns the milliseconds.
    fn draw(&mut self, camera: &Camera, options: &RenderOptions) -> Result<f64, TimedPaintError> {
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        let method = match options.method.renderer() {
            Renderer::Projected => &mut self.projected,
            Renderer::Exact => &mut self.exact,
        };
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
        match self.path {
            DrawPath::Quads => FramePath::Quads,
            DrawPath::Tiles => FramePath::Tiles,
        }
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
        (self.projected.is_warm, self.exact.is_warm) = (false, false);
        // Wait for the upload, which must not count towards the first frame.
        Ok(self.gpu.wait()?)
    }

    /// Sorts quads on the CPU before the frame; the total excludes that time. Other stages are GPU
    /// timestamps, one or two frames old.
    fn frame(
        &mut self,
        splats: &[Splat],
        camera: &Camera,
        options: &RenderOptions,
    ) -> Result<FrameStageMs, TimedPaintError> {
        let mut order_ms = None;
        if self.path == DrawPath::Quads {
            let started = Instant::now();
            let order = back_to_front(splats, camera, options, &mut self.scratch);
            order_ms = Some(ms_since(started));
            self.scene.set_order(&self.gpu.queue, ComparedImage::First, order)?;
        }
        let total = self.draw(camera, options)?;
        let times = match options.method.renderer() {
            Renderer::Projected => self.projected.renderer.gpu_times(),
            Renderer::Exact => self.exact.renderer.gpu_times(),
        };
        let prepare = times.and_then(|times| times.preprocess);
        let sort = order_ms.or(times.and_then(|times| times.sort));
        Ok(FrameStageMs { total, stages: [prepare, sort, None, times.map(|times| times.draw)] })
    }
}
