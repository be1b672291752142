//! What can go wrong when a checkpoint is written or read.

use super::super::error::{ExportError, Fault};
use super::version::VERSION;
use std::path::PathBuf;

/// A checkpoint that could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file itself.
    #[error(transparent)]
    File(#[from] ExportError),
    /// The file can be read, but what it holds is no usable checkpoint.
    #[error("{}: {defect}", path.display())]
    Content {
        /// Path of the file that was read.
        path: PathBuf,
        /// What is wrong and what to do about it.
        defect: Defect,
    },
    /// What was to be written would be refused by whoever reads it.
    #[error(
        "{}: not written, since it could not be read back: {}; a file of that name is as it was, export the splats to keep what was learnt",
        path.display(), defect.finding()
    )]
    Unreadable {
        /// Path of the file that would have been written.
        path: PathBuf,
        /// What is wrong with the model.
        defect: Defect,
    },
}

/// Why bytes are no usable checkpoint.
#[derive(Debug, thiserror::Error)]
pub enum Defect {
    /// The file does not begin as a checkpoint does.
    #[error("expected a checkpoint (.vbgs), found {found}; name a file that `train` wrote")]
    NotACheckpoint {
        /// The first bytes.
        found: String,
    },
    /// Line ends or high bits were changed on the way.
    #[error(
        "expected a checkpoint, found one damaged by a transfer in text mode; copy it again in \
         binary mode"
    )]
    TextMode,
    /// Another major version.
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
    /// The file ends too early.
    #[error(
        "expected {expected} bytes, found {found}: the file is cut short; use another copy, such \
         as the .bak beside it"
    )]
    Truncated {
        /// Bytes there must be at least.
        expected: u64,
        /// Bytes there are.
        found: u64,
    },
    /// A CRC-32 does not match the bytes it stands for.
    #[error(
        "{place}: the checksum does not match, so bytes are damaged; use another copy, such as the \
         .bak beside it"
    )]
    Checksum {
        /// The header, or the tag of the section.
        place: String,
    },
    /// A section without which the file cannot be understood.
    #[error(
        "section `{tag}` is needed and unknown to this program, which reads version {}.{} and found \
         {}.{}; use a newer program", VERSION.0, VERSION.1, version.0, version.1
    )]
    UnknownSection {
        /// Four-letter tag of the unknown section.
        tag: String,
        /// Version of the file.
        version: (u16, u16),
    },
    /// Header, table or a section is not as the format says.
    #[error("{place}: expected {expected}, found {found}; use another copy, or train again")]
    Malformed {
        /// The header, a section, or a value in one.
        place: String,
        /// What the format asks for.
        expected: String,
        /// What the file holds.
        found: String,
    },
    /// Memory ran out.
    #[error("{0}")]
    Memory(Fault),
}

impl Defect {
    /// What is wrong, without what to do about a file.
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

/// A tag as it may appear in a message.
pub(super) fn tag_text(tag: [u8; 4]) -> String {
    tag.escape_ascii().to_string()
}
