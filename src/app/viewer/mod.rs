//! The central view: where one stands, what is compared, and painting with whatever the machine
//! has.

mod axes;
mod captions;
pub mod compared_model;
mod comparison;
mod crop_handles;
mod current_frame;
mod editing;
pub mod export_preview;
mod frame_points;
pub mod frame_refs;
mod frusta;
mod guide;
pub mod kept;
pub mod measure;
pub mod mode;
mod overlay;
mod pacing;
pub mod painter;
mod photo;
pub mod picture_request;
mod pixel_status;
mod place;
pub mod preview;
mod previewing;
pub mod settings;
mod stand;
mod steering;
pub mod thumbnails;
pub mod toolbar;
mod world_painter;

use super::camera::ViewCamera;
use super::draw_budget::DrawBudget;
use super::drawing::DrawHistory;
use super::edit::editor::Editor;
use super::file_proposal::FileProposal;
use super::palette::Palette;
use super::panels::legend;
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
use compared_model::ModelSlot;
use crop_handles::EditDrag;
use eframe::egui::{Rect, Sense, Ui, Vec2};
use export_preview::ExportPreview;
use frame_points::FramePoints;
use frame_refs::{FrameRef, fit};
use glam::DVec3;
use measure::MeasureTool;
use mode::ViewMode;
use painter::ViewPainter;
use photo::PhotoRequests;
use picture_request::PictureRequest;
use settings::ViewSettings;
use stand::{GuideStage, Place};
use std::sync::Arc;
use std::time::{Duration, Instant};
use thumbnails::Thumbnails;
use world_painter::WorldPainter;

/// How long after the last movement the picture is refined.
const SETTLE: Duration = Duration::from_millis(150);

/// Place of the legend, from the lower left corner of the viewport, points.
const LEGEND: Vec2 = Vec2::new(10.0, -10.0);

/// State of the central view.
pub struct SceneView {
    /// What the user chose.
    pub settings: ViewSettings,
    mode: ViewMode,
    painter: ViewPainter,
    waker: Waker,
    camera: Option<ViewCamera>,
    place: Place,
    /// What the camera shows by itself; `None` once a hand has moved it.
    guide: Option<GuideStage>,
    is_flying: bool,
    measure: MeasureTool,
    /// What the camera stays with if it is opened again.
    kept: Option<FileProposal>,
    /// Size of the viewport in the last pass, pixels.
    viewport: [u32; 2],
    /// Of the dataset with this serial.
    thumbnails: Option<(u64, Thumbnails)>,
    /// The dataset's camera visited last, from which stepping goes on.
    latest_frame: Option<FrameRef>,
    /// The camera of the latest picture.
    latest_camera: Option<Camera>,
    /// Share of the viewport's width at which a wipe changes over.
    divider: f32,
    compared: ModelSlot,
    /// What is compared with instead while an export is chosen.
    preview: ExportPreview,
    points: FramePoints,
    /// Starts with the first photograph.
    photos: Option<PhotoRequests>,
    hint: Option<(String, Instant)>,
    /// Serial of what the camera was set up for.
    serial: u64,
    /// What is drawn: for framing, for the GPU, and to hand over when the GPU fails.
    palette: Palette,
    editor: Editor,
    /// Frames of the run.
    n_frames: usize,
    edit_drag: Option<EditDrag>,
    /// The box that a drag has drawn last, points.
    latest_box: Option<Rect>,
    selection: SplatSelection,
    moved_at: Instant,
    drawn: DrawHistory,
    budget: DrawBudget,
    gpu_failed: bool,
}

impl SceneView {
    /// Starts at nothing.
    pub fn new(painter: ViewPainter, settings: ViewSettings, waker: Waker) -> Self {
        Self {
            settings,
            mode: ViewMode::Single,
            drawn: DrawHistory::new(painter.drawer()),
            painter,
            waker,
            camera: None,
            place: Place::Free,
            guide: Some(GuideStage::Start),
            is_flying: false,
            measure: MeasureTool::default(),
            kept: None,
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
            budget: DrawBudget::default(),
            gpu_failed: false,
        }
    }

