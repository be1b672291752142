//! Rendering dataset views and scoring them against their photographs (`rendering.md` (f)).

use super::metrics::{self, MetricError, SsimPadding};
use super::report::{EvalReport, SkippedFrame, ViewReport};
use crate::dataset::Dataset;
use crate::dataset::frame::{DepthKind, Frame};
use crate::math::image::{Image, RgbImage};
use crate::model::splats::Splat;
use crate::render::cpu::{CpuRenderer, Rendered};
use crate::render::{Method, RenderOptions, Renderer};
use serde::{Deserialize, Serialize};

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
    /// Every view was skipped.
    #[error(
        "{dataset}: expected at least one usable view in the split `{split}`, found none ({skipped} skipped; the first: {first})"
    )]
    NoUsableView {
        /// Name of the dataset.
        dataset: String,
        /// Name of the split.
        split: String,
        /// Views skipped.
        skipped: usize,
        /// Message of the first one.
        first: String,
    },
}

/// Scores the listed views of a split one after the other; `progress` hears how many are done. Views
/// whose files are unusable are left out and listed in the report.
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
    let split_name = dataset.splits[split].name.clone();
    let refused = dataset.warnings.iter().filter(|w| w.split == split_name);
    let mut skipped: Vec<SkippedFrame> = refused.map(|w| SkippedFrame::from(&*w.error)).collect();
    for (done, &index) in views.iter().enumerate() {
        match dataset.load(split, index) {
            Ok(frame) => {
                let rendered = renderer.render(splats, &frame.camera, &options.render);
                let score = score(index, &frame, &rendered, options);
                let named = |source| EvalError::Metric { frame: frame.name.clone(), source };
                scores.push(score.map_err(named)?);
            }
            Err(error) => skipped.push(SkippedFrame::from(&error)),
        }
        progress(done + 1);
    }
    if scores.is_empty() {
        return Err(no_view(dataset, split_name, &skipped));
    }
    Ok((EvalReport { skipped, ..summarise(split_name, &scores, options) }, scores))
}

fn no_view(dataset: &Dataset, split: String, skipped: &[SkippedFrame]) -> EvalError {
    let dataset = dataset.name.clone();
    match skipped.first() {
        None => EvalError::NoViews { dataset, split },
        Some(first) => EvalError::NoUsableView {
            dataset,
            split,
            skipped: skipped.len(),
            first: first.message.clone(),
        },
    }
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
    let method = options.render.method;
    let depth_mae = match frame.depth_as(depth_kind(method)) {
        Some(depth) if n_covered > 0 => {
            let error = metrics::depth_error(&rendered.depth, &rendered.coverage, &depth)?;
            error.mae.is_finite().then_some(error.mae)
        }
        _ => None,
    };
    Ok(ViewReport {
        index,
        frame: frame.name.clone(),
        renderer: method.renderer(),
        psnr: metrics::psnr(&rendered.color, &truth)?,
        psnr_covered,
        coverage: n_covered as f64 / covered.data.len().max(1) as f64,
        ssim: metrics::ssim(&rendered.color, &truth, SsimPadding::Valid)?,
        depth_mae,
    })
}

/// What a renderer's depth plane measures: the truth is converted to it, not the render.
fn depth_kind(method: Method) -> DepthKind {
    match method.renderer() {
        Renderer::Projected => DepthKind::Z,
        Renderer::Exact => DepthKind::RayDistance,
    }
}

fn summarise(split: String, scores: &[ViewReport], options: &EvalOptions) -> EvalReport {
    let mean = |values: Vec<f64>| metrics::mean_std(&values).0;
    let psnr: Vec<f64> = scores.iter().map(|s| s.psnr).collect();
    let depth: Vec<f64> = scores.iter().filter_map(|s| s.depth_mae).collect();
    let covered: Vec<f64> = scores.iter().filter_map(|s| s.psnr_covered).collect();
    let (psnr_mean, psnr_std) = metrics::mean_std(&psnr);
    let exact = match options.render.method {
        Method::Projected(_) => None,
        Method::Exact(exact) => Some(exact),
    };
    let ground_truth = match options.ground_truth {
        GroundTruth::Composited => "composited",
        GroundTruth::Rgb => "rgb",
    };
    EvalReport {
        split,
        renderer: options.render.method.renderer(),
        antialias: exact.map(|e| e.antialias),
        response: exact.map(|e| e.response),
        ground_truth: ground_truth.to_owned(),
        background: options.render.background,
        views: scores.len(),
        skipped: Vec::new(),
        psnr_mean,
        psnr_std,
        psnr_covered_mean: (!covered.is_empty()).then(|| mean(covered)),
        coverage_mean: mean(scores.iter().map(|s| s.coverage).collect()),
        ssim_mean: mean(scores.iter().map(|s| s.ssim).collect()),
        depth_mae_mean: (!depth.is_empty()).then(|| mean(depth)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::frame::{Depth, DepthCodes};
    use crate::math::camera::{Camera, Intrinsics};
    use crate::math::pose::Pose;

    /// A wall two units ahead, as every renderer would draw it.
    #[test]
    fn depth_is_compared_as_the_renderer_measures_it() {
        let (width, height) = (32, 24);
        let camera = Camera {
            intrinsics: Intrinsics::from_horizontal_fov(width as u32, height as u32, 1.5),
            pose: Pose::IDENTITY,
        };
        let codes = DepthCodes::Linear16 { codes: Image::filled(width, height, 2000), unit: 1e-3 };
        let frame = Frame {
            name: "wall".to_owned(),
            camera,
            color: Image::filled(width, height, [0, 0, 0, 255]),
            depth: Some(Depth { codes, kind: DepthKind::Z, trusted: [0.1, 10.0] }),
        };
        let along_ray = |i: usize| 2.0 * camera.intrinsics.ray(i % width, i / width).length();
        let planes = [
            (Method::PROJECTED, Image::filled(width, height, 2.0)),
            (
                Method::EXACT,
                Image::from_vec(
                    width,
                    height,
                    (0..width * height).map(|i| along_ray(i) as f32).collect(),
                ),
            ),
        ];
        let error = |method, depth: &Image<f32>| {
            let rendered = Rendered {
                color: Image::filled(width, height, [0.0; 3]),
                coverage: Image::filled(width, height, 1.0),
                depth: depth.clone(),
                n_invalid: 0,
            };
            let render = RenderOptions::evaluation(method, [0.0; 3]);
            let options = EvalOptions { ground_truth: GroundTruth::Rgb, render };
            score(0, &frame, &rendered, &options).unwrap().depth_mae.unwrap()
        };
        for (method, depth) in &planes {
            assert!(error(*method, depth) < 1e-6, "{method:?}");
        }
        assert!(error(Method::EXACT, &planes[0].1) > 0.1, "z is no distance along the ray");
    }
}
