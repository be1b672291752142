//! Comparison of the scene with the other renderer, a photograph or a second model.

use super::SceneView;
use super::compared_model::ComparedModel;
use super::mode::ViewMode;
use super::photo::{PhotoQuery, PhotoRequests, PhotoResult};
use super::picture_request::{ComparedPicture, Partner, PictureRequest};
use super::stand::ViewPosition;
use crate::app::state::{NoticeKind, Opened};
use crate::dataset::calibration::ColorCamera;
use crate::math::camera::Camera;
use crate::render::compare::{Area, Combination};
use crate::render::{Exposing, Lens, Paint, RenderOptions, Renderer};
use eframe::egui::Ui;
use glam::DVec3;
use std::path::PathBuf;
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
