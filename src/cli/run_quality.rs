//! Quality at the end of a run: on the split given by `--eval` and on held-out views.

use super::args::TrainArgs;
use super::failure::Failure;
use super::quality::QualityRequest;
use super::{quality, tracked};
use vbgs_studio::dataset::error::DatasetError;
use vbgs_studio::dataset::splits::{HoldOut, ViewGroup};
use vbgs_studio::eval::near::NearRule;
use vbgs_studio::eval::report::{EvalReport, SeenReport};
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::pipeline::session::Session;
use vbgs_studio::pipeline::tracked::Trajectory;
use vbgs_studio::render::RenderMethod;

#[derive(Default)]
pub struct RunQuality {
    pub eval: Vec<EvalReport>,
    pub seen: Vec<SeenReport>,
}

/// True if quality is measured at the end of the run.
pub fn is_measured(session: &Session, args: &TrainArgs) -> bool {
    args.eval.is_some() || hold_out(session) == HoldOut::Sector
}

/// Largest number of pixels among each group's first photograph, for splits that exist already.
pub fn photo_pixels(session: &Session, args: &TrainArgs) -> usize {
    let (dataset, camera) = (session.dataset(), session.config().method.as_any().color_camera());
    let pixels = |group: ViewGroup| {
        let view = dataset.splits[group.split].frames.get(*group.frames.first()?)?;
        let k = view.photo_camera(camera.as_ref()).intrinsics;
        Some(k.width as usize * k.height as usize)
    };
    let groups = groups(session, args).unwrap_or_default();
    groups.into_iter().filter_map(pixels).max().unwrap_or(0)
}

/// Measures groups of views with the final splats, and the training views so far with each of the `early`
/// ones.
pub fn measure(
    session: &Session,
    early: &[(usize, SplatSet)],
    (args, methods): (&TrainArgs, &[RenderMethod]),
) -> Result<RunQuality, Failure> {
    let (dataset, plan) = (session.dataset(), session.plan());
    let comparison = &QualityRequest {
        args: &args.comparison,
        near_rule: NearRule::of(Some(session.config().method.preset())),
        color_camera: session.config().method.as_any().color_camera(),
        methods,
        learnt: Some((plan.split, &plan.frames[..session.visited()])),
        hold_out: hold_out(session),
    };
    let mut measured = RunQuality::default();
    // Tracked poses of the training views are unknown to early splats.
    for (visited, splats) in early.iter().filter(|_| !dataset.options.track) {
        let frames = (plan.split, &plan.frames[..*visited]);
        measured.seen.extend(quality::measure_training_views(
            splats.into(),
            dataset,
            frames,
            comparison,
        )?);
    }
    let (splats, trajectory) = (session.stored_splats(), trajectory(session));
    for group in groups(session, args)? {
        let method = &session.config().method;
        let placed = match &trajectory {
            Some(found) => tracked::place(dataset, method, &splats, found, group.views())?,
            None => None,
        };
        let (dataset, group) = match &placed {
            Some(placed) => {
                let frames = placed.frames.clone();
                (&placed.dataset, ViewGroup { frames, ..group })
            }
            None => (&**dataset, group),
        };
        let found = quality::measure((&splats).into(), dataset, &group, comparison)?;
        measured.eval.extend(found.into_iter().map(|(report, _)| report));
    }
    Ok(measured)
}

/// Tracked poses of a run, if poses were tracked.
pub fn trajectory(session: &Session) -> Option<Trajectory> {
    Trajectory::of(session.frames(), session.skipped())
}

/// Returns the named split, both groups of a held-out sector, and noise-free side views.
fn groups(session: &Session, args: &TrainArgs) -> Result<Vec<ViewGroup>, DatasetError> {
    let dataset = session.dataset();
    let named = args.eval.as_ref().map(|name| dataset.split_named(name)).transpose()?;
    let evaluation = dataset.evaluation_by(hold_out(session), session.plan().split)?;
    let of_run = match hold_out(session) {
        HoldOut::Sector => evaluation.into_groups(),
        HoldOut::Every8th => evaluation.from_the_side,
    };
    let mut groups: Vec<_> = named.into_iter().map(|split| dataset.whole_split(split)).collect();
    for group in of_run {
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    Ok(groups)
}

fn hold_out(session: &Session) -> HoldOut {
    session.config().selection.hold_out
}
