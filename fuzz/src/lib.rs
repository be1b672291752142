//! Targets of `cargo fuzz` (`README.md`).

pub mod common;
#[path = "../entries/mod.rs"]
pub mod entries;

pub use libfuzzer_sys::fuzz_target;

/// Ends the process at every panic of the product itself. Those of decoders that are other people's
/// code may be caught where the product guards against them; if they are not, libFuzzer sees them.
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

/// The binary of a target.
#[macro_export]
macro_rules! target {
    ($name:literal) => {
        $crate::fuzz_target!(
            init: $crate::watch_panics(),
            |data: &[u8]| $crate::entries::run($name, data)
        );
    };
}
