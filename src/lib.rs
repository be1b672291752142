//! VBGS Studio turns posed RGB-D frames into a Gaussian-splat scene by closed-form variational
//! Bayes: every point updates a conjugate mixture once, so learning is continual, keeps no replay
//! buffer and does not depend on the order of frames.
//!
//! # Code map
//!
//! Dependencies point downwards only; `tests/house/` holds the table.
//!
//! | module | holds |
//! |---|---|
//! | [`math`] | geometry, images, points, random streams, fixed point |
//! | [`model`] | laws, hyper-parameters, statistics, posterior, splats |
//! | [`dataset`] | one file per layout, frames, unprojection, surface points, the synthetic scene |
//! | [`train`] | candidates, E-step, statistics, reassignment: one frame at a time |
//! | [`render`] | splats to pixels: CPU (`render::cpu`) and GPU (`render::gpu`, feature `gui`) |
//! | [`export`] | PLY, GLB and checkpoints, written and read |
//! | [`eval`] | PSNR, SSIM, depth error; the report's types |
//! | [`pipeline`] | the one training loop: prefetch, train, publish; runs saved, continued, merged; cameras calibrated |
//! | `app` (feature `gui`) | the window |
//! | `cli` (in the binary) | the command line |
//!
//! # Invariants
//!
//! * Statistics are added in fixed point: any frame order and any number of threads give the same
//!   bits wherever reassignment is off; with it on, the same input in the same order does.
//! * A frame is applied whole or not at all.
//! * Only the initial model feeds the E-step; the posterior never does.
//! * The engine knows no window, and `app` and `cli` hold no algorithm.

pub mod math;
pub mod model;

pub mod dataset;
pub mod train;

pub mod eval;
pub mod export;
pub mod render;

pub mod pipeline;

#[cfg(feature = "gui")]
pub mod app;
