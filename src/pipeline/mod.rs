//! Training loop, shared by the window and the command line through [`session::Session`]: frames are decoded
//! and unprojected ahead on other threads, trained on one by one, and reported.
#![doc = include_str!("pipeline.md")]

pub mod any_preset;
pub mod autosave;
pub mod checkpoint;
pub mod demo;
mod devices;
pub mod drive_work;
pub mod error;
pub mod follow;
mod frame_loop;
mod inspection;
mod looks;
pub mod memory;
pub mod mismatch;
pub mod panic_text;
mod past;
pub mod plan;
pub mod prefetch;
pub mod prepare;
pub mod preset;
mod presets;
pub mod provenance;
pub mod run;
pub mod session;
mod session_report;
pub mod settings;
mod start;
pub mod surfels;
pub mod tracked;
