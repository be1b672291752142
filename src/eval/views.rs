//! Rendering and scoring of dataset views against their photographs (`evaluation.md`, Protocols).
//!
//! Each view is discarded after scoring, so a split of any length fits in memory. If a separate colour
//! camera took the photograph, that camera is rendered and depth is projected into its image. Unusable
//! files are listed in the report. A split without any usable view is an error, because a mean over nothing
//! would pass for a result.

use super::choices::{GroundTruth, ViewPoses};
use super::comparison::{COVERED, Comparison, compare};
use super::detail::Detail;
use super::metrics;
use super::metrics::MetricError;
use super::report::{EvalMeans, EvalProtocol, EvalReport, SkippedFrame, ViewReport};
use super::scale::{EvalScale, visit_views};
use super::seen::SeenQuality;
use super::surfaces::Surfaces;
use super::view_alignment::{AlignedView, aligned};
use crate::dataset::Dataset;
use crate::dataset::calibration::ColorCamera;
use crate::dataset::error::FrameError;
use crate::dataset::frame::{DepthKind, Frame};
use crate::dataset::surface::Sensor;
use crate::math::camera::Camera;
use crate::math::image::{Image, RgbImage};
use crate::math::measured_pixel::MASKED;
use crate::model::splat::appearance::SplatView;
use crate::render::cpu::{CpuRenderer, Rendered};
use crate::render::{RenderMethod, RenderOptions, Renderer};

/// Options for rendering and comparing views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvalOptions {
    /// Reference image of the comparison.
    pub ground_truth: GroundTruth,
    /// Camera of the photographs, if it is not the depth camera.
    pub color_camera: Option<ColorCamera>,
    /// Poses of the views.
    pub poses: ViewPoses,
    /// True to score views also at poses aligned to their photographs.
    pub align_poses: bool,
    /// Scale at which views are compared, relative to the size of the photographs.
    pub scale: EvalScale,
    /// Render options; the background is also that of the comparison.
    pub render: RenderOptions,
}

impl EvalOptions {
    /// Returns options for recorded poses at full size, with the depth camera as colour camera.
    pub fn plain(ground_truth: GroundTruth, render: RenderOptions) -> Self {
        let (poses, scale) = (ViewPoses::Recorded, EvalScale::FULL);
        let (color_camera, align_poses) = (None, false);
        Self { ground_truth, color_camera, poses, align_poses, scale, render }
    }

    fn photo_camera(&self, frame: &Frame) -> Camera {
        self.scale.camera(frame.photo_camera(self.color_camera.as_ref()))
    }

    fn is_depth_image(&self, frame: &Frame) -> bool {
        self.scale.is_full() && frame.photographed_by(self.color_camera.as_ref()).is_none()
    }
}

/// Error of an evaluation.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// Render and photograph cannot be compared.
    #[error("{frame}: {source}")]
    Metric { frame: String, source: MetricError },
    /// The split has no views.
    #[error(
        "{dataset}: expected views to evaluate in the split `{split}`, found none; choose another one (`--split`)"
    )]
    NoViews { dataset: String, split: String },
    /// Every view was skipped.
    #[error(
        "{dataset}: expected at least one usable view in the split `{split}`, found none ({skipped} skipped; the first: {first})"
    )]
    NoUsableView { dataset: String, split: String, skipped: usize, first: String },
}

