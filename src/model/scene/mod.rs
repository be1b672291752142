//! The scene model: components anchored at fixed seeds, with additive statistics that carry more
//! than a mixture's: normals, view directions, and how often a component was seen
//! (`model.md`, Scene sums). The NIW and Dirichlet posteriors of `posterior` follow from a part of
//! them.

pub mod bounds;
pub mod kept;
pub mod kept_motion;
pub mod merging;
pub mod opacity;
pub mod photometric;
pub mod points_device;
mod rigid;
pub mod splat_rule;
pub mod state;
pub mod sums;
pub mod trajectory;
pub mod waiting;
