//! Settings as text: RON, and what happens where it cannot be read.

use serde::de::DeserializeOwned;

/// Reads settings of `what`, as messages call them. What cannot be read falls back to the defaults,
/// with a text that says so: settings of another version must not keep the window from opening.
pub fn from_text<T: DeserializeOwned + Default>(what: &str, text: &str) -> (T, Option<String>) {
    match ron::from_str(text) {
        Ok(read) => (read, None),
        Err(error) => {
            let notice = format!(
                "the stored settings of {what}: expected what this version writes, found {error}; the defaults are used instead"
            );
            (T::default(), Some(notice))
        }
    }
}
