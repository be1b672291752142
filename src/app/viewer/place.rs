//! Commands and clicks that move the camera.

use super::SceneView;
use super::frame_points::FramePoints;
use super::frame_refs::{Direction, FrameRef};
use super::measure::{MeasureTool, MeasuredLength, surface_point};
use super::photo::PictureRequest;
use super::steering::{GuideStage, ViewPosition};
use super::toolbar::ViewMode;
use crate::app::camera::ViewCamera;
use crate::app::command::UiCommand;
use crate::app::film::Still;
use crate::app::selection::{PickPurpose, SplatSelection};
use crate::app::state::Opened;
use crate::math::camera::Camera;
use crate::math::camera_path::{CameraPath, Keyframe};
use crate::render::compare::Area;
use crate::render::{Lens, Renderer};
use glam::DVec3;
use std::time::Instant;

/// Duration of a turntable revolution, seconds.
const TURNTABLE_S: f64 = 12.0;

impl SceneView {
    /// Resets the view if another subject is open. Call it with every snapshot before anything is drawn
    /// from it or any key is handled, so that no camera, comparison or pending pick of the previous
    /// subject remains.
    pub fn reset_for_subject(&mut self, opened: &Opened) {
        if self.serial == opened.serial {
            return;
        }
        self.serial = opened.serial;
        self.latest_frame = None;
        self.measure = MeasureTool::default();
        self.end_preview();
        self.points = FramePoints::default();
        self.mode = ViewMode::Single;
        self.selection = SplatSelection::default();
        self.editor.reset();
        if self.retained_for.take().is_some_and(|kept| kept == opened.files) {
            return;
        }
        self.go_home(opened);
        self.guide = Some(GuideStage::Start);
    }

    /// True while the view still shows another subject.
    pub fn is_another(&self, opened: &Opened) -> bool {
        self.serial != opened.serial
    }

    /// Retains the camera when the same files are opened again, once.
    pub fn retain_camera_for(&mut self, opened: &Opened) {
        self.retained_for = Some(opened.files.clone());
    }

    /// Moves to a dataset camera and compares with its photograph.
    pub fn compare_at(&mut self, frame: FrameRef, opened: &Opened) {
        self.move_to_frame(frame);
        if !self.mode.has_photo() {
            self.set_mode(ViewMode::PhotoWipe, opened);
        }
    }

    /// True if clicks measure.
    pub fn is_measuring(&self) -> bool {
        self.measure.is_on
    }

    /// Number of points clicked for a measurement.
    pub fn n_measured(&self) -> usize {
        self.measure.n_ends()
    }

    /// Measured length, once two points were clicked.
    pub fn measured(&self) -> Option<MeasuredLength> {
        self.measure.length()
    }

    /// Takes the splat clicked for inspection, once; `Some(None)` if there was none. A double click
    /// moves the orbit centre to the clicked point instead.
    pub fn take_picked(&mut self) -> Option<Option<u32>> {
        let found = self.selection.take_picked()?;
        let picked = found
            .inspect_err(|panic| {
                let text = panic.failure_notice("finding the splat under the pointer");
                self.hint = Some((text, Instant::now()));
            })
            .ok()?;
        if self.editor.displayed_past().is_some() && picked.purpose != PickPurpose::Pivot {
            let text = "Only current splats can be inspected: return to them in the Edit tab";
            self.hint = Some((text.to_owned(), Instant::now()));
            return None;
        }
        if picked.purpose == PickPurpose::Select {
            return Some(picked.splat);
        }
        let splat = self.editor.pickable_splats(&self.palette).get(picked.splat? as usize)?;
        let point = surface_point(splat, &picked.camera, picked.pixel);
        if picked.purpose == PickPurpose::Measure {
            self.measure.set_pending_point(picked.splat?, point);
            return Some(picked.splat);
        }
        let camera = self.camera.as_mut()?;
        if self.place != ViewPosition::Free {
            camera.move_to_camera(&picked.camera);
        }
        camera.set_target(point);
        (self.place, self.guide) = (ViewPosition::Free, None);
        self.moved_at = Instant::now();
        None
    }

