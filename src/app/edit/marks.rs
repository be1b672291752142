//! Sets of splats that stay valid while training moves and replaces splats.

use super::history::Edits;
use crate::export::WriteSelection;
use crate::model::attributes::ComponentAttributes;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::splats::Splat;
use crate::render::attributes::{Attribute, Range};
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// A marked splat is still the same one if it moved by at most this many standard deviations of its longest
/// axis at marking time. Training moves a mean by less; a slot reused for another splat exceeds it.
const REACH_DEVIATIONS: f32 = 3.0;

/// Slot and position of a splat when it was marked.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Mark {
    slot: u32,
    mean: [f32; 3],
    /// Largest accepted displacement, world units.
    reach: f32,
}

/// Set of splats, identified by slot and position.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplatMarks {
    /// One bit per slot; answers most membership tests without a search.
    bits: Vec<u64>,
    /// Sorted by slot.
    marks: Vec<Mark>,
}

impl SplatMarks {
    /// Marks the splats in these slots (ascending); slots beyond the end are ignored.
    pub fn from_slots(slots: impl IntoIterator<Item = u32>, splats: &[Splat]) -> Self {
        let there = |slot: u32| Some((slot, splats.get(slot as usize)?));
        let mark = |(slot, splat): (u32, &Splat)| Mark {
            slot,
            mean: splat.mean,
            reach: REACH_DEVIATIONS * splat.scale.into_iter().fold(0.0, f32::max),
        };
        Self::from_marks(slots.into_iter().filter_map(there).map(mark).collect())
    }

    fn from_marks(marks: Vec<Mark>) -> Self {
        let n = marks.last().map_or(0, |last| last.slot as usize / 64 + 1);
        let mut bits = vec![0; n];
        for mark in &marks {
            bits[mark.slot as usize / 64] |= 1 << (mark.slot % 64);
        }
        Self { bits, marks }
    }

    /// True if the splat now in `slot` belongs to the set.
    pub fn contains(&self, slot: u32, splat: &Splat) -> bool {
        let word = self.bits.get(slot as usize / 64);
        if word.is_none_or(|word| word >> (slot % 64) & 1 == 0) {
            return false;
        }
        let Ok(at) = self.marks.binary_search_by_key(&slot, |mark| mark.slot) else { return false };
        let Mark { mean, reach, .. } = self.marks[at];
        Vec3::from_array(mean).distance(Vec3::from_array(splat.mean)) <= reach
    }

    /// Number of splats.
    pub fn len(&self) -> usize {
        self.marks.len()
    }

    /// True if the set is empty.
    pub fn is_empty(&self) -> bool {
        self.marks.is_empty()
    }

    /// Union of both sets; for splats in both, the mark of `other` is taken.
    pub fn union(&self, other: &Self) -> Self {
        let mut marks = self.difference(other).marks;
        marks.extend(&other.marks);
        marks.sort_unstable_by_key(|mark| mark.slot);
        Self::from_marks(marks)
    }

    /// Difference of both sets.
    pub fn difference(&self, other: &Self) -> Self {
        let is_other =
            |mark: &&Mark| other.marks.binary_search_by_key(&mark.slot, |o| o.slot).is_ok();
        Self::from_marks(self.marks.iter().filter(|mark| !is_other(mark)).copied().collect())
    }
}

/// Deleted splats and crop box, as applied to exported files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeftOut {
    deleted: Arc<SplatMarks>,
    crop: Option<[DVec3; 2]>,
}

impl LeftOut {
    /// Takes deletions and crop box from the edits.
    pub fn new(edits: &Edits) -> Self {
        Self { deleted: edits.deleted.clone(), crop: edits.crop }
    }

    /// True if exports contain all splats.
    pub fn is_empty(&self) -> bool {
        self.deleted.is_empty() && self.crop.is_none()
    }

    /// Flag for each splat: true if it is deleted.
    pub fn deleted_flags(&self, splats: &[Splat]) -> Vec<bool> {
        let is_deleted = |(slot, splat): (usize, &Splat)| self.deleted.contains(slot as u32, splat);
        splats.iter().enumerate().map(is_deleted).collect()
    }

    /// Selection for the file writer, with the flags returned by [`Self::deleted_flags`].
    pub fn selection<'a>(&self, flags: &'a [bool]) -> WriteSelection<'a> {
        WriteSelection { crop: self.crop, left_out: Some(flags), ..WriteSelection::default() }
    }

    /// Returns the splats that remain.
    pub fn remaining(&self, scene: Arc<SplatSet>) -> Arc<SplatSet> {
        if self.is_empty() {
            return scene;
        }
        let mut kept = SplatSet::default().finished(scene.finishing().clone());
        for (i, splat) in scene.iter().enumerate() {
            if self.is_exported(i as u32, splat) {
                kept.push(*splat, scene.appearance_of(i));
            }
        }
        Arc::new(kept)
    }

    /// True if the splat is exported.
    pub fn is_exported(&self, slot: u32, splat: &Splat) -> bool {
        let is_left_out = [self.deleted.contains(slot, splat)];
        let mean = DVec3::from_array(splat.mean.map(f64::from));
        self.selection(&is_left_out).selects(0, mean, None)
    }
}

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

    fn at(x: f32) -> Splat {
        Splat { mean: [x, 0.0, 0.0], scale: [0.1, 0.2, 0.01], opacity: 1.0, ..Splat::default() }
    }

    #[test]
    fn a_splat_is_met_where_it_was_and_not_where_another_has_its_number() {
        let splats: Vec<Splat> = (0..100).map(|i| at(i as f32)).collect();
        let marks = SplatMarks::from_slots([3, 70, 500], &splats);
        assert_eq!(marks.len(), 2, "there is no splat 500");
        assert!(marks.contains(3, &at(3.5)) && marks.contains(70, &at(69.5)));
        assert!(
            !marks.contains(3, &at(3.7))
                && !marks.contains(4, &at(4.0))
                && !marks.contains(500, &at(0.0))
        );
    }

    #[test]
    fn sets_are_added_and_taken_away() {
        let splats: Vec<Splat> = (0..9).map(|i| at(i as f32)).collect();
        let (a, b) =
            (SplatMarks::from_slots([1, 2, 5], &splats), SplatMarks::from_slots([2, 8], &splats));
        assert_eq!(a.union(&b), SplatMarks::from_slots([1, 2, 5, 8], &splats));
        assert_eq!(a.difference(&b), SplatMarks::from_slots([1, 5], &splats));
        assert!(a.difference(&a).is_empty() && a.difference(&a) == SplatMarks::default());
    }
}

#[cfg(test)]
mod threshold_tests {
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
