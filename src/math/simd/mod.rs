//! Vectors of eight f32 lanes and run-time selection of the instruction set. All code for a specific
//! CPU is in this folder.
//!
//! Every operation is bitwise equal on all instruction sets: no fused operations, no approximations.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod isa;
mod portable;
mod vector;

pub use isa::{FORCE_VARIABLE, Isa};
pub use vector::{
    Kernel, LANES, SET_LANE, Vector, dot, gather_rows, load_rows, scaled, scatter_rows, turned,
};
