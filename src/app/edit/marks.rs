//! Marks of selected, hidden and deleted splats, the crop box, and their undo log.

use crate::export::WriteSelection;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::splats::Splat;
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::sync::Arc;

/// Maximum displacement at which the mark of a splat remains valid, in standard deviations of the splat's
/// longest axis when it was marked. Training moves a splat by less; a new splat in a reused slot is farther
/// away.
const REACH_DEVIATIONS: f32 = 3.0;

/// Mark of a splat. A splat has at most one mark, because only displayed splats can be selected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// The next edit command applies to the splat.
    Selected,
    /// The splat is not displayed but exported.
    Hidden,
    /// The splat is neither displayed nor exported.
    Deleted,
}

/// Mark of a splat, with the splat's position when it was marked.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MarkedSplat {
    mark: Mark,
    mean: Vec3,
    /// Maximum displacement from `mean` at which the splat in the slot is still the marked one, world
    /// units.
    reach: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SelectMode {
    Replace,
    Add,
    Remove,
}

#[derive(Clone, Debug, Default)]
pub struct Edits {
    /// Marked splats by slot, shared between the states of an undo log.
    marked: Arc<HashMap<u32, MarkedSplat>>,
    counts: [usize; 3],
    crop: Option<[DVec3; 2]>,
}

impl PartialEq for Edits {
    fn eq(&self, other: &Self) -> bool {
        // Unchanged edits are compared in every pass, so their marks must not be.
        let same_marks = Arc::ptr_eq(&self.marked, &other.marked) || self.marked == other.marked;
        self.crop == other.crop && same_marks
    }
}

impl Edits {
    fn with_marks(&self, marked: HashMap<u32, MarkedSplat>) -> Self {
        // Counted here, because buttons need the counts in every pass.
        let mut counts = [0; 3];
        marked.values().for_each(|splat| counts[splat.mark as usize] += 1);
        Self { marked: Arc::new(marked), counts, crop: self.crop }
    }

    pub fn count(&self, mark: Mark) -> usize {
        self.counts[mark as usize]
    }

    /// Returns the mark of `splat`, which is now in `slot`. `None` if it has no mark or if the mark belongs
    /// to an earlier splat in this slot.
    pub fn mark(&self, slot: u32, splat: &Splat) -> Option<Mark> {
        let marked = self.marked.get(&slot)?;
        // Training may have reused the slot for another splat.
        let is_same = marked.mean.distance(Vec3::from_array(splat.mean)) <= marked.reach;
        is_same.then_some(marked.mark)
    }

    /// Returns the minimum and maximum corner of the crop box, world units relative to the local origin.
    /// Splats with centres outside the box are neither displayed nor exported.
    pub fn crop(&self) -> Option<[DVec3; 2]> {
        self.crop
    }

    pub fn with_crop(&self, crop: Option<[DVec3; 2]>) -> Self {
        Self { crop, ..self.clone() }
    }

    /// Returns the edits after adding the splats in the given slots to the selection, removing them from
    /// it, or making them the new selection, as specified by `how`. Ignores invalid slots, and hidden and
    /// deleted splats.
    pub fn with_selection(
        &self,
        slots: impl IntoIterator<Item = u32>,
        splats: &[Splat],
        how: SelectMode,
    ) -> Self {
        // Copied, because other states of the undo log share the marks.
        let mut marked = HashMap::clone(&self.marked);
        if how == SelectMode::Replace {
            marked.retain(|_, splat| splat.mark != Mark::Selected);
        }
        for slot in slots {
            let Some(splat) = splats.get(slot as usize) else { continue };
            match (self.mark(slot, splat), how) {
                // Not displayed, so the user cannot mean them.
                (Some(Mark::Hidden | Mark::Deleted), _) => {}
                (_, SelectMode::Remove) => drop(marked.remove(&slot)),
                _ => {
                    let reach = REACH_DEVIATIONS * splat.scale.into_iter().fold(0.0, f32::max);
                    let mean = Vec3::from_array(splat.mean);
                    marked.insert(slot, MarkedSplat { mark: Mark::Selected, mean, reach });
                }
            }
        }
        self.with_marks(marked)
    }

