//! PLY files: splats in the 3DGS layout and coloured points.

mod body;
mod compressed;
mod header;
pub(super) mod read;
pub(super) mod write;

/// Number of degree 1 harmonic coefficients per colour channel.
const N_REST_DEGREE_1: usize = 3;
/// Number of harmonic coefficients of degrees 1 to 3 together, per colour channel.
const N_REST_DEGREE_3: usize = 15;
