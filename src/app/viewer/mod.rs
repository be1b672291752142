//! Central view: camera, comparison modes, and painting on GPU or CPU.

mod captions;
pub mod comparison;
mod editing;
pub mod export_preview;
mod frame_points;
pub mod frame_refs;
mod frusta;
mod guide;
pub mod measure;
pub mod painter;
pub mod photo;
mod place;
pub mod previewing;
pub mod settings;
mod steering;
pub mod thumbnails;
pub mod toolbar;
mod world_painter;

use super::camera::ViewCamera;
use super::drawing::DrawHistory;
use super::edit::editor::Editor;
use super::opening::FileProposal;
use super::palette::Palette;
use super::panels::signal_color;
use super::selection::SplatSelection;
use super::software::Effort;
use super::splat_updates::{SplatChange, SplatUpdate};
use super::state::{Opened, RunState, Snapshot};
use super::worker::Waker;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::camera_path::Keyframe;
use crate::model::splat::appearance::SplatSet;
use crate::render::Lens;
use crate::render::compare::Area;
use comparison::ModelSlot;
use editing::EditDrag;
use eframe::egui::{Rect, Sense, Ui, Vec2};
use export_preview::ExportPreview;
use frame_points::FramePoints;
use frame_refs::{FrameRef, fit};
use glam::DVec3;
use measure::MeasureTool;
use painter::ViewPainter;
use photo::{PhotoRequests, PictureRequest};
use settings::ViewSettings;
use std::sync::Arc;
use std::time::{Duration, Instant};
use steering::{GuideStage, ViewPosition};
use thumbnails::Thumbnails;
use toolbar::ViewMode;
use world_painter::WorldPainter;

/// Time after the last movement until the picture is refined.
const SETTLE: Duration = Duration::from_millis(150);

/// Offset of the legend from the lower left corner of the viewport, points.
const LEGEND: Vec2 = Vec2::new(10.0, -10.0);

/// State of the central view.
pub struct SceneView {
    /// Settings of the viewport.
    pub settings: ViewSettings,
    mode: ViewMode,
    painter: ViewPainter,
    waker: Waker,
    camera: Option<ViewCamera>,
    place: ViewPosition,
    /// Stage of a guided camera; `None` once the user has steered.
    guide: Option<GuideStage>,
    is_flying: bool,
    measure: MeasureTool,
    /// Files of the subject whose camera is retained if it is opened again.
    retained_for: Option<FileProposal>,
    /// Size of the viewport in the last pass, pixels.
    viewport: [u32; 2],
    /// Serial of the dataset, and its thumbnails.
    thumbnails: Option<(u64, Thumbnails)>,
    /// Dataset camera visited last, from which stepping continues.
    latest_frame: Option<FrameRef>,
    /// Camera of the latest picture.
    latest_camera: Option<Camera>,
    /// Position of the wipe divider, as a share of the viewport's width.
    divider: f32,
    compared: ModelSlot,
    /// Replaces `compared` while an export is previewed.
    preview: ExportPreview,
    points: FramePoints,
    /// Started with the first photograph.
    photos: Option<PhotoRequests>,
    hint: Option<(String, Instant)>,
    /// Serial of the subject for which the camera was set up.
    serial: u64,
    /// Displayed splats: for framing, for the painter, and for its replacement if the GPU fails.
    palette: Palette,
    editor: Editor,
    n_frames: usize,
    edit_drag: Option<EditDrag>,
    /// Latest selection rectangle, points.
    latest_box: Option<Rect>,
    selection: SplatSelection,
    moved_at: Instant,
    drawn: DrawHistory,
    /// Start of the last pass of the window.
    passed_at: Instant,
    gpu_failed: bool,
}

impl SceneView {
    /// Creates a view of nothing.
    pub fn new(painter: ViewPainter, settings: ViewSettings, waker: Waker) -> Self {
        Self {
            settings,
            mode: ViewMode::Single,
            drawn: DrawHistory::new(painter.drawer()),
            painter,
            waker,
            camera: None,
            place: ViewPosition::Free,
            guide: Some(GuideStage::Start),
            is_flying: false,
            measure: MeasureTool::default(),
            retained_for: None,
            viewport: [1, 1],
            thumbnails: None,
            latest_frame: None,
            latest_camera: None,
            divider: 0.5,
            compared: ModelSlot::default(),
            preview: ExportPreview::default(),
            points: FramePoints::default(),
            photos: None,
            hint: None,
            serial: 0,
            palette: Palette::default(),
            editor: Editor::default(),
            n_frames: 0,
            edit_drag: None,
            latest_box: None,
            selection: SplatSelection::default(),
            moved_at: Instant::now(),
            passed_at: Instant::now(),
            gpu_failed: false,
        }
    }

