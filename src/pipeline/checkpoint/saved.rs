//! Run read from a checkpoint.

use super::error::RunError;
use crate::dataset::fingerprint::Fingerprint;
use crate::dataset::{Layout, LoadOptions};
use crate::eval::report;
use crate::eval::report::{FrameReport, QualityCurves, SkippedFrame};
use crate::export::checkpoint;
use crate::export::checkpoint::{Checkpoint, LoadedCheckpoint};
use crate::export::registration::Registration;
use crate::model::splat::appearance::SplatSet;
use crate::pipeline::any_preset::{Mismatch, PlacedLearner};
use crate::pipeline::error::SessionError;
use crate::pipeline::frame_loop::restore_any;
use crate::pipeline::plan::MAX_PASSES;
use crate::pipeline::run::RunConfig;
use crate::pipeline::tracked::Trajectory;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Content of the `META` section.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Name and version of the program that saved the run.
    pub program: String,
    /// Time of saving, Unix seconds.
    pub saved_unix_s: u64,
    /// Absolute path of the dataset; `None` for the built-in synthetic room.
    pub dataset: Option<PathBuf>,
    /// Fingerprint of the dataset.
    pub fingerprint: Fingerprint,
    /// Up direction in the world.
    pub up: [f64; 3],
    /// Number of frames planned for the run.
    pub planned_frames: usize,
    /// Registration of the world. Versions up to 0.1 lack it and ignore it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registration: Option<Registration>,
    /// Training time so far, in seconds.
    pub wall_s: f64,
}

/// Run read from a checkpoint.
#[derive(Clone, Debug)]
pub struct SavedRun {
    /// Path of the file.
    pub path: PathBuf,
    /// Format version, major and minor.
    pub version: (u16, u16),
    /// Size of the file in bytes.
    pub bytes: u64,
    /// Every setting that affects the result.
    pub config: RunConfig,
    /// Dataset, program and time of the run.
    pub meta: Meta,
    /// Contents of the file: model, progress and the JSON texts.
    pub content: Checkpoint,
}

impl SavedRun {
    /// Reads a checkpoint and checks that its sections match each other.
    pub fn read(path: &Path) -> Result<Self, RunError> {
        let LoadedCheckpoint { checkpoint, version, bytes } = checkpoint::read(path)?;
        Ok(Self { version, bytes, ..Self::new(path, checkpoint)? })
    }

    /// Creates the run of a checkpoint's content and checks that its sections match each other. The file need not
    /// exist; it counts no bytes.
    pub(super) fn new(path: &Path, content: Checkpoint) -> Result<Self, RunError> {
        let config: RunConfig = parse(path, "CONF", &content.config)?;
        let meta: Meta = parse(path, "META", &content.meta)?;
        if let Some(Err(found)) = meta.registration.as_ref().map(Registration::check) {
            let problem = format!("expected a registration, found {found}");
            return Err(RunError::Json { path: path.to_owned(), section: "META", problem });
        }
        let (path, version) = (path.to_owned(), checkpoint::VERSION);
        let run = Self { path, version, bytes: 0, config, meta, content };
        // Sections may be valid and yet contradict each other.
        run.config.method.as_any().check(&run.content.model).map_err(|why| run.mismatch(why))?;
        run.check_visits()?;
        Ok(run)
    }

    /// Returns the most often visited frame (its index in the split) and the number of its visits.
    pub(super) fn most_visited_frame(&self) -> (u32, usize) {
        let mut visited = self.content.cursor.visited.clone();
        visited.sort_unstable();
        let runs =
            visited.chunk_by(|a, b| a == b).filter_map(|run| Some((*run.first()?, run.len())));
        runs.max_by_key(|run| run.1).unwrap_or_default()
    }

    /// Checks that the number of passes is valid, and that no frame has more visits than there are
    /// passes.
    fn check_visits(&self) -> Result<(), RunError> {
        let passes = self.config.selection.passes;
        let refuse =
            |section, problem| Err(RunError::Json { path: self.path.clone(), section, problem });
        if !(1..=MAX_PASSES).contains(&passes) {
            return refuse("CONF", format!("expected 1 to {MAX_PASSES} passes, found {passes}"));
        }
        match self.most_visited_frame() {
            (frame, n) if n > passes => refuse(
                "CURS",
                format!(
                    "expected at most {passes} visits per frame, found frame {frame} {n} times"
                ),
            ),
            _ => Ok(()),
        }
    }

