//! Loading a MODEL argument.

use super::failure::Failure;
use super::tracked;
use glam::DVec3;
use std::path::Path;
use vbgs_studio::dataset::calibration::ColorCamera;
use vbgs_studio::dataset::fingerprint::Fingerprint;
use vbgs_studio::dataset::splits::{HoldOut, ViewGroup};
use vbgs_studio::dataset::{Dataset, LoadOptions};
use vbgs_studio::eval::measure::Views;
use vbgs_studio::export;
use vbgs_studio::export::checkpoint::is_checkpoint;
use vbgs_studio::export::local_origin;
use vbgs_studio::export::mesh::Surfel;
use vbgs_studio::model::attributes::ComponentAttributes;
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::pipeline::any_preset::Revived;
use vbgs_studio::pipeline::checkpoint::SavedRun;
use vbgs_studio::pipeline::provenance::file_comments;
use vbgs_studio::pipeline::settings::method::Method;
use vbgs_studio::pipeline::surfels::surfels;
use vbgs_studio::pipeline::tracked::{PlacedViews, Trajectory};

/// What commands need of a model, whatever file it came from.
pub struct Model {
    pub splats: SplatSet,
    /// Direction that points up, where the file says so.
    pub up: Option<DVec3>,
    /// What its positions are relative to, in the world of its dataset.
    pub local_origin: DVec3,
    /// Whether its world is known to be in metres.
    pub is_metric: bool,
    /// How it was trained, where the file says so.
    pub method: Option<Method>,
    /// Where the frames it was trained on were found, if poses were tracked and the file says so.
    pub trajectory: Option<Trajectory>,
    /// What this program said about the conversion to splats.
    pub comments: Vec<String>,
    /// The frames that it was trained on, where the file says so.
    pub learnt: Option<LearntFrames>,
}

/// The frames that a run went through.
pub struct LearntFrames {
    fingerprint: Fingerprint,
    split: Option<String>,
    visited: Vec<u32>,
    /// How the run held frames out.
    pub hold_out: HoldOut,
}

impl LearntFrames {
    /// The frames in a dataset; `None` if the run was on another one.
    pub fn of(&self, dataset: &Dataset) -> Option<ViewGroup> {
        let split = match &self.split {
            Some(name) => dataset.split_named(name).ok()?,
            None => dataset.training_split().ok()?,
        };
        // It may have grown since.
        let found = Fingerprint::of_first(dataset, split, self.fingerprint.frames());
        let is_same = self.fingerprint.difference(&found).is_none();
        let frames = || self.visited.iter().map(|&frame| frame as usize).collect();
        is_same.then(|| ViewGroup { name: None, split, frames: frames() })
    }
}

impl Model {
    /// How a dataset is opened to be looked at beside the model: one that was tracked has a world of
    /// its own, in which recorded poses mean nothing.
    ///
    /// # Errors
    /// Tracked poses are asked for and the model has none.
    pub fn load_options(&self, asked: LoadOptions) -> Result<LoadOptions, Failure> {
        match (&self.trajectory, asked.track) {
            (None, true) => Err(Failure::Usage(
                "--poses track: expected the checkpoint of a tracked run, found a model that does not say where its frames were taken; give its checkpoint.vbgs".to_owned(),
            )),
            (found, _) => Ok(LoadOptions {
                track: found.is_some(),
                local_origin: Some(self.local_origin.to_array()),
                ..asked
            }),
        }
    }

    /// The views as the model places them, if it was tracked.
    ///
    /// # Errors
    /// None of them could be placed.
    pub fn place(
        &self,
        dataset: &Dataset,
        views: Views<'_>,
    ) -> Result<Option<PlacedViews>, Failure> {
        let (Some(found), Some(method)) = (&self.trajectory, &self.method) else { return Ok(None) };
        tracked::place(dataset, method, &self.splats, found, views)
    }

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
        let of = |i| {
            ComponentAttributes::new(&learner.posterior(i), normalization, None, None)
                .photographed(learner.photographed(i))
        };
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
        return of_run(run, splats);
    }
    of_file(path)
}

/// Like [`load`], with what training knows where the file holds it. Splats are in the order of the
/// components then.
pub fn load_with_training(path: &Path) -> Result<(Model, Option<Training>), Failure> {
    if is_checkpoint(path) {
        let run = SavedRun::read(path)?;
        let revived = run.revive()?;
        let model = of_run(run, revived.learner.splats())?;
        return Ok((model, Some(Training::of(&revived))));
    }
    Ok((of_file(path)?, None))
}

fn of_run(run: SavedRun, splats: SplatSet) -> Result<Model, Failure> {
    let comments = file_comments(&run.config.method, run.content.cursor.frames);
    let (up, is_metric, trajectory) = (Some(run.up()), run.is_metric(), run.trajectory()?);
    let local_origin = run.local_origin();
    let SavedRun { config, meta, content, .. } = run;
    let learnt = Some(LearntFrames {
        fingerprint: meta.fingerprint,
        split: config.selection.split,
        hold_out: config.selection.hold_out,
        visited: content.cursor.visited,
    });
    Ok(Model {
        splats,
        up,
        local_origin,
        is_metric,
        method: Some(config.method),
        trajectory,
        comments,
        learnt,
    })
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
    let is_ours = |line: &String| line.starts_with("vbgs ") && !local_origin::is_comment(line);
    let comments = model.comments.into_iter().filter(is_ours).collect();
    Ok(Model {
        splats: model.splats,
        up,
        local_origin: model.local_origin,
        is_metric: false,
        method: None,
        trajectory: None,
        comments,
        learnt: None,
    })
}
