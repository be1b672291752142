//! The built-in demo: one definition for the window and for machines without a display.

use super::plan::Selection;
use super::session::{Session, SessionError};
use crate::dataset::Dataset;
use crate::dataset::synthetic::{self, ParamsError};
use crate::train::config::{ConfigError, Overrides, TrainConfig};
use std::sync::Arc;

/// Why the demo cannot start.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// The scene's parameters.
    #[error(transparent)]
    Scene(#[from] ParamsError),
    /// The trainer's settings.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The session.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// The synthetic room.
pub fn dataset() -> Result<Arc<Dataset>, DemoError> {
    Ok(Arc::new(synthetic::demo()?))
}

/// Settings of the demo.
pub fn config() -> Result<TrainConfig, DemoError> {
    Ok(TrainConfig::paper().with(&Overrides::default())?)
}

/// A session over all of the demo's frames.
pub fn session() -> Result<Session, DemoError> {
    Ok(Session::new(dataset()?, config()?, Selection::everything())?)
}