    /// Sets the registration of the world, also in the content.
    ///
    /// # Errors
    /// [`RunError::Session`] for numbers that JSON cannot represent.
    pub fn register(&mut self, registration: Option<Registration>) -> Result<(), RunError> {
        self.meta.registration = registration;
        self.content.meta = canonical(&self.meta).map_err(SessionError::from)?;
        Ok(())
    }

    /// Splats of the model, as in exported files.
    pub fn splats(&self) -> Result<SplatSet, RunError> {
        Ok(self.revive()?.learner.splats())
    }

    /// Returns the trajectory of tracked camera poses, if the run was tracked and its history is stored.
    ///
    /// # Errors
    /// [`RunError::Json`] for an invalid history.
    pub fn trajectory(&self) -> Result<Option<Trajectory>, RunError> {
        let Some(history) = &self.content.history else { return Ok(None) };
        let history: History = parse(&self.path, "HIST", history)?;
        Ok(Trajectory::of(&history.frames, &history.skipped))
    }

    /// Restores the learner for rendering, as if all buffered photographs had been trained on.
    ///
    /// # Errors
    /// [`RunError::Mismatch`] if model and settings do not match.
    pub fn revive(&self) -> Result<PlacedLearner, RunError> {
        let (model, frames) = (&self.content.model, self.content.cursor.frames);
        let revived = restore_any(&self.config.method, model, frames);
        let mut revived = revived.map_err(|why| self.mismatch(why))?;
        revived.learner.settle();
        Ok(revived)
    }

    fn mismatch(&self, mismatch: Mismatch) -> RunError {
        match mismatch {
            // The advice of other mismatches, to use another program, would not help here.
            Mismatch::Index(error) => RunError::Index(error),
            mismatch => RunError::Mismatch { path: self.path.clone(), mismatch },
        }
    }

    /// Up direction in the world.
    pub fn up(&self) -> DVec3 {
        // Not checked on reading: a zero vector must not give NaN.
        DVec3::from_array(self.meta.up).try_normalize().unwrap_or(DVec3::Z)
    }

    /// Returns options for opening the run's dataset with the model's local origin.
    pub fn load_options(&self) -> LoadOptions {
        self.config.load.with_fixed_origin()
    }

    /// Local origin, to which the model's positions are relative, in the world of the dataset.
    pub fn local_origin(&self) -> DVec3 {
        self.config.load.local_origin.map_or(DVec3::ZERO, DVec3::from_array)
    }

    /// True if world units are metres according to the layout of the dataset.
    pub fn is_metric(&self) -> bool {
        let load = &self.config.load;
        // With both options, the user may have chosen another unit.
        let is_given = load.depth_scale.is_some() && load.depth_range.is_some();
        !is_given && self.meta.fingerprint.layout().is_some_and(Layout::is_metric)
    }

    /// Returns a warning if the results of this machine may differ from those of the machine that saved
    /// the run.
    pub fn numerics_differ(&self) -> Option<String> {
        let here = report::numerics();
        (here != self.content.numerics).then(|| {
            format!(
                "{}: saved on a machine or build with {}, resumed with {here}: results may differ in the last bits",
                self.path.display(),
                self.content.numerics
            )
        })
    }
}

/// Content of the `HIST` section.
#[derive(Serialize, Deserialize)]
pub(super) struct History {
    pub frames: Vec<FrameReport>,
    pub skipped: Vec<SkippedFrame>,
    /// Missing in files of older programs, and without measurements.
    #[serde(default)]
    pub curves: QualityCurves,
}

impl History {
    /// Serializes to JSON with sorted keys, as [`canonical`] does.
    pub fn canonical(&self) -> Result<String, serde_json::Error> {
        // One frame at a time: as a single `Value`, a long run would take ten times the memory.
        let frames: Result<Vec<String>, _> = self.frames.iter().map(canonical).collect();
        let (skipped, frames) = (canonical(&self.skipped)?, frames?.join(","));
        let curves = match self.curves == QualityCurves::default() {
            true => String::new(),
            false => format!("\"curves\":{},", canonical(&self.curves)?),
        };
        Ok(format!("{{{curves}\"frames\":[{frames}],\"skipped\":{skipped}}}"))
    }
}

pub(super) fn parse<T: for<'de> Deserialize<'de>>(
    path: &Path,
    section: &'static str,
    json: &str,
) -> Result<T, RunError> {
    serde_json::from_str(json).map_err(|error| RunError::Json {
        path: path.to_owned(),
        section,
        problem: error.to_string(),
    })
}

/// Serializes to JSON with sorted keys, so that equal values have equal bytes.
pub(super) fn canonical(value: &impl Serialize) -> Result<String, serde_json::Error> {
    // Objects of `Value` sort their keys.
    Ok(serde_json::to_value(value)?.to_string())
}
