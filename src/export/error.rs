//! What can go wrong when a model is written or read.
//!
//! A [`Fault`] says what was expected, what was found and what to do; [`ExportError`] adds the
//! file, once, where its path is known. Text of a file is escaped and cut before it enters a
//! message: it may hold anything.

use super::endings::{READ_ENDINGS, WRITTEN_ENDINGS, listed};
use std::io;
use std::path::{Path, PathBuf};

/// A failed export or import: which file, and why.
#[derive(Debug, thiserror::Error)]
#[error("{}: {fault}", path.display())]
pub struct ExportError {
    /// The file that was to be written or read.
    pub path: PathBuf,
    /// What is wrong and what to do about it.
    pub fault: Fault,
}

/// Why a file could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// Drawable splats, but none that the options ask for.
    #[error(
        "nothing to export: expected some of {n_drawable} splats inside the crop box, with enough \
         evidence and little enough uncertainty, found none; ask for more"
    )]
    NothingSelected {
        /// Splats that could have been written.
        n_drawable: usize,
    },
    /// No splat can be drawn.
    #[error(
        "nothing to export: expected at least one finite splat with opacity above 0, found none \
         among {n_splats}; train some frames first"
    )]
    NothingToExport {
        /// Number of splats given, drawable or not.
        n_splats: usize,
    },
    /// The name does not tell the format.
    #[error("expected a name ending in {}, found {found:?}; rename it or name a format", listed(&WRITTEN_ENDINGS))]
    UnknownExtension {
        /// The extension, possibly empty.
        found: String,
    },
    /// The name does not tell the format of a mesh.
    #[error("expected a mesh's name ending in .ply, .glb or .obj, found {found:?}; rename it")]
    UnknownMeshExtension {
        /// The extension, possibly empty.
        found: String,
    },
    /// Nowhere is enough known for a surface.
    #[error(
        "no surface: expected {n_components} components to say enough of one, found none; give a \
         larger cell or leave fewer components out"
    )]
    NoSurface {
        /// Components asked.
        n_components: usize,
    },
    /// The target's folder is missing.
    #[error("the folder {} does not exist; create it or choose another", folder.display())]
    NoFolder {
        /// The missing folder.
        folder: PathBuf,
    },
    /// Nothing at that path.
    #[error("expected a model ({}), found nothing at this path; check the spelling", listed(&READ_ENDINGS))]
    Missing,
    /// Nothing at a checkpoint's path.
    #[error("expected a checkpoint (.vbgs), found nothing at this path; check the spelling")]
    NoCheckpoint,
    /// A folder stands where a file is meant.
    #[error("expected a file, found a folder; name a file in it")]
    IsFolder,
    /// A device or FIFO stands where a file is meant.
    #[error(
        "expected a file, found a FIFO or device, which may never end; copy what comes from it into a file"
    )]
    IsStream,
    /// The operating system refused.
    #[error("cannot {action}: {source}")]
    Io {
        /// What was tried, as a verb phrase.
        action: &'static str,
        /// The system's answer.
        source: io::Error,
    },
    /// No space left.
    #[error(
        "the disk is full: {written} bytes fitted, more are needed; free some space or choose \
         another folder (an older file of this name is untouched)"
    )]
    DiskFull {
        /// Bytes written before space ran out.
        written: u64,
    },
    /// An option of the caller makes no sense.
    #[error("{setting}: expected {expected}, found {found}")]
    Setting {
        /// The option's name.
        setting: &'static str,
        /// What it must be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// GLB counts bytes in 32 bits.
    #[error(
        "{n_splats} splats need {needed} bytes as GLB, whose limit is {}; export PLY instead",
        u32::MAX
    )]
    TooLargeForGlb {
        /// Splats to write.
        n_splats: usize,
        /// Size of the whole file.
        needed: u64,
    },
    /// The content is of no known format.
    #[error("expected a model ({}), found {found}; convert it to PLY", listed(&READ_ENDINGS))]
    NotAModel {
        /// The first bytes.
        found: String,
    },
    /// The format is right and the content is not.
    #[error("{place}: expected {expected}, found {found}; export the file again")]
    Malformed {
        /// Line, accessor, chunk or element.
        place: String,
        /// What the format asks for.
        expected: String,
        /// What the file holds.
        found: String,
    },
    /// A property without which there is no model.
    #[error(
        "element vertex: expected property {property}, found only {found}; export it as 3DGS or \
         point-cloud PLY"
    )]
    MissingProperty {
        /// The missing name.
        property: String,
        /// The names there are.
        found: String,
    },
    /// Valid, but not read by this program.
    #[error("unsupported: {feature}; {advice}")]
    Unsupported {
        /// What the file uses.
        feature: String,
        /// What to do instead.
        advice: &'static str,
    },
    /// More rows than the caller allows.
    #[error("expected at most {cap} splats, found {declared}; reduce the model first")]
    TooMany {
        /// Rows the file declares.
        declared: u64,
        /// Rows that the caller allows at most.
        cap: usize,
    },
    /// Memory ran out.
    #[error(
        "expected {bytes} bytes of free memory, found less; close other programs or reduce the \
         model"
    )]
    OutOfMemory {
        /// Bytes asked for.
        bytes: u64,
    },
    /// Whoever waited for the file wants it no more.
    #[error("cancelled: no file was written and an older one of this name is untouched")]
    Cancelled,
    /// Every row was unusable.
    #[error("expected at least one finite row, found none ({skipped} skipped); export it again")]
    NothingToImport {
        /// Rows with NaN or infinity.
        skipped: usize,
    },
}

/// What stops a writer where nobody wants its file; becomes [`Fault::Cancelled`].
#[derive(Debug, thiserror::Error)]
#[error("cancelled")]
pub(super) struct Cancelled;

impl Fault {
    /// Names the file.
    pub(super) fn at(self, path: &Path) -> ExportError {
        ExportError { path: path.to_path_buf(), fault: self }
    }

    pub(super) fn malformed(
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Malformed { place: place.into(), expected: expected.into(), found: found.into() }
    }
}

/// Text of a file as it may appear in a message: control characters escaped, at most 60 characters.
pub(super) fn shorten(text: &str) -> String {
    shorten_to(text, 60)
}

/// As [`shorten`] does, at most so many characters, those of what is escaped counted as they appear.
pub(super) fn shorten_to(text: &str, most: usize) -> String {
    let mut short = String::new();
    for c in text.chars() {
        let escaped = c.escape_default();
        if short.len() + escaped.len() > most {
            short.push('…');
            break;
        }
        short.extend(escaped);
    }
    short
}

/// A vector with room for exactly `n` items, or the error that memory is short.
pub(super) fn reserved<T>(n: usize) -> Result<Vec<T>, Fault> {
    let mut items = Vec::new();
    let bytes = n as u64 * size_of::<T>() as u64;
    // Sizes come from files: too large a one is to be a message, not the end of the program.
    items.try_reserve_exact(n).map_err(|_| Fault::OutOfMemory { bytes })?;
    Ok(items)
}
