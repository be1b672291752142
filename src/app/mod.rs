//! The window: draws from snapshots and sends orders to the worker; contains no algorithm.
//!
//! Training runs on the [`worker`]'s thread and never blocks the window; splats reach the viewport through
//! [`splat_updates`]. [`command`] holds the table of commands available in each state.
#![allow(missing_docs, reason = "no other crate uses this room")]

mod action_finder;
pub mod camera;
pub mod color_mode;
pub mod command;
mod detail;
pub mod drawing;
pub mod edit;
pub mod export_options;
mod film;
mod fonts;
pub mod frame_outcomes;
mod layout;
pub mod opening;
mod palette;
mod panels;
mod path_dialog;
mod path_editor;
pub mod quality;
pub mod rescue;
pub mod retention;
mod selection;
mod settings_file;
pub mod splat_updates;
pub mod state;
mod studio;
pub mod training;
mod user_folders;
mod view_thread;
pub mod viewer;
mod viewport;
mod window;
mod window_painter;
pub mod wording;
pub mod worker;

pub use crate::render::gpu::adapters;
pub use drawing::Painting;
pub use studio::Studio;
pub use window::{Exit, ExitReason, WindowError, run, run_guarded, run_window};
