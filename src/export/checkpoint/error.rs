//! Errors of writing and reading checkpoints.

use super::super::error::{ExportError, Fault};
use super::sections::VERSION;
use std::path::PathBuf;

/// Error of writing or reading a checkpoint.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file could not be read or written.
    #[error(transparent)]
    File(#[from] ExportError),
    /// The file is readable but is no usable checkpoint.
    #[error("{}: {defect}", path.display())]
    Content {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        defect: Defect,
    },
    /// The model would produce a file that `read` refuses.
    #[error(
        "{}: not written, because it could not be read back: {}; an existing file of that name is unchanged; export the splats to save the result",
        path.display(), defect.finding()
    )]
    Unreadable {
        /// Path of the file that would have been written.
        path: PathBuf,
        /// What is wrong with the model.
        defect: Defect,
    },
}

/// Reason why bytes are no usable checkpoint.
#[derive(Debug, thiserror::Error)]
pub enum Defect {
    /// The magic bytes are missing.
    #[error("expected a checkpoint (.vbgs), found {found}; name a file that `train` wrote")]
    NotACheckpoint {
        /// Description of the first bytes.
        found: String,
    },
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
    Version {
        /// Major version of the file.
        major: u16,
        /// Minor version of the file.
        minor: u16,
    },
    /// The file is truncated.
    #[error(
        "expected {expected} bytes, found {found}: the file is cut short; use another copy, such \
         as the .bak beside it"
    )]
    Truncated {
        /// Minimum length in bytes.
        expected: u64,
        /// Actual length in bytes.
        found: u64,
    },
    /// A CRC-32 does not match its bytes.
    #[error(
        "{place}: the checksum does not match, so the data are damaged; use another copy, such as \
         the .bak beside it"
    )]
    Checksum {
        /// The header, or the tag of the section.
        place: String,
    },
    /// A required section is unknown.
    #[error(
        "section `{tag}` is required but unknown to this program, which reads version {}.{} and \
         found {}.{}; use a newer program", VERSION.0, VERSION.1, version.0, version.1
    )]
    UnknownSection {
        /// Four-letter tag of the section.
        tag: String,
        /// Version of the file.
        version: (u16, u16),
    },
    /// Header, table or a section violates the format.
    #[error("{place}: expected {expected}, found {found}; use another copy, or train again")]
    Malformed {
        /// The header, a section, or a value in a section.
        place: String,
        /// What the format requires.
        expected: String,
        /// What the file holds.
        found: String,
    },
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
