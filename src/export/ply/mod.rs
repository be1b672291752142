//! PLY: splats in the 3DGS layout and plain coloured points.

mod body;
mod header;
pub(super) mod points;
pub(super) mod read;
pub(super) mod write;

/// Coefficients per splat above degree 0 when the full degree 3 is there, over three channels.
const N_REST_DEGREE_3: usize = 45;
