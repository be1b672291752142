//! `info` describes a dataset or model and lists all defects found; `calibrate` estimates the camera
//! calibration of a dataset.

use super::args::{CalibrateArgs, InfoArgs};
use super::failure::Failure;
use super::train::print_dataset_notes;
use super::{output, tracked};
use glam::DVec3;
use serde::Serialize;
use std::path::PathBuf;
use vbgs_studio::calibrate::CalibratePlan;
use vbgs_studio::dataset::calibration::Calibration;
use vbgs_studio::dataset::capture_check::CaptureCheck;
use vbgs_studio::dataset::error::DatasetError;
use vbgs_studio::dataset::fingerprint::Fingerprint;
use vbgs_studio::dataset::frame::{Depth, DepthCodes, DepthKind};
use vbgs_studio::dataset::pose_check::PoseCheck;
use vbgs_studio::dataset::splits::HELD_OUT;
use vbgs_studio::dataset::wild_poses::outlier_poses;
use vbgs_studio::dataset::{Dataset, FrameEntry, LoadOptions};
use vbgs_studio::eval::trajectory_error::TrajectoryError;
use vbgs_studio::export::checkpoint::{StoredModel, is_checkpoint};
use vbgs_studio::export::registration::Registration;
use vbgs_studio::export::{Imported, ModelKind};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::pipeline::checkpoint::SavedRun;
use vbgs_studio::pipeline::run::RunConfig;
use vbgs_studio::pipeline::tracked::Trajectory;
use vbgs_studio::train::learner::Status;
use vbgs_studio::{calibrate, dataset, export};

#[derive(Serialize)]
struct DatasetInfo {
    path: String,
    layout: &'static str,
    recognised_by: String,
    splits: Vec<SplitInfo>,
    evaluation: String,
    skipped_frames: usize,
    frame_rate: Option<f64>,
    poses: PosesInfo,
    notes: Vec<String>,
    defects: Vec<String>,
}

#[derive(Serialize)]
struct PosesInfo {
    convention: &'static str,
    /// Fraction of depth values that agree with those of neighbouring frames.
    agreement: Option<f64>,
    /// Median difference from the depths of neighbouring frames, world units.
    median_error: Option<f64>,
    pairs: usize,
    #[serde(skip)]
    // For text output; JSON contains its numbers.
    summary: Option<String>,
}

#[derive(Serialize)]
struct SplitInfo {
    name: String,
    frames: usize,
    has_depth: bool,
    width: u32,
    height: u32,
    focal_px: [f64; 2],
    principal_point_px: [f64; 2],
    photo_size: [u32; 2],
    photo_focal_px: [f64; 2],
    /// Storage format and meaning of depth values.
    depth_unit: Option<String>,
    /// Smallest and largest depth of the readable frames, world units.
    depth_range: Option<[f64; 2]>,
    bytes: u64,
    /// Blurred images, brightness jumps and time gaps; `None` if these frames are
    /// checked as part of another split.
    capture: Option<CaptureCheck>,
}

