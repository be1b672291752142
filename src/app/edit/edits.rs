//! What is selected, hidden, deleted and cropped at one moment.

use super::marks::SplatMarks;
use glam::DVec3;
use std::sync::Arc;

/// One state of the edits. Its sets are shared by the states of a history.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edits {
    /// Splats that the next step is about.
    pub selected: Arc<SplatMarks>,
    /// Splats that are not shown and that files get all the same.
    pub hidden: Arc<SplatMarks>,
    /// Splats that are neither shown nor written to files.
    pub deleted: Arc<SplatMarks>,
    /// Least and largest corner, world units relative to the local origin: splats whose centres are
    /// outside are neither shown nor written.
    pub crop: Option<[DVec3; 2]>,
}

/// What becomes of the splats that were pointed at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SelectHow {
    /// They alone are selected.
    Replace,
    /// They are selected too.
    Add,
    /// They are no longer selected.
    Remove,
}

impl Edits {
    /// Whether a file gets less than everything.
    pub fn leaves_out(&self) -> bool {
        !self.deleted.is_empty() || self.crop.is_some()
    }

    /// Whether what is shown differs from the scene.
    pub fn is_shown(&self) -> bool {
        self.leaves_out() || !self.selected.is_empty() || !self.hidden.is_empty()
    }

    /// With another selection.
    pub fn selecting(&self, marks: SplatMarks, how: SelectHow) -> Self {
        let selected = match how {
            SelectHow::Replace => marks,
            SelectHow::Add => self.selected.with(&marks),
            SelectHow::Remove => self.selected.without(&marks),
        };
        Self { selected: Arc::new(selected), ..self.clone() }
    }

    /// With what is selected hidden, which then is selected no more.
    pub fn hiding(&self) -> Self {
        let hidden = Arc::new(self.hidden.with(&self.selected));
        Self { hidden, selected: Arc::default(), ..self.clone() }
    }

    /// With what is selected deleted, which then is selected no more.
    pub fn deleting(&self) -> Self {
        let deleted = Arc::new(self.deleted.with(&self.selected));
        Self { deleted, selected: Arc::default(), ..self.clone() }
    }
}
