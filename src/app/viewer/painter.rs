//! Painting of the scene: by a GPU, or by the CPU renderer on a thread of its own if there is no real GPU
//! (`rendering.md`, Software adapters).

use super::photo::{ComparedPicture, Partner, PictureRequest};
use crate::app::drawing::{DrawHistory, DrawSample, DrawStage, Painting, ViewRenderer};
use crate::app::panels::signal_color::to_color32;
use crate::app::splat_updates::SplatChange;
use crate::app::view_thread::{Announce, ViewThread, one_thread, run_in};
use crate::app::viewport;
use crate::app::viewport::{GpuViewPainter, WindowDevice};
use crate::app::worker::Waker;
use crate::math::image::RgbImage;
use crate::model::splat::appearance::SplatSet;
use crate::render::compare::combine;
use crate::render::cpu::CpuRenderer;
use eframe::egui::{Color32, ColorImage, Pos2, Rect, TextureHandle, TextureOptions, Ui};
use rayon::prelude::*;
use std::time::{Duration, Instant};

const GPU_INTERVAL: Duration = Duration::from_millis(33);

pub struct Painter {
    painter: ViewPainter,
    pub drawn: DrawHistory,
    /// True if the CPU draws although a GPU exists.
    pub gpu_failed: bool,
    /// Start time of the latest egui pass.
    passed_at: Instant,
}

impl Painter {
    pub(super) fn new(painter: ViewPainter) -> Self {
        // A fresh history: timings of another renderer are not comparable.
        let drawn = DrawHistory::new(painter.drawer());
        Self { painter, drawn, gpu_failed: false, passed_at: Instant::now() }
    }

    pub fn n_drawn(&self) -> usize {
        match &self.painter {
            ViewPainter::Gpu(painter) => painter.n_drawn(),
            ViewPainter::Software(painter) => painter.n_drawn,
        }
    }

    /// Applies a change of splats. `splats` are all splats after the change.
    pub(super) fn change(&mut self, change: SplatChange, splats: &SplatSet) {
        match &mut self.painter {
            ViewPainter::Gpu(painter) => painter.change(change, splats),
            ViewPainter::Software(painter) => painter.change(change),
        }
    }

    /// Paints the picture over `rect`. `effort` has an effect only if the CPU draws. After an error this
    /// painter is unusable.
    pub(super) fn paint(
        &mut self,
        ui: &Ui,
        rect: Rect,
        request: &PictureRequest,
        effort: Effort,
        splats: &SplatSet,
    ) -> Result<(), String> {
        let sample = match &mut self.painter {
            ViewPainter::Gpu(painter) => painter.paint(ui, rect, request, splats)?,
            ViewPainter::Software(painter) => painter.paint(ui, rect, request, effort),
        };
        sample.into_iter().for_each(|sample| self.drawn.push(sample));
        Ok(())
    }

    /// Returns the minimum time between two snapshots during training. Every snapshot repaints the window,
    /// which takes CPU cores from training if the adapter is a software adapter.
    pub fn snapshot_interval(&self) -> Duration {
        match self.painter {
            ViewPainter::Gpu(_) => GPU_INTERVAL,
            ViewPainter::Software(_) => FOLLOW_INTERVAL,
        }
    }

    /// Starts an egui pass. Returns the time to wait before it is drawn. `merges` is true while the camera
    /// moves during training; pointer movements during the wait then share one pass.
    pub(super) fn begin_pass(&mut self, merges: bool) -> Duration {
        // egui redraws the whole window on every pointer movement, much more often than the scene is
        // rendered. Only passes drawn by the CPU take cores from training.
        let is_paced = merges && matches!(self.painter, ViewPainter::Software(_));
        let apart = if is_paced { pass_interval() } else { Duration::ZERO };
        let pause = apart.saturating_sub(self.passed_at.elapsed());
        // The caller sleeps for the pause before the pass.
        self.passed_at = Instant::now() + pause;
        pause
    }
}

pub enum ViewPainter {
    Gpu(Box<GpuViewPainter>),
    Software(Box<SoftwarePainter>),
}

impl ViewPainter {
    /// Creates a GPU painter if the adapter is a hardware GPU, otherwise a CPU painter. Also returns a
    /// line that names the renderer.
    pub fn choose(
        device: Option<&WindowDevice>,
        painting: Painting,
        waker: &Waker,
    ) -> std::io::Result<(Self, String)> {
        let Some(WindowDevice { state, faults, .. }) = device else {
            return Ok((Self::software(waker)?, "CPU renderer".to_owned()));
        };
        let capabilities = viewport::capabilities(state);
        tracing::info!("adapter: {capabilities}");
        // A software adapter would use the same cores and be far slower (`rendering.md`, Software
        // adapters).
        if capabilities.is_software() && painting == Painting::Auto {
            let who = format!("No graphics card: the CPU draws; window by {capabilities}");
            return Ok((Self::software(waker)?, who));
        }
        match GpuViewPainter::new(state, faults.clone()) {
            Ok(painter) => Ok((Self::Gpu(Box::new(painter)), capabilities.to_string())),
            Err(error) => {
                // The adapter may still draw the window itself; only the scene falls back to the CPU.
                tracing::warn!("{error}");
                Ok((Self::software(waker)?, format!("CPU renderer ({error})")))
            }
        }
    }

