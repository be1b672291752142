//! Camera of the view: steered by pointer and keys, placed at dataset cameras or path keyframes, or guided
//! by training.
//!
//! Before training, a guided camera shows all dataset cameras. During training it shows the latest
//! frame's camera, and at the end the whole scene. Steering by the user ends the guide, and the Ride
//! along command starts it again. A guided camera jumps with the snapshots, without animation, because
//! without a GPU further pictures would take CPU time from training.

use super::frame_refs::{Direction, FrameRef, fit};
use super::settings::ViewSettings;
use crate::app::camera::{ViewCamera, WHEEL_PER_HALVING};
use crate::app::opening::FileProposal;
use crate::app::state::{Opened, RunState, Snapshot, Source};
use crate::math::camera::{Camera, Intrinsics};
use crate::math::camera_path::{CameraPath, Keyframe};
use crate::math::orbit::Orbit;
use crate::math::pose::Pose;
use crate::model::splat::framing::Framing;
use crate::render::Lens;
use crate::render::compare::Area;
use eframe::egui::{Key, PointerButton, Response, Ui};
use glam::{DMat3, DVec3};
use std::time::{Duration, Instant};

const TURNTABLE_S: f64 = 12.0;
/// Time after the last camera movement until the picture is drawn at full resolution.
pub(super) const SETTLE: Duration = Duration::from_millis(150);

/// Position of the view, and stage of the automatic camera guide. Restored after the preview of another
/// position.
#[derive(Clone)]
pub struct Place {
    position: ViewPosition,
    /// Stage of the automatic camera guide; `None` once the user has moved the camera.
    guide: Option<GuideStage>,
    /// Dataset camera visited last. Commands for the next or previous camera start from it.
    latest_frame: Option<FrameRef>,
}

#[derive(Clone, Debug, PartialEq)]
enum ViewPosition {
    Free,
    At(FrameRef),
    Along(Keyframe),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum GuideStage {
    /// The dataset or model has not been displayed yet.
    Start,
    /// The view shows all cameras of the dataset.
    Overview,
    /// The view is at the camera of the frame with this position in the training order.
    Frame(usize),
    End,
}

pub(super) type PhotoCamera<'a> = &'a dyn Fn(&FrameRef) -> Camera;

pub struct Viewpoint {
    /// Camera that the user moves freely; `None` while nothing is open.
    steered: Option<ViewCamera>,
    place: Place,
    is_flying: bool,
    /// Files of the dataset or model for which the camera is kept if it is the next one opened.
    retained_for: Option<FileProposal>,
    pub size_px: [u32; 2],
    /// Camera of the latest picture, including a dataset camera or a keyframe.
    pub(super) latest: Option<Camera>,
    /// Orbit centre that the user has chosen by a double click.
    pivot: Option<DVec3>,
    moved_at: Instant,
}

impl Default for Viewpoint {
    fn default() -> Self {
        let guide = Some(GuideStage::Start);
        Self {
            steered: None,
            place: Place { position: ViewPosition::Free, guide, latest_frame: None },
            is_flying: false,
            retained_for: None,
            size_px: [1, 1],
            latest: None,
            pivot: None,
            moved_at: Instant::now(),
        }
    }
}

impl Viewpoint {
    /// Moves to the home view of a newly opened dataset or model, unless the camera is kept for it.
    pub(super) fn reset_for_subject(&mut self, opened: &Opened) {
        self.place.latest_frame = None;
        if self.retained_for.take().is_none_or(|kept| kept != opened.files) {
            self.go_home(opened);
            // Set after `go_home`, which ends the guide.
            self.place.guide = Some(GuideStage::Start);
        }
    }

    /// Keeps the camera if the same dataset or model is opened next.
    pub fn retain_for(&mut self, opened: &Opened) {
        self.retained_for = Some(opened.files.clone());
    }

    pub fn frame_ref(&self) -> Option<&FrameRef> {
        match &self.place.position {
            ViewPosition::Free | ViewPosition::Along(_) => None,
            ViewPosition::At(frame) => Some(frame),
        }
    }

    pub fn is_free(&self) -> bool {
        self.place.position == ViewPosition::Free
    }

    pub fn is_along(&self) -> bool {
        matches!(self.place.position, ViewPosition::Along(_))
    }

    pub fn is_guided(&self) -> bool {
        self.place.guide.is_some()
    }

