//! `info` of a checkpoint.

use super::args::InfoArgs;
use super::failure::Failure;
use super::{output, tracked};
use serde::Serialize;
use std::path::PathBuf;
use vbgs_studio::dataset;
use vbgs_studio::dataset::fingerprint::Fingerprint;
use vbgs_studio::eval::trajectory_error::TrajectoryError;
use vbgs_studio::pipeline::checkpoint::SavedRun;
use vbgs_studio::pipeline::run::RunConfig;
use vbgs_studio::pipeline::tracked::Trajectory;

#[derive(Serialize)]
struct CheckpointInfo {
    path: String,
    kind: &'static str,
    version: String,
    /// Program that wrote it.
    program: String,
    /// Frames learnt.
    frames: u64,
    /// Frames gone through but unusable.
    skipped: u64,
    /// Frames of the run.
    planned_frames: usize,
    points: u64,
    components: usize,
    /// Those with points.
    used: usize,
    /// Those that renderers draw.
    drawn: usize,
    bytes: u64,
    bytes_per_component: f64,
    dataset: Option<PathBuf>,
    /// Where its frames were found, if it was tracked.
    #[serde(skip_serializing_if = "Option::is_none")]
    tracking: Option<TrackingInfo>,
    config: RunConfig,
    defects: Vec<String>,
}

/// Frames of a tracked run.
#[derive(Serialize)]
struct TrackingInfo {
    trajectory: Trajectory,
    /// From the recorded poses, where the dataset is there and has any.
    error: Option<TrajectoryError>,
    #[serde(skip)]
    summary: String,
}

/// Reads all of it, and looks whether its dataset is still there.
pub fn run(args: &InfoArgs) -> Result<(), Failure> {
    let run = SavedRun::read(&args.path)?;
    // Revived, not read only: what is drawn follows from the sums and is stored nowhere.
    let learner = run.revive()?.learner;
    let (used, components) = (learner.used(), learner.components());
    let drawn = learner.stored_splats().iter().filter(|splat| splat.is_drawable()).count();
    let tracking = run.trajectory()?.map(|trajectory| tracking(trajectory, &run));
    let defects = dataset_defect(&run).into_iter().chain(run.numerics_differ()).collect();
    let SavedRun { version, bytes, config, meta, content, .. } = run;
    let cursor = &content.cursor;
    let info = CheckpointInfo {
        path: args.path.display().to_string(),
        kind: "checkpoint",
        version: format!("{}.{}", version.0, version.1),
        program: meta.program,
        frames: cursor.frames,
        skipped: cursor.visited.len() as u64 - cursor.frames,
        planned_frames: meta.planned_frames,
        points: cursor.points,
        components,
        used,
        drawn,
        bytes,
        bytes_per_component: bytes as f64 / components.max(1) as f64,
        dataset: meta.dataset,
        tracking,
        config,
        defects,
    };
    if args.json { output::json(&info) } else { print(&info) }
}

fn tracking(trajectory: Trajectory, run: &SavedRun) -> TrackingInfo {
    let path = run.meta.dataset.as_ref();
    let dataset = path.and_then(|path| dataset::open(path, &run.load_options()).ok());
    let error = dataset.and_then(|dataset| trajectory.error(&dataset));
    let summary = tracked::summary(&trajectory, error.as_ref());
    TrackingInfo { trajectory, error, summary }
}

/// Why the run could not go on as it is.
fn dataset_defect(run: &SavedRun) -> Option<String> {
    let path = run.meta.dataset.as_ref()?;
    let dataset = match dataset::open(path, &run.load_options()) {
        Ok(dataset) => dataset,
        Err(error) => return Some(format!("its dataset cannot be opened: {error}")),
    };
    let split = match &run.config.selection.split {
        Some(name) => dataset.split_named(name),
        None => dataset.training_split(),
    };
    let difference = match split {
        // Without a difference there is no defect: `?` ends with `None`.
        Ok(split) => run.meta.fingerprint.difference(&Fingerprint::of(&dataset, split))?,
        Err(error) => error.to_string(),
    };
    Some(format!("its dataset {} has changed: {difference}", path.display()))
}

fn print(info: &CheckpointInfo) -> Result<(), Failure> {
    let CheckpointInfo { config, .. } = info;
    output::line(format!(
        "{}: checkpoint, version {}, by {}, {:.1} MB ({:.0} bytes a component)",
        info.path,
        info.version,
        info.program,
        info.bytes as f64 * 1e-6,
        info.bytes_per_component
    ));
    output::line(format!(
        "  {} of {} frames learnt, {} skipped, {} points",
        info.frames, info.planned_frames, info.skipped, info.points
    ));
    output::line(format!(
        "  {} of {} components used, {} drawn",
        info.used, info.components, info.drawn
    ));
    let dataset = info.dataset.as_ref().map_or("built in".into(), |path| path.to_string_lossy());
    output::line(format!("  dataset: {dataset}"));
    if let Some(TrackingInfo { summary, trajectory, .. }) = &info.tracking {
        output::line(format!("  {summary}"));
        let lost = trajectory.skipped();
        (!lost.is_empty()).then(|| output::line(format!("    not placed: {}", lost.join(", "))));
    }
    output::line(format!("  config: {}", serde_json::to_string(config)?));
    info.defects.iter().for_each(|defect| output::line(format!("  defect: {defect}")));
    output::line(format!("  {} defects found", info.defects.len()));
    Ok(())
}