    /// Applies an update of the splats.
    pub fn apply_update(&mut self, update: SplatUpdate) {
        if let Some(photos) = &mut self.photos {
            // With learned colours: the PSNR must not depend on the displayed colours.
            photos.change(update.change.clone());
        }
        self.preview.outdate();
        let n_frames = update.n_frames;
        self.editor.stored_scenes.install_finished_copies();
        let change = self.palette.change(update);
        self.editor.stored_scenes.record(
            n_frames,
            self.palette.learned(),
            self.settings.past_bytes(),
        );
        self.pass_change_to_painter(change);
    }

    /// True if the CPU draws because the GPU failed.
    pub fn gpu_failed(&self) -> bool {
        self.gpu_failed
    }

    /// Records that a GPU exists but could not be used from the start.
    pub fn note_gpu_failure(&mut self) {
        self.gpu_failed = true;
    }

    /// Replaces the painter and passes it the whole scene.
    pub fn set_painter(&mut self, mut painter: ViewPainter) {
        // A new painter is empty, and the trainer sends only changes.
        let splats = self.editor.displayed_splats(&self.palette);
        painter.change(SplatChange::All(splats.clone()), splats);
        self.drawn = DrawHistory::new(painter.drawer());
        self.painter = painter;
        self.gpu_failed = false;
    }

    /// Number of splats in the picture.
    pub fn n_drawn(&self) -> usize {
        self.painter.n_drawn()
    }

    /// Timings of recent pictures.
    pub fn drawn(&self) -> &DrawHistory {
        &self.drawn
    }

    /// Comparison mode.
    pub fn mode(&self) -> ViewMode {
        self.mode
    }

    /// Splats in learned colours, whatever colours are displayed.
    pub fn learned(&self) -> &Arc<SplatSet> {
        self.palette.learned()
    }

    /// Dataset camera in view, if any.
    pub fn frame_ref(&self) -> Option<&FrameRef> {
        match &self.place {
            ViewPosition::Free | ViewPosition::Along(_) => None,
            ViewPosition::At(frame) => Some(frame),
        }
    }

    /// Position of the wipe divider, as a share of the viewport's width.
    pub fn divider(&self) -> f32 {
        self.divider
    }

    /// Size of the viewport in the last pass, pixels.
    pub fn size_px(&self) -> [u32; 2] {
        self.viewport
    }

    /// Centre of the steered camera, world units; `None` while nothing is open.
    pub fn eye(&self) -> Option<DVec3> {
        self.camera.map(|camera| camera.camera(self.viewport).pose.centre())
    }

    /// Orbit centre of the camera, world units; `None` while nothing is open.
    pub fn target(&self) -> Option<DVec3> {
        self.camera.map(|camera| camera.target())
    }

    /// Vertical field of view of the scene's own camera, degrees.
    pub fn own_fov_deg(&self) -> f32 {
        self.camera.map_or(45.0, |camera| camera.own_fov_y().to_degrees() as f32)
    }

