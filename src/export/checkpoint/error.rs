//! Errors of writing and reading checkpoints.

use super::super::error::{ExportError, Fault};
use super::sections::VERSION;
use std::path::PathBuf;

/// Error of writing or reading a checkpoint.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file could not be read or written.
    #[error(transparent)]
    File(#[from] ExportError),
    /// The file is readable but is not a usable checkpoint.
    #[error("{}: {defect}", path.display())]
    Content { path: PathBuf, defect: Defect },
    /// The model would produce a file that `read` rejects.
    #[error(
        "{}: not written, because it could not be read back: {}; an existing file of that name is unchanged; export the splats to save the result",
        path.display(), defect.finding()
    )]
    Unreadable { path: PathBuf, defect: Defect },
}

/// Reason why bytes are not a usable checkpoint.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum Defect {
    /// The magic bytes are missing.
    #[error("expected a checkpoint (.vbgs), found {found}; name a file that `train` wrote")]
    NotACheckpoint { found: String },
    /// Line endings or high bits were changed in transfer.
    #[error(
        "expected a checkpoint, found one damaged by a transfer in text mode; copy it again in \
         binary mode"
    )]
    TextMode,
    /// The major version is unsupported.
    #[error(
        "written by version {major}.{minor} of the format, this program reads {}; use a newer \
         program", VERSION.0
    )]
    Version { major: u16, minor: u16 },
    /// The file is truncated.
    #[error(
        "expected {expected} bytes, found {found}: the file is cut short; use another copy, such \
         as the .bak beside it"
    )]
    Truncated { expected: u64, found: u64 },
    /// A CRC-32 does not match its bytes.
    #[error(
        "{place}: the checksum does not match, so the data are damaged; use another copy, such as \
         the .bak beside it"
    )]
    Checksum { place: String },
    /// A required section is unknown.
    #[error(
        "section `{tag}` is required but unknown to this program, which reads version {}.{} and \
         found {}.{}; use a newer program", VERSION.0, VERSION.1, version.0, version.1
    )]
    UnknownSection { tag: String, version: (u16, u16) },
    /// The header, the section table or a section violates the format.
    #[error("{place}: expected {expected}, found {found}; use another copy, or train again")]
    Malformed { place: String, expected: String, found: String },
    /// The allocation failed.
    #[error("{0}")]
    Memory(Fault),
}

impl Defect {
    fn finding(&self) -> String {
        match self {
            Self::Malformed { place, expected, found } => {
                format!("{place}: expected {expected}, found {found}")
            }
            other => other.to_string(),
        }
    }

    pub(super) fn malformed(
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Malformed { place: place.into(), expected: expected.into(), found: found.into() }
    }
}

pub(super) fn tag_text(tag: [u8; 4]) -> String {
    tag.escape_ascii().to_string()
}
