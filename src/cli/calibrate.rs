//! `calibrate`: estimates a recording's camera calibration.

use super::args::CalibrateArgs;
use super::failure::Failure;
use super::output;
use super::train::print_dataset_notes;
use vbgs_studio::calibrate::CalibratePlan;
use vbgs_studio::dataset::calibration::Calibration;
use vbgs_studio::{calibrate, dataset};

pub fn run(args: &CalibrateArgs) -> Result<(), Failure> {
    // Read before the recording is opened, so that errors in it are reported at once.
    let start = args.calibration.as_deref().map(Calibration::read).transpose()?;
    let dataset = dataset::open(&args.dataset, &args.depth.recorded_load_options()?)?;
    print_dataset_notes(&dataset);
    let start = match start {
        Some(start) => start,
        None if args.from_scratch => Calibration::NONE,
        None => dataset.known_calibration().unwrap_or_default(),
    };
    let plan = CalibratePlan { split: args.split.clone(), max_frames: args.max_frames, start };
    // Checked before minutes of work whose result is written there.
    output::check_files(std::slice::from_ref(&args.output))?;
    let found = output::steps("calibrate", |progress| calibrate::run(&dataset, &plan, progress))?;
    found.skipped.iter().for_each(|message| eprintln!("warning: {message}"));
    output::write_text(&args.output, &found.calibration.to_text()?)?;
    if args.json {
        return output::print_json(&found);
    }
    output::print_line(found.text());
    out!("wrote {}; use it with `train --calibration` or in the window", args.output.display());
    Ok(())
}