    /// Hands changed splats over.
    pub fn change(&mut self, update: SplatUpdate) {
        if let Some(photos) = &mut self.photos {
            // With the colours that were learned: a figure must not depend on
            // what colours show here.
            photos.change(update.change.clone());
        }
        self.preview.outdate();
        let n_frames = update.n_frames;
        self.editor.past.take_copies();
        let change = self.palette.change(update);
        self.editor.past.note(n_frames, self.palette.learned(), self.settings.past_bytes());
        self.show(change);
    }

    /// Whether the GPU was given up.
    pub fn gpu_failed(&self) -> bool {
        self.gpu_failed
    }

    /// A GPU is there and could not be used from the start.
    pub fn note_gpu_failure(&mut self) {
        self.gpu_failed = true;
    }

    /// Draws with another painter from here on; the scene is handed over again.
    pub fn draw_by(&mut self, mut painter: ViewPainter) {
        // A new painter has nothing, and the trainer sends no more than what changes.
        let splats = self.editor.shown(&self.palette);
        painter.change(SplatChange::All(splats.clone()), splats);
        self.drawn = DrawHistory::new(painter.drawer());
        self.painter = painter;
        self.gpu_failed = false;
    }

    /// Splats in the picture.
    pub fn n_drawn(&self) -> usize {
        self.painter.n_drawn()
    }

    /// What drawing takes.
    pub fn drawn(&self) -> &DrawHistory {
        &self.drawn
    }

    /// What is compared.
    pub fn mode(&self) -> ViewMode {
        self.mode
    }

    /// The splats as they were learnt, whatever colours show.
    pub fn learned(&self) -> &Arc<SplatSet> {
        self.palette.learned()
    }

    /// The dataset's camera that is looked through.
    pub fn frame_ref(&self) -> Option<&FrameRef> {
        match &self.place {
            Place::Free | Place::Along(_) => None,
            Place::At(frame) => Some(frame),
        }
    }

    /// Share of the viewport's width at which a wipe changes over.
    pub fn divider(&self) -> f32 {
        self.divider
    }

    /// Size of the picture in the last pass, pixels.
    pub fn size_px(&self) -> [u32; 2] {
        self.viewport
    }

    /// Where the steered camera stands, world units; `None` while nothing is open.
    pub fn eye(&self) -> Option<DVec3> {
        self.camera.map(|camera| camera.camera(self.viewport).pose.centre())
    }

    /// What the camera turns about, world units; `None` while nothing is open.
    pub fn target(&self) -> Option<DVec3> {
        self.camera.map(|camera| camera.target())
    }

    /// Vertical field of view of the scene's own camera, degrees.
    pub fn own_fov_deg(&self) -> f32 {
        self.camera.map_or(45.0, |camera| camera.own_fov_y().to_degrees() as f32)
    }

