//! Frames on a graphics adapter, without a window.

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

/// Frames before the first timed one: clocks rise, and lists grow to what the scene needs.
const WARM_UP: usize = 8;

/// One path of one adapter.
pub struct TimedGpu {
    gpu: Rc<HeadlessGpu>,
    path: DrawPath,
    /// One per method, so that each has its own times.
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
    /// Paths on the adapter chosen.
    pub fn all(choice: &AdapterChoice, paths: &[DrawPath]) -> Result<Vec<Self>, HeadlessError> {
        // Shared by all paths: drivers were seen to break when several devices come and go.
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

    /// Draws and waits; milliseconds of that.
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
        // A frame whose lists did not fit is not whole, and its time no time of a frame.
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
        // Two scenes need not fit at once.
        self.scene = GpuScene::new(device, queue, &[])?;
        self.scene = GpuScene::new(device, queue, splats)?;
        // Lists grow again with every scene.
        (self.projected.is_warm, self.exact.is_warm) = (false, false);
        // The upload must not end in the time of the first frame.
        Ok(self.gpu.wait()?)
    }

    /// The order of quads is found beside the frame and is no part of its total; stages are the
    /// GPU's own times, of a frame or two before.
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
