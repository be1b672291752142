//! `merge`: models trained on different frames, added.

use super::args::MergeArgs;
use super::failure::Failure;
use super::output;
use vbgs_studio::export::checkpoint;
use vbgs_studio::pipeline::checkpoint::{SavedRun, merge};

/// Merges as asked.
pub fn run(args: &MergeArgs) -> Result<(), Failure> {
    output::check_files(std::slice::from_ref(&args.output))?;
    let runs: Result<Vec<_>, _> = args.checkpoints.iter().map(|p| SavedRun::read(p)).collect();
    // Never none: clap asks for two checkpoints.
    let Some(merged) = merge(runs?)? else { return Ok(()) };
    checkpoint::write(&args.output, &merged.content)?;
    output::line(format!(
        "wrote {}: {} models, {} frames",
        args.output.display(),
        args.checkpoints.len(),
        merged.content.cursor.frames
    ));
    Ok(())
}
