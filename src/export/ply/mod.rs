//! PLY files: splats in the 3DGS layout and coloured points.

mod body;
mod compressed;
mod header;
pub(super) mod read;
pub(super) mod write;

/// Coefficients per channel above degree 0, up to degree 1.
const N_REST_DEGREE_1: usize = 3;
/// Coefficients per channel above degree 0, up to degree 3.
const N_REST_DEGREE_3: usize = 15;
