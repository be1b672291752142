//! JSON types of `report.json` and of `eval --json`; field names are part of the public interface.
//!
//! Reports are read by other programs, so field names never change. Missing values are `Option`, because JSON
//! cannot represent NaN.

use super::choices::{GroundTruth, ViewPoses};
use super::cracks::CrackReport;
use super::scale::EvalScale;
use super::seen::SeenQuality;
use super::trajectory_error::TrajectoryError;
use crate::dataset::calibration::ColorCamera;
use crate::dataset::error::FrameError;
use crate::dataset::splits::ViewGroupName;
use crate::model::scene::state::TrackedPose;
use crate::render::{Antialias, Exposing, Renderer, Response};
use crate::train::device_trial::{ComparerUse, PassUse};
use crate::train::outcome::{MemoryEstimate, OutlierReason, PhotographOutcome};
use crate::train::timing::StageMs;
use serde::{Deserialize, Serialize};

pub use super::detail::Detail;
pub use super::machine::{
    available_bytes, describe, numerics, obtainable_bytes, peak_rss_bytes, rss_bytes,
};
pub use super::sharpness::SharpnessBand;
pub use super::view_alignment::AlignedView;

/// Version tag of [`Report`].
pub const REPORT_FORMAT: &str = "vbgs-report/1";

/// Report of a training run.
#[derive(Clone, Debug, Serialize)]
// Generic because the settings belong to the pipeline, on which this module must not depend.
pub struct Report<C> {
    /// Version tag, [`REPORT_FORMAT`], for programs that read reports.
    pub format: &'static str,
    /// Training data.
    pub dataset: DatasetReport,
    /// Every setting of the run.
    pub config: C,
    /// Machine of the run.
    pub machine: MachineReport,
    /// One entry per trained frame, in order of training.
    pub frames: Vec<FrameReport>,
    /// Frames that could not be used.
    pub skipped: Vec<SkippedFrame>,
    /// Totals over the trained frames, and the size of the model.
    pub summary: Summary,
    /// Quality per split, if evaluated.
    pub eval: Vec<EvalReport>,
    /// Quality early in the run, on pixels where depth cameras measured a surface, if evaluated.
    pub seen: Vec<SeenReport>,
    /// Error of tracked poses against recorded ones, if both exist.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tracking: Option<TrajectoryError>,
    /// Device that compared photographs with renders; `None` if photographs are not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub comparer: Option<ComparerUse>,
    /// Device that computed the passes over frames; `None` if no device supports these passes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub passes: Option<PassUse>,
    /// Device that fitted points; `None` if no device supports these fits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<PassUse>,
}

/// Quality on the pixels where depth cameras measured a surface, over the frames trained on so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeenReport {
    /// Number of frames trained on when quality was measured.
    pub after_frames: usize,
    /// Renderer of the views.
    pub renderer: Renderer,
    /// Mean quality over the frames trained on.
    #[serde(flatten)]
    pub seen: SeenQuality,
}

/// Training data of a run.
#[derive(Clone, Debug, Serialize)]
pub struct DatasetReport {
    /// Folder of the dataset, or name of the procedural scene.
    pub path: String,
    /// Layout of the files.
    pub layout: String,
    /// Split used for training.
    pub split: String,
    /// Number of frames selected for training.
    pub frames: usize,
    /// Width of the first frame, pixels.
    pub width: u32,
    /// Height of the first frame, pixels.
    pub height: u32,
}

/// Machine of a run.
#[derive(Clone, Debug, Serialize)]
pub struct MachineReport {
    /// Number of training threads.
    pub threads: usize,
    /// Name of the CPU.
    pub cpu: String,
    /// Instruction set used by the engine.
    pub simd: String,
    /// Name of the graphics adapter, if one was used.
    pub adapter: Option<String>,
}