    /// Returns the edits with every mark `from` replaced by `to`, or removed if `to` is `None`.
    pub fn with_replaced(&self, from: Mark, to: Option<Mark>) -> Self {
        let mut marked = HashMap::clone(&self.marked);
        match to {
            Some(to) => {
                let matching = marked.values_mut().filter(|splat| splat.mark == from);
                matching.for_each(|splat| splat.mark = to);
            }
            None => marked.retain(|_, splat| splat.mark != from),
        }
        self.with_marks(marked)
    }

    pub fn affects_display(&self) -> bool {
        !self.marked.is_empty() || self.crop.is_some()
    }

    pub fn is_exported(&self, slot: u32, splat: &Splat) -> bool {
        let mean = DVec3::from_array(splat.mean.map(f64::from));
        let inside = WriteSelection { crop: self.crop, ..WriteSelection::default() };
        self.mark(slot, splat) != Some(Mark::Deleted) && inside.selects(0, mean, None)
    }
}

/// Maximum number of states in the undo log. Each state stores about 40 bytes per marked splat.
const MAX_STATES: usize = 101;

#[derive(Debug)]
pub struct EditLog {
    states: Vec<Edits>,
    /// Index of the current state. Later states can be redone.
    at: usize,
    /// True while an action that changes the current state, such as a slider drag, is in progress.
    is_dragging: bool,
}

impl Default for EditLog {
    fn default() -> Self {
        // Never empty, so that there is a current state.
        Self { states: vec![Edits::default()], at: 0, is_dragging: false }
    }
}

impl EditLog {
    pub fn current(&self) -> &Edits {
        &self.states[self.at]
    }

    /// Adds an undo step unless `next` equals the current edits.
    pub fn step(&mut self, next: Edits) {
        self.drag(next);
        self.end_drag();
    }

    /// Adds an undo step, or updates the step in progress. A step lasts until [`Self::end_drag`] and is
    /// undone as a whole.
    pub fn drag(&mut self, next: Edits) {
        if next == *self.current() {
            return;
        }
        if std::mem::replace(&mut self.is_dragging, true) {
            self.states[self.at] = next;
            return;
        }
        // Undone states do not follow from the new one.
        self.states.truncate(self.at + 1);
        self.states.push(next);
        if self.states.len() > MAX_STATES {
            self.states.remove(0);
        }
        self.at = self.states.len() - 1;
    }

    pub fn end_drag(&mut self) {
        self.is_dragging = false;
    }

    pub fn can_undo(&self) -> bool {
        self.at > 0
    }

    pub fn can_redo(&self) -> bool {
        self.at + 1 < self.states.len()
    }

    pub fn undo(&mut self) {
        self.end_drag();
        self.at = self.at.saturating_sub(1);
    }

    pub fn redo(&mut self) {
        self.end_drag();
        self.at += usize::from(self.can_redo());
    }
}

/// Edits that exclude splats from exported files: deletions and the crop box.
#[derive(Clone, Debug, Default)]
pub struct LeftOut(Edits);

impl PartialEq for LeftOut {
    /// Ignores marks that exports do not depend on, so that a preview remains valid when the selection
    /// changes.
    fn eq(&self, other: &Self) -> bool {
        let is_deleted = |mark: &MarkedSplat| mark.mark == Mark::Deleted;
        let marks = [&self.0, &other.0].map(|edits| &edits.marked);
        let n_deleted = [&self.0, &other.0].map(|edits| edits.count(Mark::Deleted));
        let mut deleted = marks[0].iter().filter(|(_, mark)| is_deleted(mark));
        // With equal counts of deleted splats, one direction of the comparison suffices.
        let is_same = |(slot, mark)| marks[1].get(slot) == Some(mark);
        self.0.crop == other.0.crop
            && (Arc::ptr_eq(marks[0], marks[1])
                || n_deleted[0] == n_deleted[1] && deleted.all(is_same))
    }
}

impl LeftOut {
    pub fn new(edits: &Edits) -> Self {
        Self(edits.clone())
    }

    /// True if exports contain all splats.
    pub fn is_empty(&self) -> bool {
        self.0.count(Mark::Deleted) == 0 && self.0.crop.is_none()
    }

