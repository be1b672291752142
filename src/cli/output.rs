//! Everything that goes to stdout, and the files every command writes.
#![allow(clippy::print_stdout)]

use super::failure::Failure;
use anyhow::Context;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use serde::Serialize;
use std::io::Write;
use std::path::Path;
use vbgs_studio::dataset::Dataset;
use vbgs_studio::eval::report::EvalReport;
use vbgs_studio::export::atomic::write_atomic;
use vbgs_studio::math::image::RgbImage;

/// One line for people.
pub fn line(text: impl std::fmt::Display) {
    // A closed pipe is the reader's choice, not an error of ours.
    let _ = writeln!(std::io::stdout(), "{text}");
}

/// One JSON document for machines.
pub fn json(value: &impl Serialize) -> Result<(), Failure> {
    line(serde_json::to_string_pretty(value)?);
    Ok(())
}

/// Writes a JSON file, whole or not at all.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_vec_pretty(value)?;
    write_atomic(path, |out| out.write_all(&text))?;
    Ok(())
}

/// Writes a text file, whole or not at all.
pub fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    write_atomic(path, |out| out.write_all(text.as_bytes()))?;
    Ok(())
}

/// Writes an 8-bit PNG, whole or not at all.
pub fn write_png(path: &Path, image: &RgbImage) -> Result<(), Failure> {
    let (width, height) = (image.width as u32, image.height as u32);
    write_atomic(path, |out| {
        PngEncoder::new(out)
            .write_image(&image.to_rgb8(), width, height, ExtendedColorType::Rgb8)
            .map_err(std::io::Error::other)
    })?;
    Ok(())
}

/// Creates a folder and those above it.
pub fn create_folder(path: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(path).with_context(|| {
        format!(
            "{}: expected a folder to write to, which could not be created; choose another",
            path.display()
        )
    })?;
    // Better now than after the training whose result belongs here.
    tempfile::tempfile_in(path).with_context(|| {
        format!(
            "{}: expected a folder to write to, found one that takes no files; choose another",
            path.display()
        )
    })?;
    Ok(())
}

/// Says on stderr which views could not be measured, besides those refused at opening.
pub fn skipped_views(dataset: &Dataset, eval: &EvalReport) {
    let told: Vec<String> = dataset.warnings.iter().map(|w| w.error.to_string()).collect();
    let untold = eval.skipped.iter().filter(|view| !told.contains(&view.message));
    untold.for_each(|view| eprintln!("warning: {}", view.message));
}

/// The quality of one split in a sentence.
pub fn quality(eval: &EvalReport) -> String {
    let depth =
        eval.depth_mae_mean.map_or_else(String::new, |mae| format!(", depth error {mae:.4}"));
    let covered = match eval.psnr_covered_mean {
        Some(psnr) => {
            format!("{psnr:.2} dB over the {:.1} % covered", 100.0 * eval.coverage_mean)
        }
        None => "nothing covered".to_owned(),
    };
    let settings = match (eval.antialias, eval.response) {
        (Some(antialias), Some(response)) => format!(" (antialias {antialias}, {response})"),
        _ => String::new(),
    };
    format!(
        "{}{settings} on {} views of `{}` ({} ground truth): PSNR {:.2} ± {:.2} dB, {covered}, SSIM {:.4}{depth}",
        eval.renderer,
        eval.views,
        eval.split,
        eval.ground_truth,
        eval.psnr_mean,
        eval.psnr_std,
        eval.ssim_mean,
    )
}