    pub fn software(waker: &Waker) -> std::io::Result<Self> {
        Ok(Self::Software(Box::new(SoftwarePainter::new(waker.clone())?)))
    }

    pub fn drawer(&self) -> ViewRenderer {
        match self {
            Self::Gpu(painter) => painter.drawer(),
            Self::Software(_) => ViewRenderer::Cpu,
        }
    }
}

/// Minimum time between two redraws that follow changes by training.
const FOLLOW_INTERVAL: Duration = Duration::from_millis(500);

/// Returns the minimum time between two egui passes while the camera moves during training.
///
/// Only this interval and [`Effort::BesideTraining`] limit the CPU time that drawing takes from training.
fn pass_interval() -> Duration {
    // 200 ms of one core, shared by all. A pass takes about 20 ms of a core and a picture twice that, so
    // drawing takes a fifth of the cores.
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get() as u32);
    Duration::from_millis(200) / cores
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effort {
    /// Draws with one thread at half resolution, during training. Each picture is followed by a pause of
    /// twice its drawing time. Pictures that show only changes by training are at least
    /// [`FOLLOW_INTERVAL`] apart.
    BesideTraining,
    /// Draws like [`Self::BesideTraining`] at a [`QuickScale`], while the camera moves.
    MovingBesideTraining,
    /// Draws with all threads at a [`QuickScale`], while the camera moves.
    Moving,
    /// Draws with all threads at full resolution.
    Full,
}

impl Effort {
    pub(super) fn new(is_training: bool, is_moving: bool) -> Self {
        match (is_training, is_moving) {
            // Training takes precedence over pictures, even while the camera moves.
            (true, false) => Self::BesideTraining,
            (true, true) => Self::MovingBesideTraining,
            (false, true) => Self::Moving,
            (false, false) => Self::Full,
        }
    }

    fn is_beside_training(self) -> bool {
        matches!(self, Self::BesideTraining | Self::MovingBesideTraining)
    }
}

/// Ratio of the side lengths of picture and viewport while the camera moves. It follows the drawing times, so
/// that the picture follows the hand on few cores and in large windows.
#[derive(Clone, Copy, Debug, PartialEq)]
struct QuickScale(f64);

impl QuickScale {
    /// Drawing time of a picture that the scale aims at.
    // Thirty pictures a second leave 33 ms; the window's own pass takes a fourth of it.
    const GOAL: Duration = Duration::from_millis(25);
    const LARGEST: f64 = 0.5;
    /// Least number of pixels of a picture: with fewer, a room is not recognised.
    const LEAST_PIXELS: f64 = 48_000.0;
    /// Range of the ratio of wanted and present scale in which the scale stays: pictures of alternating
    /// sharpness flicker.
    const STEADY: std::ops::Range<f64> = 0.85..1.2;

    /// Returns the scale after a picture at this scale took a time to draw. `pixels` is the number of pixels
    /// of the viewport.
    fn after(self, took: Duration, pixels: f64) -> Self {
        // The time grows with the number of pixels at most.
        let ratio = (Self::GOAL.as_secs_f64() / took.as_secs_f64().max(1e-4)).sqrt();
        if Self::STEADY.contains(&ratio) {
            return self;
        }
        let least = (Self::LEAST_PIXELS / pixels.max(1.0)).sqrt().min(Self::LARGEST);
        // Half of the way, because a single picture may be held up by other programs.
        Self((self.0 * ratio.sqrt()).clamp(least, Self::LARGEST))
    }
}

struct Picture {
    image: ColorImage,
    /// Number of splats in the picture, without empty slots.
    n_drawn: usize,
    took: Duration,
}

pub struct SoftwarePainter {
    thread: ViewThread<(PictureRequest, Effort, f64), Picture>,
    texture: Option<TextureHandle>,
    asked: Option<(PictureRequest, Effort)>,
    asked_at: Instant,
    took: Duration,
    /// Scales of pictures beside training and of others: they have different numbers of threads.
    quick: [QuickScale; 2],
    is_stale: bool,
    n_drawn: usize,
}

