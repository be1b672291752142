//! Loads a MODEL argument.

use super::failure::Failure;
use glam::DVec3;
use std::mem;
use std::path::Path;
use vbgs_studio::dataset::calibration::ColorCamera;
use vbgs_studio::dataset::fingerprint::Fingerprint;
use vbgs_studio::dataset::splits::{HoldOut, ViewGroup};
use vbgs_studio::dataset::{self, Dataset, LoadOptions};
use vbgs_studio::export;
use vbgs_studio::export::checkpoint::is_checkpoint;
use vbgs_studio::export::local_origin;
use vbgs_studio::export::mesh::Surfel;
use vbgs_studio::export::registration::Registration;
use vbgs_studio::model::attributes::ComponentAttributes;
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::pipeline::any_preset::{PlacedLearner, file_comments};
use vbgs_studio::pipeline::checkpoint::SavedRun;
use vbgs_studio::pipeline::settings::method::Method;
use vbgs_studio::pipeline::tracked::{Trajectory, surfels};

pub struct Model {
    pub splats: SplatSet,
    pub up: Option<DVec3>,
    /// Up direction in the axes of `splats`, if the format defines its axes instead of keeping the dataset's.
    defined_up: Option<DVec3>,
    /// Position of the model's local origin in the dataset's world, world units.
    pub local_origin: DVec3,
    pub is_metric: bool,
    /// Registration of the world, which exports apply.
    pub registration: Option<Registration>,
    pub method: Option<Method>,
    pub trajectory: Option<Trajectory>,
    /// Comments written by this program about the conversion to splats.
    pub comments: Vec<String>,
    pub trained_frames: Option<TrainedFrames>,
}

pub struct TrainedFrames {
    fingerprint: Fingerprint,
    split: Option<String>,
    visited: Vec<u32>,
    pub hold_out: HoldOut,
}

impl TrainedFrames {
    /// Returns a model's training frames as views of a dataset, or `None` if the run used another
    /// dataset.
    pub fn of(&self, dataset: &Dataset) -> Option<ViewGroup> {
        let split = match &self.split {
            // Another dataset may lack the split.
            Some(name) => dataset.split_named(name).ok()?,
            None => dataset.training_split().ok()?,
        };
        // The dataset may have grown since.
        let found = Fingerprint::of_first_frames(dataset, split, self.fingerprint.frames());
        let is_same = self.fingerprint.difference(&found).is_none();
        let frames = || self.visited.iter().map(|&frame| frame as usize).collect();
        is_same.then(|| ViewGroup { name: None, split, frames: frames() })
    }
}

impl Model {
    /// Opens a dataset together with the model. Formats that define their axes do not keep those of the dataset:
    /// such a model is turned to the dataset's up direction, as an export from its world was turned away from it.
    ///
    /// # Errors
    /// Those of opening. Tracked poses were requested, but the model has none.
    pub fn open_dataset(&mut self, path: &Path, asked: LoadOptions) -> Result<Dataset, Failure> {
        let open = |model: &Self| Ok(dataset::open(path, &model.load_options(asked)?)?);
        let dataset: Dataset = open(self)?;
        let up = dataset.up(dataset.training_split().unwrap_or(0));
        let Some(from) = self.defined_up.replace(up).filter(|from| *from != up) else {
            return Ok(dataset);
        };
        let (splats, origin) = (mem::take(&mut self.splats), self.local_origin);
        (self.splats, self.local_origin) = export::turned(splats, origin, [from, up]);
        self.up = Some(up);
        note!(
            "note: the model's format is z-up or y-up: turned to the dataset's up direction {up:.3}"
        );
        // Poses are relative to the origin, which was turned as well.
        if origin == DVec3::ZERO { Ok(dataset) } else { open(self) }
    }

