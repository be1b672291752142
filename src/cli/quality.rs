//! Converts options to measurements, one per requested renderer. Measuring itself is in
//! `vbgs_studio::eval::measure`.

use super::args::{ComparisonArgs, GroundTruthName};
use super::failure::Failure;
use super::{output, progress};
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::calibration::ColorCamera;
use vbgs_studio::dataset::splits::{HoldOut, ViewGroup};
use vbgs_studio::eval::choices::GroundTruth;
use vbgs_studio::eval::cracks;
use vbgs_studio::eval::learnt::learnt_views;
use vbgs_studio::eval::measure::{self, Views};
use vbgs_studio::eval::near::{NearRule, near_plane};
use vbgs_studio::eval::report::{EvalReport, SeenReport, ViewReport};
use vbgs_studio::eval::views::EvalOptions;
use vbgs_studio::math::camera::Camera;
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::render::{RenderMethod, RenderOptions};

/// Options for comparing splats with photographs.
pub struct QualityRequest<'a> {
    /// Ground truth, background, partial coverage and exposure, as given.
    pub args: &'a ComparisonArgs,
    /// Rule for the near plane if none is given.
    pub near_rule: NearRule,
    /// Colour camera of the photographs, if it differs from the depth camera.
    pub color_camera: Option<ColorCamera>,
    /// Renderers to use in turn.
    pub methods: &'a [RenderMethod],
    /// Frames the model was trained on, if known.
    pub learnt: Option<Views<'a>>,
    /// Hold-out rule of training.
    pub hold_out: HoldOut,
}

/// Measures a group of views with each renderer; results are grouped by renderer.
pub fn measure(
    splats: SplatView,
    dataset: &Dataset,
    group: &ViewGroup,
    request: &QualityRequest,
) -> Result<Vec<(EvalReport, Vec<ViewReport>)>, Failure> {
    let (methods, views) = (request.methods, group.views());
    if request.color_camera.is_some() {
        eprintln!(
            "note: views are rendered with the colour camera of the photographs, not the depth camera"
        );
    }
    let crack_views = cracks::views(dataset, views.0, views.1);
    // Training views in place of views without depth would show the sector that was held out.
    let shows_sector = |split| split == views.0 || request.hold_out == HoldOut::Every8th;
    let crack_views = crack_views.filter(|(split, _)| shows_sector(*split));
    let crack_views = crack_views.as_ref().map(|(split, frames)| (*split, frames.as_slice()));
    let n_steps = measure::n_steps(views, crack_views);
    let near = request.near(splats, dataset, views);
    let bar = progress::bar(methods.len() * n_steps, "view");
    let mut found = Vec::with_capacity(methods.len());
    for (i, &method) in methods.iter().enumerate() {
        let options = request.options(method, near);
        let tell = |done| bar.set_position((i * n_steps + done) as u64);
        found.push(measure::measure_quality(splats, dataset, views, crack_views, &options, tell)?);
    }
    bar.finish_and_clear();
    let learnt_views = request.learnt.map(|learnt| learnt_views(dataset, learnt, views));
    for (report, views) in &mut found {
        (report.group, report.learnt_views) = (group.name, learnt_views);
        views.iter_mut().for_each(|view| view.group = group.name);
    }
    // Unreadable views are the same for every renderer.
    if let Some((report, _)) = found.first() {
        output::warn_skipped_views(dataset, report);
    }
    Ok(found)
}

/// Measures how splats reproduce the depth and images of the frames they were trained on.
pub fn measure_training_views(
    splats: SplatView,
    dataset: &Dataset,
    views: Views<'_>,
    request: &QualityRequest,
) -> Result<Vec<SeenReport>, Failure> {
    let mut found = Vec::with_capacity(request.methods.len());
    let near = request.near(splats, dataset, views);
    for &method in request.methods {
        found.extend(measure::seen(splats, dataset, views, &request.options(method, near))?);
    }
    Ok(found)
}

impl QualityRequest<'_> {
    /// Near plane of all views, world units.
    fn near(&self, splats: SplatView, dataset: &Dataset, (split, views): Views<'_>) -> f64 {
        self.args.near.unwrap_or_else(|| {
            let frames = &dataset.splits[split].frames;
            let cameras: Vec<Camera> = views.iter().map(|&view| frames[view].camera).collect();
            near_plane(splats, &cameras, self.near_rule)
        })
    }

    fn options(&self, method: RenderMethod, near: f64) -> EvalOptions {
        let ComparisonArgs {
            ground_truth,
            background,
            partial_coverage,
            exposure,
            eval_poses,
            align_poses,
            eval_scale,
            near: _,
        } = *self.args;
        EvalOptions {
            ground_truth: match ground_truth {
                GroundTruthName::Composited => GroundTruth::Composited,
                GroundTruthName::Rgb => GroundTruth::Rgb,
            },
            partial_coverage,
            color_camera: self.color_camera,
            poses: eval_poses,
            align_poses,
            scale: eval_scale,
            render: RenderOptions {
                exposure_mode: exposure,
                near,
                ..RenderOptions::evaluation(method, background)
            },
        }
    }
}
