//! Time, size and memory of the writers, printed by
//! `cargo test --release --test export -- --ignored figures --nocapture`.

use super::random_splats;
use std::time::Instant;
use vbgs_studio::export::{ModelFormat, WriteOptions, write};

/// A field of `/proc/self/status`, MB.
fn memory_mb(field: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with(field)).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
}

#[test]
#[ignore = "a measurement; needs an idle machine"]
fn figures_of_a_million_splats() {
    let mut splats = random_splats(1_000_000, 91);
    splats.iter_mut().for_each(|s| s.scale = s.scale.map(|v| v.clamp(1e-3, 0.1)));
    let folder = tempfile::tempdir_in("/dev/shm").unwrap();
    let before = memory_mb("VmRSS");
    for format in ModelFormat::ALL {
        let path = folder.path().join("scene").with_extension(format.extension());
        // Resets the peak memory counter.
        std::fs::write("/proc/self/clear_refs", "5").unwrap();
        let started = Instant::now();
        let summary = write(&path, &splats, &WriteOptions::new(format)).unwrap();
        let seconds = started.elapsed().as_secs_f64();
        let more = memory_mb("VmHWM") - before;
        eprintln!(
            "{format}: {seconds:.2} s, {} bytes, {more:.0} MB besides the model",
            summary.bytes
        );
        std::fs::remove_file(&path).unwrap();
    }
}
