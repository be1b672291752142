//! Ranges of settings and the error for values outside.

/// A setting is out of its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{setting}: expected {expected}, found {found}")]
pub struct ConfigError {
    /// Name of the setting as in settings files.
    pub setting: &'static str,
    /// Permitted range.
    pub expected: String,
    /// Value found.
    pub found: String,
}

/// Maximum number of components of a model: ids are stored as `i32`.
pub const MAX_COMPONENTS: usize = 20_000_000;
