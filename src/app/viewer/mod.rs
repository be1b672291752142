//! Central view of the scene: camera, comparison, overlays, and painting by GPU or CPU.

mod captions;
pub mod comparison;
mod editing;
pub mod export_preview;
mod frame_points;
pub mod frame_refs;
pub mod measure;
pub mod overlays;
pub mod painter;
pub mod photo;
pub mod settings;
pub mod thumbnails;
pub mod toolbar;
pub mod viewpoint;
mod world_painter;

use super::color_mode::ColorMode;
use super::command::UiCommand;
use super::edit::editor::Editor;
use super::film::Still;
use super::palette::Palette;
use super::panels::signal_color;
use super::selection::PickPurpose;
use super::splat_updates::{SplatChange, SplatUpdate};
use super::state::{NoticeKind, Opened, RunState, Snapshot};
use super::worker::Waker;
use crate::math::camera::Camera;
use crate::math::camera_path::{CameraPath, Keyframe};
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::framing::framing;
use crate::render::attributes::Attribute;
use crate::render::compare::Area;
use crate::render::{Lens, Renderer};
use comparison::Comparison;
use eframe::egui::{Rect, Sense, Ui, Vec2};
use export_preview::ExportChoice;
use frame_refs::{Direction, FrameRef, fit};
use glam::DVec3;
use measure::{MeasureTool, MeasuredWorld, surface_point};
use overlays::Overlays;
use painter::{Effort, Painter, ViewPainter};
use photo::PictureRequest;
use settings::ViewSettings;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use thumbnails::Thumbnails;
use toolbar::ViewMode;
use viewpoint::{SETTLE, Viewpoint};
use world_painter::WorldPainter;

/// Offset of the legend from the lower left corner of the viewport, points.
const LEGEND: Vec2 = Vec2::new(10.0, -10.0);
/// Offset of the measuring tool's panel from the upper left corner of the viewport, points.
const MEASURE: Vec2 = Vec2::new(10.0, 76.0);

pub struct SceneView {
    pub settings: ViewSettings,
    pub camera: Viewpoint,
    pub comparison: Comparison,
    pub overlays: Overlays,
    pub painter: Painter,
    /// Splats in learned and in displayed colours.
    // Kept beside the painter, because its replacement after a GPU failure needs all of them.
    pub palette: Palette,
    pub editor: Editor,
    /// Folders for stored scenes of the run, in order of preference.
    pub past_folders: Arc<[PathBuf]>,
    n_frames: usize,
    /// Serial number of the dataset or model for which the view was set up.
    serial: u64,
    waker: Waker,
}

impl SceneView {
    pub fn new(painter: ViewPainter, settings: ViewSettings, waker: Waker) -> Self {
        Self {
            settings,
            camera: Viewpoint::default(),
            comparison: Comparison::default(),
            overlays: Overlays::default(),
            painter: Painter::new(painter),
            palette: Palette::default(),
            editor: Editor::default(),
            past_folders: Arc::default(),
            n_frames: 0,
            serial: 0,
            waker,
        }
    }

    pub fn apply_update(&mut self, update: SplatUpdate) {
        // Passed on before the palette consumes the update and recolours it.
        self.comparison.change(update.change.clone());
        let at = update.after;
        self.editor.stored_scenes.release_written();
        let change = self.palette.change(update);
        self.editor.stored_scenes.record(
            at,
            self.palette.learned(),
            &self.past_folders,
            self.settings.panels.past_bytes(),
        );
        self.pass_change_to_painter(change);
    }

    /// Replaces the painter and passes the whole scene to the new one.
    pub fn set_painter(&mut self, painter: ViewPainter) {
        self.painter = Painter::new(painter);
        // A new painter is empty, and the trainer sends only changes.
        let splats = self.editor.displayed_splats(&self.palette);
        self.painter.change(SplatChange::All(splats.clone()), splats);
    }

    pub fn learned(&self) -> &Arc<SplatSet> {
        self.palette.learned()
    }

