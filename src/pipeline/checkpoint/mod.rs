//! Saved runs: saving a session at a frame boundary, reading, resuming and merging.

// As in `export`: a number from a file must never cause an out-of-range index.
#![warn(clippy::indexing_slicing, clippy::string_slice)]

mod asked;
mod error;
mod merge;
mod saved;
mod snapshot;

pub use asked::ResumeRequest;
pub use error::RunError;
pub use merge::{merge, merge_onto};
pub use saved::{Meta, SavedRun};
pub use snapshot::SessionSnapshot;
