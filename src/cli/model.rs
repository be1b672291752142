//! Loading a MODEL argument.

use super::failure::Failure;
use glam::DVec3;
use std::path::Path;
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::calibration::ColorCamera;
use vbgs_studio::export;
use vbgs_studio::export::checkpoint::is_checkpoint;
use vbgs_studio::export::mesh::Surfel;
use vbgs_studio::model::attributes::ComponentAttributes;
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::pipeline::any_preset::Revived;
use vbgs_studio::pipeline::checkpoint::SavedRun;
use vbgs_studio::pipeline::provenance::file_comments;
use vbgs_studio::pipeline::settings::method::Method;
use vbgs_studio::pipeline::surfels::surfels;

/// What commands need of a model, whatever file it came from.
pub struct Model {
    pub splats: SplatSet,
    /// Direction that points up, where the file says so.
    pub up: Option<DVec3>,
    /// Whether its world is known to be in metres.
    pub is_metric: bool,
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

/// What training knows of each component of a model.
pub struct Training {
    /// Points it has received.
    pub evidence: Vec<f64>,
    /// Standard deviation of its position, world units.
    pub uncertainty: Vec<f64>,
    /// Its pieces of surface, by component.
    pub surfels: Vec<(usize, Surfel)>,
}

impl Training {
    fn of(revived: &Revived) -> Self {
        let (learner, normalization) = (&revived.learner, &revived.normalization);
        let of = |i| ComponentAttributes::new(&learner.posterior(i), normalization, None, None);
        let attributes: Vec<_> = (0..learner.components()).map(of).collect();
        let evidence = attributes.iter().map(|a| a.evidence.map_or(0.0, f64::from)).collect();
        let uncertainty = |a: &ComponentAttributes| a.uncertainty.map_or(f64::INFINITY, f64::from);
        let uncertainty = attributes.iter().map(uncertainty).collect();
        Self { evidence, uncertainty, surfels: surfels(revived) }
    }
}

/// Reads a model, recognised by its content, and says on stderr what was ignored or guessed.
pub fn load(path: &Path) -> Result<Model, Failure> {
    if is_checkpoint(path) {
        let run = SavedRun::read(path)?;
        let splats = run.splats()?;
        return Ok(of_run(run, splats));
    }
    of_file(path)
}

/// Like [`load`], with what training knows where the file holds it. Splats are in the order of the
/// components then.
pub fn load_with_training(path: &Path) -> Result<(Model, Option<Training>), Failure> {
    if is_checkpoint(path) {
        let run = SavedRun::read(path)?;
        let revived = run.revive()?;
        let model = of_run(run, revived.learner.splats());
        return Ok((model, Some(Training::of(&revived))));
    }
    Ok((of_file(path)?, None))
}

fn of_run(run: SavedRun, splats: SplatSet) -> Model {
    let comments = file_comments(&run.config.method, run.content.cursor.frames);
    let (up, is_metric) = (Some(run.up()), run.is_metric());
    Model { splats, up, is_metric, method: Some(run.config.method), comments }
}

fn of_file(path: &Path) -> Result<Model, Failure> {
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
    Ok(Model { splats: model.splats, up, is_metric: false, method: None, comments })
}
