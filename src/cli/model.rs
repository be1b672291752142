//! Loading a MODEL argument.

use super::failure::Failure;
use glam::DVec3;
use std::path::Path;
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::calibration::ColorCamera;
use vbgs_studio::export;
use vbgs_studio::export::checkpoint::is_checkpoint;
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::model::splat::splats::CovarianceForm;
use vbgs_studio::pipeline::checkpoint::SavedRun;
use vbgs_studio::pipeline::settings::method::Method;

/// What commands need of a model, whatever file it came from.
pub struct Model {
    pub splats: SplatSet,
    /// Direction that points up, where the file says so.
    pub up: Option<DVec3>,
    /// How it was trained, where the file says so.
    pub method: Option<Method>,
    /// What this program said about the conversion to splats.
    pub comments: Vec<String>,
}

impl Model {
    /// The camera that takes a dataset's photographs, if not the one that measures depth: what the
    /// model was trained with, else what is known of the layout.
    pub fn color_camera(&self, dataset: &Dataset) -> Option<ColorCamera> {
        match &self.method {
            Some(method) => method.any().color_camera(),
            None => dataset.known_calibration().and_then(|c| c.color_camera),
        }
    }
}

/// Reads a model, recognised by its content, and says on stderr what was ignored or guessed.
pub fn load(path: &Path) -> Result<Model, Failure> {
    if is_checkpoint(path) {
        let run = SavedRun::read(path)?;
        let comments = conversion_comments(&run.config.method);
        let (splats, up) = (run.splats()?, Some(run.up()));
        return Ok(Model { splats, up, method: Some(run.config.method), comments });
    }
    let model = export::read(path)?;
    for note in &model.notes {
        eprintln!("note: {}: {note}", path.display());
    }
    if model.skipped > 0 {
        eprintln!(
            "warning: {}: {} rows that are not finite were left out",
            path.display(),
            model.skipped
        );
    }
    let up = model.up();
    // Foreign comments speak of the foreign file: its axes, its exporter.
    let comments = model.comments.into_iter().filter(|line| line.starts_with("vbgs ")).collect();
    Ok(Model { splats: model.splats, up, method: None, comments })
}

/// Comment lines of files that name a conversion other than the plain one.
pub fn conversion_comments(method: &Method) -> Vec<String> {
    match method.any().covariance_form() {
        CovarianceForm::LegacyCholesky => vec!["vbgs legacy-cov".to_owned()],
        CovarianceForm::Eigen => Vec::new(),
    }
}
