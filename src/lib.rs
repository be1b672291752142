//! VBGS Studio turns posed RGB-D frames into a Gaussian-splat scene by closed-form variational Bayes. Every
//! point updates a conjugate mixture once. Learning is therefore continual, needs no replay buffer and does
//! not depend on the order of frames.
//!
//! # Code map
//!
//! Dependencies only point downwards; `tests/house/` holds the table.
//!
//! | module | contents |
//! |---|---|
//! | [`math`] | numbers and geometry: cameras, images, random streams, fixed point; foreign text |
//! | [`observation`] | observations of a frame: points, or surfaces |
//! | [`model`] | conjugate distributions and posterior, the mixtures of both presets, splats |
//! | [`dataset`] | dataset layouts, frames, unprojection, surface points, the synthetic scene |
//! | [`train`] | training frame by frame: [`train::paper`] as published, [`train::scene`] the default |
//! | [`render`] | splats to pixels: CPU (`render::cpu`) and GPU (`render::gpu`, feature `gui`) |
//! | [`export`] | export and import of models, checkpoints |
//! | [`eval`] | PSNR, SSIM, detail, depth error, cracks; the report's types; tables |
//! | [`pipeline`] | the training loop: settings, prefetch, training; saving, resuming and merging runs |
//! | [`calibrate`] | camera calibration, estimated from the recording |
//! | `bench` (feature `bench`) | speed against error, as tables and plots |
//! | `app` (feature `gui`) | the window |
//! | `cli` (in the binary, feature `cli`) | the command line |
//!
//! The documentation of [`model`], [`train`], [`train::scene`], [`train::scene::photometric`], [`dataset`],
//! [`render`], [`export`], [`eval`] and [`pipeline`] includes explanations with formulas and experiments.
//!
//! # Invariants
//!
//! * Statistics are added in fixed point. Without reassignment of components, results are bit-identical
//!   for any frame order and any number of threads. With reassignment, they are bit-identical for the
//!   same frames in the same order.
//! * A frame is applied completely or not at all.
//! * Only the initial model enters the E-step, never the posterior.
//! * The engine does not depend on the window, and `app` and `cli` contain no algorithms.

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
