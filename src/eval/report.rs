//! The JSON types of `report.json` and of `eval --json`; names are part of the product's contract.
//!
//! Plain data without methods that compute: a report is written once and read by other programs so
//! the names of its fields stay. Values that may be missing are `Option`, not NaN, which JSON
//! cannot hold.

use super::aligned::AlignedView;
use super::choices::{PartialCoverage, ViewPoses};
use super::cracks::CrackReport;
use super::scale::EvalScale;
use super::seen::Seen;
use super::trajectory_error::TrajectoryError;
use crate::dataset::calibration::ColorCamera;
use crate::dataset::error::FrameError;
use crate::dataset::splits::ViewGroupName;
use crate::model::scene::trajectory::TrackedPose;
use crate::render::Exposing;
use crate::render::{Antialias, Renderer, Response};
use crate::train::comparer_use::ComparerUse;
use crate::train::outcome::{Contradiction, PhotographOutcome};
use crate::train::pass_use::PassUse;
use crate::train::timing::StageMs;
use serde::{Deserialize, Serialize};

/// Version tag of [`Report`].
pub const REPORT_FORMAT: &str = "vbgs-report/1";

/// Everything a training run says about itself.
#[derive(Clone, Debug, Serialize)]
// Generic: settings belong to the pipeline, which this room may not know.
pub struct Report<C> {
    /// Version tag, [`REPORT_FORMAT`], for programs that read reports.
    pub format: &'static str,
    /// What was trained on.
    pub dataset: DatasetReport,
    /// Every setting that shaped the run.
    pub config: C,
    /// Where it ran.
    pub machine: MachineReport,
    /// One entry per trained frame, in order of training.
    pub frames: Vec<FrameReport>,
    /// Frames that could not be used.
    pub skipped: Vec<SkippedFrame>,
    /// Totals over the trained frames, and the model's size.
    pub summary: Summary,
    /// Quality, where it was asked for.
    pub eval: Vec<EvalReport>,
    /// What the model shows of the frames it has learnt, early in the run; where quality was asked
    /// for.
    pub seen: Vec<SeenReport>,
    /// How far tracked poses are from the recorded ones, where there are both.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tracking: Option<TrajectoryError>,
    /// What photographs were compared on; `None` where they teach nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub comparer: Option<ComparerUse>,
    /// What passes over frames ran on; `None` where no device can run them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub passes: Option<PassUse>,
    /// What a scene's points were fitted on; `None` where no device can fit them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<PassUse>,
}

/// Quality on the pixels that the frames learnt so far saw.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeenReport {
    /// Number of frames learnt when this was measured.
    pub after_frames: usize,
    /// Which renderer drew the views.
    pub renderer: Renderer,
    /// Means over those frames.
    #[serde(flatten)]
    pub seen: Seen,
}

/// What was trained on.
#[derive(Clone, Debug, Serialize)]
pub struct DatasetReport {
    /// Folder, or the name of the procedural scene.
    pub path: String,
    /// Layout of the files.
    pub layout: String,
    /// Split that was trained on.
    pub split: String,
    /// Frames chosen for training.
    pub frames: usize,
    /// Columns of the first frame.
    pub width: u32,
    /// Rows of the first frame.
    pub height: u32,
}

/// Where a run took place.
#[derive(Clone, Debug, Serialize)]
pub struct MachineReport {
    /// Threads of the trainer.
    pub threads: usize,
    /// Name of the processor.
    pub cpu: String,
    /// Instructions the engine runs on.
    pub simd: String,
    /// Name of the graphics adapter, if one drew.
    pub adapter: Option<String>,
}

/// One trained frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameReport {
    /// Position in the order of training, from 0.
    pub index: usize,
    /// Name of the frame within its split.
    pub frame: String,
    /// Points learnt from.
    pub points: usize,
    /// Measured pixels that made no point.
    pub points_dropped: usize,
    /// Components, used or not.
    pub components: usize,
    /// Components with statistics.
    pub used: usize,
    /// Components that came into being. Reports of scenes by version 0.1.0 call these reassigned.
    #[serde(default)]
    pub born: usize,
    /// Unused components that moved to badly explained points.
    pub reassigned: usize,
    /// Components that became part of others.
    #[serde(default)]
    pub merged: usize,
    /// Mean ELBO of the frame's points under the initial model, nats.
    pub elbo_mean: f64,
    /// How its photograph compared with the scene before, where photographs are learnt.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photograph: Option<PhotographOutcome>,
    /// Where its camera was found, where poses are tracked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracked: Option<TrackedPose>,
    /// Milliseconds from the last change of its files to its being learnt, where it was taken while
    /// it was recorded; by the file system's clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub behind_ms: Option<f64>,
    /// Where the time went.
    pub ms: FrameMs,
}

