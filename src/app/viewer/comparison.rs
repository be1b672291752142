//! What the scene is compared with: the other renderer, a photograph or a second model.

use super::SceneView;
use super::compared_model::ComparedModel;
use super::mode::ViewMode;
use super::photo::{PhotoQuery, PhotoRequests, PhotoResult};
use super::picture_request::{ComparedPicture, Partner, PictureRequest};
use super::stand::Place;
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
    /// The second model, if there is one: what an export would give back, while one is previewed.
    pub fn compared(&self) -> Option<&Arc<ComparedModel>> {
        self.preview.model().or(self.compared.model())
    }

    /// Why a comparison cannot be chosen, if so.
    pub fn why_not(&self, mode: ViewMode, opened: &Opened) -> Option<&'static str> {
        mode.why_not(self.settings.lens, opened, self.compared().map(|model| &**model))
    }

    /// Reads a second model, which is compared with when it is there.
    pub fn compare_with(&mut self, path: PathBuf) -> std::io::Result<()> {
        self.hint = Some((format!("Reading {}…", path.display()), Instant::now()));
        self.compared.read(path, self.waker.clone())
    }

    /// Why there is no second model to remove, if so.
    pub fn why_not_remove(&self) -> Option<&'static str> {
        if self.preview.model().is_some() {
            // What is seen beside the scene is no model that was opened.
            return Some("An export is previewed: switch its preview off first");
        }
        self.compared.model().is_none().then_some("No second model is open")
    }

    /// Compares with no second model any more.
    pub fn remove_compared(&mut self) {
        self.compared.clear();
    }

    /// Shows a second model that was read since, relative to the scene's local origin; what there is to say
    /// of it.
    pub fn take_compared(&mut self, origin: DVec3) -> Vec<(NoticeKind, String)> {
        let taken = self.compared.take();
        self.compared.follow_origin(origin);
        let Some((is_there, told)) = taken else { return Vec::new() };
        self.hint = None;
        if is_there && !self.mode.has_model() {
            self.mode = ViewMode::ModelWipe;
        }
        told
    }

    /// The camera whose photographs are looked at, where it is not the one that measured depth, to
    /// whose pixels preparation belongs.
    pub(super) fn color_camera(&self, opened: &Opened) -> Option<ColorCamera> {
        opened.color_camera().filter(|_| self.mode != ViewMode::Preparation)
    }

    /// The photograph taken from here, if it is compared with.
    pub(super) fn look_at_photo(
        &mut self,
        ui: &Ui,
        opened: &Opened,
        is_training: bool,
    ) -> Option<Result<PhotoResult, String>> {
        // A second model is measured by the photograph beside the scene, where there is one.
        let is_looked_at = self.mode.needs_frame() || self.mode.has_model();
        let (true, Place::At(frame)) = (is_looked_at, &self.place) else { return None };
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
                    return Some(Err(format!(
                        "no thread for photographs could be started: {error}"
                    )));
                }
            }
        }
        self.photos.as_mut()?.look(ui, &query, is_training).cloned()
    }

    /// What to draw.
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
        // A dataset's camera is a pinhole whatever else is looked through.
        let lens = if self.place == Place::Free { settings.lens } else { Lens::Pinhole };
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
                // Of its own size: a far larger or smaller scene must not cut it off.
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
        if self.mode.has_photo() && self.place != Place::Free && options.look.paint == Paint::Stored
        {
            // Beside a photograph the scene is as bright as that was taken.
            options.exposing = Exposing::Recorded;
        }
        PictureRequest { camera, options, second }
    }
}
