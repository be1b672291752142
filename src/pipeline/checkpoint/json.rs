//! JSON sections of a checkpoint.

use super::error::RunError;
use serde::{Deserialize, Serialize};
use std::path::Path;

pub(super) fn parse<T: for<'de> Deserialize<'de>>(
    path: &Path,
    section: &'static str,
    json: &str,
) -> Result<T, RunError> {
    serde_json::from_str(json).map_err(|error| RunError::Json {
        path: path.to_owned(),
        section,
        problem: error.to_string(),
    })
}

/// Serializes with sorted keys, so that equal values have equal bytes.
pub(super) fn canonical(value: &impl Serialize) -> Result<String, serde_json::Error> {
    Ok(serde_json::to_value(value)?.to_string())
}
