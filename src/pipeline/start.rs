//! Training on the built-in synthetic room.

use super::error::SessionError;
use super::plan::Selection;
use super::session::Session;
use super::settings::method::MethodRequest;
use crate::dataset::synthetic::ParamsError;
use crate::dataset::{Dataset, synthetic};
use std::sync::Arc;

/// Error of starting the demo, which trains on the built-in synthetic room.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// The parameters of the synthetic room are invalid.
    #[error("{0}")]
    Scene(#[from] ParamsError),
    /// The session could not be started.
    #[error("{0}")]
    Session(#[from] SessionError),
}

/// Returns the dataset of the built-in synthetic room.
pub fn dataset() -> Result<Arc<Dataset>, DemoError> {
    Ok(Arc::new(synthetic::demo()?))
}

/// Starts a session over all frames of the built-in synthetic room.
pub fn session(asked: impl Into<MethodRequest>) -> Result<Session, DemoError> {
    Ok(Session::new(dataset()?, asked, Selection::all_frames())?)
}
