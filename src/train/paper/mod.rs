//! The published algorithm: candidate search, E-step, statistics, update and reassignment
//! (`train.md`, Stages of a frame). The pass over the points changes no shared state; only the final addition of
//! its records does, and that cannot fail: a frame is applied whole or not at all.

pub mod config;
pub mod engine;
mod fused;
pub mod index;
pub mod init;
pub mod learner;
pub mod memory;
pub mod pass;
pub mod passes;
mod plain;
pub mod reassign;
pub mod scalar;
mod slots;
mod smallest;
pub mod trainer;