impl FrameReport {
    /// What a user should know of a frame that was not learnt, or only in part.
    pub fn doubt(&self) -> Option<String> {
        let PhotographOutcome { difference, usual, contradiction } = self.photograph?;
        let (found, left_out) = match contradiction? {
            Contradiction::Picture => ("its photograph differs", "its picture"),
            Contradiction::Colors => ("the colours of its points differ", "it"),
            Contradiction::Depth => {
                return Some(format!(
                    "{}: it measured something behind {:.0} % of the surfaces in view, where {:.0} % are usual, so nothing was learnt from it; check its pose, and whether something moved",
                    self.frame,
                    100.0 * difference,
                    100.0 * usual
                ));
            }
        };
        Some(format!(
            "{}: {found} from the scene by {difference:.3}, where {usual:.3} is usual (root mean square of colours in [0, 1]), so nothing was learnt from {left_out}; check its pose and exposure, and whether something moved",
            self.frame
        ))
    }
}

/// Milliseconds of one frame. `load` and `prepare` run ahead on another thread and are not part of
/// `train`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameMs {
    /// Reading and decoding.
    pub load: f64,
    /// Filtering, unprojecting, normalising.
    pub prepare: f64,
    /// The trainer's stages.
    #[serde(flatten)]
    pub stages: StageMs,
}

/// A frame that could not be used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkippedFrame {
    /// Name of the frame within its split.
    pub frame: String,
    /// The file, what was expected and found, what to do.
    pub message: String,
}

impl From<&FrameError> for SkippedFrame {
    fn from(error: &FrameError) -> Self {
        Self { frame: error.frame.clone(), message: error.to_string() }
    }
}

/// Totals of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Median of `ms.train`.
    pub train_ms_median: f64,
    /// 95 % quantile of `ms.train`.
    pub train_ms_p95: f64,
    /// Points learnt per second of `ms.train`.
    pub points_per_s: f64,
    /// Components, used or not.
    pub components: usize,
    /// Components with statistics.
    pub used: usize,
    /// Components that are drawn.
    pub drawn: usize,
    /// Bytes of the model.
    pub model_bytes: usize,
    /// Largest resident memory of the process; `None` where the system does not tell.
    pub peak_rss_bytes: Option<u64>,
    /// From start to the end of training.
    pub wall_s: f64,
}

