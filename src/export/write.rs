//! Models into files: the options are checked, splats mapped and counted, and one format writes.

use super::error::{ExportError, Fault, shorten};
use super::format::{ModelFormat, WriteOptions};
use super::gaussian::drawable;
use super::{atomic, glb, mapping, ply};
use crate::model::splat::appearance::SplatView;
use std::io::{self, Write};
use std::path::Path;

/// What an export wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteSummary {
    /// Splats in the file: as many as were drawable, times two or four if they were split.
    pub n_written: usize,
    /// Splats left out: not finite, or of opacity 0 (unused components).
    pub n_skipped: usize,
    /// Size of the file.
    pub bytes: u64,
}

/// Writes the drawable splats to `path`, whole or not at all (see [`atomic::write_atomic`]), mapped
/// to plain ones where they are more than that (see [`mapping`]).
///
/// Positions are exact, scales at least 1e-7; opacities in PLY are kept within `[1e-6, 1 − 1e-6]`.
///
/// # Errors
/// [`Fault::NothingToExport`] if no splat is drawable, [`Fault::Setting`] for options that do not
/// fit the splats, [`Fault::TooLargeForGlb`] from 4 GiB, and whatever writing the file can meet.
pub fn write<'a>(
    path: &Path,
    splats: impl Into<SplatView<'a>>,
    options: &WriteOptions,
) -> Result<WriteSummary, ExportError> {
    let view: SplatView = splats.into();
    let n_splats = view.splats().len();
    let n_drawable = drawable(view).count();
    if n_drawable == 0 {
        return Err(Fault::NothingToExport { n_splats }.at(path));
    }
    let mapped = match options.format {
        ModelFormat::Ply | ModelFormat::Glb => mapping::to_plain(view, options.mapping),
        ModelFormat::PointCloudPly => None,
    };
    let n_written = mapped.as_ref().map_or(n_drawable, |plain| plain.len());
    let view = mapped.as_ref().map_or(view, Into::into);
    let content = prepare(view, options).map_err(|fault| fault.at(path))?;
    let bytes = atomic::write_atomic(path, |out| content(out))?;
    Ok(WriteSummary { n_written, n_skipped: n_splats - n_drawable, bytes })
}

type Content<'a> = Box<dyn Fn(&mut dyn Write) -> io::Result<()> + 'a>;

/// Checks everything that can be wrong with the options before a file is created.
fn prepare<'a>(view: SplatView<'a>, options: &'a WriteOptions) -> Result<Content<'a>, Fault> {
    check_comments(options.comments)?;
    let rows = move || drawable(view).map(|(_, gaussian)| gaussian);
    Ok(match options.format {
        ModelFormat::Ply => {
            let layout = ply::write::PlyLayout::new(rows(), options)?;
            Box::new(move |out| layout.write(out, rows()))
        }
        ModelFormat::PointCloudPly => {
            let header = ply::points::header(rows().count(), view.splats().len(), options)?;
            Box::new(move |out| ply::points::points(out, &header, view, options))
        }
        ModelFormat::Glb => {
            let layout = glb::write::GlbLayout::new(rows(), options)?;
            Box::new(move |out| layout.write(out, rows()))
        }
    })
}

fn check_comments(comments: &[String]) -> Result<(), Fault> {
    let printable = |line: &String| line.bytes().all(|b| (b' '..=b'~').contains(&b));
    match comments.iter().find(|line| !printable(line)) {
        None => Ok(()),
        Some(line) => Err(Fault::Setting {
            setting: "comment",
            expected: "one line of printable ASCII".into(),
            found: shorten(line),
        }),
    }
}
