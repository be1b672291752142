//! Measures the quality of models as the options request, with each requested renderer. The
//! measurements themselves are in `vbgs_studio::eval::choices`.

use super::args::{ComparisonArgs, Protocol, TrainArgs};
use super::failure::Failure;
use super::{output, tracked};
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::calibration::ColorCamera;
use vbgs_studio::dataset::error::DatasetError;
use vbgs_studio::dataset::splits::{HoldOut, ViewGroup};
use vbgs_studio::eval::choices::{GroundTruth, ViewPoses, Views};
use vbgs_studio::eval::near::{NearRule, near_plane};
use vbgs_studio::eval::report::{EvalReport, SeenReport, ViewReport};
use vbgs_studio::eval::seen::learnt_views;
use vbgs_studio::eval::views::EvalOptions;
use vbgs_studio::eval::{choices, cracks};
use vbgs_studio::math::camera::Camera;
use vbgs_studio::model::splat::appearance::{SplatSet, SplatView};
use vbgs_studio::pipeline::session::Session;
use vbgs_studio::pipeline::settings::method::Method;
use vbgs_studio::pipeline::tracked::Trajectory;
use vbgs_studio::render::{RenderOptions, Renderer};

pub struct QualityRequest<'a> {
    pub args: &'a ComparisonArgs,
    pub near_rule: NearRule,
    /// Colour camera of the photographs, if it differs from the depth camera.
    pub color_camera: Option<ColorCamera>,
    pub renderers: &'a [Renderer],
    /// Settings and poses of a tracked model, relative to which new views are tracked.
    pub tracked: Option<(&'a Method, &'a Trajectory)>,
    pub learnt: Option<Views<'a>>,
    pub hold_out: HoldOut,
}

