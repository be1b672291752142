//! Tools and drawings over the picture: dataset cameras, points of a frame, measuring, picking, hints.

use super::editing::EditTool;
use super::frame_points::FramePoints;
use super::frame_refs::FrameRef;
use super::measure::MeasureTool;
use super::thumbnails::Thumbnails;
use super::world_painter::WorldPainter;
use crate::app::path_editor::PathEditor;
use crate::app::selection::SplatSelection;
use crate::app::state::{Opened, RunState, Snapshot};
use crate::app::worker::Waker;
use crate::export::camera_path::PacedPath;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::camera_path::Keyframe;
use crate::model::splat::appearance::Finishing;
use eframe::egui::{Align2, Color32, FontId, Stroke, Ui};
use glam::DVec3;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::time::{Duration, Instant};

/// Maximum number of cameras drawn. More cameras are subsampled evenly.
// More would hide each other.
const MAX_CAMERAS: usize = 60;
/// Length of a drawn camera frustum, in scene radii: before training, when there is nothing else to see, and
/// beside the scene.
const LENGTH_ALONE: f64 = 0.25;
const LENGTH: f64 = 0.1;
/// Opacity of the photographs of frustums beside the scene.
const OPACITY: f64 = 0.6;
/// Distance from the eye, in lengths of a frustum, at which frustums become fainter, and at which they
/// vanish.
const FADES: [f64; 2] = [3.0, 1.0];
/// Colours of the cameras of untrained frames, of trained frames, and of the last trained frame.
const AHEAD: Color32 = Color32::from_rgb(120, 150, 190);
const DONE: Color32 = Color32::from_rgb(110, 200, 120);
const LATEST: Color32 = Color32::from_rgb(255, 170, 60);
/// Colour of the edited camera path, length of the frusta at its keyframes in scene radii, and number of
/// straight pieces of its curve for each keyframe.
const PATH: Color32 = Color32::from_rgb(235, 110, 235);
const LENGTH_OF_KEYFRAME: f64 = 0.08;
const PIECES_PER_KEYFRAME: usize = 24;
const HINT: Duration = Duration::from_secs(5);

struct KeptThumbnails {
    /// Serial number of the dataset.
    serial: u64,
    /// Hash of what determines the pictures of the dataset.
    pictures: u64,
    thumbnails: Thumbnails,
}

/// Returns a hash of the names of all frames and of the options with which they are read.
fn hash_of_pictures(opened: &Opened) -> u64 {
    let mut hasher = DefaultHasher::new();
    opened.path.hash(&mut hasher);
    for split in opened.dataset.iter().flat_map(|dataset| &dataset.splits) {
        split.name.hash(&mut hasher);
        split.frames.iter().for_each(|frame| frame.name.hash(&mut hasher));
    }
    let options = opened.dataset.as_ref().map(|dataset| &dataset.options);
    // As text, because numbers with a point have no hash.
    format!("{options:?}").hash(&mut hasher);
    hasher.finish()
}

#[derive(Default)]
pub struct Overlays {
    pub measure: MeasureTool,
    pub(super) selection: SplatSelection,
    pub(super) edit: EditTool,
    points: FramePoints,
    thumbnails: Option<KeptThumbnails>,
    hint: Option<(String, Instant)>,
    /// Camera path that is edited, if it is to be drawn.
    pub path: Option<PathEditor>,
}

impl Overlays {
    pub(super) fn reset_for_subject(&mut self) {
        // Points and splat numbers of the previous subject mean nothing in the next one.
        self.measure = MeasureTool::default();
        self.selection = SplatSelection::default();
        self.points = FramePoints::default();
    }

    pub fn is_measuring(&self) -> bool {
        self.measure.is_on
    }

    pub(super) fn show_hint(&mut self, text: impl Into<String>) {
        self.hint = Some((text.into(), Instant::now()));
    }

    pub(super) fn clear_hint(&mut self) {
        self.hint = None;
    }