    /// Draws the view into the remaining space. Returns a message if the GPU failed.
    pub fn ui(&mut self, ui: &mut Ui, snapshot: &Snapshot) -> Option<String> {
        // Not reachable by Tab: the view uses keys that keyboard focus would consume.
        let sense = Sense::CLICK | Sense::DRAG;
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), sense);
        let opened = snapshot.opened.as_ref()?;
        self.take_preview();
        self.leave_unsupported_modes(opened);
        let pixels = rect.size() * ui.ctx().pixels_per_point();
        let size = [pixels.x.round() as u32, pixels.y.round() as u32];
        if size[0] == 0 || size[1] == 0 {
            return None; // minimised, or squeezed out by the panels
        }
        self.viewport = size;
        self.n_frames = snapshot.n_frames;
        self.follow_guide(opened, snapshot);
        self.measure.add_inspected_point(snapshot.inspected.as_deref());
        self.begin_edit(ui, &response, opened);
        // Before the camera is computed, so that a drag shows in the same pass.
        self.steer(ui, &response, opened, size);
        let (camera, area) = self.camera_now(opened, size)?;
        self.latest_camera = Some(camera);
        let result = self.request_photo_result(ui, opened, snapshot.state == RunState::Training);
        let request =
            self.picture_request(camera, area, result.as_ref().and_then(|s| s.as_ref().ok()));
        let message = self.paint(ui, rect, &request, snapshot.state);
        self.measure_preview(&request, snapshot.state);
        self.draw_world(ui, rect, &request, opened, snapshot);
        self.draw_captions(ui, rect, &request, result);
        // The past is drawn in its own colours, to which the legend does not apply.
        let legend = self.palette.legend().filter(|_| self.editor.displayed_past().is_none());
        if let Some((attribute, range)) = legend {
            signal_color::ui(attribute, range.as_ref(), rect.left_bottom() + LEGEND, ui);
        }
        self.update_edit_drag(ui, &response, &request, opened);
        // Picking needs positions, not colours, and these splats are shared without a copy.
        let splats = self.editor.pickable_splats(&self.palette);
        let picked = self.selection.ui(
            ui,
            &response,
            &request,
            splats,
            snapshot,
            &self.waker,
            self.measure.is_on,
        );
        message.or(picked.err().map(|e| format!("starting the picking thread failed: {e}")))
    }

    /// Draws the overlays in world coordinates.
    fn draw_world(
        &mut self,
        ui: &Ui,
        rect: Rect,
        request: &PictureRequest,
        opened: &Opened,
        snapshot: &Snapshot,
    ) {
        let is_pinhole = self.place != ViewPosition::Free || self.settings.lens == Lens::Pinhole;
        if is_pinhole {
            let radius = opened.home.radius;
            let world = WorldPainter::new(ui, rect, &request.camera, radius);
            if self.settings.shows_grid {
                self.grid(&world, radius);
            }
            if self.shows_cameras(snapshot) {
                self.draw_frusta(ui, &world, opened, snapshot);
            }
            if self.settings.shows_points {
                self.draw_frame_points(&world, opened, snapshot);
            }
            self.measure.draw(&world);
        }
        if self.place == ViewPosition::Free {
            self.gizmo(ui, rect);
        }
    }

    /// Leaves modes that the scene or lens does not support, and applies colours and edits.
    fn leave_unsupported_modes(&mut self, opened: &Opened) {
        if self.mode_unavailable_reason(self.mode, opened).is_some() {
            self.mode = ViewMode::Single;
        }
        if self.settings.color_mode.unavailable_reason(opened.available_modes).is_some() {
            self.settings.color_mode = Default::default();
        }
        self.apply_colors_and_edits();
    }

    /// Returns the camera for a viewport of `size` pixels, and the area that a photograph would fill.
    fn camera_now(&mut self, opened: &Opened, size: [u32; 2]) -> Option<(Camera, Area)> {
        let camera = self.camera.as_mut()?;
        let settings = &self.settings;
        let fov_deg = match settings.lens {
            Lens::Pinhole => settings.pinhole_fov_deg,
            Lens::Fisheye => Some(settings.fisheye_fov_deg),
        };
        camera.set_lens(settings.lens, fov_deg.map(|fov| f64::from(fov).to_radians()));
        match &self.place {
            ViewPosition::At(frame) => {
                let color_camera = self.color_camera(opened);
                let scene = self.palette.splats().finishing();
                Some(fit(&frame.photo_camera(color_camera.as_ref(), scene), size))
            }
            ViewPosition::Along(moment) => Some((camera_at_keyframe(moment, size), Area::FULL)),
            ViewPosition::Free => Some((camera.camera(size), Area::FULL)),
        }
    }

    fn paint(
        &mut self,
        ui: &Ui,
        rect: Rect,
        request: &PictureRequest,
        state: RunState,
    ) -> Option<String> {
        let moving = self.moved_at.elapsed() < SETTLE;
        // Training takes precedence over pictures, even while the camera moves.
        let effort = match (state, moving) {
            (RunState::Training, _) => Effort::BesideTraining,
            (_, true) => Effort::Moving,
            (_, false) => Effort::Full,
        };
        if moving {
            // egui does not repaint without input: one more pass refines the picture.
            ui.ctx().request_repaint_after(SETTLE);
        }
        let splats = self.editor.displayed_splats(&self.palette);
        match self.painter.paint(ui, rect, request, effort, splats) {
            Ok(sample) => {
                sample.into_iter().for_each(|sample| self.drawn.push(sample));
                None
            }
            Err(error) => self.fall_back_to_cpu(&error.to_string()),
        }
    }

    /// Falls back to the CPU renderer and passes it the whole scene.
    fn fall_back_to_cpu(&mut self, reason: &str) -> Option<String> {
        match ViewPainter::software(&self.waker) {
            Ok(painter) => {
                self.set_painter(painter);
                self.gpu_failed = true;
                Some(format!(
                    "the GPU can no longer draw the scene ({reason}); the CPU renderer is used instead; retry the GPU in Settings"
                ))
            }
            Err(error) => Some(format!(
                "the GPU cannot draw the scene ({reason}) and starting the CPU renderer failed ({error}); export the scene and restart the program"
            )),
        }
    }
}

/// Camera at a keyframe of a path, for a viewport of `width` × `height` pixels.
fn camera_at_keyframe(moment: &Keyframe, [width, height]: [u32; 2]) -> Camera {
    let intrinsics = Intrinsics::from_vertical_fov(width, height, moment.fov_y);
    Camera { intrinsics, pose: moment.pose }
}
