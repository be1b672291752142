//! Output to stdout, and files written by all commands.

#![allow(clippy::print_stdout)]

use super::failure::Failure;
use anyhow::Context;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use vbgs_studio::dataset::Dataset;
use vbgs_studio::eval::cracks::{CrackReport, Cracks};
use vbgs_studio::eval::report::{
    AlignedView, Detail, EvalReport, SeenReport, SharpnessBand, ViewReport,
};
use vbgs_studio::eval::seen::SeenQuality;
use vbgs_studio::export::atomic::write_atomic;
use vbgs_studio::math::foreign::{displayable, displayable_json};

/// First error of writing to stdout. Printing continues after the error, and the command fails once it
/// has finished.
static STDOUT: Mutex<Option<std::io::Error>> = Mutex::new(None);

pub fn print_line(text: impl std::fmt::Display) {
    let text = text.to_string();
    // `println!` would panic on an error.
    note(writeln!(std::io::stdout(), "{}", displayable(&text)));
}

pub fn print_note(text: std::fmt::Arguments) {
    let text = text.to_string();
    // A closed stderr must not stop a training.
    let _ = writeln!(std::io::stderr(), "{}", displayable(&text));
}

fn note(written: std::io::Result<()>) {
    match written {
        // A closed pipe is not an error: the reader stopped early.
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            STDOUT.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }
        _ => {}
    }
}

pub fn check_stdout() -> Result<(), Failure> {
    // An error of buffered output appears only on flushing.
    note(std::io::stdout().flush());
    match STDOUT.lock().unwrap_or_else(PoisonError::into_inner).take() {
        None => Ok(()),
        Some(error) => Err(failed!(
            "stdout: expected to write the whole output, found: {error}; free some space or redirect it elsewhere"
        )),
    }
}

pub fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    print_line(displayable_json(&serde_json::to_string_pretty(value)?));
    Ok(())
}

pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_vec_pretty(value)?;
    write_atomic(path, |out| out.write_all(&text))?;
    Ok(())
}

pub fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    write_atomic(path, |out| out.write_all(text.as_bytes()))?;
    Ok(())
}

/// Creates a folder with its parents and checks that it is writable.
pub fn create_folder(path: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(path).with_context(|| {
        format!(
            "{}: expected a folder to write to, which could not be created; choose another",
            path.display()
        )
    })?;
    // Checked now rather than after the training whose result is written here.
    tempfile::tempfile_in(path).with_context(|| {
        format!(
            "{}: expected a folder to write to, found one that is not writable; choose another",
            path.display()
        )
    })?;
    Ok(())
}

/// Rejects output paths that cannot be replaced. Called before long work begins.
pub fn check_files(paths: &[PathBuf]) -> Result<(), Failure> {
    // Files are replaced by renaming, which fails for folders.
    match paths.iter().find(|path| path.is_dir()) {
        None => Ok(()),
        Some(path) => Err(failed!(
            "{}: expected a file to replace or nothing, found a folder; remove it or choose another place",
            path.display()
        )),
    }
}

/// Rejects links and devices at names that the program chose in a folder. What a link refers to would be
/// replaced unasked.
pub fn check_no_links(paths: &[PathBuf]) -> Result<(), Failure> {
    let is_other = |path: &&PathBuf| path.symlink_metadata().is_ok_and(|found| !found.is_file());
    match paths.iter().find(is_other) {
        None => Ok(()),
        Some(path) => Err(failed!(
            "{}: expected a file to replace or nothing, found a link or device; remove it or choose another folder",
            path.display()
        )),
    }
}

/// Warns about views that could not be measured, unless they were already reported when the dataset was
/// opened.
pub fn warn_skipped_views(dataset: &Dataset, eval: &EvalReport) {
    let told: Vec<String> = dataset.warnings.iter().map(|w| w.error.to_string()).collect();
    let untold = eval.skipped.iter().filter(|view| !told.contains(&view.message));
    untold.for_each(|view| note!("warning: {}", view.message));
}

fn detail(detail: Option<Detail>) -> String {
    detail.map_or_else(String::new, |detail| format!(", detail {detail}"))
}

pub fn view(view: &ViewReport) -> String {
    let detail = detail(view.detail);
    let aligned = view.psnr_aligned_covered.map_or_else(String::new, |psnr| {
        format!("  covered, colours aligned {psnr:6.2} dB{detail}")
    });
    format!(
        "{:>5} {:24} {:9} PSNR {:6.2} dB  SSIM {:.4}{aligned}",
        view.index, view.frame, view.renderer, view.psnr, view.ssim
    )
}

