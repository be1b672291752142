//! Errors of writing and reading models.
//!
//! A [`Fault`] states what was expected, what was found and what to do; [`ExportError`] adds the path. Text
//! from a file is escaped and shortened before it enters a message, because it may hold anything.

use super::format::{READ_ENDINGS, WRITTEN_ENDINGS, listed};
use std::io;
use std::path::{Path, PathBuf};

/// Error of exporting or importing a file.
#[derive(Debug, thiserror::Error)]
#[error("{}: {fault}", path.display())]
pub struct ExportError {
    /// Path of the file.
    pub path: PathBuf,
    /// What is wrong, and what to do about it.
    pub fault: Fault,
}

/// Reason why a file could not be written or read.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// Drawable splats exist, but the options exclude all of them.
    #[error(
        "nothing to export: expected some of {n_drawable} splats inside the crop box, with enough \
         evidence and low enough uncertainty, found none; relax these limits"
    )]
    NothingSelected { n_drawable: usize },
    /// No splat can be drawn.
    #[error(
        "nothing to export: expected at least one finite splat with opacity above 0, found none \
         among {n_splats}; train some frames first"
    )]
    NothingToExport { n_splats: usize },
    /// The file name has no known model extension.
    #[error("expected a name ending in {}, found {found:?}; rename it or name a format", listed(&WRITTEN_ENDINGS))]
    UnknownExtension { found: String },
    /// The file name has no known mesh extension.
    #[error("expected a mesh file name ending in .ply, .glb or .obj, found {found:?}; rename it")]
    UnknownMeshExtension { found: String },
    /// No region has enough evidence (number of points) for a surface.
    #[error(
        "no surface: expected enough evidence for one from {n_components} components, found too \
         little; use a larger cell or leave fewer components out"
    )]
    NoSurface { n_components: usize },
    /// The target folder is missing.
    #[error("the folder {} does not exist; create it or choose another", folder.display())]
    NoFolder { folder: PathBuf },
    /// The model file does not exist.
    #[error("expected a model ({}), found nothing at this path; check the spelling", listed(&READ_ENDINGS))]
    Missing,
    /// The checkpoint file does not exist.
    #[error("expected a checkpoint (.vbgs), found nothing at this path; check the spelling")]
    NoCheckpoint,
    /// The path is a folder, not a file.
    #[error("expected a file, found a folder; name a file in it")]
    IsFolder,
    /// The path is a device or FIFO, not a file.
    #[error(
        "expected a file, found a FIFO or device, which may never end; copy its data into a file"
    )]
    IsStream,
    /// The operating system reported an error.
    #[error("cannot {action}: {source}")]
    Io { action: &'static str, source: io::Error },
    /// The disk is full.
    #[error(
        "the disk is full after {written} bytes; free some space or choose another folder (an \
         existing file of this name is unchanged)"
    )]
    DiskFull { written: u64 },
    /// An option has an invalid value.
    #[error("{setting}: expected {expected}, found {found}")]
    Setting { setting: &'static str, expected: String, found: String },
    /// The file would exceed GLB's 32-bit length.
    #[error(
        "{n_splats} splats need {needed} bytes as GLB, whose limit is {}; export PLY instead",
        u32::MAX
    )]
    TooLargeForGlb { n_splats: usize, needed: u64 },
    /// The content has no known format.
    #[error("expected a model ({}), found {found}; convert it to PLY", listed(&READ_ENDINGS))]
    NotAModel { found: String },
    /// The content violates its format.
    #[error("{place}: expected {expected}, found {found}; export the file again")]
    Malformed { place: String, expected: String, found: String },
    /// A required PLY property is missing.
    #[error(
        "element vertex: expected property {property}, found only {found}; export it as 3DGS or \
         point-cloud PLY"
    )]
    MissingProperty { property: String, found: String },
    /// The file is valid, but this program does not support it.
    #[error("unsupported: {feature}; {advice}")]
    Unsupported { feature: String, advice: &'static str },
    /// The file has more rows than the caller permits.
    #[error("expected at most {cap} splats, found {declared}; reduce the model first")]
    TooMany { declared: u64, cap: usize },
    /// The allocation failed.
    #[error(
        "expected {bytes} bytes of free memory, found less; close other programs or reduce the \
         model"
    )]
    OutOfMemory { bytes: u64 },
    /// The caller cancelled the export.
    #[error("cancelled: no file was written and an existing file of this name is unchanged")]
    Cancelled,
    /// Every row was unusable.
    #[error("expected at least one finite row, found none ({skipped} skipped); export it again")]
    NothingToImport { skipped: usize },
}

/// Error that a cancelled writer returns; it is converted to [`Fault::Cancelled`].
#[derive(Debug, thiserror::Error)]
#[error("cancelled")]
pub(super) struct Cancelled;

impl Fault {
    pub(super) fn with_path(self, path: &Path) -> ExportError {
        ExportError { path: path.to_path_buf(), fault: self }
    }

    pub(super) fn setting(
        setting: &'static str,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Self::Setting { setting, expected: expected.into(), found: found.to_string() }
    }

    pub(super) fn malformed(
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Malformed { place: place.into(), expected: expected.into(), found: found.into() }
    }
}

/// Escapes control characters and shortens text from a file to 60 characters, for messages.
pub(super) fn shorten(text: &str) -> String {
    shorten_to(text, 60)
}

pub(super) fn shorten_to(text: &str, most: usize) -> String {
    let mut short = String::new();
    for c in text.chars() {
        // Control characters of a file must not reach a terminal.
        let escaped = c.escape_default();
        if short.len() + escaped.len() > most {
            short.push('…');
            break;
        }
        short.extend(escaped);
    }
    short
}

pub(super) fn try_with_capacity<T>(n: usize) -> Result<Vec<T>, Fault> {
    let mut items = Vec::new();
    let bytes = n as u64 * size_of::<T>() as u64;
    // Sizes come from files: an excessive one must give an error, not abort the program.
    items.try_reserve_exact(n).map_err(|_| Fault::OutOfMemory { bytes })?;
    Ok(items)
}
