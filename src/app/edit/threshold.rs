//! Selection criteria for poorly determined splats: low evidence or high uncertainty.

use crate::model::attributes::ComponentAttributes;
use crate::model::splat::splats::Splat;
use crate::render::attributes::{Attribute, Range};

/// Criterion for selecting splats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SelectCriterion {
    /// Evidence below the threshold, points.
    #[default]
    LowEvidence,
    /// Standard deviation of the position above the threshold, world units.
    HighUncertainty,
}

impl SelectCriterion {
    /// Both criteria, in the order of the panel.
    pub const ALL: [Self; 2] = [Self::LowEvidence, Self::HighUncertainty];

    /// Label in the panel.
    pub fn label(self) -> &'static str {
        match self {
            Self::LowEvidence => "Evidence below",
            Self::HighUncertainty => "Uncertainty above",
        }
    }

    /// Component attribute that is compared.
    pub fn attribute(self) -> Attribute {
        match self {
            Self::LowEvidence => Attribute::Evidence,
            Self::HighUncertainty => Attribute::Uncertainty,
        }
    }

    /// True if a splat meets the criterion; false if its attribute is unknown.
    pub fn is_met(self, known: &ComponentAttributes, threshold: f64) -> bool {
        match self {
            Self::LowEvidence => known.evidence.is_some_and(|n| f64::from(n) < threshold),
            Self::HighUncertainty => known.uncertainty.is_some_and(|d| f64::from(d) > threshold),
        }
    }

    /// Slots of drawable splats that meet the criterion.
    pub fn slots<'a>(
        self,
        threshold: f64,
        splats: &'a [Splat],
        known: &'a [ComponentAttributes],
    ) -> impl Iterator<Item = u32> + 'a {
        let all = splats.iter().zip(known).zip(0..);
        let met = all.filter(move |((splat, known), _)| {
            splat.is_drawable() && self.is_met(known, threshold)
        });
        met.map(|(_, slot)| slot)
    }

    /// Range of the slider; `None` if no attribute is known. It extends the central range of the values
    /// tenfold on both sides to reach outliers.
    pub fn range(self, known: &[ComponentAttributes]) -> Option<[f64; 2]> {
        let [lo, hi] = Range::of(self.attribute(), known)?.ends();
        Some([0.1 * lo, 10.0 * hi])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_known_is_not_doubted() {
        let splat = Splat {
            opacity: 1.0,
            scale: [1.0; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            ..Splat::default()
        };
        let known = |evidence, uncertainty| ComponentAttributes {
            evidence,
            uncertainty,
            ..ComponentAttributes::default()
        };
        let all = [known(Some(5.0), Some(0.1)), known(None, None), known(Some(50.0), Some(0.9))];
        let splats = [splat, splat, splat, splat];
        let slots = |doubt: SelectCriterion, threshold| -> Vec<u32> {
            doubt.slots(threshold, &splats, &all).collect()
        };
        assert_eq!(slots(SelectCriterion::LowEvidence, 20.0), [0]);
        assert_eq!(slots(SelectCriterion::HighUncertainty, 0.5), [2]);
        assert_eq!(SelectCriterion::LowEvidence.range(&[known(None, None)]), None);
        let [lo, hi] = SelectCriterion::LowEvidence.range(&all).unwrap();
        assert!(lo < 5.0 && hi > 50.0);
    }
}
