//! State of all edits at one moment: selection, hidden and deleted splats, crop box.

use super::marks::SplatMarks;
use glam::DVec3;
use std::sync::Arc;

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
pub enum SelectHow {
    /// Replaces the selection.
    Replace,
    /// Adds to the selection.
    Add,
    /// Removes from the selection.
    Remove,
}

impl Edits {
    /// True if exports omit splats.
    pub fn leaves_out(&self) -> bool {
        !self.deleted.is_empty() || self.crop.is_some()
    }

    /// True if the edits change the display.
    pub fn is_shown(&self) -> bool {
        self.leaves_out() || !self.selected.is_empty() || !self.hidden.is_empty()
    }

    /// Returns the edits with `marks` combined into the selection.
    pub fn selecting(&self, marks: SplatMarks, how: SelectHow) -> Self {
        let selected = match how {
            SelectHow::Replace => marks,
            SelectHow::Add => self.selected.with(&marks),
            SelectHow::Remove => self.selected.without(&marks),
        };
        Self { selected: Arc::new(selected), ..self.clone() }
    }

    /// Returns the edits with the selection hidden and cleared.
    pub fn hiding(&self) -> Self {
        let hidden = Arc::new(self.hidden.with(&self.selected));
        Self { hidden, selected: Arc::default(), ..self.clone() }
    }

    /// Returns the edits with the selection deleted and cleared.
    pub fn deleting(&self) -> Self {
        let deleted = Arc::new(self.deleted.with(&self.selected));
        Self { deleted, selected: Arc::default(), ..self.clone() }
    }
}
