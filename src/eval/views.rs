//! Rendering dataset views and scoring them against their photographs (`rendering.md` (f)).

use super::metrics::{self, MetricError, SsimPadding};
use super::report::{EvalReport, ViewReport};
use crate::dataset::Dataset;
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::math::image::{Image, RgbImage};
use crate::model::splats::Splat;
use crate::render::RenderOptions;
use crate::render::cpu::{CpuRenderer, Rendered};
use serde::{Deserialize, Serialize};

/// Name of the one renderer there is, as reports spell it.
pub const PROJECTED: &str = "projected";

/// A pixel counts as covered from this accumulated opacity on.
pub const COVERED: f32 = 0.5;

/// What a render is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GroundTruth {
    /// Straight alpha over the render's background: the honest comparison.
    Composited,
    /// The RGB bytes with alpha dropped, as the paper does.
    Rgb,
}

/// How views are rendered and compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvalOptions {
    /// What a render is compared with.
    pub ground_truth: GroundTruth,
    /// Settings of the render; its background is the comparison's.
    pub render: RenderOptions,
}

/// A view could not be scored.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// Its files are unusable.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// Render and photograph do not fit together.
    #[error("{frame}: {source}")]
    Metric {
        /// Name of the view.
        frame: String,
        /// What does not fit.
        source: MetricError,
    },
    /// There is nothing to measure.
    #[error(
        "{dataset}: expected views to evaluate in the split `{split}`, found none; choose another with --split"
    )]
    NoViews {
        /// Name of the dataset.
        dataset: String,
        /// Name of the split.
        split: String,
    },
}

/// Scores the listed views of a split one after the other; `progress` hears how many are done.
pub fn evaluate(
    splats: &[Splat],
    dataset: &Dataset,
    split: usize,
    views: &[usize],
    options: &EvalOptions,
    mut progress: impl FnMut(usize),
) -> Result<(EvalReport, Vec<ViewReport>), EvalError> {
    let mut renderer = CpuRenderer::new();
    let mut scores = Vec::with_capacity(views.len());
    for (done, &index) in views.iter().enumerate() {
        let frame = dataset.load(split, index)?;
        let rendered = renderer.render(splats, &frame.camera, &options.render);
        let score = score(index, &frame, &rendered, options);
        scores
            .push(score.map_err(|source| EvalError::Metric { frame: frame.name.clone(), source })?);
        progress(done + 1);
    }
    let split_name = dataset.splits[split].name.clone();
    if scores.is_empty() {
        return Err(EvalError::NoViews { dataset: dataset.name.clone(), split: split_name });
    }
    Ok((summarise(split_name, &scores, options), scores))
}

/// The photograph a render is compared with.
pub fn ground_truth(frame: &Frame, kind: GroundTruth, background: [f32; 3]) -> RgbImage {
    frame.color.map(|&[r, g, b, a]| {
        let rgb = [r, g, b].map(|v| v as f32 / 255.0);
        match kind {
            GroundTruth::Rgb => rgb,
            GroundTruth::Composited => {
                let alpha = a as f32 / 255.0;
                std::array::from_fn(|i| alpha * rgb[i] + (1.0 - alpha) * background[i])
            }
        }
    })
}

fn score(
    index: usize,
    frame: &Frame,
    rendered: &Rendered,
    options: &EvalOptions,
) -> Result<ViewReport, MetricError> {
    let truth = ground_truth(frame, options.ground_truth, options.render.background);
    let covered: Image<bool> = rendered.coverage.map(|&a| a >= COVERED);
    let n_covered = covered.data.iter().filter(|&&c| c).count();
    let psnr_covered = match n_covered {
        0 => None,
        _ => Some(metrics::psnr_masked(&rendered.color, &truth, &covered)?),
    };
    let depth_mae = match frame.depth_z() {
        Some(depth) if n_covered > 0 => {
            let error = metrics::depth_error(&rendered.depth, &rendered.coverage, &depth)?;
            error.mae.is_finite().then_some(error.mae)
        }
        _ => None,
    };
    Ok(ViewReport {
        index,
        frame: frame.name.clone(),
        renderer: PROJECTED.to_owned(),
        psnr: metrics::psnr(&rendered.color, &truth)?,
        psnr_covered,
        coverage: n_covered as f64 / covered.data.len().max(1) as f64,
        ssim: metrics::ssim(&rendered.color, &truth, SsimPadding::Valid)?,
        depth_mae,
    })
}

fn summarise(split: String, scores: &[ViewReport], options: &EvalOptions) -> EvalReport {
    let mean = |values: Vec<f64>| metrics::mean_std(&values).0;
    let psnr: Vec<f64> = scores.iter().map(|s| s.psnr).collect();
    let depth: Vec<f64> = scores.iter().filter_map(|s| s.depth_mae).collect();
    let (psnr_mean, psnr_std) = metrics::mean_std(&psnr);
    let ground_truth = match options.ground_truth {
        GroundTruth::Composited => "composited",
        GroundTruth::Rgb => "rgb",
    };
    EvalReport {
        split,
        renderer: PROJECTED.to_owned(),
        ground_truth: ground_truth.to_owned(),
        background: options.render.background,
        views: scores.len(),
        psnr_mean,
        psnr_std,
        psnr_covered_mean: mean(scores.iter().filter_map(|s| s.psnr_covered).collect()),
        coverage_mean: mean(scores.iter().map(|s| s.coverage).collect()),
        ssim_mean: mean(scores.iter().map(|s| s.ssim).collect()),
        depth_mae_mean: (!depth.is_empty()).then(|| mean(depth)),
    }
}
