//! What a panic said.

use std::any::Any;

/// The message in a panic's payload, if it carries one.
pub(crate) fn panic_text(payload: &(dyn Any + Send)) -> Option<&str> {
    // `panic!` carries a `&str` if there is nothing to format in its message, else a `String`.
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str))
}
