//! Mismatch between a stored model and the settings stored with it.

use crate::train::candidates::IndexError;

/// How a stored model contradicts the settings stored with it.
#[derive(Debug, thiserror::Error)]
pub enum Mismatch {
    /// The prior differs.
    #[error("expected the prior that its settings imply, found another")]
    Prior,
    /// The settings require another form of model, described here.
    #[error("expected {0} according to its settings, found another")]
    Form(String),
    /// A setting is out of range.
    #[error("{0}")]
    Setting(String),
    /// The means cannot be indexed.
    #[error(transparent)]
    Index(#[from] IndexError),
}
