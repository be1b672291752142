//! Sets of splats that stay valid while training moves and replaces splats.

use crate::model::splat::splats::Splat;
use glam::Vec3;

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