    /// True while the user flies the camera with keys. Held keys then trigger no commands.
    pub fn is_flying(&self) -> bool {
        self.is_flying
    }

    pub fn is_moving(&self) -> bool {
        self.moved_at.elapsed() < SETTLE
    }

    /// Records a camera movement. The picture is refined once [`SETTLE`] has passed without another one.
    pub(super) fn note_movement(&mut self) {
        self.moved_at = Instant::now();
    }

    /// Returns the centre of the freely moved camera, world units; `None` while nothing is open.
    pub fn eye(&self) -> Option<DVec3> {
        self.steered.map(|camera| camera.camera(self.size_px).pose.centre())
    }

    /// Returns the orbit centre of the camera, world units; `None` while nothing is open.
    pub fn target(&self) -> Option<DVec3> {
        self.steered.map(|camera| camera.orbit.target)
    }

    pub fn up(&self) -> DVec3 {
        self.steered.map_or(DVec3::Z, |camera| camera.orbit.up)
    }

    pub(super) fn rotation_from_world(&self) -> Option<DMat3> {
        self.steered.map(|camera| camera.camera(self.size_px).pose.inverse().0)
    }

    pub fn own_fov_deg(&self) -> f32 {
        self.steered.map_or(45.0, |camera| camera.own_fov_y.to_degrees() as f32)
    }

    /// Returns the scene radius and the distance between `camera` and the scene's centre, world units.
    pub(super) fn extent(&self, camera: &Camera) -> (f64, f64) {
        self.steered.map_or((1.0, 1.0), |view| (view.radius, view.distance_to_middle(camera)))
    }

    pub fn keyframe(&self) -> Option<Keyframe> {
        let Camera { intrinsics, pose } = self.latest?;
        Some(Keyframe { time: 0.0, pose, fov_y: intrinsics.fov_y() })
    }

    /// Returns a closed camera path of one revolution that starts where the camera is. It circles the place
    /// of the last double click while the camera turns about it, else the middle of the scene.
    pub(super) fn turntable(&self, scene: Option<Framing>) -> Option<CameraPath> {
        let Keyframe { pose, fov_y, .. } = self.keyframe()?;
        let orbit = self.steered?.orbit;
        let is_pivot = self.is_free() && self.pivot == Some(orbit.target);
        let centre = scene.filter(|_| !is_pivot).map_or(orbit.target, |scene| scene.centre);
        let eye = pose.centre();
        let towards = Pose::look_at(eye, centre, orbit.up)?;
        let orbit = Orbit::from_pose(&towards, orbit.up, eye.distance(centre));
        Some(CameraPath::turntable(&orbit, fov_y, TURNTABLE_S))
    }

    /// Returns the camera of the whole viewport, and the part of the viewport that a photograph from
    /// this camera fills.
    pub(super) fn camera_now(
        &mut self,
        settings: &ViewSettings,
        photo_camera: PhotoCamera<'_>,
    ) -> Option<(Camera, Area)> {
        let (steered, size) = (self.steered.as_mut()?, self.size_px);
        let fov_deg = match settings.lens {
            Lens::Pinhole => settings.pinhole_fov_deg,
            Lens::Fisheye => Some(settings.fisheye_fov_deg),
        };
        steered.set_lens(settings.lens, fov_deg.map(|fov| f64::from(fov).to_radians()));
        let shown = match &self.place.position {
            ViewPosition::At(frame) => fit(&photo_camera(frame), size),
            ViewPosition::Along(Keyframe { pose, fov_y, .. }) => {
                let intrinsics = Intrinsics::from_vertical_fov(size[0], size[1], *fov_y);
                (Camera { intrinsics, pose: *pose }, Area::FULL)
            }
            ViewPosition::Free => (steered.camera(size), Area::FULL),
        };
        self.latest = Some(shown.0);
        Some(shown)
    }