    /// Draws the view over all space left. Returns a message if the GPU had to be given up.
    pub fn ui(&mut self, ui: &mut Ui, snapshot: &Snapshot) -> Option<String> {
        // No stop of Tab: it has keys of its own, which the focus would take from it.
        let sense = Sense::CLICK | Sense::DRAG;
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), sense);
        let opened = snapshot.opened.as_ref()?;
        self.take_preview();
        self.fall_back(opened);
        let pixels = rect.size() * ui.ctx().pixels_per_point();
        let size = [pixels.x.round() as u32, pixels.y.round() as u32];
        if size[0] == 0 || size[1] == 0 {
            return None; // minimised, or squeezed out by the panels
        }
        self.viewport = size;
        self.n_frames = snapshot.n_frames;
        self.follow_guide(opened, snapshot);
        self.measure.take(snapshot.inspected.as_deref());
        self.begin_edit(ui, &response, opened);
        // Before the camera is asked for: a drag shows in the picture of the same pass.
        self.steer(ui, &response, opened, size);
        let (camera, area) = self.camera_now(opened, size)?;
        self.latest_camera = Some(camera);
        let result = self.look_at_photo(ui, opened, snapshot.state == RunState::Training);
        let request =
            self.picture_request(camera, area, result.as_ref().and_then(|s| s.as_ref().ok()));
        let message = self.paint(ui, rect, &request, snapshot.state);
        self.measure_preview(&request, snapshot.state);
        self.draw_world(ui, rect, &request, opened, snapshot);
        self.decorate(ui, rect, &request, result);
        // The past is shown in its own colours.
        let legend = self.palette.legend().filter(|_| self.editor.past_shown().is_none());
        if let Some((attribute, range)) = legend {
            legend::ui(attribute, range.as_ref(), rect.left_bottom() + LEGEND, ui);
        }
        self.edit(ui, &response, &request, opened);
        // A click is about places, which colours do not change, and these
        // splats are shared uncopied.
        let splats = self.editor.clickable(&self.palette);
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

    /// What lies in the world beside the splats.
    fn draw_world(
        &mut self,
        ui: &Ui,
        rect: Rect,
        request: &PictureRequest,
        opened: &Opened,
        snapshot: &Snapshot,
    ) {
        let is_pinhole = self.place != Place::Free || self.settings.lens == Lens::Pinhole;
        if is_pinhole {
            let radius = opened.home.radius;
            let world = WorldPainter::new(ui, rect, &request.camera, radius);
            if self.settings.shows_grid {
                self.grid(&world, radius);
            }
            if self.shows_cameras(snapshot) {
                self.frusta(ui, &world, opened, snapshot);
            }
            if self.settings.shows_points {
                self.frame_points(&world, opened, snapshot);
            }
            self.measure.draw(&world);
        }
        if self.place == Place::Free {
            self.gizmo(ui, rect);
        }
    }

    /// Leaves what this scene or lens cannot show, and colours it as is asked for.
    fn fall_back(&mut self, opened: &Opened) {
        if self.why_not(self.mode, opened).is_some() {
            self.mode = ViewMode::Single;
        }
        if self.settings.color_mode.why_not(opened.available_modes).is_some() {
            self.settings.color_mode = Default::default();
        }
        self.show_edits();
    }

    /// The camera for a viewport of `size` pixels, and the part of it that a photograph would fill.
    fn camera_now(&mut self, opened: &Opened, size: [u32; 2]) -> Option<(Camera, Area)> {
        let camera = self.camera.as_mut()?;
        let settings = &self.settings;
        let fov_deg = match settings.lens {
            Lens::Pinhole => settings.pinhole_fov_deg,
            Lens::Fisheye => Some(settings.fisheye_fov_deg),
        };
        camera.look_through(settings.lens, fov_deg.map(|fov| f64::from(fov).to_radians()));
        match &self.place {
            Place::At(frame) => {
                let color_camera = self.color_camera(opened);
                let scene = self.palette.splats().finishing();
                Some(fit(&frame.photo_camera(color_camera.as_ref(), scene), size))
            }
            Place::Along(moment) => Some((along(moment, size), Area::FULL)),
            Place::Free => Some((camera.camera(size), Area::FULL)),
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
        // Training comes before pictures, also of a camera that a hand moves: they keep to a budget.
        let effort = match (state, moving) {
            (RunState::Training, _) => {
                Effort::Shared { scale: self.budget.scale(moving), apart: self.snapshot_interval() }
            }
            (_, true) => Effort::Moving,
            (_, false) => Effort::Full,
        };
        if moving {
            // egui sleeps without input: it is woken once more to refine what was drawn in haste.
            ui.ctx().request_repaint_after(SETTLE);
        }
        let splats = self.editor.shown(&self.palette);
        match self.painter.paint(ui, rect, request, effort, &mut self.budget, splats) {
            Ok(sample) => {
                if let Some(sample) = sample {
                    self.drawn.push(sample);
                }
                None
            }
            Err(error) => self.give_up_gpu(&error.to_string()),
        }
    }

    /// Draws on the CPU from here on; the scene is handed over again.
    fn give_up_gpu(&mut self, reason: &str) -> Option<String> {
        match ViewPainter::software(&self.waker) {
            Ok(painter) => {
                self.draw_by(painter);
                self.gpu_failed = true;
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

/// The camera of a moment of a path in a viewport of `size` pixels.
fn along(moment: &Keyframe, [width, height]: [u32; 2]) -> Camera {
    let intrinsics = Intrinsics::from_vertical_fov(width, height, moment.fov_y);
    Camera { intrinsics, pose: moment.pose }
}
