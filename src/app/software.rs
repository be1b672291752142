//! Painting without a real GPU: the CPU renderer on its own thread, its picture as a texture
//! (`rendering.md` (d)).

use super::feed::SplatChange;
use super::view_thread::{Announce, ViewThread};
use super::worker::Waker;
use crate::math::camera::Camera;
use crate::math::image::unit_to_byte;
use crate::model::splats::Splat;
use crate::render::RenderOptions;
use crate::render::cpu::CpuRenderer;
use eframe::egui::{Color32, ColorImage, TextureHandle, TextureOptions, Ui};
use std::time::{Duration, Instant};

/// A picture to be made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Camera for the whole viewport, in pixels of the screen.
    pub camera: Camera,
    /// Background and near plane.
    pub options: RenderOptions,
}

/// How much of the machine a picture may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// While training: half resolution, one thread, with pauses.
    Shared,
    /// While the camera moves: half resolution.
    Moving,
    /// Otherwise: full resolution.
    Full,
}

struct Picture {
    image: ColorImage,
    /// Splats there were at the time, empty slots not counted.
    n_drawn: usize,
}

/// Painter of the viewport on machines without a real GPU.
pub struct SoftwarePainter {
    thread: ViewThread<(View, Effort), Picture>,
    texture: Option<TextureHandle>,
    asked: Option<(View, Effort)>,
    asked_at: Instant,
    is_stale: bool,
    n_drawn: usize,
}

/// Least time between two pictures while training: on two cores drawing must leave the trainer its
/// share, and one half-size picture takes some 30 ms of one core.
const SHARED_INTERVAL: Duration = Duration::from_millis(450);

impl SoftwarePainter {
    /// Starts the drawing thread.
    pub fn new(waker: Waker) -> std::io::Result<Self> {
        let mut renderer = CpuRenderer::new();
        let alone = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .map_err(std::io::Error::other)?;
        let draw = move |splats: &[Splat], (view, effort): (View, Effort)| {
            let camera = match effort {
                Effort::Full => view.camera,
                Effort::Shared | Effort::Moving => {
                    Camera { intrinsics: view.camera.intrinsics.scaled(0.5), ..view.camera }
                }
            };
            let mut render = || renderer.render(splats, &camera, &view.options);
            let rendered = if effort == Effort::Shared { alone.install(render) } else { render() };
            let size = [rendered.color.width, rendered.color.height];
            let pixels = rendered.color.data.iter().map(|&p| {
                let [r, g, b] = p.map(unit_to_byte);
                Color32::from_rgb(r, g, b)
            });
            let image = ColorImage::new(size, pixels.collect());
            Picture { image, n_drawn: splats.iter().filter(|s| s.opacity > 0.0).count() }
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

    /// Hands changed splats over.
    pub fn change(&mut self, change: SplatChange) {
        self.thread.change(change);
        self.is_stale = true;
    }

    /// Paints the newest picture over the viewport and asks for the next if one is needed. The last
    /// picture stays until then. Returns the number of splats in the picture.
    pub fn paint(
        &mut self,
        ui: &Ui,
        rect: eframe::egui::Rect,
        view: View,
        effort: Effort,
    ) -> usize {
        if let Some(picture) = self.thread.take() {
            self.n_drawn = picture.n_drawn;
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
        self.ask(ui, view, effort);
        if let Some(texture) = &self.texture
            && self.n_drawn > 0
        {
            let uv = eframe::egui::Rect::from_min_max([0.0, 0.0].into(), [1.0, 1.0].into());
            ui.painter().image(texture.id(), rect, uv, Color32::WHITE);
        }
        self.n_drawn
    }

    fn ask(&mut self, ui: &Ui, view: View, effort: Effort) {
        let moved = self.asked.is_none_or(|(asked, _)| asked != view);
        let refine = self.asked.is_none_or(|(_, asked)| asked != effort);
        if !(moved || refine || self.is_stale) || self.thread.is_busy() {
            return; // a finished picture wakes the window, which asks again
        }
        let pause = SHARED_INTERVAL.saturating_sub(self.asked_at.elapsed());
        let has_picture = self.n_drawn > 0;
        if effort == Effort::Shared && !moved && has_picture && !pause.is_zero() {
            ui.ctx().request_repaint_after(pause);
            return;
        }
        // While training, the next snapshot shows the picture: painting the window through a software
        // adapter costs more than the picture, so it happens once per snapshot and not twice.
        let announce = match effort {
            Effort::Shared if !moved && has_picture => Announce::Quietly,
            _ => Announce::Wake,
        };
        self.thread.ask((view, effort), announce);
        self.asked = Some((view, effort));
        self.asked_at = Instant::now();
        self.is_stale = false;
    }
}
