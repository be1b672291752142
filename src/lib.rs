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
//! | [`math`] | numbers and geometry: cameras, images, random streams, fixed point |
//! | [`observation`] | what a frame says: points, or surfaces |
//! | [`model`] | conjugate laws and posterior, the mixture of either preset, splats |
//! | [`dataset`] | one file per layout, frames, unprojection, surface points, the synthetic scene |
//! | [`train`] | one frame at a time: [`train::paper`] as published, [`train::scene`] the default |
//! | [`render`] | splats to pixels: CPU (`render::cpu`) and GPU (`render::gpu`, feature `gui`) |
//! | [`export`] | PLY, GLB and checkpoints, written and read |
//! | [`eval`] | PSNR, SSIM, depth error, cracks; the report's types; tables |
//! | [`pipeline`] | the one training loop: settings, prefetch, train, publish; runs saved, continued, merged |
//! | [`calibrate`] | what took a recording, found from the recording itself |
//! | `bench` (feature `bench`) | speed against error, as tables and plots |
//! | `app` (feature `gui`) | the window |
//! | `cli` (in the binary, feature `cli`) | the command line |
//!
//! Explanations, with formulas and what was tried, open the documentation of [`model`], [`train`],
//! [`train::scene`], [`train::scene::photometric`], [`dataset`], [`render`], [`export`], [`eval`] and
//! [`pipeline`].
//!
//! # Invariants
//!
//! * Statistics are added in fixed point: any frame order and any number of threads give the same
//!   bits wherever reassignment is off; with it on, the same input in the same order does.
//! * A frame is applied whole or not at all.
//! * Only the initial model feeds the E-step; the posterior never does.
//! * The engine knows no window, and `app` and `cli` hold no algorithm.

pub mod math;
pub mod observation;

pub mod model;

pub mod dataset;
pub mod train;

pub mod eval;
pub mod export;
pub mod render;

pub mod pipeline;

#[cfg(feature = "bench")]
pub mod bench;
pub mod calibrate;

#[cfg(feature = "gui")]
pub mod app;
