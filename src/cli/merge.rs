//! `merge`: models trained on different frames, as one.

use super::args::MergeArgs;
use super::failure::Failure;
use super::output;
use vbgs_studio::export::checkpoint;
use vbgs_studio::pipeline::checkpoint::{SavedRun, merge, merge_onto};

/// Merges as asked.
pub fn run(args: &MergeArgs) -> Result<(), Failure> {
    output::check_files(std::slice::from_ref(&args.output))?;
    let runs: Result<Vec<_>, _> = args.checkpoints.iter().map(|p| SavedRun::read(p)).collect();
    let merged = match &args.start {
        None => merge(runs?)?,
        Some(start) => merge_onto(&SavedRun::read(start)?, runs?)?,
    };
    // Never none: clap asks for two checkpoints.
    let Some(merged) = merged else { return Ok(()) };
    checkpoint::write(&args.output, &merged.content)?;
    output::line(format!(
        "wrote {}: {} models, {} frames",
        args.output.display(),
        args.checkpoints.len(),
        merged.content.cursor.frames
    ));
    Ok(())
}
