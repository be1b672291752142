//! Memory check before a run starts.

use super::any_preset::ComponentLimit;
use crate::eval::report;
use crate::train::outcome::MemoryEstimate;

/// Error of a run that would not fit into memory. Sizes are in 10⁶ bytes.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MemoryError {
    /// The maximum number of components would not fit.
    #[error(
        "{setting}: expected at most {most} components, which fit into the {available_mb} MB of free memory, found {found} ({needed_mb} MB); use fewer or close other programs"
    )]
    Components { setting: &'static str, most: u64, found: usize, available_mb: u64, needed_mb: u64 },
    /// The frames alone would not fit.
    #[error(
        "memory: expected {needed_mb} MB for frames of this size, found {available_mb} MB free; reduce the image size or close other programs"
    )]
    Frames { available_mb: u64, needed_mb: u64 },
}

/// Checks that a run fits into the free memory, if the machine reports its free memory.
///
/// # Errors
/// [`MemoryError`] states how many components would fit, or that the frames alone would not fit.
pub fn check(estimate: MemoryEstimate, limit: ComponentLimit) -> Result<(), MemoryError> {
    match report::available_bytes() {
        Some(available) => check_against(estimate, limit, available),
        None => Ok(()),
    }
}

fn check_against(
    estimate: MemoryEstimate,
    limit: ComponentLimit,
    available: u64,
) -> Result<(), MemoryError> {
    // Free memory is rounded down and needed memory up, so that a message never contradicts itself.
    let (available_mb, megabytes) = (available / 1_000_000, |n: u64| n.div_ceil(1_000_000));
    if estimate.frames > available {
        return Err(MemoryError::Frames { available_mb, needed_mb: megabytes(estimate.frames) });
    }
    let (setting, found) = match limit {
        ComponentLimit::Fixed(n) => ("components", n),
        ComponentLimit::Asked(n) => ("budget (`--budget`)", n),
        // Hardly any run reaches the default limit.
        ComponentLimit::Default(_) => return Ok(()),
    };
    if estimate.total() <= available {
        return Ok(());
    }
    // At least one byte, so that the division is defined.
    let per_component = (estimate.model / found.max(1) as u64).max(1);
    let most = available.saturating_sub(estimate.frames) / per_component;
    let needed_mb = megabytes(estimate.total());
    Err(MemoryError::Components { setting, most, found, available_mb, needed_mb })
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
            MemoryError::Frames { .. } => unreachable!(),
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
        let found = check_against(scene, default, scene.frames);
        assert_eq!(found, Ok(()), "a default limit is not counted");
        let error = check_against(scene, default, scene.frames - 1).unwrap_err();
        assert!(matches!(error, MemoryError::Frames { .. }), "{error}");
    }
}
