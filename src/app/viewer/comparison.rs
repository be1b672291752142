//! Comparison of the scene with the other renderer, a photograph, a second model or the preview of an
//! export.

use super::export_preview::{ExportPreview, PreviewReport};
use super::frame_refs::FrameRef;
use super::photo::{
    ComparedPicture, Partner, PhotoQuery, PhotoRequests, PhotoResult, PictureRequest,
};
use super::settings::ViewSettings;
use super::toolbar::ViewMode;
use super::viewpoint::Viewpoint;
use crate::app::opening::{BareSplats, OpenError, read_splats};
use crate::app::splat_updates::SplatChange;
use crate::app::state::{NoticeKind, Opened};
use crate::app::view_thread::take_finished;
use crate::app::worker::Waker;
use crate::dataset::calibration::ColorCamera;
use crate::export::turned;
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::framing::framing;
use crate::pipeline::job::Job;
use crate::render::compare::{Area, Combination};
use crate::render::{Exposing, Lens, Paint, RenderOptions, Renderer};
use eframe::egui::Ui;
use glam::DVec3;
use std::mem;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub struct Comparison {
    mode: ViewMode,
    /// Position of the wipe divider, as a fraction of the viewport's width.
    pub divider: f32,
    model: Option<Arc<ComparedModel>>,
    /// Recording in whose world the second model is: that of the dataset opened last.
    recording: Option<Recording>,
    reading: Option<(PathBuf, Job<ReadModel>)>,
    /// Preview of an export. While it is shown, its model replaces `model`.
    pub(super) preview: ExportPreview,
    mode_before_preview: Option<ViewMode>,
    /// Requests for photographs; created when the first photograph is needed.
    photos: Option<PhotoRequests>,
}

impl Default for Comparison {
    fn default() -> Self {
        Self {
            mode: ViewMode::Single,
            divider: 0.5,
            model: None,
            recording: None,
            reading: None,
            preview: ExportPreview::default(),
            mode_before_preview: None,
            photos: None,
        }
    }
}

impl Comparison {
    pub fn mode(&self) -> ViewMode {
        self.mode
    }

    pub(super) fn set_mode(&mut self, mode: ViewMode) {
        self.mode = mode;
    }

    /// Returns the second model, if any. While an export is previewed, this is the exported model.
    pub fn model(&self) -> Option<&Arc<ComparedModel>> {
        self.preview.model().or(self.model.as_ref())
    }

    /// Starts reading a checkpoint or splat file as the second model. Replaces a read in progress.
    pub(super) fn read(&mut self, path: PathBuf, waker: &Waker) -> std::io::Result<()> {
        let file = path.clone();
        let job = Job::start_waking("second model", waker.clone(), move || read(&file))?;
        self.reading = Some((path, job));
        Ok(())
    }

