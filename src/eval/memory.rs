//! Memory needed for evaluation, in addition to the model and its training frames.

use crate::train::memory::MemoryEstimate;

/// Per pixel: render, photograph, depth, surfaces and buffers of the metrics.
const PIXEL_BYTES: u64 = 370;
/// Per component: its splats, including those of early frames, and their records.
const SPLAT_BYTES: u64 = 420;
/// The program and memory retained from training.
const FIXED_BYTES: u64 = 50_000_000;

/// Adds to an estimate the memory for evaluating views of `pixels` of a model with at most `components`.
pub fn with_evaluation(
    estimate: MemoryEstimate,
    pixels: usize,
    components: usize,
) -> MemoryEstimate {
    let MemoryEstimate { model, frames } = estimate;
    MemoryEstimate {
        model: model.saturating_add(SPLAT_BYTES.saturating_mul(components as u64)),
        // Training frames are freed before views are evaluated.
        frames: frames.max(PIXEL_BYTES.saturating_mul(pixels as u64).saturating_add(FIXED_BYTES)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::scene::config::SceneConfig;
    use crate::train::scene::photometric::rule::PhotometricMode;

    /// Peaks of runs on the synthetic room in the TUM layout with two threads: pixels per frame,
    /// components, photographs used, views evaluated, and megabytes.
    const MEASURED: [(usize, usize, bool, bool, u64); 11] = [
        (19_200, 5_262, false, false, 22),
        (19_200, 5_262, true, false, 84),
        (19_200, 24_615, true, false, 119),
        (307_200, 16_554, false, false, 117),
        (307_200, 52_554, false, false, 130),
        (307_200, 16_554, true, false, 218),
        (307_200, 52_554, true, false, 281),
        (307_200, 16_554, false, true, 171),
        (307_200, 52_554, false, true, 200),
        (1_228_800, 35_947, false, false, 372),
        (1_228_800, 35_947, true, true, 571),
    ];

    #[test]
    fn estimates_are_within_a_fifth_of_what_was_measured() {
        for (pixels, components, photographs, measured, peak) in MEASURED {
            let photometric = photographs.then(|| PhotometricMode::Light.rule()).flatten();
            let config =
                SceneConfig { photometric, max_components: components, ..SceneConfig::exact(0.02) };
            let mut estimate = config.memory(pixels, 3);
            if measured {
                estimate = with_evaluation(estimate, pixels, components);
            }
            let share = estimate.total() as f64 / 1e6 / peak as f64;
            assert!((0.8..1.2).contains(&share), "{pixels} {components}: {share} of {peak} MB");
        }
    }
}
