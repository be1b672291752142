//! `merge`: combines models trained on different frames.

use super::args::MergeArgs;
use super::failure::Failure;
use super::output;
use vbgs_studio::export::checkpoint;
use vbgs_studio::pipeline::checkpoint::{SavedRun, merge, merge_onto};
use vbgs_studio::train::scene::config::BirthRule;

pub fn run(args: &MergeArgs) -> Result<(), Failure> {
    output::check_files(std::slice::from_ref(&args.output))?;
    let runs: Result<Vec<_>, _> = args.checkpoints.iter().map(|p| SavedRun::read(p)).collect();
    let merged = match &args.start {
        None => merge(warn_about_fusing(runs?))?,
        Some(start) => merge_onto(&SavedRun::read(start)?, runs?)?,
    };
    // Never `None`: clap requires two checkpoints.
    let Some(merged) = merged else { return Ok(()) };
    checkpoint::write(&args.output, &merged.content)?;
    output::print_line(format!(
        "wrote {}: {} models, {} frames",
        args.output.display(),
        args.checkpoints.len(),
        merged.content.cursor.frames
    ));
    Ok(())
}

/// Warns about the quality lost by fusing models with different seeds.
fn warn_about_fusing(runs: Vec<SavedRun>) -> Vec<SavedRun> {
    let first = runs.first().and_then(|run| run.config.method.scene());
    if first.is_some_and(|scene| scene.engine.births == BirthRule::Seeds) {
        eprintln!(
            "warning: setting `births`: expected \"lattice\" or \"body-centred\" for runs without a common start, found \"seeds\": surfaces seen by several runs will be blurred; resume all of them from one short run (train --resume START --shard K/N) and merge with --start START"
        );
    }
    runs
}