    /// Moves the camera by user input. At a dataset camera, the movement starts at the pose of that
    /// camera. `turns` is false during a drag that makes an edit.
    pub(super) fn steer(
        &mut self,
        ui: &Ui,
        response: &Response,
        turns: bool,
        settings: &ViewSettings,
        photo_camera: PhotoCamera<'_>,
    ) {
        let delta = response.drag_delta();
        let delta = [f64::from(delta.x), f64::from(delta.y)];
        let is_turn = turns && response.dragged_by(PointerButton::Primary);
        let is_pan = response.dragged_by(PointerButton::Secondary)
            || response.dragged_by(PointerButton::Middle);
        // The delta belongs to all held buttons together, so only one gesture may use it.
        let turn = if is_turn { delta } else { [0.0; 2] };
        let pan = if is_pan && !is_turn { delta } else { [0.0; 2] };
        // Over a panel the wheel scrolls the panel.
        let dolly = if response.hovered() {
            let (wheel, zoom) = ui.input(|i| (i.smooth_scroll_delta.y, i.zoom_delta()));
            // A pinch divides the distance by its factor.
            f64::from(wheel) + WHEEL_PER_HALVING * f64::from(zoom).log2()
        } else {
            0.0
        };
        let fly = flight(ui, &mut self.is_flying);
        if turn == [0.0; 2] && pan == [0.0; 2] && dolly == 0.0 && fly == [0.0; 3] {
            return;
        }
        self.place.guide = None;
        // Computed before the position becomes free, or the view would jump to the last steered pose.
        let from = self.camera_now(settings, photo_camera).filter(|_| !self.is_free());
        let Some(camera) = &mut self.steered else { return };
        if let Some((from, _)) = from {
            camera.move_to_camera(&from);
            self.place.position = ViewPosition::Free;
        }
        let size = response.rect.size();
        let size = [f64::from(size.x), f64::from(size.y)];
        camera.orbit_by(turn, size[1]);
        camera.pan(pan, size);
        camera.dolly(dolly);
        camera.fly(fly);
        self.note_movement();
    }

    pub(super) fn end_guide(&mut self) {
        self.place.guide = None;
    }

    fn set_free(&mut self) {
        (self.place.position, self.place.guide) = (ViewPosition::Free, None);
        self.note_movement();
    }

    pub(super) fn go_home(&mut self, opened: &Opened) {
        self.steered = Some(ViewCamera::home(&opened.home));
        self.set_free();
    }

    /// Shows the whole scene. The direction of view is kept unless the dataset's cameras have not looked
    /// along it: there is nothing but the back of surfaces.
    pub(super) fn fit_scene(&mut self, scene: Option<Framing>, opened: &Opened) {
        self.set_free();
        if let (Some(camera), Some(scene)) = (&mut self.steered, scene) {
            let seen_from = outward_directions(opened);
            let is_seen = |outward: DVec3| seen_from.iter().any(|o| o.dot(outward) > SEEN_COSINE);
            if !is_seen(camera.orbit.outward())
                && let Some(side) = seen_side(&seen_from, camera.orbit.up)
            {
                camera.set_view_direction(-side);
            }
            camera.fit_scene(&scene, self.size_px);
        }
    }

    /// Makes `point` the orbit centre. `seen_by` is the camera of the picture in which the point was
    /// clicked.
    pub(super) fn set_target(&mut self, point: DVec3, seen_by: &Camera) {
        let is_free = self.is_free();
        let Some(camera) = &mut self.steered else { return };
        // At a dataset camera the steered one is somewhere else.
        if !is_free {
            camera.move_to_camera(seen_by);
        }
        camera.set_target(point);
        self.pivot = Some(camera.orbit.target);
        self.set_free();
    }

    /// If `is_up` is true, makes `axis` point up. Otherwise moves the camera so that it looks at the
    /// orbit centre against the direction of `axis`.
    pub(super) fn apply_axis(&mut self, axis: DVec3, is_up: bool) {
        let Some(camera) = &mut self.steered else { return };
        match is_up {
            true => camera.set_up(axis),
            false => camera.set_view_direction(-axis),
        }
        self.place.guide = None;
        self.note_movement();
    }

    pub fn move_to_frame(&mut self, frame: FrameRef) {
        // Called before the position is set, because it resets the position.
        self.set_free();
        self.place.position = ViewPosition::At(frame.clone());
        self.place.latest_frame = Some(frame);
    }

    /// Moves to the dataset camera visited last, or to the first one. Does nothing if the view is
    /// already at a dataset camera.
    pub(super) fn move_to_any_frame(&mut self, opened: &Opened) {
        let first = || opened.dataset.as_ref().and_then(FrameRef::first);
        if self.is_free()
            && let Some(frame) = self.place.latest_frame.clone().or_else(first)
        {
            self.move_to_frame(frame);
        }
    }

    /// Moves to a keyframe of a camera path. The view stays there until something else moves the camera.
    pub(super) fn move_to_keyframe(&mut self, moment: Keyframe) {
        self.set_free();
        self.place.position = ViewPosition::Along(moment);
    }

