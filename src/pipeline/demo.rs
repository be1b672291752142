//! The built-in demo: one definition for the window and for machines without a display.

use super::error::SessionError;
use super::plan::Selection;
use super::session::Session;
use super::settings::method::MethodRequest;
use crate::dataset::Dataset;
use crate::dataset::synthetic::{self, ParamsError};
use std::sync::Arc;

/// Why the demo cannot start.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// The scene's parameters.
    #[error("{0}")]
    Scene(#[from] ParamsError),
    /// The session.
    #[error("{0}")]
    Session(#[from] SessionError),
}

/// The synthetic room.
pub fn dataset() -> Result<Arc<Dataset>, DemoError> {
    Ok(Arc::new(synthetic::demo()?))
}

/// A session over all of the demo's frames.
pub fn session(asked: impl Into<MethodRequest>) -> Result<Session, DemoError> {
    Ok(Session::new(dataset()?, asked, Selection::everything())?)
}
