//! The training engine: one frame of points in, updated statistics out.
//!
//! A frame runs through candidate search, E-step, statistics, update and reassignment
//! (`model.md` 6–10). The pass over the points changes no shared state; only the final addition of
//! its records does, and that cannot fail: a frame is applied whole or not at all.

pub mod candidates;
pub mod config;
pub mod engine;
pub mod estep;
mod fused;
pub mod index;
pub mod init;
mod ownership;
pub mod pass;
mod plain;
pub mod reassign;
pub mod scalar;
pub mod scene;
mod slots;
pub mod timing;
pub mod trainer;
pub mod warnings;
