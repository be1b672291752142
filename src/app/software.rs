//! Painting without a real GPU: the CPU renderer on its own thread, its picture as a texture
//! (`rendering.md`, Software adapters).

use super::drawing::{DrawSample, DrawStage};
use super::splat_updates::SplatChange;
use super::view_thread::{Announce, ViewThread};
use super::viewer::photo::{ComparedPicture, Partner, PictureRequest};
use super::worker::Waker;
use crate::math::image::{RgbImage, unit_to_byte};
use crate::model::splat::appearance::SplatSet;
use crate::render::compare::combine;
use crate::render::cpu::CpuRenderer;
use eframe::egui::{Color32, ColorImage, Pos2, Rect, TextureHandle, TextureOptions, Ui};
use std::time::{Duration, Instant};

/// Minimum time between two pictures that follow training.
pub const FOLLOW_INTERVAL: Duration = Duration::from_millis(500);

/// Minimum time between two passes of the window while the camera moves during training: 200 ms of
/// one core, shared by all cores.
///
/// This is the whole rule that protects training, together with [`Effort::BesideTraining`]. A pass
/// takes about 20 ms of a core and a picture twice that, so drawing takes a fifth of the cores.
pub fn pass_interval() -> Duration {
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get() as u32);
    Duration::from_millis(200) / cores
}

/// CPU effort of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// One thread at half resolution. Each picture is followed by a rest of twice its time, and pictures
    /// that only follow training are at least [`FOLLOW_INTERVAL`] apart.
    BesideTraining,
    /// While the camera moves: all threads at half resolution.
    Moving,
    /// All threads at full resolution.
    Full,
}

impl Effort {
    /// Size of the picture relative to the viewport, per side.
    fn scale(self) -> f64 {
        if self == Self::Full { 1.0 } else { 0.5 }
    }
}

struct Picture {
    image: ColorImage,
    /// Number of splats at that time, without empty slots.
    n_drawn: usize,
    took: Duration,
}

/// Painter of the viewport on machines without a real GPU.
pub struct SoftwarePainter {
    thread: ViewThread<(PictureRequest, Effort), Picture>,
    texture: Option<TextureHandle>,
    asked: Option<(PictureRequest, Effort)>,
    asked_at: Instant,
    /// Time that the latest picture took.
    took: Duration,
    is_stale: bool,
    n_drawn: usize,
}

impl SoftwarePainter {
    pub fn new(waker: Waker) -> std::io::Result<Self> {
        let mut renderer = CpuRenderer::new();
        // In rayon's global pool a picture would use every core, including those of training.
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let alone = alone.map_err(std::io::Error::other)?;
        let draw = move |splats: &SplatSet, (request, effort): (PictureRequest, Effort)| {
            let started = Instant::now();
            let mut render = || picture(&mut renderer, splats, &request, effort.scale());
            let picture =
                if effort == Effort::BesideTraining { alone.install(render) } else { render() };
            let took = started.elapsed();
            let n_drawn = splats.iter().filter(|s| s.opacity > 0.0).count();
            Picture { image: texels(&picture), n_drawn, took }
        };
        Ok(Self {
            thread: ViewThread::start("drawing", waker, draw)?,
            texture: None,
            asked: None,
            asked_at: Instant::now(),
            took: Duration::ZERO,
            is_stale: true,
            n_drawn: 0,
        })
    }

    pub fn change(&mut self, change: SplatChange) {
        self.thread.change(change);
        self.is_stale = true;
    }

    /// Paints the newest picture over the viewport and requests the next one if needed; until then the
    /// last picture remains. Returns the timing of a new picture.
    pub fn paint(
        &mut self,
        ui: &Ui,
        rect: Rect,
        request: &PictureRequest,
        effort: Effort,
    ) -> Option<DrawSample> {
        let drawn = self.thread.take().map(|Picture { image, n_drawn, took }| {
            (self.n_drawn, self.took) = (n_drawn, took);
            // Linear, because pictures made during training or motion are smaller.
            match &mut self.texture {
                Some(texture) => texture.set(image, TextureOptions::LINEAR),
                None => {
                    let texture = ui.ctx().load_texture("splats", image, TextureOptions::LINEAR);
                    self.texture = Some(texture);
                }
            }
            let ms = 1e3 * took.as_secs_f64();
            // Counted by the performance test of orbiting (`tests/app/window.rs`).
            tracing::debug!("picture: {ms:.1} ms");
            let mut sample = DrawSample::new(0);
            sample.add(DrawStage::Picture, Some(ms));
            sample
        });
        self.request_picture(ui, request, effort);
        // A picture without splats is not painted: it would only fill the cleared window again, which
        // is expensive on a software adapter. A comparison may still show a photograph.
        if let Some(texture) = &self.texture
            && (self.n_drawn > 0 || request.second.is_some())
        {
            let uv = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            ui.painter().image(texture.id(), rect, uv, Color32::WHITE);
        }
        drawn
    }

    pub fn n_drawn(&self) -> usize {
        self.n_drawn
    }

    fn request_picture(&mut self, ui: &Ui, request: &PictureRequest, effort: Effort) {
        let moved = self.asked.as_ref().is_none_or(|(asked, _)| asked != request);
        let refine = self.asked.as_ref().is_none_or(|(_, asked)| asked.scale() != effort.scale());
        if !(moved || refine || self.is_stale) || self.thread.is_busy() {
            return; // a finished picture wakes the window, which tries again
        }
        let mut announce = Announce::Wake;
        if effort == Effort::BesideTraining {
            let mut apart = 3 * self.took;
            // A moved camera and the first picture do not wait for training.
            if !moved && self.n_drawn > 0 {
                apart = apart.max(FOLLOW_INTERVAL);
                // The next snapshot shows the picture: painting the window with a software adapter costs
                // more than the picture, so it happens once per snapshot.
                announce = Announce::Quietly;
            }
            let pause = apart.saturating_sub(self.asked_at.elapsed());
            if !pause.is_zero() {
                ui.ctx().request_repaint_after(pause);
                return;
            }
        }
        self.thread.send_request((request.clone(), effort), announce);
        self.asked = Some((request.clone(), effort));
        self.asked_at = Instant::now();
        self.is_stale = false;
    }
}

/// Renders one picture, or two combined.
fn picture(
    renderer: &mut CpuRenderer,
    splats: &SplatSet,
    request: &PictureRequest,
    scale: f64,
) -> RgbImage {
    let mut camera = request.camera;
    if scale != 1.0 {
        camera.intrinsics = camera.intrinsics.scaled(scale);
    }
    let mut first = renderer.render(splats, &camera, &request.options).color;
    if let Some(ComparedPicture { partner, area, how }) = &request.second {
        let mut render = |splats, options| renderer.render(splats, &camera, options).color;
        let other = match partner {
            Partner::Splats(options) => &render(splats, options),
            Partner::Model(model, options) => &render(&model.splats, options),
            Partner::Photo(photo) => &**photo,
        };
        combine(&mut first, other, *area, *how);
    }
    first
}

fn texels(picture: &RgbImage) -> ColorImage {
    let pixels = picture.data.iter().map(|&p| {
        let [r, g, b] = p.map(unit_to_byte);
        Color32::from_rgb(r, g, b)
    });
    ColorImage::new([picture.width, picture.height], pixels.collect())
}
