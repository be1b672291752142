//! The central view: steering the camera, and painting with whatever the machine has.

use super::camera::ViewCamera;
use super::color_mode::ColorMode;
use super::feed::{Delivery, SplatChange};
use super::palette::Palette;
use super::panels::legend;
use super::selection::Selection;
use super::software::{Effort, SoftwarePainter, View};
use super::state::{Opened, RunState, Snapshot};
use super::viewport::GpuPainter;
use super::worker::Waker;
use crate::model::splats::framing;
use crate::render::{Method, RenderOptions};
use eframe::egui::{PointerButton, Rect, Response, Sense, Ui, Vec2};
use std::time::{Duration, Instant};

/// Colour behind the scene.
const BACKGROUND: [f32; 3] = [0.09, 0.10, 0.12];

/// Place of the legend, from the lower left corner of the viewport, points.
const LEGEND: Vec2 = Vec2::new(10.0, -10.0);

/// How long after the last movement the picture is refined.
const SETTLE: Duration = Duration::from_millis(150);

enum Painter {
    Gpu(Box<GpuPainter>),
    Software(Box<SoftwarePainter>),
}

/// State of the central view.
pub struct SceneView {
    painter: Painter,
    waker: Waker,
    camera: Option<ViewCamera>,
    /// Serial of what the camera was set up for.
    serial: u64,
    /// What is drawn: for framing, for the GPU, and to hand over when the GPU fails.
    palette: Palette,
    selection: Selection,
    moved_at: Instant,
    n_drawn: usize,
    gpu_failed: bool,
}

impl SceneView {
    /// Starts with a GPU painter if there is one.
    pub fn new(gpu: Option<GpuPainter>, waker: Waker) -> std::io::Result<Self> {
        let painter = match gpu {
            Some(gpu) => Painter::Gpu(Box::new(gpu)),
            None => Painter::Software(Box::new(SoftwarePainter::new(waker.clone())?)),
        };
        Ok(Self {
            painter,
            waker,
            camera: None,
            serial: 0,
            palette: Palette::default(),
            selection: Selection::default(),
            moved_at: Instant::now(),
            n_drawn: 0,
            gpu_failed: false,
        })
    }

    /// Hands changed splats over.
    pub fn change(&mut self, delivery: Delivery) {
        let change = self.palette.change(delivery);
        self.pass_on(change);
    }

    /// Colours the scene in another way. What only the trainer knows comes with later changes.
    pub fn set_color_mode(&mut self, mode: ColorMode) {
        if let Some(change) = self.palette.choose(mode.attribute()) {
            self.pass_on(change);
        }
    }

    fn pass_on(&mut self, change: SplatChange) {
        match &mut self.painter {
            Painter::Gpu(painter) => painter.change(change, self.palette.splats()),
            Painter::Software(painter) => painter.change(change),
        }
    }

    /// What the user clicked at, once: a splat, or `Some(None)` for none.
    pub fn take_picked(&mut self) -> Option<Option<u32>> {
        self.selection.take_picked()
    }

    /// Splats in the picture.
    pub fn n_drawn(&self) -> usize {
        self.n_drawn
    }

    /// Looks at the whole scene.
    pub fn frame_scene(&mut self) {
        if let (Some(camera), Some(framing)) = (&mut self.camera, framing(self.palette.splats())) {
            camera.frame(&framing);
            self.moved_at = Instant::now();
        }
    }

    /// Goes back to the view the scene was opened with.
    pub fn go_home(&mut self, opened: &Opened) {
        self.camera = Some(ViewCamera::home(&opened.home));
        self.moved_at = Instant::now();
    }

    /// Draws the view over all space left. Returns a message if the GPU had to be given up.
    pub fn ui(&mut self, ui: &mut Ui, snapshot: &Snapshot) -> Option<String> {
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        let opened = snapshot.opened.as_ref()?;
        if self.serial != opened.serial {
            self.serial = opened.serial;
            self.go_home(opened);
        }
        self.steer(ui, &response);
        let failure = self.paint(ui, rect, snapshot);
        let Some(view) = self.view(ui, rect) else { return failure };
        let picked =
            self.selection.ui(ui, &response, &view, self.palette.learned(), snapshot, &self.waker);
        if let Some((attribute, range)) = self.palette.legend() {
            legend::ui(attribute, range.as_ref(), rect.left_bottom() + LEGEND, ui);
        }
        failure.or(picked.err().map(|e| format!("starting the picking thread failed: {e}")))
    }

