//! `eval`: a model against the photographs of a dataset.

use super::args::EvalArgs;
use super::failure::Failure;
use super::model::Model;
use super::quality::QualityRequest;
use super::train::announce;
use super::{model, output, quality, tracked};
use serde::Serialize;
use vbgs_studio::dataset::calibration::{Calibration, ColorCamera};
use vbgs_studio::dataset::splits::HOLD_OUT_EVERY;
use vbgs_studio::dataset::{self, Dataset};
use vbgs_studio::eval::near::NearRule;
use vbgs_studio::eval::report::{EvalReport, ViewReport};
use vbgs_studio::pipeline::settings::method::Method;
use vbgs_studio::render::Lens;

#[derive(Serialize)]
struct EvalOutput {
    eval: Vec<EvalReport>,
    views: Vec<ViewReport>,
}

/// Measures as asked.
pub fn run(args: &EvalArgs) -> Result<(), Failure> {
    // Wrong usage first: models and datasets take seconds to read.
    let methods = args.renderer.methods(Lens::Pinhole)?;
    let model = model::load(&args.model)?;
    let load = model.load_options(args.depth.load_options())?;
    let dataset = dataset::open(&args.dataset, &load)?;
    announce(&dataset);
    if let Some(found) = &model.trajectory {
        eprintln!("note: {}", tracked::summary(found, found.error(&dataset).as_ref()));
    }
    let (split, frames) = choose_views(&dataset, args)?;
    let (dataset, frames) = match model.place(&dataset, (split, &frames))? {
        Some(placed) => (placed.dataset, placed.frames),
        None => (dataset, frames),
    };
    let views = (split, &frames[..]);
    let color_camera = color_camera(args, &model, &dataset)?;
    if let Some(camera) = color_camera {
        let scaling = dataset.splits[split].scaling(&camera).map_err(|error| {
            let file = args.calibration.as_deref().unwrap_or(&args.model);
            Failure::failed(error).of_calibration(Some(file))
        })?;
        scaling.iter().for_each(|scaled| eprintln!("note: {scaled}"));
    }
    let learnt = model.learnt.as_ref().and_then(|learnt| learnt.of(&dataset));
    let learnt = learnt.as_ref().map(|(split, frames)| (*split, &frames[..]));
    if learnt.is_none() {
        let path = args.model.display();
        eprintln!("note: {path}: does not say which of these views it was trained on");
    }
    let comparison = QualityRequest {
        args: &args.comparison,
        near_rule: NearRule::of(model.method.as_ref().map(Method::preset)),
        color_camera,
        methods: &methods,
        learnt,
    };
    let found = quality::measure((&model.splats).into(), &dataset, views, &comparison)?;
    if args.json {
        let (eval, views): (_, Vec<_>) = found.into_iter().unzip();
        return output::json(&EvalOutput { eval, views: views.concat() });
    }
    for (report, views) in &found {
        views.iter().for_each(|view| output::line(output::view(view)));
        output::line(output::quality(report));
    }
    Ok(())
}

fn color_camera(
    args: &EvalArgs,
    model: &Model,
    dataset: &Dataset,
) -> Result<Option<ColorCamera>, Failure> {
    match &args.calibration {
        Some(path) => Ok(Calibration::read(path)?.color_camera),
        None => Ok(model.color_camera(dataset)),
    }
}

fn choose_views(dataset: &Dataset, args: &EvalArgs) -> Result<(usize, Vec<usize>), Failure> {
    let (split, frames) = match &args.split {
        Some(name) => {
            let split = dataset.split_named(name)?;
            (split, (0..dataset.splits[split].frames.len()).collect())
        }
        None => {
            // A dataset without depth has no split to train on, but photographs to compare with.
            let evaluation = dataset.evaluation(dataset.training_split().unwrap_or(0));
            // Not its reason: what was trained on is counted below, by the model's own list.
            match evaluation.held_out {
                true => eprintln!("note: evaluating on every {HOLD_OUT_EVERY}th frame"),
                false => eprintln!("note: evaluating on {}", evaluation.why),
            }
            (evaluation.split, evaluation.frames)
        }
    };
    let frames: Vec<usize> = frames.into_iter().step_by(args.stride).collect();
    let n = args.max_frames.unwrap_or(frames.len()).min(frames.len());
    Ok((split, frames[..n].to_vec()))
}
