//! Comparison of the scene with the other renderer, a photograph or a second model.

use super::SceneView;
use super::photo::{
    ComparedPicture, Partner, PhotoQuery, PhotoRequests, PhotoResult, PictureRequest,
};
use super::steering::ViewPosition;
use super::toolbar::ViewMode;
use crate::app::opening::{BareSplats, OpenError, read_splats};
use crate::app::state::{NoticeKind, Opened};
use crate::app::worker::Waker;
use crate::dataset::calibration::ColorCamera;
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::framing::framing;
use crate::pipeline::job::Job;
use crate::render::compare::{Area, Combination};
use crate::render::{Exposing, Lens, Paint, RenderOptions, Renderer};
use eframe::egui::Ui;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

impl SceneView {
    /// Second model, if any; while an export is previewed, the exported model.
    pub fn compared(&self) -> Option<&Arc<ComparedModel>> {
        self.preview.model().or(self.compared.model())
    }

    /// Reason why a comparison mode is unavailable, if it is.
    pub fn mode_unavailable_reason(&self, mode: ViewMode, opened: &Opened) -> Option<&'static str> {
        mode.unavailable_reason(self.settings.lens, opened, self.compared().map(|model| &**model))
    }

    /// Starts reading a second model; the view compares with it once it is read.
    pub fn compare_with(&mut self, path: PathBuf) -> std::io::Result<()> {
        self.hint = Some((format!("Reading {}…", path.display()), Instant::now()));
        self.compared.read(path, self.waker.clone())
    }

    /// Reason why there is no second model to remove, if so.
    pub fn remove_unavailable_reason(&self) -> Option<&'static str> {
        if self.preview.model().is_some() {
            // The model beside the scene is the preview, not an opened file.
            return Some("An export preview is shown: switch it off first");
        }
        self.compared.model().is_none().then_some("No second model is open")
    }

    /// Removes the second model.
    pub fn remove_compared(&mut self) {
        self.compared.clear();
    }

    /// Shows a second model that was read since the last call, relative to the scene's local origin
    /// `origin`. Returns its notices.
    pub fn take_compared(&mut self, origin: DVec3) -> Vec<(NoticeKind, String)> {
        let taken = self.compared.take_finished_read();
        self.compared.rebase_to_origin(origin);
        let Some((is_there, told)) = taken else { return Vec::new() };
        self.hint = None;
        if is_there && !self.mode.has_model() {
            self.mode = ViewMode::ModelWipe;
        }
        told
    }

    /// Camera that took the photographs, if it is not the depth camera. Preparation uses the depth
    /// camera's pixels.
    pub(super) fn color_camera(&self, opened: &Opened) -> Option<ColorCamera> {
        opened.color_camera().filter(|_| self.mode != ViewMode::Preparation)
    }

    /// Returns the photograph at the current dataset camera with its metrics, if the mode uses it.
    pub(super) fn request_photo_result(
        &mut self,
        ui: &Ui,
        opened: &Opened,
        is_training: bool,
    ) -> Option<Result<PhotoResult, String>> {
        // A second model is also measured against the photograph, if there is one.
        let is_looked_at = self.mode.needs_frame() || self.mode.has_model();
        let (true, ViewPosition::At(frame)) = (is_looked_at, &self.place) else { return None };
        let query = PhotoQuery {
            frame: frame.clone(),
            color_camera: self.color_camera(opened),
            prepared: match self.mode {
                ViewMode::Preparation => Some(Arc::new(opened.scene()?.surface.clone())),
                _ => None,
            },
            options: self.settings.measured(),
            compared: self.compared().cloned(),
        };
        if self.photos.is_none() {
            match PhotoRequests::new(self.waker.clone(), self.palette.learned().clone()) {
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
        camera: Camera,
        area: Area,
        result: Option<&PhotoResult>,
    ) -> PictureRequest {
        let settings = &self.settings;
        let (radius, distance) = self
            .camera
            .map_or((1.0, 1.0), |view| (view.radius(), view.distance_to_middle(&camera)));
        // A dataset camera is a pinhole, whatever lens is chosen.
        let lens = if self.place == ViewPosition::Free { settings.lens } else { Lens::Pinhole };
        let options =
            |renderer| settings.options(settings.method(renderer, lens), radius, distance);
        let wipe = Combination::Wipe(self.divider);
        let difference = Combination::Difference(settings.difference_gain);
        let renderers = |how| {
            let partner = Partner::Splats(options(Renderer::Exact));
            (Renderer::Projected, Some(ComparedPicture { partner, area: Area::FULL, how }))
        };
        let photo = |how| {
            let partner = result.map(|result| Partner::Photo(result.image.clone()));
            (settings.renderer, partner.map(|partner| ComparedPicture { partner, area, how }))
        };
        let model = |how| {
            let second = self.compared().map(|model| {
                let seen = options(settings.renderer);
                // The near plane follows the model's own size: that of the scene could clip a model of
                // another scale.
                let own = settings.options(seen.method, model.radius, distance);
                let options = RenderOptions { near: own.near, ..seen };
                let partner = Partner::Model(model.clone(), options);
                ComparedPicture { partner, area: Area::FULL, how }
            });
            (settings.renderer, second)
        };
        let (renderer, second) = match self.mode {
            ViewMode::Single => (settings.renderer, None),
            ViewMode::Wipe => renderers(wipe),
            ViewMode::Difference => renderers(difference),
            ViewMode::ModelWipe => model(wipe),
            ViewMode::ModelDifference => model(difference),
            ViewMode::PhotoWipe | ViewMode::Preparation => photo(wipe),
            ViewMode::PhotoDifference => photo(difference),
        };
        let mut options = options(renderer);
        if self.mode.has_photo()
            && self.place != ViewPosition::Free
            && options.style.paint == Paint::Stored
        {
            // Beside a photograph the scene is drawn with the exposure of that photograph.
            options.exposure_mode = Exposing::Recorded;
        }
        PictureRequest { camera, options, second }
    }
}

/// Maximum length of a name in a caption, characters: the viewport of a small window is about 450
/// points wide.
const MAX_NAME: usize = 30;

/// Model compared with the scene.
#[derive(Clone, Debug)]
pub struct ComparedModel {
    /// File name with its folder, shortened for a caption.
    pub name: String,
    /// Path of the file.
    pub path: PathBuf,
    /// Splats, with positions relative to `local_origin`.
    pub splats: SplatSet,
    /// Origin of the positions, world coordinates.
    pub local_origin: DVec3,
    /// Radius of the model, world units; it determines the near plane.
    pub radius: f64,
}

impl ComparedModel {
    /// Re-expresses the positions relative to another origin.
    fn move_origin(&mut self, origin: DVec3) {
        let moved = self.local_origin - origin;
        for splat in self.splats.splats_mut() {
            splat.mean = (DVec3::from_array(splat.mean.map(f64::from)) + moved).as_vec3().into();
        }
        self.local_origin = origin;
    }
}

/// Notice for the user.
type NoticeText = (NoticeKind, String);

/// Model compared with the scene, and the one being read.
#[derive(Default)]
pub struct ModelSlot {
    model: Option<Arc<ComparedModel>>,
    reading: Option<Reading>,
}

struct Reading {
    path: PathBuf,
    job: Job<Result<(ComparedModel, Vec<NoticeText>), String>>,
}

impl ModelSlot {
    /// Model, once it has been read.
    pub fn model(&self) -> Option<&Arc<ComparedModel>> {
        self.model.as_ref()
    }

    /// Starts reading a checkpoint or splat file; replaces a read in progress.
    pub fn read(&mut self, path: PathBuf, waker: Waker) -> std::io::Result<()> {
        let file = path.clone();
        let job = Job::start_waking("second model", waker, move || read(&file))?;
        self.reading = Some(Reading { path, job });
        Ok(())
    }

    /// Re-expresses the model relative to the scene's local origin, which may change with the dataset.
    pub fn rebase_to_origin(&mut self, origin: DVec3) {
        if let Some(model) = self.model.as_mut().filter(|model| model.local_origin != origin) {
            Arc::make_mut(model).move_origin(origin);
        }
    }

    /// Removes the model.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Takes a finished read: true if the model was replaced, and the notices. After an error the
    /// previous model stays.
    pub fn take_finished_read(&mut self) -> Option<(bool, Vec<NoticeText>)> {
        let reading = self.reading.as_ref()?;
        let read = reading.job.poll()?.unwrap_or_else(|panic| {
            Err(format!(
                "{}: {}",
                reading.path.display(),
                panic.failure_notice("reading the model")
            ))
        });
        self.reading = None;
        match read {
            Ok((model, told)) => {
                self.model = Some(Arc::new(model));
                Some((true, told))
            }
            Err(problem) => Some((false, vec![(NoticeKind::Error, problem)])),
        }
    }
}

fn read(path: &Path) -> Result<(ComparedModel, Vec<NoticeText>), String> {
    let read = read_splats(path).map_err(|error: OpenError| error.to_string())?;
    let BareSplats { splats, local_origin, notices: told } = read;
    let Some(framing) = framing(splats.iter()) else {
        return Err(format!(
            "{}: expected at least one splat, found none; compare with another file",
            path.display()
        ));
    };
    let model = ComparedModel {
        name: name_of(path),
        path: path.to_owned(),
        splats,
        local_origin,
        radius: framing.radius,
    };
    Ok((model, told))
}

/// Returns the file name with its folder, because the files of all runs have the same name. Only the
/// end of a long name is retained.
fn name_of(path: &Path) -> String {
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
    fn positions_follow_the_scenes_origin() {
        let far = DVec3::new(5e5, 5e6, 0.0);
        let splat = Splat { mean: [1.0, 2.0, 3.0], ..Splat::default() };
        let mut slot = ModelSlot {
            model: Some(Arc::new(ComparedModel {
                name: String::new(),
                path: PathBuf::new(),
                splats: SplatSet::from(vec![splat]),
                local_origin: far,
                radius: 1.0,
            })),
            reading: None,
        };
        slot.rebase_to_origin(far - DVec3::X);
        let model = slot.model().unwrap();
        assert_eq!(model.splats.view().splats()[0].mean, [2.0, 2.0, 3.0]);
        assert_eq!(model.local_origin, far - DVec3::X);
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
