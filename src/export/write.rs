//! Export of models: checks the options, selects and maps splats, and writes one format.

use super::error::{ExportError, Fault, shorten};
use super::format::{ModelFormat, WriteOptions};
use super::imported::ANTIALIASED_COMMENTS;
use super::source::ExportRows;
use super::stream::{ProgressCounter, SplatRows};
use super::{atomic, glb, ply, spz};
use crate::model::splat::appearance::SplatView;
use std::io;
use std::io::Write;
use std::path::Path;

/// Summary of an export.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteSummary {
    /// Number of splats written. A native splat that was split counts as two or four.
    pub n_written: usize,
    /// Number of undrawable splats: not finite, or with opacity 0 (unused components).
    pub n_skipped: usize,
    /// Number of drawable splats excluded by [`WriteOptions::selection`].
    pub n_left_out: usize,
    /// Size of the file in bytes.
    pub bytes: u64,
}

/// Writes the drawable splats to `path` atomically (see [`atomic::write_atomic`]). Native splats are
/// mapped to plain ones (see [`super::mapping`]). Needs 8 bytes of memory per splat and a block of rows;
/// SPZ also needs memory for the compressed file and 16 bytes per splat.
///
/// Positions are exact except in SPZ, and scales are at least 1e-7. Opacities in PLY are limited to
/// `[1e-6, 1 − 1e-6]`.
///
/// # Errors
/// [`Fault::NothingToExport`] if no splat is drawable, [`Fault::NothingSelected`] if none is selected,
/// [`Fault::Setting`] for invalid options, [`Fault::TooLargeForGlb`] from 4 GiB, [`Fault::Cancelled`], or an
/// error of writing the file.
pub fn write<'a>(
    path: &Path,
    splats: impl Into<SplatView<'a>>,
    options: &WriteOptions,
) -> Result<WriteSummary, ExportError> {
    let view: SplatView = splats.into();
    let comments = stated_comments(view, options);
    let options = &WriteOptions { comments: &comments, ..options.clone() };
    let source = select_rows(view, options).map_err(|fault| fault.with_path(path))?;
    // Prepared before any file is created, because layouts refuse what their format cannot hold.
    let content = prepare_content(&source, options).map_err(|fault| fault.with_path(path))?;
    let bytes = atomic::write_atomic(path, |out| content(out))?;
    let n_skipped = view.splats().len() - source.n_drawable;
    let n_left_out = source.n_left_out;
    Ok(WriteSummary { n_written: source.n_rows(), n_skipped, n_left_out, bytes })
}

pub(super) fn encode(view: SplatView, options: &WriteOptions) -> Result<Vec<u8>, Fault> {
    let comments = stated_comments(view, options);
    let options = &WriteOptions { comments: &comments, ..options.clone() };
    let source = select_rows(view, options)?;
    let content = prepare_content(&source, options)?;
    let mut bytes = Vec::new();
    content(&mut bytes).map_err(atomic::to_fault("convert", 0))?;
    Ok(bytes)
}

/// Returns the comments of a file: those given, and how other programs are to draw the splats.
fn stated_comments(view: SplatView, options: &WriteOptions) -> Vec<String> {
    let is_stated = view.finishing().is_antialiased && options.format != ModelFormat::PointCloudPly;
    let stated = ANTIALIASED_COMMENTS.iter().filter(|_| is_stated).map(|line| (*line).to_owned());
    options.comments.iter().cloned().chain(stated).collect()
}

fn select_rows<'a>(view: SplatView<'a>, options: &WriteOptions) -> Result<ExportRows<'a>, Fault> {
    check_comments(options.comments)?;
    let source = ExportRows::new(view, options)?;
    match (source.n_drawable, source.n_rows()) {
        (0, _) => Err(Fault::NothingToExport { n_splats: view.splats().len() }),
        (n_drawable, 0) => Err(Fault::NothingSelected { n_drawable }),
        _ => Ok(source),
    }
}

type Content<'a> = Box<dyn Fn(&mut dyn Write) -> io::Result<()> + 'a>;

fn prepare_content<'a>(
    source: &'a ExportRows<'a>,
    options: &'a WriteOptions,
) -> Result<Content<'a>, Fault> {
    let steps =
        |n_columns: usize| ProgressCounter::new(options.progress, source.n_rows() * n_columns);
    Ok(match options.format {
        ModelFormat::Ply => {
            let layout = ply::write::PlyLayout::new(source, options)?;
            Box::new(move |out| layout.write(out, source, &mut steps(1)))
        }
        ModelFormat::PointCloudPly => {
            let header = ply::write::header(source.n_rows(), options)?;
            Box::new(move |out| ply::write::points(out, &header, source, options, &mut steps(1)))
        }
        ModelFormat::Glb => {
            let layout = glb::write::GlbLayout::new(source, options)?;
            Box::new(move |out| layout.write(out, source, &mut steps(layout.n_columns())))
        }
        ModelFormat::Spz => {
            let layout =
                spz::write::SpzLayout::new(source, options.spz_version, source.is_antialiased())?;
            Box::new(move |out| layout.write(out, source, &mut steps(layout.n_columns())))
        }
    })
}

fn check_comments(comments: &[String]) -> Result<(), Fault> {
    // A line break would end the comment and begin another header line.
    let printable = |line: &String| line.bytes().all(|b| (b' '..=b'~').contains(&b));
    match comments.iter().find(|line| !printable(line)) {
        None => Ok(()),
        Some(line) => Err(Fault::setting("comment", "one line of printable ASCII", shorten(line))),
    }
}
