//! Ranges of settings, and what is said of one outside its range.

/// A setting outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{setting}: expected {expected}, found {found}")]
pub struct ConfigError {
    /// Name of the setting, as settings files spell it.
    pub setting: &'static str,
    /// The allowed range.
    pub expected: String,
    /// The value given.
    pub found: String,
}

/// Most components a model may have: one id is an `i32` everywhere it is stored.
pub const MAX_COMPONENTS: usize = 20_000_000;
