//! The window: draws from snapshots, answers with orders, holds no algorithm.
//!
//! The trainer lives on the [`worker`]'s thread and the window never waits for it; splats reach the
//! viewport through [`feed`]. What is legal when stands in [`command`].

mod adapter_memory;
pub mod camera;
pub mod color_mode;
pub mod command;
mod device;
mod dialogs;
pub mod drawing;
mod drop_target;
mod export_options;
mod facts;
pub mod feed;
mod kept;
mod opening;
mod palette;
mod panels;
mod picker;
mod selection;
mod software;
pub mod state;
mod studio;
pub mod training;
pub mod unattended;
mod view_thread;
pub mod viewer;
mod viewport;
mod window;
mod wording;
pub mod worker;

pub use studio::{Painting, Studio};

pub use crate::render::gpu::adapters;
pub use window::{Exit, Leave, run};

use unattended::Unattended;

/// Why there is no window.
#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    /// No display server to open a window on.
    #[error("no display found")]
    NoDisplay,
    /// A display server is announced but does not answer.
    #[error("the display server does not answer")]
    DisplaySilent,
    /// No adapter can draw the window.
    #[error("no usable graphics adapter found ({0})")]
    NoAdapter(String),
    /// One window after the other lost its device.
    #[error("the graphics device was lost {0} times in a row")]
    DeviceLost(usize),
    /// There was a window, and there is none any more, but there is a run that goes on.
    #[error("the window is gone for good: {0}")]
    Gone(Box<WindowError>, Unattended),
    /// The window failed for another reason.
    #[error("no window could be opened ({0})")]
    Window(String),
}

impl From<eframe::Error> for WindowError {
    fn from(error: eframe::Error) -> Self {
        match error {
            eframe::Error::Winit(_) | eframe::Error::WinitEventLoop(_) => Self::DisplaySilent,
            eframe::Error::Wgpu(error) => Self::NoAdapter(error.to_string()),
            other => Self::Window(other.to_string()),
        }
    }
}
