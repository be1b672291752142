//! Tests that lack a recording, a device or a program are skipped with one line, or fail in strict mode.

use std::io::Write;
use std::path::Path;

/// Set to 1, as continuous integration does, it turns every skipped test into a failure.
pub const STRICT: &str = "VBGS_STRICT";

/// Returns nothing and writes one line that names what is missing and counts the tests skipped so far in this
/// run of cargo.
///
/// # Panics
/// Panics in strict mode.
#[track_caller]
pub fn skip<T>(missing: &str, remedy: &str) -> Option<T> {
    let is_strict = std::env::var_os(STRICT).is_some_and(|value| value == "1");
    let line = outcome(missing, remedy, is_strict, skipped_so_far);
    // Not by `eprintln`, which the harness hides in tests that pass.
    let _ = writeln!(std::io::stderr(), "{}", line.unwrap_or_else(|failure| panic!("{failure}")));
    None
}

/// The line of a skipped test, or the message of one that fails.
pub fn outcome(
    missing: &str,
    remedy: &str,
    is_strict: bool,
    count: impl FnOnce() -> usize,
) -> Result<String, String> {
    match is_strict {
        true => {
            Err(format!("{missing}: {remedy}, or unset {STRICT} to skip the tests that need it"))
        }
        false => Ok(format!("skipped: {missing} ({} skipped so far)", count())),
    }
}

/// Counts this test, too. The programs of one `cargo test` are children of one process and share a file.
fn skipped_so_far() -> usize {
    #[cfg(unix)]
    let run = std::os::unix::process::parent_id();
    #[cfg(not(unix))]
    let run = std::process::id();
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("skipped-{run}"));
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(&path).unwrap();
    file.write_all(b".").unwrap();
    file.metadata().unwrap().len() as usize
}