/// Measures a group of views with each renderer. Returns, for each renderer, a report and the reports
/// of its views.
pub fn measure(
    splats: &SplatSet,
    dataset: &Dataset,
    group: &ViewGroup,
    request: &QualityRequest,
) -> Result<Vec<(EvalReport, Vec<ViewReport>)>, Failure> {
    // A tracked model has its own world, in which its views have no recorded poses.
    let placed = match request.tracked {
        Some((method, poses)) => tracked::place(dataset, method, splats, poses, group.views())?,
        None => None,
    };
    let (dataset, views) = match &placed {
        Some(placed) => (&placed.dataset, (group.split, placed.frames.as_slice())),
        None => (dataset, group.views()),
    };
    let (splats, renderers) = (splats.view(), request.renderers);
    if request.color_camera.is_some() {
        note!(
            "note: views are rendered with the colour camera of the photographs, not the depth camera"
        );
    }
    let crack_views = cracks::views(dataset, views.0, views.1);
    // Training views in place of views without depth would show the sector that was held out.
    let shows_sector = |split| split == views.0 || request.hold_out == HoldOut::Every8th;
    let crack_views = crack_views.filter(|(split, _)| shows_sector(*split));
    let crack_views = crack_views.as_ref().map(|(split, frames)| (*split, frames.as_slice()));
    let n_steps = choices::n_steps(views, crack_views);
    let near = request.near(splats, dataset, views);
    let bar = output::bar(renderers.len() * n_steps, "view");
    let mut found = Vec::with_capacity(renderers.len());
    for (i, &renderer) in renderers.iter().enumerate() {
        let options = request.options(renderer, near);
        let tell = |done| bar.set_position((i * n_steps + done) as u64);
        found.push(choices::measure_quality(splats, dataset, views, crack_views, &options, tell)?);
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

impl QualityRequest<'_> {
    /// Returns the near plane for all views, world units.
    fn near(&self, splats: SplatView, dataset: &Dataset, (split, views): Views<'_>) -> f64 {
        let frames = &dataset.splits[split].frames;
        let cameras: Vec<Camera> = views.iter().map(|&view| frames[view].camera).collect();
        let rule = match self.args.protocol {
            Protocol::Composited => self.near_rule,
            Protocol::Paper => NearRule::Published,
        };
        near_plane(splats, &cameras, rule)
    }

    fn options(&self, renderer: Renderer, near: f64) -> EvalOptions {
        let ComparisonArgs { protocol, background, align_poses, eval_scale } = *self.args;
        let (ground_truth, poses, render) = match protocol {
            Protocol::Composited => {
                let render = RenderOptions::evaluation(renderer.into(), background);
                (GroundTruth::Composited, ViewPoses::Corrected, render)
            }
            Protocol::Paper => {
                let render = RenderOptions::published(renderer, background);
                (GroundTruth::Rgb, ViewPoses::Recorded, render)
            }
        };
        EvalOptions {
            ground_truth,
            color_camera: self.color_camera,
            poses,
            align_poses,
            scale: eval_scale,
            render: RenderOptions { near, ..render },
        }
    }
}

#[derive(Default)]
pub struct RunQuality {
    pub eval: Vec<EvalReport>,
    pub seen: Vec<SeenReport>,
}

pub fn is_measured(session: &Session, args: &TrainArgs) -> bool {
    args.eval.is_some() || hold_out(session) == HoldOut::Sector
}

/// Returns the largest number of pixels of any group's first photograph. Splits that do not exist yet
/// are ignored.
pub fn photo_pixels(session: &Session, args: &TrainArgs) -> usize {
    let (dataset, camera) = (session.dataset(), session.config().method.as_any().color_camera());
    let pixels = |group: ViewGroup| {
        let view = dataset.splits[group.split].frames.get(*group.frames.first()?)?;
        let k = view.photo_camera(camera.as_ref()).intrinsics;
        Some(k.n_pixels())
    };
    // A followed recording may not have the split yet.
    let groups = groups(session, args).unwrap_or_default();
    groups.into_iter().filter_map(pixels).max().unwrap_or(0)
}

/// Measures the quality of a run. Evaluation views are measured with the final splats. Training views
/// are measured with each of the `early` splats, which were stored after the first few frames.
pub fn measure_run(
    session: &Session,
    early: &[(usize, SplatSet)],
    args: &TrainArgs,
) -> Result<RunQuality, Failure> {
    let (dataset, plan) = (session.dataset(), session.plan());
    let trajectory = Trajectory::of(session.frames(), session.skipped());
    let method = &session.config().method;
    let request = &QualityRequest {
        args: &ComparisonArgs::default(),
        near_rule: NearRule::of(Some(method.preset())),
        color_camera: method.as_any().color_camera(),
        renderers: &[Renderer::Projected],
        tracked: trajectory.as_ref().map(|poses| (method, poses)),
        learnt: Some((plan.split, &plan.frames[..session.visited()])),
        hold_out: hold_out(session),
    };
    let mut measured = RunQuality::default();
    // Tracked poses of the training views are unknown to early splats.
    for (visited, splats) in early.iter().filter(|_| !dataset.options.track) {
        let views = (plan.split, &plan.frames[..*visited]);
        let near = request.near(splats.view(), dataset, views);
        let options = request.options(Renderer::Projected, near);
        measured.seen.extend(choices::seen(splats.view(), dataset, views, &options)?);
    }
    let splats = session.splats();
    for group in groups(session, args)? {
        let found = measure(&splats, dataset, &group, request)?;
        measured.eval.extend(found.into_iter().map(|(report, _)| report));
    }
    Ok(measured)
}

/// Returns the groups of views to measure: the split named by `--eval`; with a sector hold-out, new views
/// on the camera path and views off it; and noise-free side views, if the dataset has them.
fn groups(session: &Session, args: &TrainArgs) -> Result<Vec<ViewGroup>, DatasetError> {
    let dataset = session.dataset();
    let named = args.eval.as_ref().map(|name| dataset.split_named(name)).transpose()?;
    let evaluation = dataset.evaluation_by(hold_out(session), session.plan().split)?;
    let of_run = match hold_out(session) {
        HoldOut::Sector => evaluation.into_groups(),
        // The other held-out views are measured only if `--eval` names their split.
        HoldOut::Every8th => evaluation.from_the_side,
    };
    let mut groups: Vec<_> = named.into_iter().map(|split| dataset.whole_split(split)).collect();
    for group in of_run {
        // `--eval` may name a split that the hold-out rule selects too.
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    Ok(groups)
}

fn hold_out(session: &Session) -> HoldOut {
    session.config().selection.hold_out
}
