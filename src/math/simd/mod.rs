//! Eight f32 lanes, and the choice at run time of the instructions behind them. This folder is the
//! one place with code for a particular processor.
//!
//! Every operation gives equal bits on every instruction set: nothing is fused, nothing
//! approximated.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod isa;
mod portable;
mod rows;
mod triples;
mod vector;

pub use isa::{FORCE_VARIABLE, Isa};
pub use rows::{gather_rows, load_rows, scatter_rows};
pub use triples::{dot, scaled, turned};
pub use vector::{EVERY_BIT, Kernel, LANES, Vector};
