//! PLY: splats in the 3DGS layout and plain coloured points.

mod body;
mod compressed;
mod header;
pub(super) mod points;
pub(super) mod read;
pub(super) mod write;

/// Coefficients per channel above degree 0 when degree 1 is all there is.
const N_REST_DEGREE_1: usize = 3;
/// Coefficients per channel above degree 0 of the full degree 3.
const N_REST_DEGREE_3: usize = 15;