/// Report of a trained frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameReport {
    /// Index in the order of training, from 0.
    pub index: usize,
    /// Name of the frame within its split.
    pub frame: String,
    /// Number of points trained on.
    pub points: usize,
    /// Number of pixels with measured depth that gave no point.
    pub points_dropped: usize,
    /// Number of components, used or not.
    pub components: usize,
    /// Number of components with statistics.
    pub used: usize,
    /// Number of components created in this frame. In reports of scenes by version 0.1.0, `reassigned`
    /// holds this number.
    #[serde(default)]
    pub born: usize,
    /// Number of unused components moved to badly explained points.
    pub reassigned: usize,
    /// Number of components merged into others.
    #[serde(default)]
    pub merged: usize,
    /// Mean ELBO of the frame's points under the initial model, nats.
    pub elbo_mean: f64,
    /// Comparison of the frame's photograph with the scene before training on the frame, if photographs
    /// are used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photograph: Option<PhotographOutcome>,
    /// Tracked pose, if poses are tracked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracked: Option<TrackedPose>,
    /// Latency in a recording in progress: milliseconds from the last change of the frame's files to the
    /// end of its training, by the file system's clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub behind_ms: Option<f64>,
    /// Duration of each stage, milliseconds.
    pub ms: FrameMs,
}

impl FrameReport {
    /// Returns a warning if the frame is an outlier that was not, or only partially, trained on.
    pub fn outlier_warning(&self) -> Option<String> {
        let PhotographOutcome { difference, usual, contradiction } = self.photograph?;
        let (found, left_out) = match contradiction? {
            OutlierReason::Picture => ("its photograph differs", "the photograph"),
            OutlierReason::Colors => ("the colours of its points differ", "the frame"),
            OutlierReason::Depth => {
                return Some(format!(
                    "{}: its depth lies behind {:.0} % of the surfaces in view (usually {:.0} %), so the frame was not trained on; check its pose, and whether something moved",
                    self.frame,
                    100.0 * difference,
                    100.0 * usual
                ));
            }
        };
        Some(format!(
            "{}: {found} from the scene by {difference:.3} (usually {usual:.3}; root mean square of colours in [0, 1]), so {left_out} was not trained on; check its pose and exposure, and whether something moved",
            self.frame
        ))
    }
}

/// Milliseconds of one frame. `load` and `prepare` run ahead on another thread and are not included in
/// `train`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameMs {
    /// Reading and decoding.
    pub load: f64,
    /// Filtering, unprojection and normalisation.
    pub prepare: f64,
    /// Time spent in each stage of training, milliseconds.
    #[serde(flatten)]
    pub stages: StageMs,
}

/// A frame that could not be used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkippedFrame {
    /// Name of the frame within its split.
    pub frame: String,
    /// Error message: file, what was expected and found, and what to do.
    pub message: String,
}

impl From<&FrameError> for SkippedFrame {
    fn from(error: &FrameError) -> Self {
        Self { frame: error.frame.clone(), message: error.to_string() }
    }
}

/// Quality measured repeatedly during a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct QualityCurves {
    /// Renderer of all measurements; `None` without measurements.
    pub renderer: Option<Renderer>,
    /// Means over held-out views, in ascending order of frames.
    pub quality: Vec<QualityPoint>,
    /// Frames that were trained on early.
    pub retention: Vec<RetainedFrame>,
}

impl QualityCurves {
    /// Returns the curves without values that JSON cannot represent, such as the PSNR of equal pictures.
    pub fn finite(mut self) -> Self {
        // JSON turns them into `null`, and is then refused on reading.
        let is_read_back = |point: &QualityPoint| {
            serde_json::to_value(point).and_then(serde_json::from_value::<QualityPoint>).is_ok()
        };
        self.quality.retain(is_read_back);
        for frame in &mut self.retention {
            frame.psnr.retain(|point| point.iter().all(|value| value.is_finite()));
        }
        self
    }
}

/// Mean metrics over a set of views.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct QualityPoint {
    /// Number of frames trained on.
    pub frames: usize,
    /// Training time until then, seconds.
    pub seconds: f64,
    /// Number of components in use.
    pub components: usize,
    /// Mean PSNR, dB.
    pub psnr: f64,
    /// Mean PSNR over the pixels that splats cover, dB, and mean fraction of such pixels in a view.
    pub covered: Option<(f64, f64)>,
    /// Mean SSIM.
    pub ssim: f64,
    /// Mean detail with colours aligned; `None` for views without any.
    pub detail: Option<Detail>,
    /// Mean absolute depth error, world units; `None` for views without depth.
    pub depth_error: Option<f64>,
}