    pub fn remove_unavailable_reason(&self) -> Option<&'static str> {
        if self.preview.model().is_some() {
            // The model beside the scene is the preview, not an opened file.
            return Some("An export preview is shown: switch it off first");
        }
        self.model.is_none().then_some("No second model is open")
    }

    /// Shows a second model beside the scene.
    pub fn show_model(&mut self, model: ComparedModel) {
        self.model = Some(Arc::new(model));
        self.mode = ViewMode::ModelWipe;
    }

    pub fn remove_model(&mut self) {
        (self.model, self.reading) = (None, None);
        self.end_photos();
    }

    /// Ends the thread of photographs, which retains the photograph and the model that it measured last.
    fn end_photos(&mut self) {
        if let Some(photos) = self.photos.take() {
            // On another thread, because that of the photographs may wait for a drive.
            let _ = std::thread::Builder::new().spawn(move || drop(photos));
        }
    }

    /// Removes a second model that belongs to another recording than the one that was opened. It stays beside
    /// checkpoints and further runs of its recording, and beside splat files, which may be of any recording.
    /// Returns the text of a notice if no file contains the removed model.
    pub(super) fn enter_world(&mut self, opened: &Opened) -> Option<String> {
        self.end_photos();
        let recording = Recording(opened.dataset.as_ref()?.path.clone());
        let before = self.recording.replace(recording.clone())?;
        if before == recording {
            return None;
        }
        self.reading = None;
        self.model.take().filter(|model| !model.is_in_file)?;
        let name = before.0.as_ref().and_then(|path| path.file_name()).unwrap_or_default();
        Some(format!(
            "The scene before retraining “{}” is gone: it belonged to that recording, and no file contains it; save a run before retraining to keep both",
            name.to_string_lossy()
        ))
    }

    /// Shows the second model if its file has been read, and returns its notices. After an error the
    /// previous model remains.
    ///
    /// Also places the model in the scene, whose local origin and up direction differ between datasets.
    pub(super) fn take_read(&mut self, up: DVec3, origin: DVec3) -> Option<Vec<Notice>> {
        let taken = take_finished(&mut self.reading).map(|(path, read)| match read {
            Ok(Ok((model, notices))) => {
                self.model = Some(Arc::new(model));
                // The difference between two models stays on; any other mode would not show the new one.
                if !self.mode.has_model() {
                    self.mode = ViewMode::ModelWipe;
                }
                notices
            }
            Ok(Err(problem)) => vec![(NoticeKind::Error, problem)],
            Err(panic) => {
                let text = panic.failure_notice("reading the model");
                vec![(NoticeKind::Error, format!("{}: {text}", path.display()))]
            }
        });
        if let Some(model) = self.model.as_mut().filter(|model| !model.is_in(up, origin)) {
            Arc::make_mut(model).place(up, origin);
        }
        taken
    }

    pub(super) fn change(&mut self, change: SplatChange) {
        // In learned colours: the PSNR must not depend on the displayed ones.
        self.photos.iter_mut().for_each(|photos| photos.change(change.clone()));
        self.preview.is_stale = true;
    }

    /// Returns the camera that took the photographs, if it differs from the depth camera.
    pub(super) fn color_camera(&self, opened: &Opened) -> Option<ColorCamera> {
        // Preparation registers colours to the depth camera's pixels.
        opened.color_camera().filter(|_| self.mode != ViewMode::Preparation)
    }

    pub(super) fn request_photo(
        &mut self,
        ui: &Ui,
        frame: Option<&FrameRef>,
        (opened, settings): (&Opened, &ViewSettings),
        learned: &Arc<SplatSet>,
        (is_training, waker): (bool, &Waker),
    ) -> Option<Result<PhotoResult, String>> {
        // A second model is also measured against the photograph, if there is one.
        let is_used = self.mode.needs_frame() || self.mode.has_model();
        let query = PhotoQuery {
            frame: frame.filter(|_| is_used)?.clone(),
            color_camera: self.color_camera(opened),
            prepared: match self.mode {
                ViewMode::Preparation => Some(Arc::new(opened.scene()?.surface.clone())),
                _ => None,
            },
            options: settings.measured(),
            compared: self.model().cloned(),
        };
        if self.photos.is_none() {
            match PhotoRequests::new(waker.clone(), learned.clone()) {
                Ok(requests) => self.photos = Some(requests),
                Err(error) => {
                    return Some(Err(format!("starting the photograph thread failed: {error}")));
                }
            }
        }
        self.photos.as_mut()?.request_result(ui, &query, is_training).cloned()
    }

    pub(super) fn picture_request(
        &self,
        settings: &ViewSettings,
        view: &Viewpoint,
        (camera, area): (Camera, Area),
        photo: Option<&PhotoResult>,
    ) -> PictureRequest {
        let (radius, distance) = view.extent(&camera);
        // A dataset camera is a pinhole, whatever lens is chosen.
        let lens = if view.is_free() { settings.lens } else { Lens::Pinhole };
        let options =
            |renderer| settings.options(settings.method(renderer, lens), radius, distance);
        let partner = match self.mode {
            ViewMode::Single => None,
            ViewMode::Wipe | ViewMode::Difference => {
                Some(Partner::Splats(options(Renderer::Exact)))
            }
            ViewMode::ModelWipe | ViewMode::ModelDifference => self.model().map(|model| {
                let seen = options(settings.renderer);
                // The near plane follows the model's own size: that of the scene could clip a model of
                // another scale.
                let own = settings.options(seen.method, model.radius, distance);
                Partner::Model(model.clone(), RenderOptions { near: own.near, ..seen })
            }),
            ViewMode::PhotoWipe | ViewMode::PhotoDifference | ViewMode::Preparation => {
                photo.map(|photo| Partner::Photo(photo.image.clone()))
            }
        };
        let how = match self.mode.is_difference() {
            true => Combination::Difference(settings.difference_gain),
            false => Combination::Wipe(self.divider),
        };
        let second = partner.map(|partner| {
            // A render fills the viewport, a photograph only the area that its shape allows.
            let area = if matches!(partner, Partner::Photo(_)) { area } else { Area::FULL };
            ComparedPicture { partner, area, how }
        });
        let mut options = options(match self.mode {
            ViewMode::Wipe | ViewMode::Difference => Renderer::Projected,
            _ => settings.renderer,
        });
        if self.mode.has_photo() && !view.is_free() && options.style.paint == Paint::Stored {
            // Beside a photograph the scene is drawn with the exposure of that photograph.
            options.exposure_mode = Exposing::Recorded;
        }
        PictureRequest { camera, options, second }
    }

    pub fn export_preview_report(&self) -> Option<PreviewReport> {
        self.preview.report()
    }

    /// Shows the result of a finished conversion of the export preview. The first result switches the view
    /// to a wipe between scene and exported model.
    pub(super) fn take_preview(&mut self) {
        if self.preview.take_finished_jobs() && self.mode_before_preview.is_none() {
            self.mode_before_preview = Some(self.mode);
            self.mode = ViewMode::ModelWipe;
        }
    }

    /// Ends the export preview and restores the previous view mode.
    pub(super) fn end_preview(&mut self) {
        self.preview = ExportPreview::default();
        // A mode chosen during the preview stays, unless it needs the model that is gone.
        if let Some(before) = self.mode_before_preview.take().filter(|_| self.mode.has_model()) {
            self.mode = before;
        }
    }

    pub(super) fn take_retained(&mut self) -> Self {
        // The export dialog closes with the window, so its preview ends too.
        self.end_preview();
        // The thread of photographs would wake the closed window.
        self.photos = None;
        std::mem::take(self)
    }
}

