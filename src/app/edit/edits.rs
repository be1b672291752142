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