    /// Draws the view into the remaining space. Returns an error message if the GPU failed.
    pub fn ui(&mut self, ui: &mut Ui, snapshot: &Snapshot) -> Option<String> {
        // Not reachable by Tab: the view uses keys that keyboard focus would consume.
        let sense = Sense::CLICK | Sense::DRAG;
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), sense);
        let opened = snapshot.opened.as_deref()?;
        self.comparison.take_preview();
        self.leave_unsupported_modes(opened);
        self.apply_colors_and_edits();
        let pixels = rect.size() * ui.ctx().pixels_per_point();
        let size = [pixels.x.round() as u32, pixels.y.round() as u32];
        if size[0] == 0 || size[1] == 0 {
            return None; // minimised, or squeezed out by the panels
        }
        self.camera.size_px = size;
        self.n_frames = snapshot.n_frames;
        let is_training = snapshot.state == RunState::Training;
        self.camera.follow_guide(opened, snapshot, || framing(self.palette.splats().iter()));
        self.overlays.measure.add_inspected_point(snapshot.inspected.as_deref());
        // Handles are hit where the latest picture shows them.
        let latest = self.camera.latest.and_then(|camera| self.world(ui, rect, &camera, opened));
        self.overlays.edit.begin(ui, &response, &self.editor, latest);
        let edits = self.overlays.edit.is_active();
        if edits {
            // A guided camera must not move during the drag.
            self.camera.end_guide();
        }
        let color_camera = self.comparison.color_camera(opened);
        let scene = self.palette.splats().finishing();
        let photo_camera = |frame: &FrameRef| frame.photo_camera(color_camera.as_ref(), scene);
        // Steered before the camera is computed, so that a drag shows in the same pass.
        self.camera.steer(ui, &response, !edits, &self.settings, &photo_camera);
        let (camera, area) = self.camera.camera_now(&self.settings, &photo_camera)?;
        let photo = self.comparison.request_photo(
            ui,
            self.camera.frame_ref(),
            (opened, &self.settings),
            self.palette.learned(),
            (is_training, &self.waker),
        );
        let known = photo.as_ref().and_then(|photo| photo.as_ref().ok());
        let request =
            self.comparison.picture_request(&self.settings, &self.camera, (camera, area), known);
        let message = self.paint(ui, rect, &request, is_training);
        if !self.camera.is_moving()
            && let Err(error) = self.comparison.preview.measure(&request, is_training, &self.waker)
        {
            let text = format!("Starting the thread that measures the preview failed: {error}");
            self.overlays.show_hint(text);
        }
        let world = self.world(ui, rect, &camera, opened);
        if let Some(world) = &world {
            self.draw_world(ui, world, opened, snapshot);
        }
        if self.camera.is_free() {
            self.camera.gizmo(ui, rect);
        }
        if opened.plan.is_some() {
            self.guide_button(ui, rect);
        }
        if self.overlays.is_measuring() {
            let corner = rect.left_top() + MEASURE;
            self.overlays.measure.ui(ui, corner, &measured_world(opened, snapshot));
        }
        self.draw_captions(ui, rect, &request, photo.as_ref());
        // The past is drawn in its own colours, to which the legend does not apply.
        let legend = self.palette.legend().filter(|_| self.editor.displayed_past().is_none());
        if let Some((attribute, range)) = legend {
            signal_color::ui(attribute, range.as_ref(), rect.left_bottom() + LEGEND, ui);
        }
        let shown = (&request, world.as_ref());
        self.overlays.edit.update(ui, &response, shown, &mut self.editor, &self.palette);
        // Picking needs positions, not colours, and these splats are shared without a copy.
        let splats = self.editor.pickable_splats(&self.palette);
        let measures = self.overlays.is_measuring();
        let picked = self.overlays.selection.ui(
            ui,
            &response,
            &request,
            splats,
            snapshot,
            &self.waker,
            measures,
        );
        message.or(picked.err().map(|e| format!("starting the picking thread failed: {e}")))
    }

    /// Returns a painter of overlays in world coordinates; `None` for a fisheye, which bends straight
    /// lines.
    fn world(&self, ui: &Ui, rect: Rect, camera: &Camera, opened: &Opened) -> Option<WorldPainter> {
        let is_pinhole = !self.camera.is_free() || self.settings.lens == Lens::Pinhole;
        is_pinhole.then(|| WorldPainter::new(ui, rect, camera, opened.home.radius))
    }

    fn draw_world(&mut self, ui: &Ui, world: &WorldPainter, opened: &Opened, snapshot: &Snapshot) {
        if self.settings.shows_grid {
            world.grid(self.camera.up(), opened.home.radius);
        }
        let run = (opened, snapshot);
        // Always before training, when there is nothing else to see.
        if self.settings.shows_cameras || snapshot.frames_done == 0 {
            self.overlays.draw_cameras(ui, world, run, &self.waker);
        }
        if self.settings.shows_points {
            let (frame, scene) = (self.camera.frame_ref(), self.palette.splats().finishing());
            self.overlays.draw_points(world, frame, run, scene, &self.waker);
        }
        if self.overlays.is_measuring() {
            self.overlays.measure.draw(world, &measured_world(opened, snapshot));
        }
        self.overlays.draw_path(world, opened.home.radius);
    }

    fn leave_unsupported_modes(&mut self, opened: &Opened) {
        if self.mode_unavailable_reason(self.comparison.mode(), opened).is_some() {
            self.comparison.set_mode(ViewMode::Single);
        }
        if self.color_unavailable_reason(self.settings.color_mode, opened).is_some() {
            self.settings.color_mode = Default::default();
        }
    }

    fn paint(
        &mut self,
        ui: &Ui,
        rect: Rect,
        request: &PictureRequest,
        is_training: bool,
    ) -> Option<String> {
        let moving = self.camera.is_moving();
        let effort = Effort::new(is_training, moving);
        if moving {
            // egui does not repaint without input: one more pass refines the picture.
            ui.ctx().request_repaint_after(SETTLE);
        }
        let splats = self.editor.displayed_splats(&self.palette);
        let reason = self.painter.paint(ui, rect, request, effort, splats).err()?;
        Some(match ViewPainter::software(&self.waker) {
            Ok(painter) => {
                self.set_painter(painter);
                self.painter.gpu_failed = true;
                format!(
                    "the GPU can no longer draw the scene ({reason}); the CPU renderer is used instead; retry the GPU in Settings"
                )
            }
            Err(error) => format!(
                "the GPU cannot draw the scene ({reason}) and starting the CPU renderer failed ({error}); export the scene and restart the program"
            ),
        })
    }

    /// Starts an egui pass. Returns the time to wait before it is drawn.
    pub fn begin_pass(&mut self, state: RunState) -> Duration {
        self.painter.begin_pass(state == RunState::Training && self.camera.is_moving())
    }

    /// Returns the thumbnails of the open dataset; `None` if their thread could not be started.
    pub fn thumbnails(&mut self, opened: &Opened) -> Option<&mut Thumbnails> {
        self.overlays.thumbnails(opened, &self.waker)
    }

    pub fn editor(&self) -> &Editor {
        &self.editor
    }

    /// Returns the attribute that the worker delivers with components: the displayed one, else evidence
    /// if a panel needs attributes.
    fn watched_attribute(&self) -> Option<Attribute> {
        let for_panels = self.editor.needs_attributes.then_some(Attribute::Evidence);
        // Textures hold their shares themselves.
        let shown = self.settings.color_mode.attribute().filter(|&a| a != Attribute::Texture);
        shown.or(for_panels)
    }

    /// Returns the attribute that the worker must deliver, and resets the requests of panels. Called at the
    /// end of an egui pass.
    pub fn take_watched_attribute(&mut self) -> Option<Attribute> {
        let watched = self.watched_attribute();
        // Panels renew their requests in the next pass.
        (self.editor.needs_attributes, self.editor.shows_crop) = (false, false);
        watched
    }

    fn apply_colors_and_edits(&mut self) {
        self.palette.set_stores_attributes(self.watched_attribute().is_some());
        if let Some(change) = self.palette.set_attribute(self.settings.color_mode.attribute()) {
            self.pass_change_to_painter(change);
        }
        if let Some(change) = self.editor.update_visible(&self.palette) {
            self.painter.change(change, self.editor.displayed_splats(&self.palette));
        }
    }

    fn pass_change_to_painter(&mut self, change: SplatChange) {
        if let Some(change) = self.editor.apply_change(change, &self.palette) {
            self.painter.change(change, self.editor.displayed_splats(&self.palette));
        }
    }

    /// Resets the view if another dataset or model is open: no camera, comparison or pending pick of the
    /// previous one remains. Must be called with every snapshot, before the view is drawn or handles keys.
    /// Returns the text of a notice if a second model is lost.
    pub fn reset_for_subject(&mut self, opened: &Opened) -> Option<String> {
        if self.serial == opened.serial {
            return None;
        }
        self.serial = opened.serial;
        self.overlays.reset_for_subject();
        self.comparison.end_preview();
        self.comparison.set_mode(ViewMode::Single);
        self.editor.reset();
        self.camera.reset_for_subject(opened);
        self.comparison.enter_world(opened)
    }

    pub fn is_another(&self, opened: &Opened) -> bool {
        self.serial != opened.serial
    }

    pub fn apply(&mut self, command: UiCommand, opened: &Opened) {
        let settings = &mut self.settings;
        match command {
            UiCommand::FrameScene => {
                self.camera.fit_scene(self.editor.framing(&self.palette), opened);
            }
            UiCommand::Home => self.camera.go_home(opened),
            UiCommand::ToggleRenderer if settings.lens == Lens::Fisheye => {
                let text = "Only the exact renderer supports a fisheye: choose the pinhole first";
                self.overlays.show_hint(text);
            }
            UiCommand::ToggleRenderer => {
                settings.renderer = match settings.renderer {
                    Renderer::Projected => Renderer::Exact,
                    Renderer::Exact => Renderer::Projected,
                };
            }
            UiCommand::PreviousCamera => self.camera.step(opened, Direction::Back),
            UiCommand::NextCamera => self.camera.step(opened, Direction::Forth),
            UiCommand::AutoCamera => self.camera.toggle_guide(),
            UiCommand::Measure => self.overlays.measure.toggle(),
            UiCommand::Cameras => settings.shows_cameras = !settings.shows_cameras,
            UiCommand::Points => {
                settings.shows_points = !settings.shows_points;
                self.overlays.clear_points();
            }
            UiCommand::Grid => settings.shows_grid = !settings.shows_grid,
            UiCommand::ComparePhoto if self.comparison.mode().has_photo() => {
                self.set_mode(ViewMode::Single, opened);
            }
            UiCommand::ComparePhoto => self.set_mode(ViewMode::PhotoWipe, opened),
            // The editor ignores commands that are not its own.
            edit => self.editor.execute(edit, &self.palette),
        }
    }

    pub fn mode_unavailable_reason(&self, mode: ViewMode, opened: &Opened) -> Option<&'static str> {
        let model = self.comparison.model().map(|model| &**model);
        mode.unavailable_reason(self.settings.lens, opened, model)
    }

    pub fn color_unavailable_reason(
        &self,
        mode: ColorMode,
        opened: &Opened,
    ) -> Option<&'static str> {
        let has_textures = self.learned().finishing().textures.is_some();
        mode.unavailable_reason(opened.available_modes, has_textures)
    }

    pub fn set_mode(&mut self, mode: ViewMode, opened: &Opened) {
        self.comparison.set_mode(mode);
        if mode.needs_frame() {
            self.camera.move_to_any_frame(opened);
        }
    }

    pub fn compare_at(&mut self, frame: FrameRef, opened: &Opened) {
        self.camera.move_to_frame(frame);
        if !self.comparison.mode().has_photo() {
            self.set_mode(ViewMode::PhotoWipe, opened);
        }
    }

    pub fn move_to_keyframe(&mut self, moment: Keyframe) {
        if self.comparison.mode().needs_frame() {
            self.comparison.set_mode(ViewMode::Single);
        }
        self.camera.move_to_keyframe(moment);
    }

    pub fn compare_with(&mut self, path: PathBuf) -> std::io::Result<()> {
        self.overlays.show_hint(format!("Reading {}…", path.display()));
        self.comparison.read(path, &self.waker)
    }

    /// Shows a second model if its file has been read, and returns its notices. `up` and `origin` are the
    /// scene's up direction and local origin, to which the model is moved.
    pub fn take_compared(&mut self, up: DVec3, origin: DVec3) -> Vec<(NoticeKind, String)> {
        let read = self.comparison.take_read(up, origin);
        if read.is_some() {
            self.overlays.clear_hint();
        }
        read.unwrap_or_default()
    }

    /// Previews an export beside the scene, or ends the preview.
    pub fn preview_export(
        &mut self,
        choice: Option<ExportChoice>,
        opened: &Opened,
        state: RunState,
    ) -> std::io::Result<()> {
        let Some(choice) = choice else {
            self.comparison.end_preview();
            return Ok(());
        };
        let (frame, scene) = ((opened.home.up, opened.local_origin), self.palette.learned());
        let is_training = state == RunState::Training;
        let preview = &mut self.comparison.preview;
        preview.request_conversion(choice, scene, frame, is_training, &self.waker)
    }

    /// Returns a closed path around the middle of the displayed scene, or around the user's pivot.
    pub fn turntable(&self) -> Option<CameraPath> {
        self.camera.turntable(self.editor.framing(&self.palette))
    }

    /// Returns the data for rendering the current view to a file of `size` pixels: only the scene, without
    /// comparison and overlays. What the viewport shows is whole in a picture of any shape.
    pub fn still(&self, size: [u32; 2], is_beside_training: bool) -> Option<Still> {
        let (camera, _) = fit(&self.camera.latest?, size);
        let shown = (camera, Area::FULL);
        // Without a photograph, and over the whole viewport: a file shows the scene alone.
        let request = self.comparison.picture_request(&self.settings, &self.camera, shown, None);
        let splats = self.editor.displayed_splats(&self.palette).clone();
        Some(Still { splats, camera, options: request.options, is_beside_training })
    }

    /// Returns the slot of the splat that was clicked for inspection, once per click; `Some(None)` if no
    /// splat was hit. After a double click, moves the orbit centre to the clicked point instead.
    pub fn take_picked(&mut self) -> Option<Option<u32>> {
        let found = self.overlays.selection.take_picked()?;
        let picked = found
            .inspect_err(|panic| {
                let text = panic.failure_notice("finding the splat under the pointer");
                self.overlays.show_hint(text);
            })
            .ok()?;
        if self.editor.displayed_past().is_some() && picked.purpose != PickPurpose::Pivot {
            let text = "Only current splats can be inspected: return to them in the Edit tab";
            self.overlays.show_hint(text);
            return None;
        }
        if picked.purpose == PickPurpose::Select {
            return Some(picked.splat);
        }
        let splat = self.editor.pickable_splats(&self.palette).get(picked.splat? as usize)?;
        let point = surface_point(splat, &picked.camera, picked.pixel);
        if picked.purpose == PickPurpose::Measure {
            self.overlays.measure.waiting = Some((picked.splat?, point));
            return Some(picked.splat);
        }
        self.camera.set_target(point, &picked.camera);
        None
    }

    pub fn take_retained_state(&mut self) -> KeptView {
        KeptView {
            serial: self.serial,
            camera: std::mem::take(&mut self.camera),
            comparison: self.comparison.take_retained(),
            measure: std::mem::take(&mut self.overlays.measure),
            editor: std::mem::take(&mut self.editor),
        }
    }

    /// Restores the view state of the previous window. Opening another dataset or model resets it.
    pub fn restore_retained_state(&mut self, kept: KeptView) {
        (self.serial, self.camera, self.comparison) = (kept.serial, kept.camera, kept.comparison);
        self.overlays.measure = kept.measure;
        self.editor = kept.editor.without_scene();
    }
}

// Only while measuring: whether units are metres is found by a search through the frames.
fn measured_world<'a>(opened: &Opened, snapshot: &'a Snapshot) -> MeasuredWorld<'a> {
    MeasuredWorld {
        registration: snapshot.registration.as_deref(),
        up: opened.home.up,
        origin: opened.local_origin,
        is_metric: opened.dataset.as_ref().is_some_and(|dataset| dataset.is_metric()),
    }
}

/// View state that the next window restores if the same dataset or model is still open.
pub struct KeptView {
    serial: u64,
    camera: Viewpoint,
    comparison: Comparison,
    measure: MeasureTool,
    editor: Editor,
}
