//! Errors of opening the window and of keeping it open.

use super::rescue::Crash;
use super::unattended::Unattended;

/// Reason why there is no window.
#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    /// There is no display server.
    #[error("no display found")]
    NoDisplay,
    /// A display server is announced but does not respond.
    #[error("the display server does not respond")]
    DisplaySilent,
    /// No adapter can draw the window.
    #[error("no usable graphics adapter found ({0})")]
    NoAdapter(String),
    /// Several windows in a row have lost their device.
    #[error("the graphics device was lost {0} times in a row")]
    DeviceLost(usize),
    /// The window was lost and cannot be reopened, but its run continues.
    #[error("the window is gone for good: {0}")]
    Gone(Box<WindowError>, Unattended),
    /// A panic of the window's thread or of the training thread.
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