    pub(super) fn hint(&self, ui: &Ui) -> Option<&str> {
        let (text, since) = self.hint.as_ref()?;
        let left = HINT.saturating_sub(since.elapsed());
        if left.is_zero() {
            return None;
        }
        // egui does not repaint without input, so the hint would stay.
        ui.ctx().request_repaint_after(left);
        Some(text)
    }

    /// Returns the thumbnails of the open dataset. Those of the same dataset survive a reset.
    pub(super) fn thumbnails(&mut self, opened: &Opened, waker: &Waker) -> Option<&mut Thumbnails> {
        if self.thumbnails.as_ref().is_none_or(|kept| kept.serial != opened.serial) {
            let pictures = hash_of_pictures(opened);
            let kept = self.thumbnails.take().filter(|kept| kept.pictures == pictures);
            // The view works without thumbnails, so the error is dropped.
            let thumbnails =
                kept.map(|kept| kept.thumbnails).or_else(|| Thumbnails::start(waker.clone()).ok());
            let serial = opened.serial;
            self.thumbnails =
                thumbnails.map(|thumbnails| KeptThumbnails { serial, pictures, thumbnails });
        }
        self.thumbnails.as_mut().map(|kept| &mut kept.thumbnails)
    }

    pub(super) fn draw_cameras(
        &mut self,
        ui: &Ui,
        world: &WorldPainter,
        (opened, snapshot): (&Opened, &Snapshot),
        waker: &Waker,
    ) {
        let Some(plan) = &opened.plan else { return };
        let n = plan.frames.len();
        let latest = snapshot.frames.recent.last().map(|frame| frame.index);
        let stride = n.div_ceil(MAX_CAMERAS).max(1);
        let is_alone = snapshot.frames_done == 0;
        let length = opened.home.radius * if is_alone { LENGTH_ALONE } else { LENGTH };
        let visibility = |centre: DVec3| {
            let [begin, end] = FADES.map(|lengths| lengths * length);
            let near = ((world.eye().distance(centre) - end) / (begin - end)).clamp(0.0, 1.0);
            if is_alone { 1.0 } else { near }
        };
        // During training the cores are needed for training, not for thumbnails.
        let may_decode = snapshot.state != RunState::Training;
        // The latest frame again at the end, so that its frustum covers the others.
        for position in (0..n).step_by(stride).chain(latest) {
            let Some(frame) = FrameRef::trained(opened, position) else { continue };
            let color = match latest {
                Some(latest) if latest == position => LATEST,
                Some(latest) if position < latest => DONE,
                _ => AHEAD,
            };
            let visible = visibility(frame.entry().camera.pose.centre());
            if visible == 0.0 {
                continue;
            }
            let thumbnails = self.thumbnails(opened, waker);
            let opacity = if is_alone { 1.0 } else { OPACITY * visible };
            let color = color.gamma_multiply(visible as f32);
            let look = (length, color, Color32::WHITE.gamma_multiply(opacity as f32));
            draw_frustum(ui, world, &frame, look, thumbnails.map(|t| (t, may_decode)));
        }
    }

    /// Draws the camera path: its curve, numbered frusta at its keyframes, and a dot at the playback position.
    pub(super) fn draw_path(&self, world: &WorldPainter, radius: f64) {
        let Some(editor) = &self.path else { return };
        let (stroke, length) = (Stroke::new(2.0, PATH), LENGTH_OF_KEYFRAME * radius);
        if let Some(PacedPath { path, .. }) = editor.paced() {
            let n = PIECES_PER_KEYFRAME * path.keyframes().len();
            let centre = |share: f64| path.at(share * path.duration()).pose.centre();
            let places: Vec<DVec3> = (0..=n).map(|i| centre(i as f64 / n as f64)).collect();
            places.windows(2).for_each(|ends| world.line([ends[0], ends[1]], stroke));
            if let Some(at) = world.position(path.at(editor.moment).pose.centre()) {
                world.painter.circle_filled(at, 5.0, PATH);
            }
        }
        let [width, height] = editor.size;
        for (i, Keyframe { pose, fov_y, .. }) in editor.keyframes().iter().enumerate() {
            // At a keyframe its own frustum would cover the view.
            if world.eye().distance(pose.centre()) < length {
                continue;
            }
            let intrinsics = Intrinsics::from_vertical_fov(width, height, *fov_y);
            draw_wires(world, &Camera { intrinsics, pose: *pose }, length, stroke);
            if let Some(at) = world.position(pose.centre()) {
                let (text, font) = ((i + 1).to_string(), FontId::proportional(13.0));
                world.painter.text(at, Align2::RIGHT_BOTTOM, text, font, PATH);
            }
        }
    }