    /// Executes a command of the view.
    pub fn apply(&mut self, command: UiCommand, opened: &Opened) {
        match command {
            UiCommand::FrameScene => self.frame_scene(),
            UiCommand::Home => {
                self.go_home(opened);
                self.guide = None;
            }
            UiCommand::ToggleRenderer => self.toggle_renderer(),
            UiCommand::PreviousCamera => self.step(opened, Direction::Back),
            UiCommand::NextCamera => self.step(opened, Direction::Forth),
            UiCommand::AutoCamera => self.toggle_guide(),
            UiCommand::Measure => self.measure.toggle(),
            UiCommand::Cameras => {
                self.settings.shows_cameras = !self.settings.shows_cameras;
            }
            UiCommand::Points => self.toggle_points(),
            UiCommand::Grid => self.settings.shows_grid = !self.settings.shows_grid,
            UiCommand::ComparePhoto if self.mode.has_photo() => {
                self.set_mode(ViewMode::Single, opened);
            }
            UiCommand::ComparePhoto => self.set_mode(ViewMode::PhotoWipe, opened),
            // The editor ignores commands that are not its own.
            edit => self.editor.execute(edit, &self.palette),
        }
    }

    /// Sets the comparison mode; photographs are compared at a dataset camera.
    pub fn set_mode(&mut self, mode: ViewMode, opened: &Opened) {
        self.mode = mode;
        if mode.needs_frame() && self.place == ViewPosition::Free {
            let first = || opened.dataset.as_ref().and_then(FrameRef::first);
            if let Some(frame) = self.latest_frame.clone().or_else(first) {
                self.move_to_frame(frame);
            }
        }
    }

    fn toggle_renderer(&mut self) {
        if self.settings.lens == Lens::Fisheye {
            let text = "Only the exact renderer supports a fisheye: choose the pinhole first";
            self.hint = Some((text.to_owned(), Instant::now()));
            return;
        }
        self.settings.renderer = match self.settings.renderer {
            Renderer::Projected => Renderer::Exact,
            Renderer::Exact => Renderer::Projected,
        };
    }

    fn frame_scene(&mut self) {
        (self.place, self.guide) = (ViewPosition::Free, None);
        if let (Some(camera), Some(framing)) =
            (&mut self.camera, self.editor.framing(&self.palette))
        {
            camera.fit_scene(&framing, self.viewport);
            self.moved_at = Instant::now();
        }
    }

    fn go_home(&mut self, opened: &Opened) {
        self.camera = Some(ViewCamera::home(&opened.home));
        self.place = ViewPosition::Free;
        self.moved_at = Instant::now();
    }

    fn step(&mut self, opened: &Opened, direction: Direction) {
        let frame = match (&self.latest_frame, direction) {
            // The first step after steering returns to the last camera instead of passing it.
            (Some(frame), _) if self.place == ViewPosition::Free => Some(frame.clone()),
            (Some(frame), _) => {
                Some(frame.in_current_dataset(opened.dataset.as_ref()).neighbour(direction))
            }
            (None, Direction::Forth) => opened.dataset.as_ref().and_then(FrameRef::first),
            (None, Direction::Back) => {
                let first = opened.dataset.as_ref().and_then(FrameRef::first);
                first.map(|first| first.neighbour(direction))
            }
        };
        if let Some(frame) = frame {
            self.move_to_frame(frame);
        }
    }

    /// Camera of the latest picture, as a keyframe.
    pub fn keyframe(&self) -> Option<Keyframe> {
        let Camera { intrinsics, pose } = self.latest_camera?;
        Some(Keyframe { time: 0.0, pose, fov_y: intrinsics.fov_y() })
    }

    /// Returns the current picture for a file: the scene alone, without comparison and overlays.
    pub fn still(&self) -> Option<Still> {
        let camera = self.latest_camera?;
        let PictureRequest { options, .. } = self.picture_request(camera, Area::FULL, None);
        Some(Still { splats: self.editor.displayed_splats(&self.palette).clone(), camera, options })
    }

    /// Path of one revolution about the orbit centre, from the current camera.
    pub fn turntable(&self) -> Option<CameraPath> {
        let fov_y = self.keyframe()?.fov_y;
        Some(CameraPath::turntable(&self.camera?.orbit(), fov_y, TURNTABLE_S))
    }

    /// Moves to a keyframe of a camera path, until something else moves the camera.
    pub fn move_to_keyframe(&mut self, moment: Keyframe) {
        if self.mode.needs_frame() {
            self.mode = ViewMode::Single;
        }
        (self.place, self.guide) = (ViewPosition::Along(moment), None);
        self.moved_at = Instant::now();
    }

    /// True while the camera is on a path.
    pub fn is_along(&self) -> bool {
        matches!(self.place, ViewPosition::Along(_))
    }

    /// Up direction, unit length.
    pub fn up(&self) -> DVec3 {
        self.camera.map_or(DVec3::Z, |camera| camera.up())
    }

    /// Moves to a dataset camera.
    pub fn move_to_frame(&mut self, frame: FrameRef) {
        (self.place, self.guide) = (ViewPosition::At(frame.clone()), None);
        self.latest_frame = Some(frame);
        self.moved_at = Instant::now();
    }
}
