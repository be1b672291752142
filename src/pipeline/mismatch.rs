//! How a stored model contradicts the settings stored beside it.

use crate::train::candidates::IndexError;

/// How a stored model contradicts the settings stored beside it.
#[derive(Debug, thiserror::Error)]
pub enum Mismatch {
    /// Its prior is not theirs.
    #[error("expected the prior that its settings imply, found another")]
    Prior,
    /// They ask for another kind of model: this one.
    #[error("expected {0}, as its settings say, found another")]
    Form(String),
    /// A setting is out of range.
    #[error("{0}")]
    Setting(String),
    /// Its means cannot be indexed.
    #[error(transparent)]
    Index(#[from] IndexError),
}