    /// Returns the options for opening a dataset together with the model. A tracked model has its own world,
    /// in which recorded poses are meaningless.
    fn load_options(&self, asked: LoadOptions) -> Result<LoadOptions, Failure> {
        match (&self.trajectory, asked.track) {
            (None, true) => Err(usage!(
                "--poses track: expected the checkpoint of a tracked run, found a model without the poses of its frames; give its checkpoint.vbgs"
            )),
            (found, _) => Ok(LoadOptions {
                track: found.is_some(),
                calibrated_photographs: asked.calibrated_photographs
                    || self.method.as_ref().is_some_and(|m| m.as_any().color_camera().is_some()),
                local_origin: Some(self.local_origin.to_array()),
                ..asked
            }),
        }
    }

    /// Returns settings and poses of a tracked model, relative to which new views are tracked.
    pub fn tracked(&self) -> Option<(&Method, &Trajectory)> {
        self.method.as_ref().zip(self.trajectory.as_ref())
    }

    /// Returns the colour camera of a dataset's photographs, if it differs from the depth camera. This
    /// is the one used for training or, for models without settings, that of the dataset's layout.
    pub fn color_camera(&self, dataset: &Dataset) -> Option<ColorCamera> {
        match &self.method {
            Some(method) => method.as_any().color_camera(),
            // Splat files do not contain a camera.
            None => dataset.known_calibration().and_then(|c| c.color_camera),
        }
    }
}

pub struct Training {
    pub evidence: Vec<f64>,
    /// Standard deviation of each component's position, world units.
    pub uncertainty: Vec<f64>,
    pub surfels: Vec<(usize, Surfel)>,
}

impl Training {
    fn of(revived: &PlacedLearner) -> Self {
        let (learner, normalization) = (&revived.learner, &revived.normalization);
        let of = |i| {
            let component = learner.component(i);
            ComponentAttributes::new(&component.posterior, normalization, None, None)
                .with_photometric_uncertainty(component.photometric_deviations)
        };
        let attributes: Vec<_> = (0..learner.status().components).map(of).collect();
        // Without statistics a component has no evidence and unlimited uncertainty.
        let evidence = attributes.iter().map(|a| a.evidence.map_or(0.0, f64::from)).collect();
        let uncertainty = |a: &ComponentAttributes| a.uncertainty.map_or(f64::INFINITY, f64::from);
        let uncertainty = attributes.iter().map(uncertainty).collect();
        Self { evidence, uncertainty, surfels: surfels(&**learner, normalization) }
    }
}

/// Reads a model and detects its format by content. Data that is ignored or assumed is reported on
/// stderr.
pub fn load(path: &Path) -> Result<Model, Failure> {
    if is_checkpoint(path) {
        let run = SavedRun::read(path)?;
        let splats = run.splats()?;
        return of_run(run, splats);
    }
    of_file(path)
}

/// Reads a model like [`load`], with the training state if the file contains it. Splats are then in
/// component order.
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
    let learnt = Some(TrainedFrames {
        fingerprint: meta.fingerprint,
        split: config.selection.split,
        hold_out: config.selection.hold_out,
        visited: content.cursor.visited,
    });
    Ok(Model {
        splats,
        up,
        defined_up: None,
        local_origin,
        is_metric,
        registration: meta.registration,
        method: Some(config.method),
        trajectory,
        comments,
        trained_frames: learnt,
    })
}

fn of_file(path: &Path) -> Result<Model, Failure> {
    let model = export::read(path)?;
    for note in &model.notes {
        note!("note: {}: {note}", path.display());
    }
    if model.skipped > 0 {
        note!(
            "warning: {}: {} rows that are not finite were left out",
            path.display(),
            model.skipped
        );
    }
    let up = model.up();
    // Comments of other programs describe the original file: its axes, its exporter.
    let is_ours = |line: &String| line.starts_with("vbgs ") && !local_origin::is_comment(line);
    // The local origin is left out, because each export writes its own in its own axes.
    let comments = model.comments.into_iter().filter(is_ours).collect();
    Ok(Model {
        splats: model.splats,
        up,
        defined_up: model.defined_up,
        local_origin: model.local_origin,
        is_metric: false,
        registration: None,
        method: None,
        trajectory: None,
        comments,
        trained_frames: None,
    })
}
