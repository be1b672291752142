//! Scene model: components at fixed seeds with additive statistics. Besides the sums of the mixture,
//! they hold sums over normals and view directions, and visibility counts (`model.md`, Scene sums). The
//! NIW and Dirichlet posteriors derive from a subset of the sums.

pub mod photometric;
pub mod points_device;
mod rigid;
pub mod splat_rule;
pub mod state;
pub mod sums;
pub mod texels;
pub mod waiting;
