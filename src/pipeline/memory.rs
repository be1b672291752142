//! Limits of a run that follow from the memory of the machine.

use super::any_preset::{AnyPreset, ComponentLimit};
use crate::eval::report;
use crate::train::outcome::MemoryEstimate;
use crate::train::scene::config::TEXTURE_COPIES;

/// Error of work that would not fit into memory. Sizes are in 10⁶ bytes.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MemoryError {
    /// The maximum number of components would not fit.
    #[error(
        "{setting}: found {found} components ({needed_mb} MB), expected at most {most}, which fit into the {available_mb} MB of memory for this program; use fewer or close other programs"
    )]
    Components { setting: &'static str, most: u64, found: usize, available_mb: u64, needed_mb: u64 },
    /// Frames and textures would not fit, or would leave too little for components.
    #[error(
        "memory: found {available_mb} MB for this program, expected {needed_mb} MB for frames of this size, textures and a small model; {advice}"
    )]
    Frames { available_mb: u64, needed_mb: u64, advice: String },
    /// The frames of a calibration would not fit.
    #[error(
        "frames (`--max-frames`): found {found} of this size ({needed_mb} MB), expected at most {most}, which fit into the {available_mb} MB of memory for this program; use fewer or close other programs"
    )]
    Calibration { most: u64, found: usize, available_mb: u64, needed_mb: u64 },
}

/// Least number of components of a useful scene, and number of pixels of a frame to a component of it. A
/// default limit is never lower: a scene would grow coarse, and spend its time on merging.
const LEAST_COMPONENTS: u64 = 10_000;
const MOST_PIXELS: usize = 16;

/// Fits the default limit of components to the memory that this process can hold, with evaluation, and
/// checks the other limits against it. Each frame has `pixels` pixels. No limit changes where the memory is
/// ample or unknown, so results do not depend on the machine there.
///
/// # Errors
/// [`MemoryError`] states how many components would fit, or which other settings.
pub fn fit(preset: &mut dyn AnyPreset, pixels: usize) -> Result<(), MemoryError> {
    match report::obtainable_bytes() {
        Some(available) => fit_into(preset, pixels, available),
        None => Ok(()),
    }
}

fn fit_into(preset: &mut dyn AnyPreset, pixels: usize, available: u64) -> Result<(), MemoryError> {
    let (estimate, limit) = (preset.memory(pixels), preset.component_limit());
    if let ComponentLimit::Default(n) | ComponentLimit::Lowered(n) = limit {
        let estimate = report::with_evaluation(estimate, pixels, n);
        // Other programs need memory too, and merging components takes some for a moment.
        let most = fitting_components(&estimate, n, available - available / 8);
        let least = LEAST_COMPONENTS.max((pixels / MOST_PIXELS) as u64);
        if most < least {
            return Err(too_large(&estimate, (n, least), available));
        }
        // Rounded, because the free memory is never quite the same.
        let step = (most / 16).next_power_of_two();
        let rounded = (most / step * step).max(least);
        preset.lower_default_limit(usize::try_from(rounded).unwrap_or(usize::MAX));
    }
    check_against(estimate, preset.component_limit(), available)
}

/// Checks that a run fits into the memory that this process can hold, if the machine reports it. A default
/// limit of components counts as [`fit`] left it.
///
/// # Errors
/// As [`fit`].
pub fn check(estimate: MemoryEstimate, limit: ComponentLimit) -> Result<(), MemoryError> {
    match report::obtainable_bytes() {
        Some(available) => check_against(estimate, limit, available),
        None => Ok(()),
    }
}

/// Returns a note on a default limit of components that was lowered to what fits into memory.
pub fn note(limit: ComponentLimit) -> Option<String> {
    let ComponentLimit::Lowered(n) = limit else { return None };
    Some(format!(
        "memory holds {n} components, so the budget is lowered to that; further ones are merged. \
         --budget N sets another"
    ))
}

fn bytes_per_component(estimate: &MemoryEstimate, n: usize) -> u64 {
    // At least one byte, so that the division is defined.
    (estimate.model / n.max(1) as u64).max(1)
}

fn fitting_components(estimate: &MemoryEstimate, n: usize, available: u64) -> u64 {
    let left = available.saturating_sub(estimate.frames).saturating_sub(estimate.textures);
    left / bytes_per_component(estimate, n)
}

// Available memory is rounded down and needed memory up, so that a message never contradicts itself.
fn megabytes(available: u64, needed: u64) -> [u64; 2] {
    [available / 1_000_000, needed.div_ceil(1_000_000)]
}

/// Error of a run with `n` components at most that has no room for the `least` number of them.
fn too_large(estimate: &MemoryEstimate, (n, least): (usize, u64), available: u64) -> MemoryError {
    let scene = least.min(n as u64) * bytes_per_component(estimate, n);
    let fixed = estimate.frames.saturating_add(scene);
    // As in `fit_into`, an eighth is left to others.
    let needed = |bytes: u64| bytes.saturating_add(bytes.div_ceil(7));
    let left = (available - available / 8).saturating_sub(fixed);
    let advice = match (estimate.textures, left / TEXTURE_COPIES / 1_000_000) {
        (0, _) => "use smaller images or close other programs".to_owned(),
        (_, 0) if needed(fixed) > available => {
            "use smaller images, or close other programs; `--set textures=0` alone is not enough"
                .to_owned()
        }
        (_, most) => format!("`--set textures={most}` fits, else close other programs"),
    };
    let needed = needed(fixed.saturating_add(estimate.textures));
    let [available_mb, needed_mb] = megabytes(available, needed);
    MemoryError::Frames { available_mb, needed_mb, advice }
}

