//! Undo and redo history of the edits.

use super::marks::SplatMarks;
use glam::DVec3;
use std::sync::Arc;

/// Maximum number of undo steps. Each stores its marked splats at 20 bytes a splat.
const MAX_STEPS: usize = 100;

/// Current edits with undo and redo stacks.
#[derive(Debug, Default)]
pub struct EditHistory {
    current: Edits,
    before: Vec<Edits>,
    redo_stack: Vec<Edits>,
    /// True while the last step is still in progress, such as a slider drag.
    is_open: bool,
}

impl EditHistory {
    /// Current edits.
    pub fn current(&self) -> &Edits {
        &self.current
    }

    /// Adds an undo step unless `next` equals the current edits.
    pub fn step(&mut self, next: Edits) {
        self.drag(next);
        self.end_drag();
    }

    /// Adds a step that continues until [`Self::end_drag`] and is undone as a whole.
    pub fn drag(&mut self, next: Edits) {
        if next == self.current {
            return;
        }
        let before = std::mem::replace(&mut self.current, next);
        if !std::mem::replace(&mut self.is_open, true) {
            if self.before.len() == MAX_STEPS {
                self.before.remove(0);
            }
            self.before.push(before);
            self.redo_stack.clear();
        }
    }

    /// Ends the current step; the next change starts a new one.
    pub fn end_drag(&mut self) {
        self.is_open = false;
    }

    /// True if there is a step to undo.
    pub fn can_undo(&self) -> bool {
        !self.before.is_empty()
    }

    /// True if there is a step to redo.
    pub fn can_redo(&self) -> bool {
        !self.redo_stack.is_empty()
    }

    /// Undoes the last step.
    pub fn undo(&mut self) {
        self.end_drag();
        if let Some(before) = self.before.pop() {
            self.redo_stack.push(std::mem::replace(&mut self.current, before));
        }
    }

    /// Redoes the last undone step.
    pub fn redo(&mut self) {
        self.end_drag();
        if let Some(again) = self.redo_stack.pop() {
            self.before.push(std::mem::replace(&mut self.current, again));
        }
    }
}

/// One state of the edits. States of a history share their sets.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edits {
    /// Selected splats, which the next command applies to.
    pub selected: Arc<SplatMarks>,
    /// Splats that are not displayed but exported.
    pub hidden: Arc<SplatMarks>,
    /// Splats that are neither displayed nor exported.
    pub deleted: Arc<SplatMarks>,
    /// Least and largest corner of the crop box, world units relative to the local origin. Splats with
    /// centres outside are neither displayed nor exported.
    pub crop: Option<[DVec3; 2]>,
}

/// How a new selection combines with the current one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SelectMode {
    /// Replaces the selection.
    Replace,
    /// Adds to the selection.
    Add,
    /// Removes from the selection.
    Remove,
}

impl Edits {
    /// True if exports omit splats.
    pub fn excludes_splats(&self) -> bool {
        !self.deleted.is_empty() || self.crop.is_some()
    }

    /// True if the edits change the display.
    pub fn affects_display(&self) -> bool {
        self.excludes_splats() || !self.selected.is_empty() || !self.hidden.is_empty()
    }

    /// Returns the edits with `marks` combined into the selection.
    pub fn with_selection(&self, marks: SplatMarks, how: SelectMode) -> Self {
        let selected = match how {
            SelectMode::Replace => marks,
            SelectMode::Add => self.selected.union(&marks),
            SelectMode::Remove => self.selected.difference(&marks),
        };
        Self { selected: Arc::new(selected), ..self.clone() }
    }

    /// Returns the edits with the selection hidden and cleared.
    pub fn with_selection_hidden(&self) -> Self {
        let hidden = Arc::new(self.hidden.union(&self.selected));
        Self { hidden, selected: Arc::default(), ..self.clone() }
    }

    /// Returns the edits with the selection deleted and cleared.
    pub fn with_selection_deleted(&self) -> Self {
        let deleted = Arc::new(self.deleted.union(&self.selected));
        Self { deleted, selected: Arc::default(), ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn cropped(x: f64) -> Edits {
        Edits { crop: Some([DVec3::ZERO, DVec3::splat(x)]), ..Edits::default() }
    }

    #[test]
    fn steps_are_taken_back_and_made_again_and_a_drag_is_one() {
        let mut history = EditHistory::default();
        history.step(cropped(1.0));
        for x in [2.0, 3.0, 4.0] {
            history.drag(cropped(x));
        }
        history.end_drag();
        history.undo();
        assert_eq!(history.current(), &cropped(1.0));
        history.redo();
        assert_eq!(history.current(), &cropped(4.0));
        history.undo();
        history.undo();
        assert_eq!(history.current(), &Edits::default());
        assert!(!history.can_undo() && history.can_redo());
        history.step(cropped(7.0));
        assert!(!history.can_redo(), "a new step clears the redo stack");
        history.step(cropped(7.0));
        history.undo();
        assert!(!history.can_undo(), "a step without a change is not recorded");
    }
}
