//! `train`: headless training with files at the end.

use super::args::{ComparisonArgs, ConversionName, GroundTruthName, TrainArgs};
use super::failure::Failure;
use super::interrupt::Interrupt;
use super::model::conversion_comments;
use super::{output, progress};
use anyhow::Context;
use indicatif::ProgressBar;
use std::path::Path;
use std::sync::Arc;
use vbgs_studio::dataset::{self, Dataset};
use vbgs_studio::eval::report::EvalReport;
use vbgs_studio::eval::views::{self, EvalOptions, GroundTruth};
use vbgs_studio::export::checkpoint;
use vbgs_studio::export::{Format, WriteOptions, write};
use vbgs_studio::model::splats::CovarianceForm;
use vbgs_studio::pipeline::checkpoint::{Asked, SavedRun};
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::render::RenderOptions;
use vbgs_studio::train::config::{Overrides, Preset, TrainConfig};

/// Trains as asked; after Ctrl-C the files are written all the same.
pub fn run(args: &TrainArgs) -> Result<(), Failure> {
    let start = match &args.resume {
        None => Start::New(Box::new(train_config(args)?)),
        Some(path) => {
            let asked = Box::new(asked(args)?);
            Start::Saved(Box::new(saved_run(path, &asked)?), asked)
        }
    };
    let interrupt = Interrupt::listen()?;
    let load = match &start {
        Start::New(_) => args.depth.load_options(),
        Start::Saved(run, _) => run.config.load,
    };
    let dataset = Arc::new(dataset::open(&args.dataset, &load)?);
    if let Some(split) = &args.eval {
        dataset.split_named(split)?;
    }
    announce(&dataset);
    let mut session = match start {
        Start::New(config) => Session::new(dataset, *config, selection(args))?,
        Start::Saved(run, asked) => run.resume(dataset, &asked, args.force)?,
    };
    output::create_folder(&args.out)?;
    if let Some(why) = &session.plan().held_out {
        eprintln!("note: held out for evaluation: {why}");
    }
    let checkpoint = args.out.join(CHECKPOINT);
    let end = train(&mut session, &interrupt, |session, bar| {
        let due = args.autosave_frames.is_some_and(|n| session.visited().is_multiple_of(n));
        if due && let Err(error) = autosave(session, &checkpoint) {
            // The run is worth more than one of its copies.
            progress::warn(bar, &error.to_string());
        }
    });
    if session.engine().frames() == 0 && end.is_err() {
        return end.map(drop);
    }
    // Whatever happens next, the model is safe.
    let files = save_model(&session, &args.out)?;
    let (eval, failure) = match (&args.eval, &end) {
        (Some(split), Ok(true)) => match evaluate(&session, split, &args.comparison) {
            Ok(report) => (vec![report], None),
            Err(failure) => (Vec::new(), Some(failure)),
        },
        _ => (Vec::new(), None),
    };
    save_report(&session, args, files, eval)?;
    let finished = end? && !interrupt.is_asked();
    match failure {
        Some(failure) => Err(failure),
        None if finished => Ok(()),
        None => Err(Failure::Interrupted),
    }
}

/// Where training starts from.
enum Start {
    New(Box<TrainConfig>),
    Saved(Box<SavedRun>, Box<Asked>),
}

/// The run to go on with, whose settings agree with those asked for.
fn saved_run(path: &Path, asked: &Asked) -> Result<SavedRun, Failure> {
    let run = SavedRun::read(path)?;
    run.check(asked)?;
    if let Some(warning) = run.numerics_differ() {
        eprintln!("warning: {warning}");
    }
    let trained = run.content.cursor.visited.len();
    let most = asked.max_frames.or(run.config.selection.max_frames);
    if most.is_some_and(|most| most <= trained) {
        eprintln!("note: {trained} frames are trained already; --max-frames N trains up to N");
    }
    Ok(run)
}

/// Trains until the frames end (true) or Ctrl-C (false); `learnt` is called after every frame.
pub fn train(
    session: &mut Session,
    interrupt: &Interrupt,
    learnt: impl Fn(&Session, &ProgressBar),
) -> Result<bool, Failure> {
    let bar = progress::bar(session.plan().frames.len(), "frame");
    bar.set_position(session.visited() as u64);
    bar.reset_eta();
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
                learnt(session, &bar);
            }
            Step::Skipped(skipped) => progress::warn(&bar, &skipped.message),
            Step::Finished => break,
        }
    }
    bar.finish_and_clear();
    Ok(true)
}

/// Name of the checkpoint in the output folder.
const CHECKPOINT: &str = "checkpoint.vbgs";

fn autosave(session: &Session, path: &Path) -> anyhow::Result<()> {
    checkpoint::write_keeping_old(path, &session.checkpoint()?)?;
    Ok(())
}

/// Writes `checkpoint.vbgs` and `scene.ply`, the latter unless nothing was learnt; their names.
fn save_model(session: &Session, out: &Path) -> Result<&'static str, Failure> {
    if session.engine().frames() > 0 {
        checkpoint::write(&out.join(CHECKPOINT), &session.checkpoint()?)?;
    }
    if session.engine().used() == 0 {
        return Ok("");
    }
    let comments = conversion_comments(&session.config().train);
    let options =
        WriteOptions { comments: &comments, up: session.up(), ..WriteOptions::new(Format::Ply) };
    write(&out.join("scene.ply"), &session.splats(), &options)?;
    Ok("scene.ply, checkpoint.vbgs and ")
}

/// Writes `report.json` and prints the result.
fn save_report(
    session: &Session,
    args: &TrainArgs,
    models: &str,
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
    output::line(format!("wrote {models}report.json to {}", args.out.display()));
    Ok(())
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
    let everything = Selection::everything();
    Selection {
        split: args.split.clone(),
        order: args.order.unwrap_or(everything.order),
        stride: args.stride.unwrap_or(everything.stride),
        shard: args.shard,
        max_frames: args.max_frames,
    }
}

/// What the command line says beside `--resume`.
fn asked(args: &TrainArgs) -> Result<Asked, Failure> {
    Ok(Asked {
        preset: args.preset,
        train: overrides(args)?,
        split: args.split.clone(),
        order: args.order,
        stride: args.stride,
        shard: args.shard,
        load: args.depth.load_options(),
        max_frames: args.max_frames,
    })
}

fn train_config(args: &TrainArgs) -> Result<TrainConfig, Failure> {
    let preset = match args.preset {
        None | Some(Preset::Paper) => TrainConfig::paper(),
    };
    Ok(preset.with(&overrides(args)?)?)
}

/// Settings from the command line, then from the file it names.
fn overrides(args: &TrainArgs) -> Result<Overrides, Failure> {
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
    Ok(line.or(file))
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