/// Scores the given views of a split; `progress` receives the number of views done. Views with unusable
/// files are listed in the report.
///
/// # Errors
/// A render and its photograph cannot be compared, or no view is usable.
pub fn evaluate<'a>(
    splats: impl Into<SplatView<'a>>,
    dataset: &Dataset,
    split: usize,
    views: &[usize],
    options: &EvalOptions,
    progress: impl FnMut(usize),
) -> Result<(EvalReport, Vec<ViewReport>), EvalError> {
    let splats = splats.into();
    let sensor = dataset.sensor();
    let visit = |renderer: &mut CpuRenderer, index, loaded: Result<Frame, FrameError>| {
        let mut frame = loaded.map_err(|error| SkippedFrame::from(&error))?;
        let is_corrected = options.poses == ViewPoses::Corrected;
        if is_corrected {
            frame.camera.pose = splats.finishing().corrected_pose(&frame.camera.pose);
        }
        let camera = options.photo_camera(&frame);
        let own = is_corrected.then(|| splats.finishing().photograph_camera(camera));
        let camera = own.unwrap_or(camera);
        let rendered = renderer.render(splats, &camera, &options.render);
        let surfaces = photographed_surfaces(&frame, &camera, sensor, options);
        // The photograph has a pose of its own, but the depth image that of the points.
        let has_own_pose = options.is_depth_image(&frame) && camera.pose != frame.camera.pose;
        let of_points =
            has_own_pose.then(|| renderer.render(splats, &frame.camera, &options.render));
        let drawn = Drawn { photograph: &rendered, depth: of_points.as_ref().unwrap_or(&rendered) };
        let mut score = score(index, &frame, surfaces.as_ref(), drawn, options);
        if let (Ok(view), true) = (&mut score, options.align_poses) {
            let draw = |camera: &Camera| renderer.render(splats, camera, &options.render);
            match aligned_view(&frame, &camera, rendered, options, draw) {
                Ok(found) => view.pose_aligned = found,
                Err(error) => score = Err(error),
            }
        }
        Ok(score.map_err(|source| EvalError::Metric { frame: frame.name, source }))
    };
    let split_name = dataset.splits[split].name.clone();
    // Frames rejected when the dataset was opened are not views, but reports list them.
    let refused = dataset.warnings.iter().filter(|w| w.split == split_name);
    let mut skipped: Vec<SkippedFrame> = refused.map(|w| SkippedFrame::from(&*w.error)).collect();
    let mut scores = Vec::with_capacity(views.len());
    for visited in visit_views(dataset, split, views, visit, progress) {
        match visited {
            // Views too small for SSIM concern the whole split, so they are an error, not a skipped file.
            Ok(score) => scores.push(score?),
            Err(frame) => skipped.push(frame),
        }
    }
    if scores.is_empty() {
        return Err(no_view(dataset, split_name, &skipped));
    }
    Ok((summarise(split_name, &scores, skipped, options), scores))
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

/// Returns the reference image of a comparison. Pixels that a mask leaves out are NaN, and no metric counts
/// them.
pub fn ground_truth(frame: &Frame, kind: GroundTruth, background: [f32; 3]) -> RgbImage {
    frame.color.map(|&[r, g, b, a]| {
        if [r, g, b, a] == MASKED {
            return [f32::NAN; 3];
        }
        let rgb = [r, g, b].map(|v| v as f32 / 255.0);
        match kind {
            GroundTruth::Rgb => rgb,
            GroundTruth::Composited => {
                let alpha = a as f32 / 255.0;
                // In encoded values rather than linear light, like the renderers (`rendering.md`,
                // Conventions).
                std::array::from_fn(|i| alpha * rgb[i] + (1.0 - alpha) * background[i])
            }
        }
    })
}

/// A scene drawn from the pose of a photograph, and from that of its depth image.
#[derive(Clone, Copy)]
struct Drawn<'a> {
    photograph: &'a Rendered,
    depth: &'a Rendered,
}

fn score(
    index: usize,
    frame: &Frame,
    surfaces: Option<&Surfaces>,
    drawn: Drawn<'_>,
    options: &EvalOptions,
) -> Result<ViewReport, MetricError> {
    let truth = reference_image(frame, options);
    let Rendered { color: shown, coverage, .. } = drawn.photograph;
    let Comparison { psnr, ssim, coverage: covered_share, covered } =
        compare(shown, coverage, &truth)?;
    let seen = match surfaces {
        None => None,
        Some(surfaces) => SeenQuality::compare(shown, coverage, &truth, surfaces)?,
    };
    let depth_mae = match measured_depth(frame, surfaces, options) {
        // Without a covered pixel the error would be a mean over nothing.
        Some(depth) if covered.is_some() => {
            // NaN if no covered pixel has depth; JSON has no NaN.
            Some(metrics::depth_error(&drawn.depth.depth, &drawn.depth.coverage, &depth)?)
                .filter(|mae| mae.is_finite())
        }
        _ => None,
    };
    Ok(ViewReport {
        group: None,
        index,
        frame: frame.name.clone(),
        renderer: options.render.method.renderer(),
        psnr,
        psnr_covered: covered.as_ref().map(|c| c.psnr),
        coverage: covered_share,
        ssim,
        psnr_aligned: covered.as_ref().map(|c| c.aligned_psnr_frame),
        psnr_aligned_covered: covered.as_ref().map(|c| c.aligned_psnr),
        ssim_aligned: covered.as_ref().map(|c| c.aligned_ssim),
        detail: covered.and_then(|c| Detail::compare(&c.aligned, coverage, &truth)),
        seen,
        pose_aligned: None,
        depth_mae,
    })
}

