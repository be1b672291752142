//! `eval`: a model against the photographs of a dataset.

use super::args::EvalArgs;
use super::failure::Failure;
use super::model::Model;
use super::quality::QualityRequest;
use super::train::announce;
use super::{model, output, quality};
use serde::Serialize;
use vbgs_studio::dataset::calibration::{Calibration, ColorCamera};
use vbgs_studio::dataset::{self, Dataset};
use vbgs_studio::eval::report::{EvalReport, ViewReport};
use vbgs_studio::render::Lens;
use vbgs_studio::train::setting::Preset;

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
    let dataset = dataset::open(&args.dataset, &args.depth.load_options())?;
    announce(&dataset);
    let (split, frames) = choose_views(&dataset, args)?;
    let views = (split, &frames[..]);
    let color_camera = color_camera(args, &model, &dataset)?;
    let is_paper = model.method.as_ref().is_some_and(|method| method.preset() == Preset::Paper);
    let comparison =
        QualityRequest { args: &args.comparison, is_paper, color_camera, methods: &methods };
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
            eprintln!("note: evaluating on {}", evaluation.why);
            (evaluation.split, evaluation.frames)
        }
    };
    let frames: Vec<usize> = frames.into_iter().step_by(args.stride).collect();
    let n = args.max_frames.unwrap_or(frames.len()).min(frames.len());
    Ok((split, frames[..n].to_vec()))
}
