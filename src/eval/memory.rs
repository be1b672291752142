//! What measuring takes of the machine's memory, beside the model and the frames it was learnt from.

use crate::train::memory::MemoryEstimate;

/// Render, photograph, depth, surfaces and what metrics keep of a view, per pixel.
const PIXEL_BYTES: u64 = 370;
/// A component's splats, those of early frames included, and their records.
const SPLAT_BYTES: u64 = 420;
/// The program and what learning leaves behind.
const FIXED_BYTES: u64 = 50_000_000;

/// An estimate and what it takes to measure views of `pixels` of a model of at most `components`.
pub fn with_measuring(
    estimate: MemoryEstimate,
    pixels: usize,
    components: usize,
) -> MemoryEstimate {
    let MemoryEstimate { model, frames } = estimate;
    MemoryEstimate {
        model: model.saturating_add(SPLAT_BYTES.saturating_mul(components as u64)),
        // Frames are gone when views are measured.
        frames: frames.max(PIXEL_BYTES.saturating_mul(pixels as u64).saturating_add(FIXED_BYTES)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::scene::config::SceneConfig;
    use crate::train::scene::photometric::rule::PhotometricMode;

    /// Peaks of runs on the synthetic room as TUM's files, two threads: pixels of a frame, components,
    /// whether photographs were learnt and views measured, and megabytes.
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
                estimate = with_measuring(estimate, pixels, components);
            }
            let share = estimate.total() as f64 / 1e6 / peak as f64;
            assert!((0.8..1.2).contains(&share), "{pixels} {components}: {share} of {peak} MB");
        }
    }
}