fn aligned_view(
    frame: &Frame,
    camera: &Camera,
    rendered: Rendered,
    options: &EvalOptions,
    draw: impl FnMut(&Camera) -> Rendered,
) -> Result<Option<AlignedView>, MetricError> {
    let truth = reference_image(frame, options);
    let found = aligned(camera, rendered, &truth, options.render.method.renderer(), draw)?;
    let poses = [&camera.pose, &found.pose];
    let view = &found.rendered;
    AlignedView::compare(poses, &view.color, &view.coverage, &truth)
}

fn reference_image(frame: &Frame, options: &EvalOptions) -> RgbImage {
    let truth = ground_truth(frame, options.ground_truth, options.render.background);
    options.scale.photograph(truth, &options.photo_camera(frame).intrinsics)
}

fn photographed_surfaces(
    frame: &Frame,
    camera: &Camera,
    sensor: Sensor,
    options: &EvalOptions,
) -> Option<Surfaces> {
    let surfaces = Surfaces::of(frame, sensor)?;
    match options.is_depth_image(frame) {
        true => Some(surfaces),
        false => Some(surfaces.project_into(camera, options.render.near as f32)),
    }
}

fn measured_depth(
    frame: &Frame,
    surfaces: Option<&Surfaces>,
    options: &EvalOptions,
) -> Option<Image<f32>> {
    let kind = depth_kind(options.render.method);
    match options.is_depth_image(frame) {
        // The file's full depth: projection would lose the border.
        true => frame.depth_as(kind),
        false => surfaces.map(|s| s.depth_of_kind(kind)),
    }
}

/// Returns the depth convention of a renderer, to which ground truth is converted.
fn depth_kind(method: RenderMethod) -> DepthKind {
    match method.renderer() {
        Renderer::Projected => DepthKind::Z,
        Renderer::Exact => DepthKind::RayDistance,
    }
}

