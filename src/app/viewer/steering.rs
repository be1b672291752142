//! Camera control by pointer and keys: orbit, pan, dolly, fly.

use super::SceneView;
use super::frame_refs::FrameRef;
use crate::app::drawing::ViewRenderer;
use crate::app::software;
use crate::app::state::{Opened, RunState};
use crate::math::camera_path::Keyframe;
use eframe::egui::{Key, PointerButton, Response, Ui};
use std::time::{Duration, Instant};

/// User input of one pass; drags in points, flights in scene radii.
struct Gesture {
    turn: [f64; 2],
    pan: [f64; 2],
    dolly: f64,
    fly: [f64; 3],
}

/// Flying keys and their directions: right, down, ahead.
const FLYING: [(Key, [f64; 3]); 6] = [
    (Key::W, [0.0, 0.0, 1.0]),
    (Key::S, [0.0, 0.0, -1.0]),
    (Key::A, [-1.0, 0.0, 0.0]),
    (Key::D, [1.0, 0.0, 0.0]),
    (Key::Q, [0.0, 1.0, 0.0]),
    (Key::E, [0.0, -1.0, 0.0]),
];
/// Flight speed, scene radii per second, and the factors of Shift and Ctrl.
const SPEED: f64 = 0.5;
const FAST: f64 = 10.0;
const SLOW: f64 = 0.1;
/// Longest time step of a flight, seconds, so that a slow pass causes no large jump.
const MAX_STEP_S: f32 = 0.1;

impl Gesture {
    fn read(ui: &Ui, response: &Response, is_flying: &mut bool, turns: bool) -> Self {
        let delta = response.drag_delta();
        let delta = [f64::from(delta.x), f64::from(delta.y)];
        let is_turn = turns && response.dragged_by(PointerButton::Primary);
        let is_pan = response.dragged_by(PointerButton::Secondary)
            || response.dragged_by(PointerButton::Middle);
        // Over a panel the wheel scrolls the panel.
        let dolly = if response.hovered() {
            let (wheel, zoom) = ui.input(|i| (i.smooth_scroll_delta.y, i.zoom_delta()));
            // A pinch divides the distance by its factor; the wheel halves it every 240 points.
            f64::from(wheel) + 240.0 * f64::from(zoom).log2()
        } else {
            0.0
        };
        Self {
            turn: if is_turn { delta } else { [0.0; 2] },
            pan: if is_pan && !is_turn { delta } else { [0.0; 2] },
            dolly,
            fly: flight(ui, is_flying),
        }
    }

    fn is_nothing(&self) -> bool {
        self.turn == [0.0; 2] && self.pan == [0.0; 2] && self.dolly == 0.0 && self.fly == [0.0; 3]
    }
}

/// Flight by the held keys in this pass. Ctrl slows a flight in progress but starts none, because Ctrl
/// with these keys saves and exports.
fn flight(ui: &Ui, is_flying: &mut bool) -> [f64; 3] {
    if ui.ctx().text_edit_focused() {
        *is_flying = false;
        return [0.0; 3];
    }
    let (held, modifiers, dt) = ui.input(|i| {
        let held = FLYING.iter().filter(|(key, _)| i.key_down(*key)).map(|(_, way)| *way);
        (held.collect::<Vec<[f64; 3]>>(), i.modifiers, i.stable_dt.min(MAX_STEP_S))
    });
    let add = |sum: [f64; 3], way: &[f64; 3]| std::array::from_fn(|k| sum[k] + way[k]);
    let way = held.iter().fold([0.0; 3], add);
    // Opposite keys cancel out, but releasing one of them must not end the flight.
    *is_flying = !held.is_empty() && (*is_flying || !modifiers.command);
    if !*is_flying {
        return [0.0; 3];
    }
    // egui does not repaint without input events, and held keys cause none.
    ui.ctx().request_repaint();
    let factor = match (modifiers.shift, modifiers.command) {
        (true, _) => FAST,
        (false, true) => SLOW,
        (false, false) => 1.0,
    };
    way.map(|share| share * SPEED * factor * f64::from(dt))
}

impl SceneView {
    /// Moves the camera by user input; at a dataset camera it starts from that pose.
    pub(super) fn steer(
        &mut self,
        ui: &Ui,
        response: &Response,
        opened: &Opened,
        size_px: [u32; 2],
    ) {
        let turns = !self.is_editing();
        let gesture = Gesture::read(ui, response, &mut self.is_flying, turns);
        if gesture.is_nothing() {
            return;
        }
        self.take_over_camera(opened, size_px);
        let Some(camera) = &mut self.camera else { return };
        let size = response.rect.size();
        let size = [f64::from(size.x), f64::from(size.y)];
        camera.orbit_by(gesture.turn, size[1]);
        camera.pan(gesture.pan, size);
        camera.dolly(gesture.dolly);
        camera.fly(gesture.fly);
        self.moved_at = Instant::now();
    }

    /// True while keys fly the camera; held keys then trigger no commands.
    pub fn is_flying(&self) -> bool {
        self.is_flying
    }

    /// Hands the camera over to the user at its current pose.
    pub(super) fn take_over_camera(&mut self, opened: &Opened, size_px: [u32; 2]) {
        self.guide = None;
        if let Some((stood, _)) = self.camera_now(opened, size_px)
            && let (ViewPosition::At(_) | ViewPosition::Along(_), Some(camera)) =
                (&self.place, &mut self.camera)
        {
            camera.move_to_camera(&stood);
            self.place = ViewPosition::Free;
        }
    }
}

/// Minimum time between two snapshots if a GPU draws.
const GPU_INTERVAL: Duration = Duration::from_millis(33);

impl SceneView {
    /// Minimum time between two snapshots during training. Every snapshot repaints the window, which a
    /// software adapter does on the cores that train (`rendering.md`, Software adapters).
    pub fn snapshot_interval(&self) -> Duration {
        match self.painter.drawer() {
            ViewRenderer::Cpu => software::FOLLOW_INTERVAL,
            ViewRenderer::Gpu | ViewRenderer::UntimedGpu => GPU_INTERVAL,
        }
    }

    /// Starts a pass of the window; returns the time to wait before it. egui redraws the whole window
    /// on every pointer movement, much more often than the scene is rendered; during training these
    /// movements are merged.
    pub fn begin_pass(&mut self, state: RunState) -> Duration {
        let is_shared = state == RunState::Training && self.painter.drawer() == ViewRenderer::Cpu;
        let is_steered = is_shared && self.moved_at.elapsed() < super::SETTLE;
        let apart = if is_steered { software::pass_interval() } else { Duration::ZERO };
        let pause = apart.saturating_sub(self.passed_at.elapsed());
        self.passed_at = Instant::now() + pause;
        pause
    }
}

/// Position of the view.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum ViewPosition {
    /// Steered freely.
    Free,
    /// Exactly at a dataset camera.
    At(FrameRef),
    /// At a keyframe of a camera path.
    Along(Keyframe),
}

/// Stage of the guided camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GuideStage {
    /// Nothing of the subject is shown yet.
    Start,
    /// All cameras of the dataset.
    Overview,
    /// Camera of the frame at this position in training order.
    Frame(usize),
    /// The finished scene.
    End,
}
