//! Dataset cameras in the viewport: frusta that end in the photographs.

use super::SceneView;
use super::frame_points::FramePoints;
use super::frame_refs::FrameRef;
use super::thumbnails::Thumbnails;
use super::world_painter::WorldPainter;
use crate::app::state::{Opened, RunState, Snapshot};
use crate::math::camera::Camera;
use eframe::egui::{Color32, Stroke, Ui};
use glam::DVec3;
use std::time::Instant;

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

impl SceneView {
    /// Number of the frame whose points are drawn, among all frames, and the number of its points.
    pub fn points_shown(&self) -> Option<(usize, usize)> {
        let shown = self.points.displayed().filter(|_| self.settings.shows_points);
        shown.map(|(frame, points)| (frame.number(), points.as_ref().map_or(0, Vec::len)))
    }

    /// Returns the frame in view, else the one trained last, else the first.
    fn current_frame(&self, opened: &Opened, snapshot: &Snapshot) -> Option<FrameRef> {
        let latest = snapshot.recent.last().map_or(0, |frame| frame.index);
        self.frame_ref().cloned().or_else(|| FrameRef::trained(opened, latest))
    }

    /// Draws the points of the current frame; until they are decoded, those of the previous one.
    pub(super) fn draw_frame_points(
        &mut self,
        world: &WorldPainter,
        opened: &Opened,
        snapshot: &Snapshot,
    ) {
        self.points.take_decoded();
        if let Some(frame) = self.current_frame(opened, snapshot) {
            // The corrected pose, because the scene is trained with it.
            let scene = self.palette.splats().finishing();
            let pose = scene.corrected_pose(&frame.entry().camera.pose);
            let cameras = (pose, opened.color_camera());
            let is_training = snapshot.state == RunState::Training;
            if let Err(error) =
                self.points.request_decoding(frame, cameras, is_training, &self.waker)
            {
                let text = format!("Starting the thread that decodes the frame failed: {error}");
                self.hint = Some((text, Instant::now()));
            }
        }
        match self.points.displayed() {
            None => {}
            Some((_, Ok(points))) => world.points(points),
            Some((_, Err(problem))) => self.hint = Some((problem.clone(), Instant::now())),
        }
    }

    pub(super) fn toggle_points(&mut self) {
        self.settings.shows_points = !self.settings.shows_points;
        self.points = FramePoints::default();
    }
}