fn summarise(
    split: String,
    scores: &[ViewReport],
    skipped: Vec<SkippedFrame>,
    options: &EvalOptions,
) -> EvalReport {
    // Over the views that have a value.
    let mean =
        |value: fn(&ViewReport) -> Option<f64>| metrics::mean(scores.iter().filter_map(value));
    let of_all = |value: fn(&ViewReport) -> f64| {
        metrics::mean_std(&scores.iter().map(value).collect::<Vec<_>>())
    };
    let (psnr_mean, psnr_std) = of_all(|s| s.psnr);
    let exact = match options.render.method {
        RenderMethod::Projected => None,
        RenderMethod::Exact(exact) => Some(exact),
    };
    let seen: Vec<SeenQuality> = scores.iter().filter_map(|s| s.seen).collect();
    let aligned: Vec<AlignedView> = scores.iter().filter_map(|s| s.pose_aligned).collect();
    let protocol = EvalProtocol {
        renderer: options.render.method.renderer(),
        antialias: exact.map(|e| e.antialias),
        response: exact.map(|e| e.response),
        ground_truth: options.ground_truth,
        exposure: options.render.exposure_mode,
        poses: options.poses,
        color_camera: options.color_camera,
        scale: options.scale,
        background: options.render.background,
    };
    let means = EvalMeans {
        psnr_mean,
        psnr_std,
        psnr_covered_mean: mean(|s| s.psnr_covered),
        covered_from: COVERED,
        coverage_mean: of_all(|s| s.coverage).0,
        ssim_mean: of_all(|s| s.ssim).0,
        psnr_aligned_mean: mean(|s| s.psnr_aligned),
        psnr_aligned_covered_mean: mean(|s| s.psnr_aligned_covered),
        ssim_aligned_mean: mean(|s| s.ssim_aligned),
        detail_mean: Detail::mean(scores),
        seen_mean: SeenQuality::mean(&seen),
        pose_aligned_mean: AlignedView::mean(&aligned),
        depth_mae_mean: mean(|s| s.depth_mae),
    };
    EvalReport {
        group: None,
        split,
        protocol,
        views: scores.len(),
        learnt_views: None,
        skipped,
        means,
        cracks: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::surfaces;

    const SIZE: (usize, usize) = (32, 24);

    fn wall() -> Frame {
        let (width, height) = SIZE;
        surfaces::tests::wall(surfaces::tests::camera(width as u32, height as u32), |_, _| 2000)
    }

    fn rendered(depth: &Image<f32>) -> Rendered {
        let (width, height) = SIZE;
        Rendered {
            color: Image::filled(width, height, [0.0; 3]),
            coverage: Image::filled(width, height, 1.0),
            depth: depth.clone(),
            n_invalid: 0,
        }
    }

    fn plain(method: RenderMethod) -> EvalOptions {
        EvalOptions::plain(GroundTruth::Rgb, RenderOptions::evaluation(method, [0.0; 3]))
    }

    #[test]
    fn depth_is_compared_as_the_renderer_measures_it() {
        let (width, height) = SIZE;
        let frame = wall();
        let along_ray =
            |i: usize| 2.0 * frame.camera.intrinsics.ray(i % width, i / width).length() as f32;
        let distances = (0..width * height).map(along_ray).collect();
        let planes = [
            (RenderMethod::PROJECTED, Image::filled(width, height, 2.0)),
            (RenderMethod::EXACT, Image::from_vec(width, height, distances)),
        ];
        // A colour camera at the same pose must yield the same.
        let k = frame.camera.intrinsics;
        let same = ColorCamera {
            focal: [k.fx, k.fy],
            principal: [k.cx, k.cy],
            offset: [0.0; 3],
            rotation: [0.0; 3],
            size: None,
        };
        let error = |method, depth: &Image<f32>, color_camera| {
            let options = EvalOptions { color_camera, ..plain(method) };
            let camera = options.photo_camera(&frame);
            let surfaces = photographed_surfaces(&frame, &camera, Sensor::Kinect, &options);
            let rendered = rendered(depth);
            let drawn = Drawn { photograph: &rendered, depth: &rendered };
            let score = score(0, &frame, surfaces.as_ref(), drawn, &options);
            score.unwrap().depth_mae.unwrap()
        };
        for (method, depth) in &planes {
            assert!(error(*method, depth, None) < 1e-6, "{method:?}");
            assert!(error(*method, depth, Some(same)) < 1e-5, "{method:?}");
        }
        assert!(
            error(RenderMethod::EXACT, &planes[0].1, None) > 0.1,
            "z differs from ray distance"
        );
    }

    /// The photograph's camera has half the focal length of the depth camera. Its image shows twice the
    /// width, and its border has no measured depth.
    #[test]
    fn photographs_are_drawn_and_judged_by_the_camera_that_took_them() {
        let frame = wall();
        let k = frame.camera.intrinsics;
        let wide = ColorCamera {
            focal: [0.5 * k.fx, 0.5 * k.fy],
            principal: [k.cx, k.cy],
            offset: [0.0, 0.0, 0.5],
            rotation: [0.0; 3],
            size: None,
        };
        let options = EvalOptions { color_camera: Some(wide), ..plain(RenderMethod::PROJECTED) };
        let camera = options.photo_camera(&frame);
        assert_eq!((camera.intrinsics.fx, camera.intrinsics.width), (0.5 * k.fx, k.width));
        assert_eq!(camera.pose.centre().z, 0.5);
        let surfaces = photographed_surfaces(&frame, &camera, Sensor::Kinect, &options).unwrap();
        let known = surfaces.z.data.iter().filter(|z| (**z - 1.5).abs() < 1e-5).count();
        // 31 of 32 columns and 23 of 24 rows lie between the outer centres, scaled by two thirds.
        assert_eq!(known, 20 * 16);
    }
}