    pub fn step(&mut self, opened: &Opened, direction: Direction) {
        let first = || opened.dataset.as_ref().and_then(FrameRef::first);
        let frame = match (&self.place.latest_frame, direction) {
            // The first step after steering returns to the last camera instead of passing it.
            (Some(frame), _) if self.is_free() => Some(frame.clone()),
            (Some(frame), _) => {
                Some(frame.in_current_dataset(opened.dataset.as_ref()).neighbour(direction))
            }
            (None, Direction::Forth) => first(),
            (None, Direction::Back) => first().map(|first| first.neighbour(direction)),
        };
        frame.into_iter().for_each(|frame| self.move_to_frame(frame));
    }

    pub fn place(&self) -> Place {
        self.place.clone()
    }

    pub fn return_to(&mut self, place: Place) {
        self.place = place;
        self.note_movement();
    }

    pub(super) fn toggle_guide(&mut self) {
        self.place.guide = match self.place.guide {
            Some(_) => None,
            None => Some(GuideStage::Start),
        };
    }

    pub(super) fn follow_guide(
        &mut self,
        opened: &Opened,
        snapshot: &Snapshot,
        scene: impl FnOnce() -> Option<Framing>,
    ) {
        let Some(shown) = self.place.guide else { return };
        let now = match (snapshot.state, snapshot.frames.recent.last()) {
            (RunState::Finished | RunState::Failed, _) => GuideStage::End,
            (_, Some(frame)) => GuideStage::Frame(frame.index),
            (_, None) => GuideStage::Overview,
        };
        if now == shown {
            return;
        }
        (self.place.guide, self.place.position) = (Some(now), ViewPosition::Free);
        let Some(camera) = &mut self.steered else { return };
        match now {
            GuideStage::Start => {}
            GuideStage::Overview => {
                if let Some(around) = framing_of_cameras(opened) {
                    camera.fit_scene_from_above(&around, self.size_px);
                    self.note_movement();
                }
            }
            GuideStage::Frame(position) => {
                if let Some(frame) = FrameRef::trained(opened, position) {
                    camera.move_to_camera(&frame.entry().camera);
                }
            }
            GuideStage::End => {
                let is_dataset = snapshot.source == Source::Dataset;
                // A room is shown from its first camera: from outside only the backs of its walls would
                // be visible.
                match scene() {
                    Some(scene) if !(is_dataset && are_inside(&camera_centres(opened), &scene)) => {
                        // The last camera of an object may have been behind it.
                        let seen_from = outward_directions(opened);
                        if let Some(side) = seen_side(&seen_from, camera.orbit.up) {
                            camera.set_view_direction(-side);
                        }
                        camera.fit_scene(&scene, self.size_px);
                    }
                    _ => *camera = ViewCamera::home(&opened.home),
                }
                self.note_movement();
            }
        }
    }
}

fn camera_poses(opened: &Opened) -> impl Iterator<Item = &Pose> {
    let run = opened.dataset.as_ref().zip(opened.plan.as_ref());
    run.into_iter().flat_map(|(dataset, plan)| {
        let frames =
            dataset.splits.get(plan.split).map_or(&[][..], |split| split.frames.as_slice());
        plan.frames.iter().filter_map(move |&index| Some(&frames.get(index)?.camera.pose))
    })
}

fn camera_centres(opened: &Opened) -> Vec<DVec3> {
    camera_poses(opened).map(Pose::centre).collect()
}

/// Returns for each dataset camera the unit vector against its direction of view.
fn outward_directions(opened: &Opened) -> Vec<DVec3> {
    camera_poses(opened).map(|pose| -pose.forward()).collect()
}

/// Cosine of the largest angle between the view and a camera that saw the same side of surfaces.
const SEEN_COSINE: f64 = 0.5;
/// Minimum length of the mean horizontal direction of cameras on one side. Around an object directions
/// cancel.
const ONE_SIDED: f64 = 0.2;

/// Returns the side from which cameras saw the scene, as a unit vector away from the scene: their mean
/// direction, or that of the first camera at their mean height if they are all around. `outwards` are unit
/// vectors. `None` without cameras or if all of them look straight down.
fn seen_side(outwards: &[DVec3], up: DVec3) -> Option<DVec3> {
    let mean = outwards.iter().sum::<DVec3>() / outwards.len().max(1) as f64;
    let level = |direction: DVec3| direction - up * direction.dot(up);
    let (sided, height) = (level(mean), mean.dot(up));
    let across = if sided.length() > ONE_SIDED { sided } else { level(*outwards.first()?) };
    Some(across.try_normalize()? * (1.0 - height * height).max(0.0).sqrt() + up * height)
}

/// Returns a sphere around all dataset cameras. Its centre is halfway between the mean camera position
/// and the target of the home view.
fn framing_of_cameras(opened: &Opened) -> Option<Framing> {
    let centres = camera_centres(opened);
    // At least 1, because the list may be empty; the result is then unused.
    let mean = centres.iter().copied().sum::<DVec3>() / centres.len().max(1) as f64;
    let centre = 0.5 * (mean + opened.home.target);
    let farthest = centres.iter().map(|c| c.distance(centre)).fold(0.0, f64::max);
    // A single camera at the home target would give a radius of 0.
    let radius = farthest.max(0.5 * opened.home.radius);
    (!centres.is_empty()).then_some(Framing { centre, radius })
}

/// True if more than half of the cameras are inside the scene's bounding sphere.
fn are_inside(cameras: &[DVec3], scene: &Framing) -> bool {
    let n = cameras.iter().filter(|c| c.distance(scene.centre) < scene.radius).count();
    2 * n > cameras.len()
}

/// Keys that fly the camera, with directions: right, down, ahead.
const FLYING: [(Key, [f64; 3]); 6] = [
    (Key::W, [0.0, 0.0, 1.0]),
    (Key::S, [0.0, 0.0, -1.0]),
    (Key::A, [-1.0, 0.0, 0.0]),
    (Key::D, [1.0, 0.0, 0.0]),
    (Key::Q, [0.0, 1.0, 0.0]),
    (Key::E, [0.0, -1.0, 0.0]),
];
/// Flight speed in scene radii per second, and its factors while Shift and Ctrl are held.
const SPEED: f64 = 0.5;
const FAST: f64 = 10.0;
const SLOW: f64 = 0.1;
/// Maximum time step of a flight, seconds.
// A slow pass must not cause a large jump.
const MAX_STEP_S: f32 = 0.1;

/// Returns the camera movement caused by the held keys in this egui pass: right, down and ahead, in scene
/// radii.
fn flight(ui: &Ui, is_flying: &mut bool) -> [f64; 3] {
    // The keys then enter text.
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
    // Ctrl slows a flight but starts none, because Ctrl with these keys saves and exports.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_around_an_object_are_outside_and_those_of_a_room_inside() {
        let scene = Framing { centre: DVec3::ZERO, radius: 1.0 };
        assert!(!are_inside(&[DVec3::X * 4.0, DVec3::Y * 4.0, DVec3::ZERO], &scene));
        assert!(are_inside(&[DVec3::X * 0.5, DVec3::ZERO, DVec3::Z * 3.0], &scene));
        assert!(!are_inside(&[], &scene), "a model without cameras is seen whole");
    }