/// Trained frame whose PSNR is measured repeatedly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RetainedFrame {
    /// Position in the order of training, from 0.
    pub position: usize,
    /// Number of trained frames at the time of each measurement, and PSNR, dB.
    pub psnr: Vec<[f64; 2]>,
}

/// Totals of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Median of the frames' training times `ms.train`, milliseconds.
    pub train_ms_median: f64,
    /// 95 % quantile of the frames' training times `ms.train`, milliseconds.
    pub train_ms_p95: f64,
    /// Number of points trained on per second of training time `ms.train`.
    pub points_per_s: f64,
    /// Number of components, used or not.
    pub components: usize,
    /// Number of components with statistics.
    pub used: usize,
    /// Number of components that are rendered.
    pub drawn: usize,
    /// Size of the model, bytes.
    pub model_bytes: usize,
    /// Peak resident memory of the process, bytes; `None` if unavailable.
    pub peak_rss_bytes: Option<u64>,
    /// Seconds from start to the end of training.
    pub wall_s: f64,
}

/// Quality over one split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvalReport {
    /// Group of the views; `None` if the split was named explicitly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<ViewGroupName>,
    /// Name of the evaluated split.
    pub split: String,
    /// How views were rendered and compared.
    #[serde(flatten)]
    pub protocol: EvalProtocol,
    /// Number of scored views, without skipped ones.
    pub views: usize,
    /// Number of the requested views that the model was trained on; `None` if unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learnt_views: Option<usize>,
    /// Views that could not be used.
    pub skipped: Vec<SkippedFrame>,
    /// Scores over the views.
    #[serde(flatten)]
    pub means: EvalMeans,
    /// Cracks, where background is visible inside surfaces; `None` if no view has depth.
    pub cracks: Option<CrackReport>,
}

/// Rendering and comparison of evaluated views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvalProtocol {
    /// Renderer of the views.
    pub renderer: Renderer,
    /// Antialiasing of splats thinner than a pixel in the exact renderer; `None` for the other renderer.
    pub antialias: Option<Antialias>,
    /// Part of a pixel's line of sight on which the exact renderer searches for a splat's largest
    /// response; `None` for the other renderer.
    pub response: Option<Response>,
    /// Reference image of the comparison.
    pub ground_truth: GroundTruth,
    /// Exposure of the renders.
    pub exposure: Exposing,
    /// Poses of the views.
    pub poses: ViewPoses,
    /// Camera of the photographs; `None` if it is the depth camera.
    pub color_camera: Option<ColorCamera>,
    /// Scale at which views were compared, relative to the size of the photographs. Photographs are
    /// area-averaged in sRGB-encoded values.
    #[serde(default)]
    pub scale: EvalScale,
    /// Background of the render, sRGB-encoded.
    pub background: [f32; 3],
}

/// Mean scores of the views of a split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvalMeans {
    /// Mean of the views' PSNR over the whole frame, dB.
    pub psnr_mean: f64,
    /// Population standard deviation (ddof 0) of the views' PSNR over the whole frame, dB.
    pub psnr_std: f64,
    /// Mean of the views' PSNR over covered pixels, dB; `None` if no view has a covered pixel.
    pub psnr_covered_mean: Option<f64>,
    /// Coverage from which a pixel counts as covered.
    pub covered_from: f32,
    /// Mean share of covered pixels.
    pub coverage_mean: f64,
    /// Mean SSIM over window positions inside the image (`valid` padding).
    pub ssim_mean: f64,
    /// Mean PSNR over the whole frame with colours aligned per view, dB.
    pub psnr_aligned_mean: Option<f64>,
    /// Mean PSNR over covered pixels with colours aligned per view, dB.
    pub psnr_aligned_covered_mean: Option<f64>,
    /// Mean SSIM with colours aligned per view.
    pub ssim_aligned_mean: Option<f64>,
    /// Means of the views' detail; `None` if no view has it.
    #[serde(default)]
    pub detail_mean: Option<Detail>,
    /// Means over the pixels where the views' depth cameras measured a surface; `None` without depth.
    pub seen_mean: Option<SeenQuality>,
    /// Means over the views rendered from aligned poses, if requested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_aligned_mean: Option<AlignedView>,
    /// Mean absolute depth error over pixels with rendered and true depth, world units; `None` without
    /// true depth. Depth is z for the projected renderer and ray distance for the exact one.
    pub depth_mae_mean: Option<f64>,
}

