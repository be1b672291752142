//! Messages of panics.

use std::any::Any;

/// Placeholder for a panic without a message.
pub const NO_MESSAGE: &str = "a panic without a message";

/// Returns the message of a panic's payload, if any.
pub fn panic_text(payload: &(dyn Any + Send)) -> Option<&str> {
    // `panic!` carries a `&str` for a literal message, else a `String`.
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str))
}
