//! Targets of `cargo fuzz` (`README.md`).

pub mod common;
#[path = "../entries/mod.rs"]
pub mod entries;

pub use libfuzzer_sys::fuzz_target;

/// Aborts the process at every panic of the product. Panics of external decoders are only printed: the product
/// catches some of them, and libFuzzer detects the others.
pub fn watch_panics() {
    let print = std::panic::take_hook();
    // The fuzzer's own hook would end the process for guarded panics too.
    drop(print);
    std::panic::set_hook(Box::new(|panic| {
        let place = panic.location().map(|place| place.file().to_owned()).unwrap_or_default();
        if place.contains(".cargo/registry") || place.contains("/rustc/") {
            eprintln!("{panic}");
            return;
        }
        eprintln!("{panic}\n{}", std::backtrace::Backtrace::force_capture());
        std::process::abort();
    }));
}

/// Defines the binary of a target.
#[macro_export]
macro_rules! target {
    ($name:literal) => {
        $crate::fuzz_target!(
            init: $crate::watch_panics(),
            |data: &[u8]| $crate::entries::run($name, data)
        );
    };
}
