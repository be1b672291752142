//! `info` for checkpoints.

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
    /// Name and version of the program that wrote it.
    program: String,
    /// Number of frames trained on.
    frames: u64,
    /// Number of unusable frames.
    skipped: u64,
    /// Total number of frames of the run.
    planned_frames: usize,
    points: u64,
    components: usize,
    /// Number of components with points.
    used: usize,
    /// Number of components that are drawn.
    drawn: usize,
    bytes: u64,
    bytes_per_component: f64,
    dataset: Option<PathBuf>,
    /// Tracked poses, if poses were tracked.
    #[serde(skip_serializing_if = "Option::is_none")]
    tracking: Option<TrackingInfo>,
    config: RunConfig,
    defects: Vec<String>,
}

/// Poses of a tracked run.
#[derive(Serialize)]
struct TrackingInfo {
    trajectory: Trajectory,
    /// Deviation from recorded poses, if the dataset is available and has any.
    error: Option<TrajectoryError>,
    #[serde(skip)]
    summary: String,
}

/// Describes a checkpoint and checks that its dataset still matches.
pub fn run(args: &InfoArgs) -> Result<(), Failure> {
    let run = SavedRun::read(&args.path)?;
    // Restored completely: the number of drawn splats is not stored but computed.
    let learner = run.revive()?.learner;
    let (used, components) = (learner.used(), learner.components());
    let drawn = learner.splats().iter().filter(|splat| splat.is_drawable()).count();
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
    if args.json { output::print_json(&info) } else { print(&info) }
}

fn tracking(trajectory: Trajectory, run: &SavedRun) -> TrackingInfo {
    let path = run.meta.dataset.as_ref();
    let dataset = path.and_then(|path| dataset::open(path, &run.load_options()).ok());
    let error = dataset.and_then(|dataset| trajectory.error(&dataset));
    let summary = tracked::summary(&trajectory, error.as_ref());
    TrackingInfo { trajectory, error, summary }
}

/// Describes why the run cannot be resumed with its dataset, if so.
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
        // `?` returns `None` if there is no difference, thus no defect.
        Ok(split) => run.meta.fingerprint.difference(&Fingerprint::of(&dataset, split))?,
        Err(error) => error.to_string(),
    };
    Some(format!("its dataset {} has changed: {difference}", path.display()))
}

fn print(info: &CheckpointInfo) -> Result<(), Failure> {
    let CheckpointInfo { config, .. } = info;
    output::print_line(format!(
        "{}: checkpoint, version {}, by {}, {:.1} MB ({:.0} bytes a component)",
        info.path,
        info.version,
        info.program,
        info.bytes as f64 * 1e-6,
        info.bytes_per_component
    ));
    output::print_line(format!(
        "  {} of {} frames trained, {} skipped, {} points",
        info.frames, info.planned_frames, info.skipped, info.points
    ));
    output::print_line(format!(
        "  {} of {} components used, {} drawn",
        info.used, info.components, info.drawn
    ));
    let dataset = info.dataset.as_ref().map_or("built in".into(), |path| path.to_string_lossy());
    output::print_line(format!("  dataset: {dataset}"));
    if let Some(TrackingInfo { summary, trajectory, .. }) = &info.tracking {
        output::print_line(format!("  {summary}"));
        let lost = trajectory.skipped();
        (!lost.is_empty())
            .then(|| output::print_line(format!("    not placed: {}", lost.join(", "))));
    }
    output::print_line(format!("  config: {}", serde_json::to_string(config)?));
    info.defects.iter().for_each(|defect| output::print_line(format!("  defect: {defect}")));
    output::print_line(format!("  {} defects found", info.defects.len()));
    Ok(())
}
