//! `train`: headless training with files at the end.

use super::args::{ComparisonArgs, ConversionName, GroundTruthName, TrainArgs};
use super::failure::Failure;
use super::interrupt::Interrupt;
use super::{output, progress};
use anyhow::Context;
use std::path::Path;
use std::sync::Arc;
use vbgs_studio::dataset::{self, Dataset};
use vbgs_studio::eval::report::EvalReport;
use vbgs_studio::eval::views::{self, EvalOptions, GroundTruth};
use vbgs_studio::export::{Format, WriteOptions, write};
use vbgs_studio::model::splats::CovarianceForm;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::render::RenderOptions;
use vbgs_studio::train::config::{Overrides, Preset, TrainConfig};

/// Trains as asked; after Ctrl-C the files are written all the same.
pub fn run(args: &TrainArgs) -> Result<(), Failure> {
    let config = train_config(args)?;
    let interrupt = Interrupt::listen()?;
    let dataset = Arc::new(dataset::open(&args.dataset, &args.depth.load_options())?);
    if let Some(split) = &args.eval {
        dataset.split_named(split)?;
    }
    announce(&dataset);
    let mut session = Session::new(dataset, config, selection(args))?;
    output::create_folder(&args.out)?;
    if let Some(why) = &session.plan().held_out {
        eprintln!("note: held out for evaluation: {why}");
    }
    let end = train(&mut session, &interrupt);
    if session.frames().is_empty() && end.is_err() {
        return end.map(drop);
    }
    // Whatever happens next, the scene is safe.
    let has_scene = save_scene(&session, &args.out)?;
    let (eval, failure) = match (&args.eval, &end) {
        (Some(split), Ok(true)) => match evaluate(&session, split, &args.comparison) {
            Ok(report) => (vec![report], None),
            Err(failure) => (Vec::new(), Some(failure)),
        },
        _ => (Vec::new(), None),
    };
    save_report(&session, args, has_scene, eval)?;
    let finished = end? && !interrupt.is_asked();
    match failure {
        Some(failure) => Err(failure),
        None if finished => Ok(()),
        None => Err(Failure::Interrupted),
    }
}

/// Trains until the frames end (true) or Ctrl-C (false).
pub fn train(session: &mut Session, interrupt: &Interrupt) -> Result<bool, Failure> {
    let bar = progress::bar(session.plan().frames.len(), "frame");
    loop {
        if interrupt.is_asked() {
            bar.abandon();
            return Ok(false);
        }
        match session.step()? {
            Step::Trained(frame) => {
                bar.set_position(frame.index as u64 + 1);
                bar.set_message(format!(
                    "{:.1} ms/frame, {} of {} components used,",
                    frame.ms.stages.train, frame.used, frame.components
                ));
            }
            Step::Skipped(skipped) => progress::warn(&bar, &skipped.message),
            Step::Finished => break,
        }
    }
    bar.finish_and_clear();
    Ok(true)
}

/// Writes `scene.ply` unless nothing was learnt; whether it did.
fn save_scene(session: &Session, out: &Path) -> Result<bool, Failure> {
    if session.engine().used() == 0 {
        return Ok(false);
    }
    let comments = conversion_comments(session);
    let options =
        WriteOptions { comments: &comments, up: session.up(), ..WriteOptions::new(Format::Ply) };
    write(&out.join("scene.ply"), &session.splats(), &options)?;
    Ok(true)
}

/// Writes `report.json` and prints the result.
fn save_report(
    session: &Session,
    args: &TrainArgs,
    has_scene: bool,
    eval: Vec<EvalReport>,
) -> Result<(), Failure> {
    let report = session.report(None, eval);
    output::write_json(&args.out.join("report.json"), &report)?;
    if args.json {
        return output::json(&report);
    }
    let summary = &report.summary;
    output::line(format!(
        "{} frames, {} skipped, in {:.1} s: median {:.1} ms a frame (95 % below {:.1} ms), {} of {} components used",
        report.frames.len(),
        report.skipped.len(),
        summary.wall_s,
        summary.train_ms_median,
        summary.train_ms_p95,
        summary.used,
        summary.components
    ));
    report.eval.iter().for_each(|e| output::line(output::quality(e)));
    let files = if has_scene { "scene.ply and report.json" } else { "report.json" };
    output::line(format!("wrote {files} to {}", args.out.display()));
    Ok(())
}

/// Comment lines of the PLY that name a conversion other than the plain one.
fn conversion_comments(session: &Session) -> Vec<String> {
    match session.config().train.conversion.form {
        CovarianceForm::LegacyCholesky => vec!["vbgs legacy-cov".to_owned()],
        CovarianceForm::Eigen => Vec::new(),
    }
}

fn evaluate(
    session: &Session,
    split: &str,
    comparison: &ComparisonArgs,
) -> Result<EvalReport, Failure> {
    let dataset = session.dataset();
    let split = dataset.split_named(split)?;
    let frames: Vec<usize> = (0..dataset.splits[split].frames.len()).collect();
    let bar = progress::bar(frames.len(), "view");
    let options = eval_options(comparison);
    let (report, _) =
        views::evaluate(&session.splats(), dataset, split, &frames, &options, |done| {
            bar.set_position(done as u64)
        })?;
    bar.finish_and_clear();
    output::skipped_views(dataset, &report);
    Ok(report)
}

/// Settings of an evaluation.
pub fn eval_options(comparison: &ComparisonArgs) -> EvalOptions {
    EvalOptions {
        ground_truth: match comparison.ground_truth {
            GroundTruthName::Composited => GroundTruth::Composited,
            GroundTruthName::Rgb => GroundTruth::Rgb,
        },
        render: RenderOptions::evaluation(comparison.background),
    }
}

/// Says on stderr what is special about a dataset.
pub fn announce(dataset: &Dataset) {
    dataset.notes.iter().for_each(|note| eprintln!("note: {note}"));
    dataset.warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));
}

fn selection(args: &TrainArgs) -> Selection {
    Selection {
        split: args.split.clone(),
        order: args.order,
        stride: args.stride,
        max_frames: args.max_frames,
    }
}

fn train_config(args: &TrainArgs) -> Result<TrainConfig, Failure> {
    let preset = match args.preset {
        Preset::Paper => TrainConfig::paper(),
    };
    let file = args.config.as_deref().map(read_config).transpose()?.unwrap_or_default();
    let line = Overrides {
        seed: args.seed,
        components: args.components,
        candidates: args.candidates,
        batch: args.batch,
        statistics: args.statistics,
        index: args.index,
        init: args.init,
        reassign: args.reassign,
        reassign_fraction: args.reassign_fraction,
        precision: args.precision,
        operations: None,
        covariance_form: args.conversion.map(|conversion| match conversion {
            ConversionName::Right => CovarianceForm::Eigen,
            ConversionName::LegacyCov => CovarianceForm::LegacyCholesky,
        }),
        scale_factor: args.scale_factor,
    };
    Ok(preset.with(&line.or(file))?)
}

fn read_config(path: &Path) -> Result<Overrides, Failure> {
    let text = std::fs::read_to_string(path).with_context(|| {
        format!("{}: expected a RON file with settings, which could not be read", path.display())
    })?;
    let options =
        ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    Ok(options.from_str(&text).with_context(|| {
        format!("{}: expected settings such as (components: 50000, candidates: 4)", path.display())
    })?)
}
