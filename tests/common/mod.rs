//! What several integration tests share.
#![allow(dead_code)] // each test binary uses its own part

#[cfg(feature = "gui")]
pub mod adapter;
pub mod agreement;
pub mod exactness;
pub mod golden;
pub mod ray;
pub mod render_cases;
pub mod scenes;
pub mod scratch;

use std::path::PathBuf;

/// A path under `../shared`, or `None` (with a line that says so) where it is absent. In CI its
/// absence is a failure.
pub fn shared(path: &str) -> Option<PathBuf> {
    let full = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared").join(path);
    if full.exists() {
        return Some(full);
    }
    assert!(
        std::env::var_os("CI").is_none(),
        "../shared/{path} not found, and in CI nothing may be skipped"
    );
    eprintln!("skipped: ../shared/{path} not found");
    None
}
