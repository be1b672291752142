//! Runs on disk: a session saved at a frame boundary, read back, continued, and merged with others.

// As in `export`: a number in a file must never be an index that is not there.
#![warn(clippy::indexing_slicing, clippy::string_slice)]

mod asked;
mod error;
mod history;
mod json;
mod merge;
mod resume;
mod save;
mod saved;
mod snapshot;

pub use asked::ResumeRequest;
pub use error::RunError;
pub use merge::{merge, merge_onto};
pub use saved::{Meta, SavedRun};
pub use snapshot::SessionSnapshot;