/// Maximum length of a name in a caption, characters.
// The viewport of a small window is about 450 points wide.
const MAX_NAME: usize = 30;

/// Path of a recording; `None` for the demo.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Recording(Option<PathBuf>);

#[derive(Clone, Debug)]
pub struct ComparedModel {
    /// File name preceded by its folder, shortened for a caption.
    pub name: String,
    /// Splats with positions relative to `local_origin`.
    pub splats: SplatSet,
    pub local_origin: DVec3,
    /// Up direction in the axes of `splats`, if the file's format defines its axes.
    pub defined_up: Option<DVec3>,
    /// Radius of the model, world units. It determines the near plane.
    pub radius: f64,
    /// True if the model can be opened again, or recomputed.
    pub is_in_file: bool,
}

impl ComparedModel {
    fn is_in(&self, up: DVec3, origin: DVec3) -> bool {
        self.local_origin == origin && self.defined_up.is_none_or(|own| own == up)
    }

    fn place(&mut self, up: DVec3, origin: DVec3) {
        // Exports of such a format from the scene were turned away from its up direction.
        if let Some(own) = self.defined_up.as_mut().filter(|own| **own != up) {
            let splats = mem::take(&mut self.splats);
            (self.splats, self.local_origin) = turned(splats, self.local_origin, [*own, up]);
            *own = up;
        }
        let moved = self.local_origin - origin;
        // In f64, because both origins may be map coordinates of millions of metres.
        for splat in self.splats.splats_mut() {
            splat.mean = (DVec3::from_array(splat.mean.map(f64::from)) + moved).as_vec3().into();
        }
        self.local_origin = origin;
    }
}

type Notice = (NoticeKind, String);

type ReadModel = Result<(ComparedModel, Vec<Notice>), String>;

fn read(path: &Path) -> ReadModel {
    let read = read_splats(path).map_err(|error: OpenError| error.to_string())?;
    let BareSplats { splats, local_origin, defined_up, notices, .. } = read;
    // Without splats there is no radius for the near plane.
    let Some(framing) = framing(splats.iter()) else {
        return Err(format!(
            "{}: expected at least one splat, found none; compare with another file",
            path.display()
        ));
    };
    let (name, radius) = (name_of(path), framing.radius);
    let model = ComparedModel { name, splats, local_origin, defined_up, radius, is_in_file: true };
    Ok((model, notices))
}

/// Returns the file name preceded by its folder. A long name is cut at its beginning.
fn name_of(path: &Path) -> String {
    // With the folder, because the files of all runs have the same name.
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let folder = path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    let name = if folder.is_empty() { file.into_owned() } else { format!("{folder}/{file}") };
    let n = name.chars().count();
    if n <= MAX_NAME {
        return name;
    }
    let end: String = name.chars().skip(n + 1 - MAX_NAME).collect();
    format!("…{end}")
}

#[cfg(test)]
mod compared_model_tests {
    use super::*;
    use crate::model::splat::splats::Splat;

    #[test]
    fn models_are_placed_by_the_scenes_origin_and_up() {
        let far = DVec3::new(5e5, 5e6, 0.0);
        let splat = Splat { mean: [1.0, 2.0, 3.0], ..Splat::default() };
        let mut model = ComparedModel {
            name: String::new(),
            splats: SplatSet::from(vec![splat]),
            local_origin: far,
            defined_up: None,
            radius: 1.0,
            is_in_file: true,
        };
        model.place(DVec3::NEG_Y, far - DVec3::X);
        assert_eq!(model.splats.view().splats()[0].mean, [2.0, 2.0, 3.0]);
        assert_eq!(model.local_origin, far - DVec3::X);
        // A format that defines its axes does not keep those of the scene.
        model.defined_up = Some(DVec3::Z);
        for (up, expected) in [(DVec3::NEG_Y, [2.0, -3.0, 2.0]), (DVec3::Z, [2.0, 2.0, 3.0])] {
            assert!(!model.is_in(up, DVec3::ZERO));
            model.local_origin = DVec3::ZERO;
            model.place(up, DVec3::ZERO);
            assert!(model.is_in(up, DVec3::ZERO));
            assert_eq!(model.splats.view().splats()[0].mean, expected);
        }
    }

    #[test]
    fn names_tell_runs_apart_and_fit_a_caption() {
        for (path, expected) in [
            ("/data/run-2/checkpoint.vbgs", "run-2/checkpoint.vbgs"),
            ("/scene.ply", "scene.ply"),
            ("/a/a long name of a folder/scene.ply", "…ng name of a folder/scene.ply"),
        ] {
            assert_eq!(name_of(Path::new(path)), expected);
            assert!(expected.chars().count() <= MAX_NAME);
        }
    }
}