    /// Returns a flag for each splat: true if it is deleted.
    pub fn deleted_flags(&self, splats: &[Splat]) -> Vec<bool> {
        let mark = |(slot, splat)| self.0.mark(slot, splat);
        (0..).zip(splats).map(|splat| mark(splat) == Some(Mark::Deleted)).collect()
    }

    /// Returns the selection of splats to write to a file. `flags` are those returned by
    /// [`Self::deleted_flags`].
    pub fn selection<'a>(&self, flags: &'a [bool]) -> WriteSelection<'a> {
        WriteSelection { crop: self.0.crop, left_out: Some(flags), ..WriteSelection::default() }
    }

    pub fn remaining(&self, scene: Arc<SplatSet>) -> Arc<SplatSet> {
        if self.is_empty() {
            return scene;
        }
        Arc::new(scene.retained(|slot, splat| self.0.is_exported(slot as u32, splat)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f32) -> Splat {
        Splat { mean: [x, 0.0, 0.0], scale: [0.1, 0.2, 0.01], opacity: 1.0, ..Splat::default() }
    }

    fn selected(slots: &[u32], how: SelectMode, before: &Edits) -> Edits {
        let splats: Vec<Splat> = (0..100).map(|i| at(i as f32)).collect();
        before.with_selection(slots.iter().copied(), &splats, how)
    }

    #[test]
    fn a_splat_is_met_where_it_was_and_not_where_another_has_its_number() {
        let edits = selected(&[3, 70, 500], SelectMode::Replace, &Edits::default());
        assert_eq!(edits.count(Mark::Selected), 2, "there is no splat 500");
        for (slot, x, expected) in
            [(3, 3.5, true), (70, 69.5, true), (3, 3.7, false), (4, 4.0, false), (500, 0.0, false)]
        {
            assert_eq!(edits.mark(slot, &at(x)).is_some(), expected, "{slot} at {x}");
        }
    }

    #[test]
    fn selections_are_added_and_taken_away_and_marks_replace_each_other() {
        let none = Edits::default();
        let a = selected(&[1, 2, 5], SelectMode::Replace, &none);
        let union = selected(&[1, 2, 5, 8], SelectMode::Replace, &none);
        assert_eq!(selected(&[2, 8], SelectMode::Add, &a), union);
        let rest = selected(&[1, 5], SelectMode::Replace, &none);
        assert_eq!(selected(&[2, 8], SelectMode::Remove, &a), rest);
        assert_eq!(selected(&[1, 2, 5], SelectMode::Remove, &a), none);

        let deleted = a.with_replaced(Mark::Selected, Some(Mark::Deleted));
        assert_eq!((deleted.count(Mark::Selected), deleted.count(Mark::Deleted)), (0, 3));
        let again = selected(&[2, 8], SelectMode::Replace, &deleted);
        assert_eq!(again.mark(2, &at(2.0)), Some(Mark::Deleted), "not displayed");
        assert_eq!(again.count(Mark::Selected), 1);
        assert!(!again.is_exported(2, &at(2.0)) && again.is_exported(8, &at(8.0)));
        let restored = again.with_replaced(Mark::Deleted, None);
        assert_eq!(restored, selected(&[8], SelectMode::Replace, &none));
    }

    #[test]
    fn steps_are_taken_back_and_made_again_and_a_drag_is_one() {
        let cropped = |x| Edits::default().with_crop(Some([DVec3::ZERO, DVec3::splat(x)]));
        let mut log = EditLog::default();
        log.step(cropped(1.0));
        for x in [2.0, 3.0, 4.0] {
            log.drag(cropped(x));
        }
        log.end_drag();
        log.undo();
        assert_eq!(log.current(), &cropped(1.0));
        log.redo();
        assert_eq!(log.current(), &cropped(4.0));
        log.undo();
        log.undo();
        assert_eq!(log.current(), &Edits::default());
        assert!(!log.can_undo() && log.can_redo());
        log.step(cropped(7.0));
        assert!(!log.can_redo(), "a new step clears what could be redone");
        log.step(cropped(7.0));
        log.undo();
        assert!(!log.can_undo(), "a step without a change is not recorded");
        for i in 0..200 {
            log.step(cropped(f64::from(i)));
        }
        let undone = std::iter::from_fn(|| log.can_undo().then(|| log.undo())).count();
        assert_eq!(undone, MAX_STATES - 1);
    }
}
