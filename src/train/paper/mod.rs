//! The `paper` preset: candidate search, E-step, statistics, update and reassignment (`training.md`,
//! Stages of a frame).
//!
//! A pass over the points does not change the model. Only the final addition of the tiles' sums to the
//! totals does. This addition cannot fail, so a frame is applied completely or not at all.

pub mod config;
mod fused;
pub mod index;
pub mod init;
pub mod learner;
mod pass;
mod passes;
mod plain;
pub mod reassign;
pub mod trainer;
