//! Painting without a real GPU: the CPU renderer on its own thread, its picture as a texture
//! (`rendering.md`, Software adapters).

use super::drawing::{DrawSample, DrawStage};
use super::splat_updates::SplatChange;
use super::thread_times;
use super::view_thread::{Announce, ViewThread};
use super::viewer::photo::{Partner, PictureRequest};
use super::worker::Waker;
use crate::math::camera::Camera;
use crate::math::image::{RgbImage, unit_to_byte};
use crate::model::splat::appearance::SplatSet;
use crate::render::compare::combine;
use crate::render::cpu::CpuRenderer;
use eframe::egui::{Color32, ColorImage, TextureHandle, TextureOptions, Ui};
use std::time::{Duration, Instant};

/// CPU effort of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effort {
    /// During training: one thread, whether or not the camera moves.
    Shared {
        /// Size relative to the viewport, per side.
        scale: f64,
        /// Minimum time between two pictures that follow training.
        apart: Duration,
    },
    /// While the camera moves: half resolution.
    Moving,
    /// Otherwise: full resolution.
    Full,
}

impl Effort {
    /// Size of the picture relative to the viewport, per side.
    fn scale(self) -> f64 {
        match self {
            Self::Shared { scale, .. } => scale,
            Self::Moving => 0.5,
            Self::Full => 1.0,
        }
    }

    fn is_shared(self) -> bool {
        matches!(self, Self::Shared { .. })
    }

    /// True if pictures of both efforts have the same resolution.
    fn has_same_scale(self, other: Self) -> bool {
        self.scale() == other.scale()
    }
}

#[derive(Clone, Copy, Debug)]
pub struct SoftwareSample {
    pub sample: DrawSample,
    /// CPU milliseconds and scale of a picture made during training.
    pub beside_training: Option<(f64, f64)>,
}

struct Picture {
    image: ColorImage,
    /// Number of splats at that time, without empty slots.
    n_drawn: usize,
    /// Time to render it, milliseconds.
    ms: f64,
    /// CPU time of the thread that rendered it, milliseconds: all of the work if that thread works
    /// alone. Less than `ms` if training uses the cores.
    worked_ms: f64,
    effort: Effort,
}

/// Painter of the viewport on machines without a real GPU.
pub struct SoftwarePainter {
    thread: ViewThread<(PictureRequest, Effort), Picture>,
    texture: Option<TextureHandle>,
    asked: Option<(PictureRequest, Effort)>,
    asked_at: Instant,
    is_stale: bool,
    n_drawn: usize,
}

impl SoftwarePainter {
    pub fn new(waker: Waker) -> std::io::Result<Self> {
        let mut renderer = CpuRenderer::new();
        // In rayon's global pool a picture would use every core, including those of training.
        let alone = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            // Its CPU time is counted by this name (`thread_times.rs`).
            .thread_name(|_| "drawing".to_owned())
            .build()
            .map_err(std::io::Error::other)?;
        let draw = move |splats: &SplatSet, (request, effort): (PictureRequest, Effort)| {
            let started = Instant::now();
            let mut render = || {
                let before = thread_times::current_thread_time();
                let picture = picture(&mut renderer, splats, &request, effort);
                (
                    picture,
                    thread_times::current_thread_time()
                        .zip(before)
                        .map(|(now, before)| now - before),
                )
            };
            let (picture, worked) =
                if effort.is_shared() { alone.install(render) } else { render() };
            let ms = started.elapsed().as_secs_f64() * 1e3;
            Picture {
                image: texels(&picture),
                n_drawn: splats.iter().filter(|s| s.opacity > 0.0).count(),
                ms,
                worked_ms: worked.map_or(ms, |worked| worked.as_secs_f64() * 1e3),
                effort,
            }
        };
        Ok(Self {
            thread: ViewThread::start("drawing", waker, draw)?,
            texture: None,
            asked: None,
            asked_at: Instant::now(),
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
        rect: eframe::egui::Rect,
        request: &PictureRequest,
        effort: Effort,
    ) -> Option<SoftwareSample> {
        let mut drawn = None;
        if let Some(picture) = self.thread.take() {
            self.n_drawn = picture.n_drawn;
            let mut sample = DrawSample::new(0);
            sample.add(DrawStage::Picture, Some(picture.ms));
            // Counted by the performance test of orbiting (`tests/app/window.rs`).
            let (worked, scale) = (picture.worked_ms, picture.effort.scale());
            tracing::debug!(
                "picture: {:.1} ms, {worked:.1} of a core, scale {scale:.2}",
                picture.ms
            );
            let beside_training =
                picture.effort.is_shared().then_some((picture.worked_ms, picture.effort.scale()));
            drawn = Some(SoftwareSample { sample, beside_training });
            // Linear, because pictures made during training or motion are smaller.
            match &mut self.texture {
                Some(texture) => texture.set(picture.image, TextureOptions::LINEAR),
                None => {
                    self.texture = Some(ui.ctx().load_texture(
                        "splats",
                        picture.image,
                        TextureOptions::LINEAR,
                    ));
                }
            }
        }
        self.request_picture(ui, request, effort);
        // A picture without splats is not painted: it would only fill the cleared window again, which
        // is expensive on a software adapter. A comparison may still show a photograph.
        if let Some(texture) = &self.texture
            && (self.n_drawn > 0 || request.second.is_some())
        {
            let uv = eframe::egui::Rect::from_min_max([0.0, 0.0].into(), [1.0, 1.0].into());
            ui.painter().image(texture.id(), rect, uv, Color32::WHITE);
        }
        drawn
    }

    pub fn n_drawn(&self) -> usize {
        self.n_drawn
    }

    fn request_picture(&mut self, ui: &Ui, request: &PictureRequest, effort: Effort) {
        let moved = self.asked.as_ref().is_none_or(|(asked, _)| asked != request);
        let refine = self.asked.as_ref().is_none_or(|(_, asked)| !asked.has_same_scale(effort));
        if !(moved || refine || self.is_stale) || self.thread.is_busy() {
            return; // a finished picture wakes the window, which tries again
        }
        // Only pictures that follow training are delayed, not those of a moved camera or the first one.
        let has_picture = self.n_drawn > 0;
        if let Effort::Shared { apart, .. } = effort
            && !moved
            && has_picture
        {
            let pause = apart.saturating_sub(self.asked_at.elapsed());
            if !pause.is_zero() {
                ui.ctx().request_repaint_after(pause);
                return;
            }
        }
        // During training the next snapshot shows the picture: painting the window with a software
        // adapter costs more than the picture, so it happens once per snapshot.
        let announce = match effort {
            Effort::Shared { .. } if !moved && has_picture => Announce::Quietly,
            _ => Announce::Wake,
        };
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
    effort: Effort,
) -> RgbImage {
    let camera = match effort {
        Effort::Full => request.camera,
        smaller => {
            let intrinsics = request.camera.intrinsics.scaled(smaller.scale());
            Camera { intrinsics, ..request.camera }
        }
    };
    let mut first = renderer.render(splats, &camera, &request.options).color;
    if let Some(second) = &request.second {
        match &second.partner {
            Partner::Splats(options) => {
                let other = renderer.render(splats, &camera, options).color;
                combine(&mut first, &other, second.area, second.how);
            }
            Partner::Model(model, options) => {
                let other = renderer.render(&model.splats, &camera, options).color;
                combine(&mut first, &other, second.area, second.how);
            }
            Partner::Photo(photo) => combine(&mut first, photo, second.area, second.how),
        }
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
