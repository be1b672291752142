//! Skips tests that lack a recording, a device or a program, with one line; in strict mode they fail.

use std::io::Write;
use std::path::Path;

/// Environment variable that, set to 1 as in continuous integration, turns every skipped test into a failure.
pub const STRICT: &str = "VBGS_STRICT";

/// Returns `None` and prints one line with the missing resource and the number of tests skipped so far in
/// this cargo run.
///
/// # Panics
/// Panics in strict mode.
#[track_caller]
pub fn skip<T>(missing: &str, remedy: &str) -> Option<T> {
    let is_strict = std::env::var_os(STRICT).is_some_and(|value| value == "1");
    let line = outcome(missing, remedy, is_strict, skipped_so_far);
    // Not `eprintln`, whose output the harness hides for passing tests.
    let _ = writeln!(std::io::stderr(), "{}", line.unwrap_or_else(|failure| panic!("{failure}")));
    None
}

/// Returns the line for a skipped test, or the error message in strict mode.
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

/// Counts this test and returns the total. All test programs of one `cargo test` have the same parent process
/// and share a counter file, whose length is the count.
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
