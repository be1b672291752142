//! Refuses a run that the machine has no free memory for, before it is taken.

use crate::eval::machine;
use crate::train::memory::MemoryEstimate;

/// A run that would not fit.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "components: expected at most {most}, which the {available_mb} MB of free memory hold, found {found} ({needed_mb} MB); take fewer components or close other programs"
)]
pub struct MemoryError {
    /// Components that would fit.
    pub most: u64,
    /// Components asked for.
    pub found: usize,
    /// Free memory, 10⁶ bytes.
    pub available_mb: u64,
    /// Memory needed, 10⁶ bytes.
    pub needed_mb: u64,
}

/// Refuses what the machine has no free memory for, where it says how much it has.
///
/// # Errors
/// [`MemoryError`] says how many components would fit.
pub fn check(estimate: MemoryEstimate, components: usize) -> Result<(), MemoryError> {
    match machine::available_bytes() {
        Some(available) => check_against(estimate, components, available),
        None => Ok(()),
    }
}

fn check_against(
    estimate: MemoryEstimate,
    components: usize,
    available: u64,
) -> Result<(), MemoryError> {
    if estimate.total() <= available {
        return Ok(());
    }
    let per_component = (estimate.model / components.max(1) as u64).max(1);
    Err(MemoryError {
        most: available.saturating_sub(estimate.frames) / per_component,
        found: components,
        available_mb: available / 1_000_000,
        needed_mb: estimate.total().div_ceil(1_000_000),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::paper::config::{Candidates, PaperConfig, PaperOverrides, StatisticsForm};

    #[test]
    fn what_does_not_fit_is_refused_with_what_would() {
        let estimate = |overrides: PaperOverrides| {
            PaperConfig::paper().with(&overrides).unwrap().memory(640_000, 2)
        };
        let paper = estimate(PaperOverrides::default());
        assert!((50_000_000..300_000_000).contains(&paper.total()), "{paper:?}");
        assert_eq!(check_against(paper, 100_000, paper.total()), Ok(()));
        let error = check_against(paper, 100_000, paper.total() - 1).unwrap_err();
        assert_eq!((error.found, error.most), (100_000, 99_999));
        let dense = estimate(PaperOverrides {
            candidates: Some(Candidates::Dense),
            statistics: Some(StatisticsForm::Unfused),
            ..PaperOverrides::default()
        });
        assert!(dense.total() > 500_000_000_000, "{dense:?}");
    }
}
