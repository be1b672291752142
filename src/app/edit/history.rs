//! Edits with what was before them and what was taken back.

use super::edits::Edits;

/// Steps that can be taken back. A step holds the splats that it has marked, 20 bytes each.
const MAX_STEPS: usize = 100;

/// The edits of now and of before.
#[derive(Debug, Default)]
pub struct EditHistory {
    now: Edits,
    before: Vec<Edits>,
    taken_back: Vec<Edits>,
    /// Whether the last step is still under way, as of a slider that is dragged.
    is_open: bool,
}

impl EditHistory {
    /// The edits of now.
    pub fn now(&self) -> &Edits {
        &self.now
    }

    /// Makes a step, unless nothing differs by it.
    pub fn step(&mut self, next: Edits) {
        self.drag(next);
        self.end_drag();
    }

    /// Makes a step that goes on until [`Self::end_drag`]: all of it is taken back at once.
    pub fn drag(&mut self, next: Edits) {
        if next == self.now {
            return;
        }
        let before = std::mem::replace(&mut self.now, next);
        if !std::mem::replace(&mut self.is_open, true) {
            if self.before.len() == MAX_STEPS {
                self.before.remove(0);
            }
            self.before.push(before);
            self.taken_back.clear();
        }
    }

    /// What comes next is a step of its own.
    pub fn end_drag(&mut self) {
        self.is_open = false;
    }

    /// Whether there is a step to take back.
    pub fn can_undo(&self) -> bool {
        !self.before.is_empty()
    }

    /// Whether a step was taken back.
    pub fn can_redo(&self) -> bool {
        !self.taken_back.is_empty()
    }

    /// Takes the last step back.
    pub fn undo(&mut self) {
        self.end_drag();
        if let Some(before) = self.before.pop() {
            self.taken_back.push(std::mem::replace(&mut self.now, before));
        }
    }

    /// Makes the step that was taken back last once more.
    pub fn redo(&mut self) {
        self.end_drag();
        if let Some(again) = self.taken_back.pop() {
            self.before.push(std::mem::replace(&mut self.now, again));
        }
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
        assert_eq!(history.now(), &cropped(1.0));
        history.redo();
        assert_eq!(history.now(), &cropped(4.0));
        history.undo();
        history.undo();
        assert_eq!(history.now(), &Edits::default());
        assert!(!history.can_undo() && history.can_redo());
        history.step(cropped(7.0));
        assert!(!history.can_redo(), "another way was taken");
        history.step(cropped(7.0));
        history.undo();
        assert!(!history.can_undo(), "a step that changes nothing is none");
    }
}
