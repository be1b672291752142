//! The training engine: one frame of points in, updated statistics out.
//!
//! A frame runs through candidate search, E-step, statistics, update and reassignment
//! (`train.md`, Stages of a frame). The pass over the points changes no shared state; only the
//! final addition of its records does, and that cannot fail: a frame is applied whole or not at
//! all.
#![doc = include_str!("train.md")]

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
