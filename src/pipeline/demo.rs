//! The built-in demo: one definition for the window and for machines without a display.

use super::plan::Selection;
use super::session::{Session, SessionError};
use crate::dataset::Dataset;
use crate::dataset::synthetic::{self, ParamsError};
use crate::train::config::{ConfigError, Overrides, ReassignPolicy, TrainConfig};
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

/// Settings of the demo: forwarded reassignment, the quicker variant, and the paper's factor on the
/// scales, which closes the gaps between small components.
pub fn config() -> Result<TrainConfig, DemoError> {
    let overrides = Overrides {
        reassign: Some(ReassignPolicy::Forwarded),
        scale_factor: Some(1.41),
        ..Overrides::default()
    };
    Ok(TrainConfig::paper().with(&overrides)?)
}

/// A session over all of the demo's frames.
pub fn session() -> Result<Session, DemoError> {
    Ok(Session::new(dataset()?, config()?, Selection::everything())?)
}
