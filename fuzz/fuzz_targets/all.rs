//! All targets in one binary for another machine. `VBGS_FUZZ_TARGET` selects one.

#![no_main]

use std::sync::LazyLock;
use vbgs_fuzz::{entries, fuzz_target, watch_panics};

static NAME: LazyLock<String> =
    LazyLock::new(|| std::env::var("VBGS_FUZZ_TARGET").expect("VBGS_FUZZ_TARGET names a target"));

fuzz_target!(init: watch_panics(), |data: &[u8]| entries::run(&NAME, data));