/// Quality over one split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvalReport {
    /// Group of the views; `None` for a split that was named.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<ViewGroupName>,
    /// Name of the split whose views were scored.
    pub split: String,
    /// Which renderer drew the views.
    pub renderer: Renderer,
    /// What the exact renderer did about splats thinner than a pixel; `None` for the other.
    pub antialias: Option<Antialias>,
    /// Where the exact renderer looked for the largest response; `None` for the other.
    pub response: Option<Response>,
    /// What the render was compared with: `composited` or `rgb`.
    pub ground_truth: String,
    /// What the render shows where splats cover a pixel in part.
    pub partial_coverage: PartialCoverage,
    /// How bright the scene was drawn.
    pub exposure: Exposing,
    /// Where views were drawn from.
    pub poses: ViewPoses,
    /// The camera that took the photographs; `None` if it measured depth as well.
    pub color_camera: Option<ColorCamera>,
    /// The fraction of the photographs' sides that views were compared at, photographs averaged over
    /// the area of each pixel in encoded values.
    #[serde(default)]
    pub scale: EvalScale,
    /// Background of the render, sRGB-encoded.
    pub background: [f32; 3],
    /// Number of views that were scored, skipped ones left out.
    pub views: usize,
    /// How many of the views asked for the model was trained on; `None` where it does not tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learnt_views: Option<usize>,
    /// Views that could not be used.
    pub skipped: Vec<SkippedFrame>,
    /// Mean of the views' PSNR over the whole frame, dB.
    pub psnr_mean: f64,
    /// Population standard deviation (ddof 0) of the views' PSNR over the whole frame, dB.
    pub psnr_std: f64,
    /// Mean of the views' PSNR over covered pixels, dB; `None` if nothing is covered in any view.
    pub psnr_covered_mean: Option<f64>,
    /// Coverage from which a pixel counts as covered.
    pub covered_from: f32,
    /// Mean share of pixels that splats cover.
    pub coverage_mean: f64,
    /// Mean SSIM, `valid` padding.
    pub ssim_mean: f64,
    /// Mean PSNR over the whole frame with colours aligned view by view, dB.
    pub psnr_aligned_mean: Option<f64>,
    /// Mean PSNR over covered pixels with colours aligned view by view, dB.
    pub psnr_aligned_covered_mean: Option<f64>,
    /// Mean SSIM with colours aligned view by view.
    pub ssim_aligned_mean: Option<f64>,
    /// Means on the pixels where the views' depth cameras saw a surface; `None` without depth.
    pub seen_mean: Option<Seen>,
    /// Means of the views drawn from where their own photographs say, where that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_aligned_mean: Option<AlignedView>,
    /// Mean absolute depth error where both have depth, world units: of depth z for the projected
    /// renderer, of distance along the ray for the exact one; `None` without true depth.
    pub depth_mae_mean: Option<f64>,
    /// Background that shows inside surfaces; `None` if no view has depth to tell.
    pub cracks: Option<CrackReport>,
}

/// Quality of one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewReport {
    /// Group of the view, as in [`EvalReport::group`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<ViewGroupName>,
    /// Position of the view in its split.
    pub index: usize,
    /// Name of the view within its split.
    pub frame: String,
    /// Which renderer drew the views.
    pub renderer: Renderer,
    /// PSNR over the whole frame, dB.
    pub psnr: f64,
    /// PSNR over covered pixels, dB; `None` if nothing is covered.
    pub psnr_covered: Option<f64>,
    /// Share of pixels that splats cover.
    pub coverage: f64,
    /// SSIM, `valid` padding.
    pub ssim: f64,
    /// PSNR over the whole frame with colours aligned
    /// ([`Alignment`](super::comparison::Alignment)), dB; `None` if nothing is covered, like the
    /// next two.
    pub psnr_aligned: Option<f64>,
    /// PSNR over covered pixels with colours aligned, dB.
    pub psnr_aligned_covered: Option<f64>,
    /// SSIM with colours aligned.
    pub ssim_aligned: Option<f64>,
    /// On the pixels where the view's depth camera saw a surface; `None` without depth.
    pub seen: Option<Seen>,
    /// Drawn from where its own photograph says, where that was asked for; `None` if nothing is covered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_aligned: Option<AlignedView>,
    /// Mean absolute depth error, world units, as in [`EvalReport::depth_mae_mean`].
    pub depth_mae: Option<f64>,
}

impl Summary {
    /// Totals of the trained frames; the model's fields are zero.
    pub fn of_frames(frames: &[FrameReport], wall_s: f64) -> Self {
        let mut train_ms: Vec<f64> = frames.iter().map(|f| f.ms.stages.train).collect();
        train_ms.sort_by(f64::total_cmp);
        let total_s = train_ms.iter().sum::<f64>() * 1e-3;
        let points: usize = frames.iter().map(|f| f.points).sum();
        Self {
            train_ms_median: quantile(&train_ms, 0.5),
            train_ms_p95: quantile(&train_ms, 0.95),
            points_per_s: if total_s > 0.0 { points as f64 / total_s } else { 0.0 },
            wall_s,
            ..Self::default()
        }
    }
}

/// Quantile of ascending values by linear interpolation; 0 for none.
pub fn quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let position = q.clamp(0.0, 1.0) * last as f64;
    let below = position.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (sorted[above] - sorted[below]) * (position - below as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate() {
        assert_eq!(quantile(&[], 0.5), 0.0);
        assert_eq!(quantile(&[3.0], 0.95), 3.0);
        assert_eq!(quantile(&[1.0, 2.0, 4.0], 0.5), 2.0);
        assert_eq!(quantile(&[0.0, 10.0], 0.95), 9.5);
    }
}
