//! Helpers shared by the integration tests.
#![allow(dead_code)] // each test binary uses only some helpers

#[cfg(feature = "gui")]
pub mod adapter;
pub mod agreement;
pub mod bag;
pub mod exactness;
pub mod golden;
pub mod layouts;
pub mod lidar;
pub mod live;
pub mod mutation;
pub mod oracle;
pub mod ray;
pub mod render_cases;
pub mod scenes;
pub mod scratch;
pub mod silent;
pub mod skip;
pub mod wavy;

use std::path::PathBuf;

/// Returns a path under `../shared`; `None` skips the test.
#[track_caller]
pub fn shared(path: &str) -> Option<PathBuf> {
    let full = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared").join(path);
    let missing = || skip::skip(&format!("../shared/{path} not found"), "put the data there");
    if full.exists() { Some(full) } else { missing() }
}