fn check_against(
    estimate: MemoryEstimate,
    limit: ComponentLimit,
    available: u64,
) -> Result<(), MemoryError> {
    if estimate.frames.saturating_add(estimate.textures) > available {
        return Err(too_large(&estimate, (limit.components(), LEAST_COMPONENTS), available));
    }
    let (setting, found) = match limit {
        ComponentLimit::Fixed(n) => ("components", n),
        ComponentLimit::Asked(n) => ("budget (`--budget`)", n),
        ComponentLimit::Default(_) | ComponentLimit::Lowered(_) => return Ok(()),
    };
    if estimate.total() <= available {
        return Ok(());
    }
    let most = fitting_components(&estimate, found, available);
    let [available_mb, needed_mb] = megabytes(available, estimate.total());
    Err(MemoryError::Components { setting, most, found, available_mb, needed_mb })
}

// Both are fitted to the peaks of calibrations of 4 to 60 frames of 640 × 480 and 1280 × 960 pixels.
/// Bytes per pixel of a frame that is calibrated: photograph with its pyramid, depth and points.
const CALIBRATED_PIXEL_BYTES: u64 = 82;
/// Bytes of the program, and of equations.
const CALIBRATION_BYTES: u64 = 80_000_000;

/// Checks that a calibration on `frames` frames of `pixels` pixels fits into the memory that this process can
/// hold, if the machine reports it.
///
/// # Errors
/// [`MemoryError::Calibration`] states how many frames would fit.
pub fn check_calibration(frames: usize, pixels: usize) -> Result<(), MemoryError> {
    match report::obtainable_bytes() {
        Some(available) => check_calibration_against(frames, pixels, available),
        None => Ok(()),
    }
}

fn check_calibration_against(
    found: usize,
    pixels: usize,
    available: u64,
) -> Result<(), MemoryError> {
    let of_frame = CALIBRATED_PIXEL_BYTES.saturating_mul(pixels.max(1) as u64);
    let most = available.saturating_sub(CALIBRATION_BYTES) / of_frame;
    if found as u64 <= most {
        return Ok(());
    }
    let needed = of_frame.saturating_mul(found as u64).saturating_add(CALIBRATION_BYTES);
    let [available_mb, needed_mb] = megabytes(available, needed);
    Err(MemoryError::Calibration { most, found, available_mb, needed_mb })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::paper::config::{PaperConfig, PaperOverrides};
    use crate::train::scene::config::SceneConfig;

    #[test]
    fn what_does_not_fit_is_refused_with_what_would() {
        let estimate = |overrides: PaperOverrides| {
            PaperConfig::paper().with(&overrides).unwrap().memory(640_000, 3, 2)
        };
        let paper = estimate(PaperOverrides::default());
        assert!((50_000_000..300_000_000).contains(&paper.total()), "{paper:?}");
        let limit = ComponentLimit::Fixed(100_000);
        assert_eq!(check_against(paper, limit, paper.total()), Ok(()));
        let error = check_against(paper, limit, paper.total() - 1).unwrap_err();
        let most = |error: MemoryError| match error {
            MemoryError::Components { setting, most, found, .. } => (setting, most, found),
            other => panic!("{other}"),
        };
        assert_eq!(most(error), ("components", 99_999, 100_000));
        let asked = SceneConfig { max_components: 20_000_000, ..SceneConfig::fine(0.02) };
        let scene = asked.memory(300_000, 3);
        let error = check_against(scene, ComponentLimit::Asked(20_000_000), scene.frames * 3);
        let (setting, would_fit, found) = most(error.unwrap_err());
        assert_eq!((setting, found), ("budget (`--budget`)", 20_000_000));
        let fits = SceneConfig { max_components: would_fit as usize, ..asked };
        assert!(fits.memory(300_000, 3).total() <= scene.frames * 3, "{would_fit}");
        let default = ComponentLimit::Default(20_000_000);
        let error = check_against(scene, default, scene.frames - 1).unwrap_err();
        assert!(matches!(error, MemoryError::Frames { .. }), "{error}");
    }

    #[test]
    fn textures_that_fit_are_named() {
        let estimate =
            MemoryEstimate { model: 2_000_000_000, frames: 200_000_000, textures: 600_000_000 };
        let error = |available| too_large(&estimate, (2_000_000, 10_000), available).to_string();
        // 700 MB of the 800 are used, of which frames and a small scene take 210.
        assert!(error(800_000_000).contains("found 800 MB"), "{}", error(800_000_000));
        assert!(error(800_000_000).contains("`--set textures=163` fits"), "{}", error(800_000_000));
        assert!(error(240_000_000).contains("`--set textures=0` fits"), "{}", error(240_000_000));
        assert!(error(239_000_000).contains("is not enough"), "{}", error(239_000_000));
    }

    #[test]
    fn frames_of_a_calibration_are_bounded() {
        let check = |frames| check_calibration_against(frames, 1_000_000, 1_000_000_000);
        assert_eq!(check(11), Ok(()));
        let found = 12;
        let [available_mb, needed_mb] = [1000, 1064];
        let refused = MemoryError::Calibration { most: 11, found, available_mb, needed_mb };
        assert_eq!(check(found), Err(refused));
    }
}