/// Quality of one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewReport {
    /// Group of the view, as in [`EvalReport::group`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<ViewGroupName>,
    /// Index of the view in its split.
    pub index: usize,
    /// Name of the view within its split.
    pub frame: String,
    /// Renderer of the view.
    pub renderer: Renderer,
    /// PSNR over the whole frame, dB.
    pub psnr: f64,
    /// PSNR over covered pixels, dB; `None` if no pixel is covered.
    pub psnr_covered: Option<f64>,
    /// Share of covered pixels.
    pub coverage: f64,
    /// SSIM over window positions inside the image (`valid` padding).
    pub ssim: f64,
    /// PSNR over the whole frame with colours aligned by least squares, dB. This field and the next two
    /// are `None` if no pixel is covered.
    pub psnr_aligned: Option<f64>,
    /// PSNR over covered pixels with colours aligned, dB.
    pub psnr_aligned_covered: Option<f64>,
    /// SSIM with colours aligned.
    pub ssim_aligned: Option<f64>,
    /// Detail with colours aligned, at the view's pose before `pose_aligned`; `None` if too few pixels
    /// are covered or the photograph has no detail.
    #[serde(default)]
    pub detail: Option<Detail>,
    /// Quality on the pixels where the view's depth camera measured a surface; `None` without depth.
    pub seen: Option<SeenQuality>,
    /// Quality at the aligned pose, if requested; `None` if no pixel is covered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_aligned: Option<AlignedView>,
    /// Mean absolute depth error, world units, as in [`EvalMeans::depth_mae_mean`].
    pub depth_mae: Option<f64>,
}

impl Summary {
    /// Computes the totals of the trained frames. Fields that describe the model are set to zero.
    pub fn of_frames(frames: &[FrameReport], wall_s: f64) -> Self {
        let mut train_ms: Vec<f64> = frames.iter().map(|f| f.ms.stages.train).collect();
        train_ms.sort_by(f64::total_cmp);
        let total_s = train_ms.iter().sum::<f64>() * 1e-3;
        let points: usize = frames.iter().map(|f| f.points).sum();
        Self {
            train_ms_median: quantile(&train_ms, 0.5),
            train_ms_p95: quantile(&train_ms, 0.95),
            // JSON has neither NaN nor infinity.
            points_per_s: if total_s > 0.0 { points as f64 / total_s } else { 0.0 },
            wall_s,
            ..Self::default()
        }
    }
}

/// Returns the quantile `q` of ascending values by linear interpolation, or 0 without values.
pub fn quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let position = q.clamp(0.0, 1.0) * last as f64;
    let below = position.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (sorted[above] - sorted[below]) * (position - below as f64)
}

// The three constants are fitted to measured peaks; a test holds estimates within a fifth of them.
/// Bytes per pixel for render, photograph, depth, surfaces and buffers of the metrics.
const PIXEL_BYTES: u64 = 370;
/// Bytes per component for its splats, including those kept for [`SeenReport`], and the renderer's
/// records.
const SPLAT_BYTES: u64 = 420;
/// Bytes of the program and of memory retained from training.
const FIXED_BYTES: u64 = 50_000_000;

/// Adds the memory for evaluation to an estimate. Each view has `pixels` pixels, and the model has at
/// most `components` components.
pub fn with_evaluation(
    estimate: MemoryEstimate,
    pixels: usize,
    components: usize,
) -> MemoryEstimate {
    let MemoryEstimate { model, frames, textures } = estimate;
    MemoryEstimate {
        // Saturating: an absurd setting must lead to a refusal, not to an overflow.
        model: model.saturating_add(SPLAT_BYTES.saturating_mul(components as u64)),
        // Training frames are freed before views are evaluated.
        frames: frames.max(PIXEL_BYTES.saturating_mul(pixels as u64).saturating_add(FIXED_BYTES)),
        textures,
    }
}

