//! Settings as RON text, with a fallback to the defaults.

use serde::de::DeserializeOwned;

/// Reads settings, which messages call `what`. Unreadable text yields the defaults and a notice:
/// settings of another version must not prevent the window from opening.
pub fn from_text<T: DeserializeOwned + Default>(what: &str, text: &str) -> (T, Option<String>) {
    match ron::from_str(text) {
        Ok(read) => (read, None),
        Err(error) => {
            let notice = format!(
                "the stored settings of {what}: expected the format of this version, found {error}; the defaults are used instead"
            );
            (T::default(), Some(notice))
        }
    }
}
