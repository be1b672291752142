//! Posed RGB-D frames from folders, from memory, and from a procedural scene.
//!
//! A format reads the metadata and poses of one layout (recognised by content, never by name) and lists
//! each frame's files; all later steps, from decoding to points, are common to all. Opening never decodes
//! images. A bad frame becomes a [`Warning`] at opening or a [`FrameError`](error::FrameError) at loading,
//! never a panic, and the other frames remain usable.
//!
//! | question | module |
//! |---|---|
//! | which layouts are supported, how is one added? | [`formats`] |
//! | how do files or buffers become a frame? | [`frame`], [`depth`] |
//! | how does a depth pixel become a point? | [`surface`] (preset `scene`), [`unproject`] (`paper`) |
//! | which frames are for training, which for evaluation? | [`splits`] |
//! | what corrects the cameras? | [`calibration`] |
//! | do poses follow the layout's convention? | [`pose_check`] |
//! | is the recording blurred, did exposure jump, are frames missing? | [`capture_check`] |
//! | how is a recording in progress followed? | [`growing`] |
//!
//! No threads are started here: the prefetcher in `pipeline` calls [`Dataset::load`].
#![doc = include_str!("../../docs/design/dataset.md")]
// Files are untrusted: a number read from one must not index unchecked. Pixel code runs on images whose
// size was checked when they were decoded.
#![warn(clippy::indexing_slicing, clippy::string_slice)]

pub mod calibration;
#[expect(clippy::indexing_slicing, reason = "pixels of images whose size was checked")]
pub mod capture_check;
pub mod depth;
pub mod error;
pub mod fingerprint;
pub mod formats;
pub mod frame;
pub mod pose_check;
pub mod range;
pub mod splits;
#[expect(clippy::indexing_slicing, reason = "pixels of images whose size was checked")]
pub mod surface;
#[expect(clippy::indexing_slicing, reason = "generates frames, reads no files")]
pub mod synthetic;
#[expect(clippy::indexing_slicing, reason = "pixels of images whose size was checked")]
pub mod unproject;
pub mod wild_poses;

mod archive;
mod bag;
mod decode;
mod distortion;
mod entry;
mod folder;
pub mod growing;
mod lengths;
mod matrix;
mod opened;
mod options;
mod sector;
#[expect(clippy::indexing_slicing, reason = "pixels of images whose size was checked")]
mod tile_points;
mod video;

pub(crate) use entry::PHOTOGRAPHS_AT_ONCE;
pub use entry::{DatasetSplit, FrameEntry};
pub use error::Warning;
pub use folder::read_settings;
pub use formats::Layout;
pub use growing::FrameMarks;
pub use opened::{Dataset, check_layout, is_archive, open};
pub use options::LoadOptions;
pub use pose_check::PoseConvention;
