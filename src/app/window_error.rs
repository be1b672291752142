//! Why there is no window, or none any more.

use super::rescue::Crash;
use super::unattended::Unattended;

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
    /// The program is at fault: a panic of the window's thread or of the training thread.
    #[error(transparent)]
    Crashed(Box<Crash>),
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