    #[test]
    fn a_scene_is_seen_from_the_side_of_its_cameras() {
        let up = DVec3::Z;
        // Five cameras within 60 degrees, one of which looks down by 30 degrees.
        let fan = [-30.0f64, -15.0, 0.0, 15.0, 30.0].map(|degrees| {
            let angle = degrees.to_radians();
            DVec3::new(angle.sin(), -angle.cos(), 0.0)
        });
        let down = DVec3::new(0.0, -(0.75f64.sqrt()), 0.5);
        let side = seen_side(&[&fan[..], &[down]].concat(), up).unwrap();
        assert!((side.length() - 1.0).abs() < 1e-12 && side.x.abs() < 1e-12, "{side}");
        assert!(side.y < -0.99 && (side.z - 0.5 / 6.0).abs() < 1e-12, "{side}");
        // All around, the first one counts, at the mean height of a half.
        let around: Vec<DVec3> = (0..8)
            .map(|i| {
                let azimuth = f64::from(i) * std::f64::consts::FRAC_PI_4;
                DVec3::new(azimuth.cos(), azimuth.sin(), 0.0) * 0.75f64.sqrt() + 0.5 * up
            })
            .collect();
        let side = seen_side(&around, up).unwrap();
        assert!(side.distance(around[0]) < 1e-12, "{side}");
        assert_eq!(seen_side(&[], up), None);
        assert_eq!(seen_side(&[up], up), None, "straight down has no side");
    }
}