    /// Returns the number, among all frames, of the frame whose points are drawn, and the number of
    /// these points.
    pub fn points_shown(&self) -> Option<(usize, usize)> {
        let (frame, points) = self.points.displayed()?;
        Some((frame.number(), points.as_ref().map_or(0, Vec::len)))
    }

    pub(super) fn clear_points(&mut self) {
        self.points = FramePoints::default();
    }

    /// Draws the points of a frame at its corrected pose. The frame is the one in view, else the last
    /// trained one, else the first one. The previous points remain until the new ones are decoded.
    pub(super) fn draw_points(
        &mut self,
        world: &WorldPainter,
        in_view: Option<&FrameRef>,
        (opened, snapshot): (&Opened, &Snapshot),
        scene: &Finishing,
        waker: &Waker,
    ) {
        self.points.take_decoded();
        let latest = snapshot.frames.recent.last().map_or(0, |frame| frame.index);
        if let Some(frame) = in_view.cloned().or_else(|| FrameRef::trained(opened, latest)) {
            let cameras = (scene.corrected_pose(&frame.entry().camera.pose), opened.color_camera());
            let is_training = snapshot.state == RunState::Training;
            if let Err(error) = self.points.request_decoding(frame, cameras, is_training, waker) {
                self.show_hint(format!(
                    "Starting the thread that decodes the frame failed: {error}"
                ));
            }
        }
        match self.points.displayed() {
            None => {}
            Some((_, Ok(points))) => world.points(points),
            Some((_, Err(problem))) => self.hint = Some((problem.clone(), Instant::now())),
        }
    }
}

fn draw_frustum(
    ui: &Ui,
    world: &WorldPainter,
    frame: &FrameRef,
    (length, color, tint): (f64, Color32, Color32),
    thumbnails: Option<(&mut Thumbnails, bool)>,
) {
    let camera = frame.entry().photo_camera(None);
    let known = thumbnails.and_then(|(thumbnails, may_decode)| {
        thumbnails.get(ui.ctx(), frame, may_decode).map(|texture| texture.id())
    });
    if let Some(texture) = known {
        let [top_left, top_right, _, bottom_left] = corners(&camera, length);
        world.picture([top_left, top_right, bottom_left], texture, tint);
    }
    draw_wires(world, &camera, length, Stroke::new(1.0, color));
}

fn draw_wires(world: &WorldPainter, camera: &Camera, length: f64, stroke: Stroke) {
    let (corners, apex) = (corners(camera, length), camera.pose.centre());
    for (i, &corner) in corners.iter().enumerate() {
        world.line([apex, corner], stroke);
        world.line([corner, corners[(i + 1) % corners.len()]], stroke);
    }
}

/// Returns the corners of the camera's image at a depth (world units), in world coordinates, clockwise
/// from the upper left.
fn corners(camera: &Camera, depth: f64) -> [DVec3; 4] {
    let k = &camera.intrinsics;
    let [width, height] = [k.width, k.height].map(f64::from);
    [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(|[x, y]| {
        let ray = DVec3::new((x - k.cx) / k.fx, (y - k.cy) / k.fy, 1.0);
        camera.pose.transform_point(ray * depth)
    })
}