/// Formats columns padded to their widest cell: text left-aligned, numbers right-aligned.
pub fn text<const N: usize>(header: [&str; N], rows: &[[String; N]]) -> String {
    let lines: Vec<[String; N]> =
        std::iter::once(header.map(str::to_owned)).chain(rows.iter().cloned()).collect();
    // In characters, as `format!` pads.
    let width = |i: usize| lines.iter().map(|l| l[i].chars().count()).max().unwrap_or(0);
    let widths: [usize; N] = std::array::from_fn(width);
    let starts_a_word = |cell: &String| cell.starts_with(|c: char| c.is_alphabetic() || c == '+');
    // A column with any word is text: its numbers align with the words, not with each other.
    let has_words = |i: usize| rows.iter().any(|row| starts_a_word(&row[i]));
    let line = |cells: &[String; N]| {
        let padded = cells.iter().zip(widths).enumerate().map(|(i, (cell, width))| {
            if has_words(i) { format!("{cell:width$}") } else { format!("{cell:>width$}") }
        });
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    lines.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// Formats an error with two significant digits; `0` for zero.
pub fn error(value: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{value:.1e}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::scene::config::SceneConfig;
    use crate::train::scene::photometric::rule::PhotometricMode;

    #[test]
    fn curves_keep_what_json_can_hold() {
        let point = |psnr: f64| QualityPoint {
            frames: 3,
            seconds: 0.5,
            components: 7,
            psnr,
            covered: Some((psnr, 1.0)),
            ssim: 0.9,
            detail: None,
            depth_error: None,
        };
        let with = |psnr: &[f64]| QualityCurves {
            renderer: Some(Renderer::Exact),
            quality: psnr.iter().map(|psnr| point(*psnr)).collect(),
            retention: vec![RetainedFrame {
                position: 10,
                psnr: psnr.iter().map(|psnr| [3.0, *psnr]).collect(),
            }],
        };
        let finite = with(&[f64::INFINITY, 30.0, f64::NAN]).finite();
        assert_eq!(finite, with(&[30.0]));
        let text = serde_json::to_string(&finite).unwrap();
        assert_eq!(serde_json::from_str::<QualityCurves>(&text).unwrap(), finite);
    }

    #[test]
    fn quantiles_interpolate() {
        assert_eq!(quantile(&[], 0.5), 0.0);
        assert_eq!(quantile(&[3.0], 0.95), 3.0);
        assert_eq!(quantile(&[1.0, 2.0, 4.0], 0.5), 2.0);
        assert_eq!(quantile(&[0.0, 10.0], 0.95), 9.5);
    }

    /// Peak memory of runs on the synthetic room in the TUM layout with two threads. Columns: pixels per
    /// frame, components, photographs used, views evaluated, and megabytes.
    const MEASURED: [(usize, usize, bool, bool, u64); 11] = [
        (19_200, 5_262, false, false, 22),
        (19_200, 5_262, true, false, 84),
        (19_200, 24_615, true, false, 119),
        (307_200, 16_554, false, false, 117),
        (307_200, 52_554, false, false, 130),
        (307_200, 16_554, true, false, 218),
        (307_200, 52_554, true, false, 281),
        (307_200, 16_554, false, true, 171),
        (307_200, 52_554, false, true, 200),
        (1_228_800, 35_947, false, false, 372),
        (1_228_800, 35_947, true, true, 571),
    ];

    #[test]
    fn estimates_are_within_a_fifth_of_what_was_measured() {
        for (pixels, components, photographs, measured, peak) in MEASURED {
            let photometric = photographs.then(|| PhotometricMode::Light.rule()).flatten();
            let config =
                SceneConfig { photometric, max_components: components, ..SceneConfig::exact(0.02) };
            let mut estimate = config.memory(pixels, 3);
            if measured {
                estimate = with_evaluation(estimate, pixels, components);
            }
            let share = estimate.total() as f64 / 1e6 / peak as f64;
            assert!((0.8..1.2).contains(&share), "{pixels} {components}: {share} of {peak} MB");
        }
    }

    #[test]
    fn columns_line_up() {
        let rows = [["a".to_owned(), "10".to_owned()], ["long".to_owned(), "5".to_owned()]];
        assert_eq!(text(["", "ms"], &rows), "      ms\na     10\nlong   5");
    }
}
