//! Tests that lack what they need fail: one that passes without having tested anything misleads.
//! Who has no reference data or no graphics adapter says so once, by a variable.

use std::io::Write;

/// Set to 1, it lets tests pass that lack their data, adapter or display.
pub const ALLOW_SKIP: &str = "VBGS_ALLOW_SKIP";

/// Nothing, with a line that says what is missing, where the variable allows it.
///
/// # Panics
/// Panics everywhere else, with what to do.
#[track_caller]
pub fn skip<T>(missing: &str, remedy: &str) -> Option<T> {
    let allowed = std::env::var_os(ALLOW_SKIP);
    let line = outcome(missing, remedy, allowed.is_some_and(|value| value == "1"));
    // Not by `eprintln`, which the harness keeps to itself in tests that pass.
    let _ = writeln!(std::io::stderr(), "{}", line.unwrap_or_else(|failure| panic!("{failure}")));
    None
}

/// The line of a test that is skipped, or the message of one that fails.
pub fn outcome(missing: &str, remedy: &str, is_allowed: bool) -> Result<String, String> {
    if is_allowed {
        Ok(format!("skipped: {missing}"))
    } else {
        Err(format!("{missing}: {remedy}, or set {ALLOW_SKIP}=1 to skip the tests that need it"))
    }
}