impl SoftwarePainter {
    fn new(waker: Waker) -> std::io::Result<Self> {
        let mut renderer = CpuRenderer::new();
        // In rayon's global pool a picture would use every core, including those of training.
        let alone = one_thread()?;
        let draw =
            move |splats: &SplatSet, (request, effort, scale): (PictureRequest, Effort, f64)| {
                let started = Instant::now();
                let pool = effort.is_beside_training().then_some(&alone);
                let image =
                    run_in(pool, || texels(&picture(&mut renderer, splats, &request, scale)));
                let took = started.elapsed();
                // Empty slots have opacity 0.
                let n_drawn = splats.iter().filter(|s| s.opacity > 0.0).count();
                Picture { image, n_drawn, took }
            };
        Ok(Self {
            thread: ViewThread::start("drawing", waker, draw)?,
            texture: None,
            asked: None,
            asked_at: Instant::now(),
            took: Duration::ZERO,
            quick: [QuickScale(QuickScale::LARGEST); 2],
            is_stale: true,
            n_drawn: 0,
        })
    }

    fn change(&mut self, change: SplatChange) {
        self.thread.change(change);
        self.is_stale = true;
    }

    /// Paints the newest picture over the viewport and requests the next one if needed. The last picture
    /// remains until then. Returns the timing of a new picture.
    fn paint(
        &mut self,
        ui: &Ui,
        rect: Rect,
        request: &PictureRequest,
        effort: Effort,
    ) -> Option<DrawSample> {
        let drawn = self.thread.take().map(|Picture { image, n_drawn, took }| {
            (self.n_drawn, self.took) = (n_drawn, took);
            self.adapt_scale();
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
            let mut sample = DrawSample::default();
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

    /// Adapts the scale to the time of the newest picture.
    fn adapt_scale(&mut self) {
        let Some((request, effort)) = &self.asked else { return };
        if matches!(effort, Effort::Moving | Effort::MovingBesideTraining) {
            let scale = &mut self.quick[usize::from(effort.is_beside_training())];
            *scale = scale.after(self.took, request.camera.intrinsics.n_pixels() as f64);
        }
    }

    /// Returns the ratio of the side lengths of picture and viewport.
    fn scale(&self, effort: Effort) -> f64 {
        match effort {
            Effort::Full => 1.0,
            Effort::BesideTraining => QuickScale::LARGEST,
            _ => self.quick[usize::from(effort.is_beside_training())].0,
        }
    }

    fn request_picture(&mut self, ui: &Ui, request: &PictureRequest, effort: Effort) {
        let moved = self.asked.as_ref().is_none_or(|(asked, _)| asked != request);
        let refine = self.asked.as_ref().is_none_or(|(_, asked)| *asked != effort);
        if !(moved || refine || self.is_stale) || self.thread.is_busy() {
            return; // a finished picture wakes the window, which tries again
        }
        let mut announce = Announce::Wake;
        if effort.is_beside_training() {
            // The rest of twice its time begins when the picture is finished.
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
        self.thread.send_request((request.clone(), effort, self.scale(effort)), announce);
        self.asked = Some((request.clone(), effort));
        self.asked_at = Instant::now();
        // Reset before the answer arrives, so that a change during the rendering makes it stale again.
        self.is_stale = false;
    }
}

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
            // At its own size, which `combine` samples.
            Partner::Photo(photo) => &**photo,
        };
        combine(&mut first, other, *area, *how);
    }
    first
}

fn texels(picture: &RgbImage) -> ColorImage {
    let pixels = picture.data.par_iter().map(|&pixel| to_color32(pixel)).collect();
    ColorImage::new([picture.width, picture.height], pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIXELS: f64 = 910.0 * 580.0;

    /// Returns the scale after pictures whose time grows with their pixels, from `full` at scale 1.
    fn settled(full: Duration, pixels: f64) -> f64 {
        let mut scale = QuickScale(QuickScale::LARGEST);
        for _ in 0..20 {
            scale = scale.after(full.mul_f64(scale.0 * scale.0), pixels);
        }
        scale.0
    }

    #[test]
    fn pictures_of_a_moving_camera_take_the_time_of_the_goal_or_have_few_pixels() {
        let ms = Duration::from_millis;
        assert_eq!(settled(ms(60), PIXELS), QuickScale::LARGEST, "fast enough");
        let scale = settled(ms(200), PIXELS);
        let took = ms(200).mul_f64(scale * scale).as_secs_f64() / QuickScale::GOAL.as_secs_f64();
        assert!((0.7..1.4).contains(&took), "{scale} takes {took} of the goal");
        let scale = settled(ms(20_000), PIXELS);
        let pixels = PIXELS * scale * scale;
        assert!((pixels / QuickScale::LEAST_PIXELS - 1.0).abs() < 1e-9, "{pixels} pixels");
        // A small viewport has fewer pixels than that at the largest scale.
        assert_eq!(settled(ms(20_000), 1e5), QuickScale::LARGEST);
    }

    #[test]
    fn a_scale_close_to_the_wanted_one_stays() {
        let scale = QuickScale(0.4);
        for took in [20, 25, 32] {
            assert_eq!(scale.after(Duration::from_millis(took), PIXELS), scale, "{took} ms");
        }
        assert!(scale.after(Duration::from_millis(50), PIXELS).0 < 0.4);
        assert!(scale.after(Duration::from_millis(8), PIXELS).0 > 0.4);
    }
}
