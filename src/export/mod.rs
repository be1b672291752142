//! Models as files: PLY in the 3DGS layout, point-cloud PLY and GLB with `KHR_gaussian_splatting` for
//! other programs, and the native [`checkpoint`]. The only place where file conventions (log scales,
//! logits, quaternion order, axes, linear colour) are converted; everywhere else a splat is a
//! [`crate::model::splat::splats::Splat`].
//!
//! ```
//! use vbgs_studio::export::{ModelFormat, ModelKind, WriteOptions, read, write};
//! use vbgs_studio::model::splat::splats::Splat;
//!
//! let splat = Splat {
//!     mean: [0.5, -1.25, 2.0],
//!     opacity: 0.95,
//!     color: [1.0, 0.5, 0.0],
//!     scale: [0.2, 0.1, 0.05],
//!     rotation: [1.0, 0.0, 0.0, 0.0],
//! };
//! let folder = tempfile::tempdir()?;
//! for name in ["scene.ply", "scene.glb"] {
//!     let path = folder.path().join(name);
//!     let summary = write(&path, &[splat], &WriteOptions::new(ModelFormat::from_path(&path)?))?;
//!     assert_eq!((summary.n_written, summary.n_skipped), (1, 0));
//!
//!     let model = read(&path)?;
//!     assert_eq!(model.kind, ModelKind::Splats);
//!     assert_eq!(model.splats[0].mean, splat.mean);
//!     assert!((model.splats[0].opacity - splat.opacity).abs() < 1e-6);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![doc = include_str!("export.md")]

pub mod atomic;
pub mod checkpoint;
pub mod error;
pub mod format;
pub mod imported;
pub mod mapping;

mod gaussian;
mod glb;
mod harmonics;
mod ply;

pub use error::{ExportError, Fault};
pub use format::{Axes, ModelFormat, WriteOptions};
pub use imported::{Imported, ModelKind, Note};

use crate::model::splat::appearance::SplatView;
use gaussian::drawable;
use std::io::{self, Read, Write};
use std::path::Path;

/// Most splats [`read`] accepts: about 1.4 GB of PLY.
pub const DEFAULT_MAX_SPLATS: usize = 20_000_000;

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
            found: error::shorten(line),
        }),
    }
}

/// Reads a model, recognised by its content and never by its name: PLY (splats or points), GLB,
/// or glTF with `data:` or sibling buffers. Accepts up to [`DEFAULT_MAX_SPLATS`] rows.
///
/// # Errors
/// The file cannot be read, is no model, is damaged, or uses what this program does not support;
/// the [`Fault`] says which. Rows that are not finite are no error: they are counted.
pub fn read(path: &Path) -> Result<Imported, ExportError> {
    read_up_to(path, DEFAULT_MAX_SPLATS)
}

/// Like [`read`], with another limit on the number of rows.
///
/// # Errors
/// As [`read`], and [`Fault::TooMany`] above `max_splats`.
pub fn read_up_to(path: &Path, max_splats: usize) -> Result<Imported, ExportError> {
    let import = || {
        let bytes = read_file(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let imported = parse(&bytes, folder, max_splats)?;
        Ok(Imported { bytes: bytes.len() as u64, ..imported })
    };
    import().map_err(|fault: Fault| fault.at(path))
}

fn parse(bytes: &[u8], folder: &Path, max_splats: usize) -> Result<Imported, Fault> {
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start();
    if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
        ply::read::ply(bytes, max_splats)
    } else if bytes.starts_with(b"glTF") {
        glb::read::glb(bytes, folder, max_splats)
    } else if text.starts_with(b"{") {
        glb::read::gltf(text, folder, max_splats)
    } else {
        let start = String::from_utf8_lossy(&bytes[..bytes.len().min(16)]);
        let found = match bytes {
            [] => "an empty file".to_owned(),
            _ => format!("a file starting \"{}\"", error::shorten(&start)),
        };
        Err(Fault::NotAModel { found })
    }
}

/// The whole file; memory is reserved for the size it really has.
fn read_file(path: &Path) -> Result<Vec<u8>, Fault> {
    let io = |source: std::io::Error| match source.kind() {
        std::io::ErrorKind::NotFound => Fault::Missing,
        _ => Fault::Io { action: "read", source },
    };
    if path.is_dir() {
        return Err(Fault::IsFolder);
    }
    let mut file = std::fs::File::open(path).map_err(io)?;
    let size = file.metadata().map_err(io)?.len();
    let room = usize::try_from(size).map_err(|_| Fault::OutOfMemory { bytes: size })?;
    let mut bytes = error::reserved(room)?;
    file.read_to_end(&mut bytes).map_err(io)?;
    Ok(bytes)
}

#[cfg(test)]
mod golden_tests;
