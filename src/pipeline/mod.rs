//! Training loop, shared by the window and the command line through [`session::Session`]: frames are decoded
//! and unprojected ahead on other threads, trained on one by one, and reported.
#![doc = include_str!("../../docs/design/pipeline.md")]

pub mod any_preset;
pub mod autosave;
pub mod checkpoint;
pub mod error;
pub mod follow;
pub mod frame_loop;
pub mod job;
pub mod memory;
pub mod panic_report;
pub mod plan;
pub mod prefetch;
mod presets;
pub mod run;
pub mod session;
pub mod settings;
pub mod tracked;
