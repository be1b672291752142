//! Training on the built-in synthetic room.

use super::error::SessionError;
use super::plan::Selection;
use super::session::Session;
use super::settings::method::MethodRequest;
use crate::dataset::synthetic::ParamsError;
use crate::dataset::{Dataset, synthetic};
use std::sync::Arc;

/// Error of starting the demo.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// Invalid scene parameters.
    #[error("{0}")]
    Scene(#[from] ParamsError),
    /// The session could not be started.
    #[error("{0}")]
    Session(#[from] SessionError),
}

/// Returns the synthetic room.
pub fn dataset() -> Result<Arc<Dataset>, DemoError> {
    Ok(Arc::new(synthetic::demo()?))
}

/// Starts a session over all frames of the demo.
pub fn session(asked: impl Into<MethodRequest>) -> Result<Session, DemoError> {
    Ok(Session::new(dataset()?, asked, Selection::all_frames())?)
}