pub fn quality(eval: &EvalReport) -> String {
    let depth =
        eval.means.depth_mae_mean.map_or_else(String::new, |mae| format!(", depth error {mae:.4}"));
    let covered = match eval.means.psnr_covered_mean {
        Some(psnr) => {
            format!("{psnr:.2} dB over the {:.1} % covered", 100.0 * eval.means.coverage_mean)
        }
        None => "nothing covered".to_owned(),
    };
    // The projected renderer has neither.
    let settings = match (eval.protocol.antialias, eval.protocol.response) {
        (Some(antialias), Some(response)) => format!(" (antialias {antialias}, {response})"),
        _ => String::new(),
    };
    let scale = match eval.protocol.scale.is_full() {
        true => String::new(),
        false => format!(" at {} of the photographs' size", eval.protocol.scale),
    };
    let group = eval.group.map_or_else(String::new, |name| format!("{name}: "));
    let plain = format!(
        "{group}{}{settings} on {} views of `{}`{scale} ({} ground truth, exposure {}, {} poses): PSNR {:.2} ± {:.2} dB, {covered}, SSIM {:.4}{depth}",
        eval.protocol.renderer,
        eval.views,
        eval.split,
        eval.protocol.ground_truth,
        eval.protocol.exposure,
        eval.protocol.poses,
        eval.means.psnr_mean,
        eval.means.psnr_std,
        eval.means.ssim_mean,
    );
    let more = [
        format_trained_views(eval),
        aligned(eval),
        eval.means.pose_aligned_mean.as_ref().map(pose_aligned),
        eval.means.seen_mean.as_ref().map(seen),
        eval.cracks.as_ref().map(cracks),
    ];
    std::iter::once(plain).chain(more.into_iter().flatten()).collect::<Vec<_>>().join("\n  ")
}

pub fn format_early(report: &SeenReport) -> String {
    let SeenReport { after_frames, renderer, seen: early } = report;
    format!("{renderer}, frames trained: {after_frames}; {}", seen(early))
}

fn format_trained_views(eval: &EvalReport) -> Option<String> {
    let n = eval.learnt_views.filter(|n| *n > 0)?;
    Some(format!(
        "trained on {n} of these views: their scores measure reproduction, not quality on unseen views"
    ))
}

fn aligned(eval: &EvalReport) -> Option<String> {
    let detail = detail(eval.means.detail_mean);
    Some(format!(
        "colours aligned view by view: covered {:.2} dB, whole frame {:.2} dB, SSIM {:.4}{detail}",
        eval.means.psnr_aligned_covered_mean?,
        eval.means.psnr_aligned_mean?,
        eval.means.ssim_aligned_mean?
    ))
}

fn pose_aligned(view: &AlignedView) -> String {
    let bands = |value: fn(&SharpnessBand) -> f64| {
        view.bands.iter().map(|band| format!("{:.2}", value(band))).collect::<Vec<_>>().join(", ")
    };
    format!(
        "poses aligned to their photographs (moved by {:.4} and {:.2}° on average): PSNR {:.2} dB, covered {:.2} dB, colours aligned {:.2} dB, SSIM {:.4}, of gradients {:.4}, detail {}; from the finest octave: energy {} of the photograph's, correlation {}",
        view.shift,
        view.turn,
        view.psnr,
        view.psnr_covered,
        view.psnr_aligned_covered,
        view.ssim_aligned,
        view.gradient_ssim,
        view.detail(),
        bands(|band| band.energy_ratio),
        bands(|band| band.correlation),
    )
}

fn seen(seen: &SeenQuality) -> String {
    let interior = seen
        .coverage_interior
        .map_or_else(String::new, |share| format!(", {:.2} % away from edges", 100.0 * share));
    format!(
        "where their depth was measured: {:.2} dB, {:.2} % covered{interior}",
        seen.psnr,
        100.0 * seen.coverage
    )
}

fn cracks(report: &CrackReport) -> String {
    let shares = |cracks: &Cracks| {
        format!("{:.2} % ({:.2} %)", 100.0 * cracks.over_01, 100.0 * cracks.over_03)
    };
    let half = report.half_distance.as_ref().map_or("not in sight".to_owned(), shares);
    format!(
        "cracks, interior pixels with transmittance > 0.1 (> 0.3) on {} views of `{}`: {}; at half the distance {half}",
        report.views,
        report.split,
        shares(&report.training_distance),
    )
}

pub fn bar(n: usize, what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(n as u64);
    // In a log file, redrawn bars are noise.
    let shown = std::io::stderr().is_terminal();
    bar.set_draw_target(if shown {
        ProgressDrawTarget::stderr()
    } else {
        ProgressDrawTarget::hidden()
    });
    let style = ProgressStyle::with_template("{prefix} {pos}/{len} {bar:32} {msg} eta {eta}");
    // A faulty template must not stop a command.
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_prefix(what);
    bar
}

pub fn steps<T>(what: &'static str, work: impl FnOnce(&mut dyn FnMut(usize, usize)) -> T) -> T {
    let bar = bar(0, what);
    let result = work(&mut |done, all| {
        // Known only now: the number of steps depends on the data.
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    result
}

pub fn share<T>(what: &'static str, work: impl FnOnce(&dyn Fn(f64)) -> T) -> T {
    let bar = bar(100, what);
    let result = work(&|share| bar.set_position((100.0 * share) as u64));
    bar.finish_and_clear();
    result
}

/// Prints a warning above a progress bar.
pub fn warn(bar: &ProgressBar, message: &str) {
    bar.suspend(|| note!("warning: {message}"));
}
