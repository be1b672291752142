//! Native checkpoints, `*.vbgs` (`files.md`, Checkpoint container): the complete state of a run at a frame
//! boundary, sufficient to resume it bit for bit.
//!
//! Little-endian. A header of 24 bytes (magic, version, number of sections, length of the file), a table with
//! one 32-byte entry per section (tag, element type, offset, length, CRC-32), the CRC-32 of both, then the
//! sections at multiples of 64 with zeros between them.
//!
//! | tag | elements | holds |
//! |---|---|---|
//! | `CONF` | bytes | JSON: every setting that affects the result |
//! | `META` | bytes | JSON: program, time, dataset and its fingerprint |
//! | `NUMX` | bytes | JSON: everything else that affects the last bits of the result |
//! | `CURS` | u64 | frames trained on, points trained on, then the visited frames in order |
//! | `HIST` | bytes | JSON: reports of the frames, and curves that the window measured; optional |
//!
//! A mixture has these sections:
//!
//! | tag | elements | holds |
//! |---|---|---|
//! | `NORM` | f64 | offset and scale of positions |
//! | `PRIR` | f64 | α₀; κ₀, κ_init, U₀ of space; ν₀; κ₀, κ_init, U₀ of colour |
//! | `DIRI` | f64 | α_k of the initial model |
//! | `MINI` | f32 or f64 | initial means in the E-step's precision: all of space, then all of colour |
//! | `STAN` | i64 or i128 | N_k |
//! | `STA1` | as `STAN` | first moments, rows x y z of space about the initial mean, x y z of colour |
//! | `STA2` | as `STAN` | second moments of space about the initial mean, rows xx xy xz yy yz zz |
//! | `CARI` | u32 | components with carries, ascending; only if there are any |
//! | `CARL` | i32 | their carries, in the order N, `STA1` of space, `STA2`, `STA1` of colour |
//!
//! Integer statistics count quanta ([`crate::math::fixed`]). An `i128` is 16 bytes, low half first. A scene
//! (version 1.1) has these sections instead:
//!
//! | tag | elements | holds |
//! |---|---|---|
//! | `ORIG` | f64 | world position that seeds are relative to |
//! | `SEED` | f32 | seeds, rows x y z, world units |
//! | `COMP` | u32 | component of each seed; only if the component budget made seeds share components |
//! | `SUMS` | i32 | sums about the seeds, rows of [`N_SUMS`], in 2⁻¹⁵; 0 where `WIDI` lists the component |
//! | `WIDI` | u32 | components with 4,096 points or more, ascending; only if there are any |
//! | `WIDE` | f64 | their sums, rows as in `SUMS`, whole multiples of 2⁻¹⁵ |
//! | `LOOK` | u32 | rows of two: expected returns in 64ths; numbers of frames in which the component was observed (low half) and seen through (high half) |
//! | `EXPO` | f64 | if gains were fitted, per trained frame: the camera's centre and unit direction in the world, and the gains of red, green and blue |
//! | `TXID` | u32 | textured components, ascending; only if there are any, as the other sections of textures |
//! | `TXLA` | f32 | their lattices: anchor, directions of columns and rows, half the side, world units |
//! | `TXSI` | u32 | level and number of patches of each |
//! | `TXPR` | i64 | sums of the predictions of each: products with residual and with itself, for two priors |
//! | `TXIX` | u16 | number of the patch at each place of each lattice, row by row; 65,535 for none |
//! | `TXEL` | i32 | weight, red, green and blue of every texel, by patch |
//! | `TXST` | u32 | number of doublings of the pitch for the memory budget; only if there are any |
//!
//! Derived data are not saved: the index, posteriors, and the state of random streams, which follows from
//! their name ([`crate::math::rng`]).
//!
//! ```
//! use vbgs_studio::export::checkpoint::{Checkpoint, Cursor, StoredModel, read, write};
//! use vbgs_studio::math::measured_pixel::Normalization;
//! use vbgs_studio::model::conjugate::prior::Hyper;
//! use vbgs_studio::model::paper::state::{InitialMeans, ModelState, Totals};
//!
//! let checkpoint = Checkpoint {
//!     config: "{}".into(),
//!     meta: "{}".into(),
//!     numerics: "{}".into(),
//!     history: None,
//!     cursor: Cursor { frames: 1, points: 500, visited: vec![0] },
//!     model: StoredModel::Mixture {
//!         normalization: Normalization { offset: [0.0; 3], scale: [1.0; 3] },
//!         hyper: Hyper::paper(1, 1.0),
//!         state: ModelState {
//!             alpha_init: vec![1.5],
//!             means: InitialMeans::F32 { space: vec![[0.25; 3]], color: vec![[0.0; 3]] },
//!             totals: Totals::Fixed128(vec![[1 << 80, 0, 0, 0, 9, 0, 0, 9, 0, 9, 0, 0, 0]]),
//!         },
//!     },
//! };
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("checkpoint.vbgs");
//! write(&path, &checkpoint)?;
//! assert_eq!(read(&path)?.checkpoint, checkpoint);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`N_SUMS`]: crate::model::scene::sums::N_SUMS

mod check;
mod container;
mod element;
mod error;
mod file;
mod mixture;
mod scene;
mod sections;
mod textures;

pub use crate::model::attributes::StoredModel;
pub use element::{Checkpoint, Cursor, LoadedCheckpoint};
pub use error::{CheckpointError, Defect};
pub use file::{is_checkpoint, parse, read, to_bytes, write, write_keeping_old};
pub use sections::{MAX_JSON_BYTES, VERSION};

// Columns are written and read in their memory layout.
const _: () = assert!(cfg!(target_endian = "little"), "checkpoints need a little-endian machine");
