//! Export and import of models: 3DGS PLY, point-cloud PLY, GLB with `KHR_gaussian_splatting`, SPZ, SOG and the
//! native [`checkpoint`]. File conventions (log scales, logits, quaternion order, axes, linear colour) are
//! converted here only; everywhere else a splat is a [`crate::model::splat::splats::Splat`].
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
#![doc = include_str!("../../docs/design/files.md")]
// Files are untrusted: a number from a file must never cause an out-of-range index.
#![warn(clippy::indexing_slicing, clippy::string_slice)]

pub mod atomic;
pub mod camera_path;
pub mod checkpoint;
pub mod error;
pub mod format;
pub mod imported;
pub mod local_origin;
pub mod mapping;
#[expect(clippy::indexing_slicing, reason = "computed from splats in memory, no file is read")]
pub mod mesh;
pub mod registration;
pub mod video;

mod detail;
mod gaussian;
mod glb;
mod html;
mod ply;
mod read;
mod read_back;
mod sog;
mod source;
mod spz;
pub mod stream;
mod usd;
mod write;

pub use error::{ExportError, Fault};
pub use format::{Axes, ModelFormat, SpzVersion, WriteOptions, WriteSelection};
pub use imported::{Imported, ModelKind, Note, Outline};
pub use read::{DEFAULT_MAX_SPLATS, check_start, read, read_outline, read_up_to};
pub use read_back::{ReadBack, read_back, turned};
pub use stream::WriteProgress;
pub use write::{WriteSummary, write};
