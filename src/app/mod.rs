//! The window: draws from snapshots, answers with orders, holds no algorithm.
//!
//! The trainer lives on the [`worker`]'s thread and the window never waits for it; splats reach the
//! viewport through [`feed`]. What is legal when stands in [`command`].

pub mod camera;
pub mod color_mode;
pub mod command;
mod dialogs;
pub mod feed;
mod opening;
mod panels;
mod scene_view;
mod software;
pub mod state;
mod studio;
mod view_thread;
mod viewport;
pub mod worker;

pub use studio::{Painting, Studio};

use eframe::egui::{Vec2, ViewportBuilder};
use state::Subject;
use std::time::Instant;

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

/// Opens the window on `subject` and runs until it is closed. `started` is when the process began.
pub fn run(subject: Subject, started: Instant) -> Result<(), WindowError> {
    if !has_display() {
        return Err(WindowError::NoDisplay);
    }
    let options = eframe::NativeOptions {
        viewport: ViewportBuilder::default()
            .with_title("VBGS Studio")
            .with_app_id("vbgs-studio")
            .with_inner_size(Vec2::new(1280.0, 800.0))
            .with_min_inner_size(Vec2::new(640.0, 400.0))
            .with_drag_and_drop(true),
        wgpu_options: viewport::wgpu_configuration(),
        ..Default::default()
    };
    let create = move |context: &eframe::CreationContext<'_>| {
        let studio = Studio::new(context, Some(subject), Painting::Auto, started)?;
        Ok(Box::new(studio) as Box<dyn eframe::App>)
    };
    Ok(eframe::run_native("vbgs-studio", options, Box::new(create))?)
}

/// Whether a display server is announced; elsewhere than on X11 and Wayland there always is one.
fn has_display() -> bool {
    let named = |variable: &str| std::env::var_os(variable).is_some_and(|v| !v.is_empty());
    !cfg!(all(unix, not(target_os = "macos"))) || named("DISPLAY") || named("WAYLAND_DISPLAY")
}
