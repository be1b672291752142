//! `info`: what a dataset or a model holds, and every defect found.

use super::args::InfoArgs;
use super::failure::Failure;
use super::{checkpoint_info, output};
use serde::Serialize;
use vbgs_studio::dataset::{self, Dataset};
use vbgs_studio::export::checkpoint::is_checkpoint;
use vbgs_studio::export::{self, Imported, ModelKind};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::model::splat::splats::bounds;

#[derive(Serialize)]
struct DatasetInfo {
    path: String,
    layout: &'static str,
    recognised_by: String,
    splits: Vec<SplitInfo>,
    evaluation: String,
    notes: Vec<String>,
    defects: Vec<String>,
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
    /// Smallest and largest measured depth of the frames looked at, world units.
    depth_range: Option<[f64; 2]>,
    bytes: u64,
}

#[derive(Serialize)]
struct ModelInfo {
    path: String,
    kind: &'static str,
    splats: usize,
    /// Highest degree of the harmonics that were read.
    sh_degree: u8,
    skipped: usize,
    bounds: Option<[[f64; 3]; 2]>,
    bytes: u64,
    comments: Vec<String>,
    notes: Vec<String>,
}

/// Looks as asked: folders are datasets, files are models.
pub fn run(args: &InfoArgs) -> Result<(), Failure> {
    if args.path.is_file() {
        if is_checkpoint(&args.path) {
            return checkpoint_info::run(args);
        }
        let info = model_info(args, &export::read(&args.path)?);
        return if args.json { output::json(&info) } else { print_model(&info) };
    }
    let dataset = dataset::open(&args.path, &args.depth.load_options())?;
    let info = dataset_info(args, &dataset);
    if args.json { output::json(&info) } else { print_dataset(&info) }
}

fn dataset_info(args: &InfoArgs, dataset: &Dataset) -> DatasetInfo {
    let mut defects: Vec<String> = dataset.warnings.iter().map(ToString::to_string).collect();
    let splits =
        (0..dataset.splits.len()).map(|split| split_info(dataset, split, &mut defects)).collect();
    let evaluation =
        dataset.training_split().map_or_else(|e| e.to_string(), |t| dataset.evaluation(t).why);
    DatasetInfo {
        path: args.path.display().to_string(),
        layout: dataset.layout.name(),
        recognised_by: dataset.recognised_by.clone(),
        splits,
        evaluation,
        notes: dataset.notes.clone(),
        defects,
    }
}

/// Loads every frame of a split: `info` is where damaged files are looked for.
fn split_info(dataset: &Dataset, split: usize, defects: &mut Vec<String>) -> SplitInfo {
    let frames = &dataset.splits[split].frames;
    let bar = super::progress::bar(frames.len(), "frame");
    let mut range: Option<[f64; 2]> = None;
    let mut bytes = 0;
    for (index, entry) in frames.iter().enumerate() {
        let files = entry.color_path().into_iter().chain(entry.depth_path());
        bytes += files.filter_map(|f| f.metadata().ok()).map(|m| m.len()).sum::<u64>();
        match dataset.load(split, index) {
            Err(error) => defects.push(error.to_string()),
            Ok(frame) => {
                // Trusted or not: this is what `--depth-range` is chosen by.
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
    SplitInfo {
        name: dataset.splits[split].name.clone(),
        frames: frames.len(),
        has_depth: dataset.splits[split].has_depth,
        width: k.width,
        height: k.height,
        focal_px: [k.fx, k.fy],
        principal_point_px: [k.cx, k.cy],
        depth_range: range,
        bytes,
    }
}

fn print_dataset(info: &DatasetInfo) -> Result<(), Failure> {
    output::line(format!(
        "{}: {} dataset, recognised by {}",
        info.path, info.layout, info.recognised_by
    ));
    for s in &info.splits {
        let depth = match s.depth_range {
            Some([lo, hi]) => format!("depth {lo:.3} to {hi:.3}"),
            None => "no depth".to_owned(),
        };
        output::line(format!(
            "  {}: {} frames of {}x{}, focal {:.1} {:.1} px, {depth}, {:.1} MB",
            s.name,
            s.frames,
            s.width,
            s.height,
            s.focal_px[0],
            s.focal_px[1],
            s.bytes as f64 * 1e-6
        ));
    }
    output::line(format!("  evaluation: {}", info.evaluation));
    info.notes.iter().for_each(|note| output::line(format!("  note: {note}")));
    info.defects.iter().for_each(|defect| output::line(format!("  defect: {defect}")));
    output::line(format!("  {} defects found", info.defects.len()));
    Ok(())
}

fn model_info(args: &InfoArgs, model: &Imported) -> ModelInfo {
    ModelInfo {
        path: args.path.display().to_string(),
        kind: match model.kind {
            ModelKind::Splats => "splats",
            ModelKind::PointCloud => "point-cloud",
        },
        splats: model.splats.len(),
        sh_degree: u8::from(!model.splats.view().appearance().is_empty()),
        skipped: model.skipped,
        bounds: bounds(&model.splats).map(|(lo, hi)| [lo.to_array(), hi.to_array()]),
        bytes: model.bytes,
        comments: model.comments.clone(),
        notes: model.notes.iter().map(ToString::to_string).collect(),
    }
}

fn print_model(info: &ModelInfo) -> Result<(), Failure> {
    output::line(format!(
        "{}: {} {}, {:.1} MB",
        info.path,
        info.splats,
        info.kind,
        info.bytes as f64 * 1e-6
    ));
    if let Some([lo, hi]) = info.bounds {
        output::line(format!("  from {lo:.3?} to {hi:.3?}"));
    }
    if info.sh_degree > 0 {
        output::line("  colour depends on the direction (harmonics of degree 1)");
    }
    info.comments.iter().for_each(|comment| output::line(format!("  comment: {comment}")));
    info.notes.iter().for_each(|note| output::line(format!("  note: {note}")));
    if info.skipped > 0 {
        output::line(format!("  defect: {} rows are not finite", info.skipped));
    }
    Ok(())
}