#[derive(Serialize)]
struct ModelInfo {
    path: String,
    kind: &'static str,
    splats: usize,
    sh_degree: u8,
    skipped: usize,
    /// Bounding box in world coordinates, including the local origin.
    bounds: Option<[[f64; 3]; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    local_origin: Option<[f64; 3]>,
    bytes: u64,
    comments: Vec<String>,
    notes: Vec<String>,
}

pub fn run(args: &InfoArgs) -> Result<(), Failure> {
    // An archive is a file that holds a dataset, not a model.
    if args.path.is_file() && !dataset::is_archive(&args.path) {
        if is_checkpoint(&args.path) {
            return describe_checkpoint(args);
        }
        let info = model_info(args, &export::read_outline(&args.path)?);
        return if args.json { output::print_json(&info) } else { print_model(&info) };
    }
    let dataset = dataset::open(&args.path, &args.depth.load_options())?;
    let info = dataset_info(args, &dataset);
    if args.json { output::print_json(&info) } else { print_dataset(&info) }
}

fn dataset_info(args: &InfoArgs, dataset: &Dataset) -> DatasetInfo {
    let warnings = dataset.warnings.iter().map(ToString::to_string);
    let mut defects: Vec<String> = warnings.chain(dataset.unused.iter().cloned()).collect();
    let splits =
        (0..dataset.splits.len()).map(|split| split_info(dataset, split, &mut defects)).collect();
    if let Ok(split) = dataset.training_split() {
        defects.extend(outlier_poses(&dataset.splits[split]).iter().map(ToString::to_string));
    }
    let poses = poses_info(dataset, &mut defects);
    let evaluation =
        // Without a training split, its error explains why nothing is evaluated.
        dataset.training_split().map_or_else(|e| e.to_string(), |t| dataset.evaluation(t).why);
    DatasetInfo {
        path: args.path.display().to_string(),
        layout: dataset.layout.name(),
        recognised_by: dataset.recognised_by.clone(),
        splits,
        evaluation,
        skipped_frames: dataset.warnings.len(),
        frame_rate: dataset.splits.first().and_then(|split| frame_rate(&split.frames)),
        poses,
        notes: dataset.notes.clone(),
        defects,
    }
}

fn poses_info(dataset: &Dataset, defects: &mut Vec<String>) -> PosesInfo {
    // Without depth there is no training split, and the check finds no pairs.
    let split = dataset.training_split().unwrap_or(0);
    let is_tracked = dataset.options.track;
    let check: Option<PoseCheck> = dataset::pose_check::check(dataset, split);
    let opened = check.as_ref().map(|check| check.opened);
    defects.extend(check.iter().flat_map(PoseCheck::warnings));
    let stated = dataset.options.poses.unwrap_or(dataset.layout.pose_convention());
    PosesInfo {
        convention: if is_tracked { "tracked" } else { stated.name() },
        agreement: opened.map(|trial| trial.agreement),
        // JSON cannot represent an infinite error.
        median_error: opened.map(|trial| trial.error).filter(|error| error.is_finite()),
        pairs: check.as_ref().map_or(0, |check| check.pairs),
        // Tracked poses have no recorded convention to check.
        summary: match is_tracked {
            true => Some("found by tracking".to_owned()),
            false => check.as_ref().map(tracked::pose_summary),
        },
    }
}

fn frame_rate(frames: &[FrameEntry]) -> Option<f64> {
    let (first, last) = (frames.first()?.time?, frames.last()?.time?);
    let rate = (frames.len() as f64 - 1.0) / (last - first);
    // A single frame, or equal times, give no finite rate.
    (rate.is_finite() && rate > 0.0).then_some(rate)
}

fn depth_unit(depth: &Depth) -> String {
    let stored = match depth.codes {
        DepthCodes::Inverse8(_) => "8-bit codes of 8 (1 - d/255) world units".to_owned(),
        DepthCodes::Linear16 { unit, .. } => format!("16-bit steps of {unit:.6} world units"),
        DepthCodes::Lengths(_) => "floats in world units".to_owned(),
    };
    let measured = match depth.kind {
        DepthKind::RayDistance => "the ray",
        DepthKind::Z => "the optical axis",
    };
    format!("{stored} along {measured}")
}

/// Describes a split. Loads every frame, which finds damaged files.
fn split_info(dataset: &Dataset, split: usize, defects: &mut Vec<String>) -> SplitInfo {
    let frames = &dataset.splits[split].frames;
    let bar = super::output::bar(frames.len(), "frame");
    let (mut range, mut unit): (Option<[f64; 2]>, Option<String>) = (None, None);
    let mut bytes = 0;
    // Held-out frames belong to another split and were checked there.
    let is_part = dataset.splits[split].name == HELD_OUT;
    for (index, entry) in frames.iter().enumerate().filter(|_| !is_part) {
        let files = entry.color_path().into_iter().chain(entry.depth_path());
        // Missing files count nothing here; loading reports them as defects.
        bytes += files.filter_map(|f| f.metadata().ok()).map(|m| m.len()).sum::<u64>();
        match dataset.load(split, index) {
            Err(error) => defects.push(error.to_string()),
            Ok(frame) => {
                unit = unit.or_else(|| frame.depth.as_ref().map(depth_unit));
                // Includes invalid depth: users choose `--depth-range` by this range.
                let depth = frame.depth_z().map(|d| d.data).unwrap_or_default();
                for z in depth.into_iter().filter(|&z| z > 0.0).map(f64::from) {
                    range = Some(range.map_or([z, z], |[lo, hi]| [lo.min(z), hi.max(z)]));
                }
            }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    // Opened datasets have no empty splits.
    let k: &Intrinsics = &frames[0].camera.intrinsics;
    let photo =
        frames[0].photo_camera(dataset.known_calibration().and_then(|c| c.color_camera).as_ref());
    let photo = photo.intrinsics;
    SplitInfo {
        name: dataset.splits[split].name.clone(),
        frames: frames.len(),
        has_depth: dataset.splits[split].has_depth,
        width: k.width,
        height: k.height,
        focal_px: [k.fx, k.fy],
        principal_point_px: [k.cx, k.cy],
        photo_size: [photo.width, photo.height],
        photo_focal_px: [photo.fx, photo.fy],
        depth_unit: unit,
        depth_range: range,
        bytes,
        capture: (!is_part).then(|| dataset::capture_check::check(&dataset.splits[split])),
    }
}

fn print_dataset(info: &DatasetInfo) -> Result<(), Failure> {
    out!("{}: {} dataset, recognised by {}", info.path, info.layout, info.recognised_by);
    info.splits.iter().for_each(print_split);
    out!("  evaluation: {}", info.evaluation);
    let summary = info.poses.summary.as_deref();
    out!("  poses: {}", summary.unwrap_or("too few frames with depth to check"));
    info.notes.iter().for_each(|note| out!("  note: {note}"));
    if info.skipped_frames > 0 {
        out!("  entries skipped: {}", info.skipped_frames);
    }
    print_defects(&info.defects);
    Ok(())
}

fn print_defects(defects: &[String]) {
    defects.iter().for_each(|defect| out!("  defect: {defect}"));
    let noun = if defects.len() == 1 { "defect" } else { "defects" };
    out!("  {} {noun} found", defects.len());
}

fn print_split(s: &SplitInfo) {
    // These frames belong to a split that was already described.
    if s.name == HELD_OUT {
        out!("  {}: {} of these frames", s.name, s.frames);
        return;
    }
    let depth = match s.depth_range {
        Some([lo, hi]) => format!("depth {lo:.3} to {hi:.3}"),
        None if s.has_depth => "unreadable depth".to_owned(),
        None => "no depth".to_owned(),
    };
    out!(
        "  {}: {} frames of {}x{}, focal {:.1} {:.1} px, {depth}, {:.1} MB",
        s.name,
        s.frames,
        s.width,
        s.height,
        s.focal_px[0],
        s.focal_px[1],
        s.bytes as f64 * 1e-6
    );
    if let Some(unit) = &s.depth_unit {
        out!("    depth: {unit}");
    }
    if s.photo_size != [s.width, s.height] || s.photo_focal_px != s.focal_px {
        let ([width, height], [fx, fy]) = (s.photo_size, s.photo_focal_px);
        out!("    photographs: {width}x{height}, focal {fx:.1} {fy:.1} px");
    }
    let capture = s.capture.iter().flat_map(capture_lines);
    capture.for_each(|line| out!("    {line}"));
}

fn model_info(args: &InfoArgs, model: &Imported) -> ModelInfo {
    ModelInfo {
        path: args.path.display().to_string(),
        kind: match model.kind {
            ModelKind::Splats => "splats",
            ModelKind::PointCloud => "point-cloud",
        },
        splats: model.outline.n_splats,
        // Import drops harmonics above degree 1.
        sh_degree: u8::from(model.outline.is_directional),
        skipped: model.skipped,
        // Splats are relative to the local origin.
        bounds: (model.outline.bounds)
            .map(|ends| ends.map(|at| (at + model.local_origin).to_array())),
        local_origin: (model.local_origin != DVec3::ZERO).then_some(model.local_origin.to_array()),
        bytes: model.bytes,
        comments: model.comments.clone(),
        notes: model.notes.iter().map(ToString::to_string).collect(),
    }
}

fn print_model(info: &ModelInfo) -> Result<(), Failure> {
    out!("{}: {} {}, {:.1} MB", info.path, info.splats, info.kind, info.bytes as f64 * 1e-6);
    if let Some([lo, hi]) = info.bounds {
        out!("  from {lo:.3?} to {hi:.3?}");
    }
    if let Some([x, y, z]) = info.local_origin {
        out!("  its positions are relative to ({x}, {y}, {z})");
    }
    if info.sh_degree > 0 {
        output::print_line("  colour depends on the direction (harmonics of degree 1)");
    }
    info.comments.iter().for_each(|comment| out!("  comment: {comment}"));
    info.notes.iter().for_each(|note| out!("  note: {note}"));
    if info.skipped > 0 {
        out!("  defect: {} rows are not finite", info.skipped);
    }
    Ok(())
}

/// Maximum number of frames listed per kind of finding. Further frames are only counted.
const NAMED: usize = 6;

fn capture_lines(check: &CaptureCheck) -> Vec<String> {
    let CaptureCheck { looked_at, frames, blurred, brightness_jumps, usual_step_s, gaps } = check;
    let mut lines = vec![format!(
        "images: {looked_at} of {frames} frames checked, {} blurred, {} jumps of brightness",
        blurred.len(),
        brightness_jumps.len()
    )];
    let shares = blurred.iter().map(|b| format!("{} ({:.2})", b.frame, b.share));
    lines.extend(list("blurred (sharpness as a share of the neighbours')", shares));
    let factors = brightness_jumps.iter().map(|j| format!("{} ({:.2})", j.frame, j.factor));
    lines.extend(list("brightness jumps (times the frame before's)", factors));
    if let Some(usual) = usual_step_s {
        lines.push(format!("times: {:.1} frames a second, {} gaps", 1.0 / usual, gaps.len()));
    }
    let waits = gaps.iter().map(|gap| format!("{} ({:.2} s)", gap.frame, gap.seconds));
    lines.extend(list("gaps (seconds since the frame before)", waits));
    lines
}

fn list(what: &str, found: impl ExactSizeIterator<Item = String>) -> Option<String> {
    let n = found.len();
    let named: Vec<String> = found.take(NAMED).collect();
    let more = n - named.len();
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (n > 0).then(|| format!("{what}: {}{more}", named.join(", ")))
}

#[derive(Serialize)]
struct CheckpointInfo {
    path: String,
    kind: &'static str,
    version: String,
    program: String,
    frames: u64,
    skipped: u64,
    planned_frames: usize,
    points: u64,
    components: usize,
    used: usize,
    drawn: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    textures: Option<TexturesInfo>,
    bytes: u64,
    bytes_per_component: f64,
    dataset: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    registration: Option<Registration>,
    #[serde(skip_serializing_if = "Option::is_none")]
    tracking: Option<TrackingInfo>,
    config: RunConfig,
    defects: Vec<String>,
}

#[derive(Serialize)]
struct TexturesInfo {
    /// Number of textured components.
    components: usize,
    /// Memory in training.
    bytes: usize,
    /// Smallest distance between neighbouring texels, world units.
    finest_pitch: f64,
}

impl TexturesInfo {
    /// Returns `None` if no component has a texture.
    fn of(model: &StoredModel) -> Option<Self> {
        let StoredModel::Scene(scene) = model else { return None };
        let state = scene.photometric.as_ref()?;
        let textures = || state.textures.iter().flatten();
        let pitches = textures().map(|texture| 1.0 / texture.lattice.per_unit());
        let finest_pitch = pitches.reduce(f64::min)?;
        Some(Self { components: textures().count(), bytes: state.texture_bytes(), finest_pitch })
    }
}

#[derive(Serialize)]
struct TrackingInfo {
    trajectory: Trajectory,
    /// Deviation of tracked from recorded poses, if the dataset is available and has recorded poses.
    error: Option<TrajectoryError>,
    #[serde(skip)]
    summary: String,
}

fn describe_checkpoint(args: &InfoArgs) -> Result<(), Failure> {
    let run = SavedRun::read(&args.path)?;
    // Restored completely: the number of drawn splats is not stored but computed.
    let learner = run.revive()?.learner;
    let Status { used, components, .. } = learner.status();
    let drawn = learner.splats().iter().filter(|splat| splat.is_drawable()).count();
    // Once for both: opening lists every frame.
    let opened = run.meta.dataset.as_ref().map(|path| dataset::open(path, &run.load_options()));
    let tracking = run.trajectory()?.map(|trajectory| {
        let dataset = opened.as_ref().and_then(|opened| opened.as_ref().ok());
        let error = dataset.and_then(|dataset| trajectory.error(dataset));
        let summary = tracked::summary(&trajectory, error.as_ref());
        TrackingInfo { trajectory, error, summary }
    });
    let defect = opened.and_then(|opened| dataset_defect(&run, opened));
    let defects = defect.into_iter().chain(run.numerics_differ()).collect();
    let SavedRun { version, bytes, config, meta, content, .. } = run;
    let cursor = &content.cursor;
    let info = CheckpointInfo {
        path: args.path.display().to_string(),
        kind: "checkpoint",
        version: format!("{}.{}", version.0, version.1),
        program: meta.program,
        frames: cursor.frames,
        // Skipped frames count as visited but not as trained.
        skipped: cursor.visited.len() as u64 - cursor.frames,
        planned_frames: meta.planned_frames,
        points: cursor.points,
        components,
        used,
        drawn,
        textures: TexturesInfo::of(&content.model),
        bytes,
        bytes_per_component: bytes as f64 / components.max(1) as f64,
        dataset: meta.dataset,
        registration: meta.registration,
        tracking,
        config,
        defects,
    };
    if args.json { output::print_json(&info) } else { print_checkpoint(&info) }
}

/// Describes why the dataset of a run prevents resuming. Returns `None` if it does not.
fn dataset_defect(run: &SavedRun, opened: Result<Dataset, DatasetError>) -> Option<String> {
    let dataset = match opened {
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
    let path = run.meta.dataset.as_deref()?.display();
    Some(format!("its dataset {path} has changed: {difference}"))
}

fn print_checkpoint(info: &CheckpointInfo) -> Result<(), Failure> {
    let CheckpointInfo { config, .. } = info;
    out!(
        "{}: checkpoint, version {}, by {}, {:.1} MB ({:.0} bytes a component)",
        info.path,
        info.version,
        info.program,
        info.bytes as f64 * 1e-6,
        info.bytes_per_component
    );
    out!(
        "  {} of {} frames trained, {} skipped, {} points",
        info.frames,
        info.planned_frames,
        info.skipped,
        info.points
    );
    out!("  {} of {} components used, {} drawn", info.used, info.components, info.drawn);
    if let Some(TexturesInfo { components, bytes, finest_pitch }) = &info.textures {
        let megabytes = *bytes as f64 * 1e-6;
        out!(
            "  textures of {components} components, {megabytes:.1} MB, finest pitch {finest_pitch:.3e}"
        );
    }
    // Only the demo has no folder.
    let dataset = info.dataset.as_ref().map_or("built in".into(), |path| path.to_string_lossy());
    out!("  dataset: {dataset}");
    if let Some(registration) = &info.registration {
        out!("  registered: {registration}");
    }
    if let Some(TrackingInfo { summary, trajectory, .. }) = &info.tracking {
        out!("  {summary}");
        let lost = trajectory.skipped();
        (!lost.is_empty()).then(|| out!("    not placed: {}", lost.join(", ")));
    }
    out!("  config: {}", serde_json::to_string(config)?);
    print_defects(&info.defects);
    Ok(())
}

/// Estimates the calibration of a recording and writes it to a file.
pub fn run_calibrate(args: &CalibrateArgs) -> Result<(), Failure> {
    // Read before the recording is opened, so that errors in it are reported at once.
    let start = args.calibration.as_deref().map(Calibration::read).transpose()?;
    let options = LoadOptions {
        calibrated_photographs: start.as_ref().is_some_and(|start| start.color_camera.is_some()),
        ..args.depth.recorded_load_options()?
    };
    let dataset = dataset::open(&args.dataset, &options)?;
    print_dataset_notes(&dataset);
    let start = match start {
        Some(start) => start,
        None if args.from_scratch => Calibration::NONE,
        None => dataset.known_calibration().unwrap_or_default(),
    };
    let plan = CalibratePlan { split: args.split.clone(), max_frames: args.max_frames, start };
    // Checked before minutes of work whose result is written there.
    output::check_files(std::slice::from_ref(&args.output))?;
    let found = output::steps("calibrate", |progress| calibrate::run(&dataset, &plan, progress))?;
    found.skipped.iter().for_each(|message| note!("warning: {message}"));
    output::write_text(&args.output, &found.calibration.to_text()?)?;
    if args.json {
        return output::print_json(&found);
    }
    output::print_line(found.text());
    out!("wrote {}; use it with `train --calibration` or in the window", args.output.display());
    Ok(())
}

#[cfg(test)]
mod capture_check_tests {
    use super::*;
    use vbgs_studio::dataset::capture_check::{BlurredFrame, BrightnessJump, TimeGap};

    #[test]
    fn every_kind_is_named_and_long_lists_are_cut() {
        let blurred = |i: usize| BlurredFrame { frame: format!("f{i}"), share: 0.25 };
        let check = CaptureCheck {
            looked_at: 160,
            frames: 4000,
            blurred: (0..8).map(blurred).collect(),
            brightness_jumps: vec![BrightnessJump { frame: "f9".into(), factor: 1.5 }],
            usual_step_s: Some(0.04),
            gaps: vec![TimeGap { frame: "f7".into(), seconds: 1.25 }],
        };
        let expected = [
            "images: 160 of 4000 frames checked, 8 blurred, 1 jumps of brightness",
            "blurred (sharpness as a share of the neighbours'): f0 (0.25), f1 (0.25), f2 (0.25), f3 (0.25), f4 (0.25), f5 (0.25) and 2 more",
            "brightness jumps (times the frame before's): f9 (1.50)",
            "times: 25.0 frames a second, 1 gaps",
            "gaps (seconds since the frame before): f7 (1.25 s)",
        ];
        assert_eq!(capture_lines(&check), expected);
    }
}
