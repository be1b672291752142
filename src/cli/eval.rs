//! `eval`: compares a model with the photographs of a dataset.

use super::args::EvalArgs;
use super::failure::Failure;
use super::model::Model;
use super::quality::QualityRequest;
use super::train::print_dataset_notes;
use super::{model, output, quality, tracked};
use serde::Serialize;
use vbgs_studio::dataset::calibration::{Calibration, ColorCamera};
use vbgs_studio::dataset::splits::{HOLD_OUT_EVERY, HoldOut, ViewGroup};
use vbgs_studio::dataset::{Dataset, LoadOptions};
use vbgs_studio::eval::near::NearRule;
use vbgs_studio::eval::report::{EvalReport, ViewReport};
use vbgs_studio::pipeline::settings::method::Method;

#[derive(Serialize)]
struct EvalOutput {
    eval: Vec<EvalReport>,
    views: Vec<ViewReport>,
}

pub fn run(args: &EvalArgs) -> Result<(), Failure> {
    let mut model = model::load(&args.model)?;
    let calibrated_photographs = args.calibration.is_some();
    let asked = LoadOptions { calibrated_photographs, ..args.reading.load_options() };
    let dataset = model.open_dataset(&args.dataset, asked)?;
    print_dataset_notes(&dataset);
    if let Some(found) = &model.trajectory {
        note!("note: {}", tracked::summary(found, found.error(&dataset).as_ref()));
    }
    let learnt = model.trained_frames.as_ref().and_then(|run| run.of(&dataset));
    if learnt.is_none() {
        let path = args.model.display();
        note!("note: {path}: does not state which of these views it was trained on");
    }
    // The hold-out rule of a run on another dataset does not apply here.
    let run = model.trained_frames.as_ref().filter(|_| learnt.is_some());
    let hold_out = args.hold_out.or(run.map(|run| run.hold_out)).unwrap_or_default();
    let trained = learnt.as_ref().map(|learnt| learnt.split);
    let mut found = Vec::new();
    for group in choose_views(&dataset, args, hold_out, trained)? {
        let comparison = QualityRequest {
            args: &args.comparison,
            near_rule: NearRule::of(model.method.as_ref().map(Method::preset)),
            color_camera: color_camera(args, &model, &dataset, group.split)?,
            renderers: args.renderer.renderers(),
            tracked: model.tracked(),
            learnt: learnt.as_ref().map(ViewGroup::views),
            hold_out,
        };
        found.extend(quality::measure(&model.splats, &dataset, &group, &comparison)?);
    }
    if args.json {
        let (eval, views): (_, Vec<_>) = found.into_iter().unzip();
        return output::print_json(&EvalOutput { eval, views: views.concat() });
    }
    for (report, views) in &found {
        views.iter().for_each(|view| output::print_line(output::view(view)));
        output::print_line(output::quality(report));
    }
    Ok(())
}

/// Returns the colour camera of a split's photographs, if it differs from the depth camera.
fn color_camera(
    args: &EvalArgs,
    model: &Model,
    dataset: &Dataset,
    split: usize,
) -> Result<Option<ColorCamera>, Failure> {
    let camera = match &args.calibration {
        Some(path) => Calibration::read(path)?.color_camera,
        None => model.color_camera(dataset),
    };
    if let Some(camera) = camera {
        let scaling = dataset.splits[split].camera_scaling(&camera).map_err(|error| {
            // The error concerns the file that contains the camera.
            let file = args.calibration.as_deref().unwrap_or(&args.model);
            Failure::failed(error).with_calibration_file(Some(file))
        })?;
        scaling.iter().for_each(|scaled| note!("note: {scaled}"));
    }
    Ok(camera)
}

fn choose_views(
    dataset: &Dataset,
    args: &EvalArgs,
    hold_out: HoldOut,
    trained: Option<usize>,
) -> Result<Vec<ViewGroup>, Failure> {
    let mut groups = match &args.split {
        Some(name) => vec![dataset.whole_split(dataset.split_named(name)?)],
        None => {
            // A dataset without depth has no training split, but photographs to compare with.
            let default = || dataset.training_split().unwrap_or(0);
            let trained = trained.unwrap_or_else(default);
            let evaluation = dataset.evaluation_by(hold_out, trained)?;
            let is_held_out = evaluation.training.is_some() && hold_out == HoldOut::Every8th;
            // Without the reason given there: trained views are counted later from the model's own list.
            match is_held_out {
                true => note!("note: evaluating on every {HOLD_OUT_EVERY}th frame"),
                false => note!("note: evaluating on {}", evaluation.why),
            }
            evaluation.into_groups()
        }
    };
    for group in &mut groups {
        group.frames.truncate(args.max_frames.unwrap_or(usize::MAX));
    }
    Ok(groups)
}
