//! Dataset cameras in the viewport: frusta that end in the photographs.

use super::SceneView;
use super::frame_refs::FrameRef;
use super::thumbnails::Thumbnails;
use super::world_painter::WorldPainter;
use crate::app::state::{Opened, RunState, Snapshot};
use crate::math::camera::Camera;
use eframe::egui::{Color32, Stroke, Ui};
use glam::DVec3;

/// Maximum number of cameras drawn, evenly subsampled; more would hide each other.
const MAX_CAMERAS: usize = 60;
/// Length of a frustum, in scene radii.
const LENGTH: f64 = 0.25;
/// Colours of frames not yet trained, of trained frames, and of the one trained last.
const AHEAD: Color32 = Color32::from_rgb(120, 150, 190);
const DONE: Color32 = Color32::from_rgb(110, 200, 120);
const LATEST: Color32 = Color32::from_rgb(255, 170, 60);

impl SceneView {
    /// True if cameras are drawn; always before training, when there is nothing else to see.
    pub(super) fn shows_cameras(&self, snapshot: &Snapshot) -> bool {
        self.settings.shows_cameras || snapshot.frames_done == 0
    }

    /// Draws the cameras of the run's frames.
    pub(super) fn draw_frusta(
        &mut self,
        ui: &Ui,
        world: &WorldPainter,
        opened: &Opened,
        snapshot: &Snapshot,
    ) {
        let Some(plan) = &opened.plan else { return };
        let n = plan.frames.len();
        let latest = snapshot.recent.last().map(|frame| frame.index);
        let stride = n.div_ceil(MAX_CAMERAS).max(1);
        let length = LENGTH * opened.home.radius;
        // During training the cores are needed for training, not for thumbnails.
        let may_decode = snapshot.state != RunState::Training;
        for position in (0..n).step_by(stride).chain(latest) {
            let Some(frame) = FrameRef::trained(opened, position) else { continue };
            let color = match latest {
                Some(latest) if latest == position => LATEST,
                Some(latest) if position < latest => DONE,
                _ => AHEAD,
            };
            let thumbnails = self.thumbnails(opened);
            draw_frustum(ui, world, &frame, length, color, thumbnails.map(|t| (t, may_decode)));
        }
    }

    /// Thumbnails of the open dataset; `None` if their thread could not be started.
    pub fn thumbnails(&mut self, opened: &Opened) -> Option<&mut Thumbnails> {
        if self.thumbnails.as_ref().is_none_or(|(serial, _)| *serial != opened.serial) {
            let started = Thumbnails::start(self.waker.clone());
            // The view works without thumbnails, so the error is dropped.
            self.thumbnails = started.ok().map(|thumbnails| (opened.serial, thumbnails));
        }
        self.thumbnails.as_mut().map(|(_, thumbnails)| thumbnails)
    }
}

fn draw_frustum(
    ui: &Ui,
    world: &WorldPainter,
    frame: &FrameRef,
    length: f64,
    color: Color32,
    thumbnails: Option<(&mut Thumbnails, bool)>,
) {
    let camera = frame.entry().photo_camera(None);
    let corners = corners(&camera, length);
    let apex = camera.pose.centre();
    let known = thumbnails.and_then(|(thumbnails, may_decode)| {
        thumbnails.get(ui.ctx(), frame, may_decode).map(|texture| texture.id())
    });
    if let Some(texture) = known {
        let [top_left, top_right, _, bottom_left] = corners;
        world.picture([top_left, top_right, bottom_left], texture, Color32::WHITE);
    }
    let stroke = Stroke::new(1.0, color);
    for (i, &corner) in corners.iter().enumerate() {
        world.line([apex, corner], stroke);
        world.line([corner, corners[(i + 1) % corners.len()]], stroke);
    }
}

/// Corners of the image at a depth, clockwise from the upper left, world coordinates.
fn corners(camera: &Camera, depth: f64) -> [DVec3; 4] {
    let k = &camera.intrinsics;
    let [width, height] = [k.width, k.height].map(f64::from);
    [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(|[x, y]| {
        let ray = DVec3::new((x - k.cx) / k.fx, (y - k.cy) / k.fy, 1.0);
        camera.pose.transform_point(ray * depth)
    })
}
