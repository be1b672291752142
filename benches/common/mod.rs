//! Timing for the benches.

use std::time::Instant;

/// Milliseconds of `repetitions` runs after one uncounted warm-up run, ascending.
pub fn times_ms(repetitions: usize, mut run: impl FnMut()) -> Vec<f64> {
    run();
    let mut ms: Vec<f64> = (0..repetitions)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    ms.sort_by(f64::total_cmp);
    ms
}
