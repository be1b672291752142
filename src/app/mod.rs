//! The window: draws from snapshots, answers with orders, holds no algorithm.
//!
//! The trainer lives on the [`worker`]'s thread and the window never waits for it; splats reach the
//! viewport through [`splat_updates`]. What is legal when stands in [`command`].

pub mod abandoned;
mod action_finder;
mod adapter_memory;
mod background_job;
pub mod camera;
pub mod color_mode;
pub mod command;
mod command_line;
mod detail;
mod device;
mod dialogs;
mod draw_budget;
pub mod drawing;
mod drop_target;
pub mod edit;
mod evidence_histogram;
mod exit;
mod export_losses;
mod export_options;
pub mod file_proposal;
mod film;
pub mod frame_outcomes;
mod fuzzy;
mod guard;
mod layout;
mod opening;
mod painting;
mod palette;
mod panels;
pub mod panic_report;
mod path_dialog;
mod path_editor;
mod pending;
mod persistence;
mod picker;
pub mod quality;
mod recent;
pub mod rescue;
pub mod retention;
mod selection;
mod session_info;
mod software;
pub mod splat_updates;
pub mod state;
mod stored_text;
mod studio;
mod tab;
mod termination;
mod thread_times;
pub mod training;
pub mod unattended;
mod view_thread;
pub mod viewer;
mod viewport;
mod window;
mod window_damage;
mod window_error;
mod window_meshes;
mod window_painter;
mod wording;
pub mod worker;

pub use exit::{Exit, Leave};
pub use guard::{guarded, run_window};
pub use painting::Painting;
pub use studio::Studio;
pub use window::run;
pub use window_error::WindowError;

pub use crate::render::gpu::adapters;