    /// The view in the pixels of the screen; `None` while there is nothing to look at.
    fn view(&self, ui: &Ui, rect: Rect) -> Option<View> {
        let camera = self.camera?;
        let pixels = rect.size() * ui.ctx().pixels_per_point();
        let size = [pixels.x.round() as u32, pixels.y.round() as u32];
        if size[0] == 0 || size[1] == 0 {
            return None;
        }
        let options = RenderOptions::viewport(Method::PROJECTED, BACKGROUND, camera.radius());
        Some(View { camera: camera.camera(size), options })
    }

    fn steer(&mut self, ui: &Ui, response: &Response) {
        let Some(camera) = &mut self.camera else { return };
        let before = *camera;
        let height = response.rect.height() as f64;
        let delta = response.drag_delta();
        let delta = [delta.x as f64, delta.y as f64];
        if response.dragged_by(PointerButton::Primary) {
            camera.turn(delta, height);
        } else if response.dragged_by(PointerButton::Secondary)
            || response.dragged_by(PointerButton::Middle)
        {
            camera.pan(delta, height);
        }
        if response.hovered() {
            let (wheel, zoom) = ui.input(|i| (i.smooth_scroll_delta.y, i.zoom_delta()));
            camera.dolly(wheel as f64 + 240.0 * (zoom as f64).log2());
        }
        if *camera != before {
            self.moved_at = Instant::now();
        }
    }

    fn paint(&mut self, ui: &Ui, rect: Rect, snapshot: &Snapshot) -> Option<String> {
        let view = self.view(ui, rect)?;
        match &mut self.painter {
            Painter::Gpu(painter) => {
                match painter.paint(ui, rect, view.camera, &view.options, self.palette.splats()) {
                    Ok(n_drawn) => {
                        self.n_drawn = n_drawn;
                        None
                    }
                    Err(error) => self.give_up_gpu(&error.to_string()),
                }
            }
            Painter::Software(painter) => {
                let moving = self.moved_at.elapsed() < SETTLE;
                let effort = match (moving, snapshot.state) {
                    (true, _) => Effort::Moving,
                    (false, RunState::Training) => Effort::Shared,
                    (false, _) => Effort::Full,
                };
                if moving {
                    ui.ctx().request_repaint_after(SETTLE);
                }
                self.n_drawn = painter.paint(ui, rect, view, effort);
                None
            }
        }
    }

    /// Whether the GPU draws the scene.
    pub fn is_on_gpu(&self) -> bool {
        matches!(self.painter, Painter::Gpu(_))
    }

    /// Whether the GPU was given up.
    pub fn gpu_failed(&self) -> bool {
        self.gpu_failed
    }

    /// Draws on a GPU from here on; the scene is handed over again.
    pub fn use_gpu(&mut self, mut painter: GpuPainter) {
        let splats = self.palette.splats();
        painter.change(SplatChange::All(splats.to_vec()), splats);
        self.painter = Painter::Gpu(Box::new(painter));
        self.gpu_failed = false;
    }

    /// Draws on the CPU from here on; the scene is handed over again.
    fn give_up_gpu(&mut self, reason: &str) -> Option<String> {
        self.gpu_failed = true;
        match SoftwarePainter::new(self.waker.clone()) {
            Ok(mut painter) => {
                painter.change(SplatChange::All(self.palette.splats().to_vec()));
                self.painter = Painter::Software(Box::new(painter));
                Some(format!(
                    "the GPU cannot draw the scene any more ({reason}); the CPU draws it from here on, Settings has a button to try the GPU again"
                ))
            }
            Err(error) => Some(format!(
                "the GPU cannot draw the scene ({reason}) and no drawing thread could be started ({error}); export the scene and restart"
            )),
        }
    }
}
