//! What a panic said.

use std::any::Any;

/// What stands for a message that is none.
pub const NO_WORDS: &str = "a panic without words";

/// The message in a panic's payload, if it carries one.
pub fn panic_text(payload: &(dyn Any + Send)) -> Option<&str> {
    // `panic!` carries a `&str` if there is nothing to format in its message, else a `String`.
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str))
}
