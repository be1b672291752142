//! Components changed by the last frame.

use crate::train::learner::Changed;

#[derive(Default)]
pub(super) struct Changes {
    /// Ascending.
    listed: Vec<u32>,
    /// True if components that are not listed have changed too.
    has_changed_all: bool,
}

impl Changes {
    /// Begins a frame.
    pub fn restart(&mut self, has_changed_all: bool) {
        self.listed.clear();
        self.has_changed_all = has_changed_all;
    }

    /// Components with points in the frame, which training replaces.
    pub fn touched(&mut self) -> &mut Vec<u32> {
        &mut self.listed
    }

    pub fn listed(&self) -> &[u32] {
        &self.listed
    }

    /// Adds components, ascending.
    pub fn add(&mut self, changed: &[u32]) {
        self.listed.extend_from_slice(changed);
        // A stable sort, which merges the two sorted runs.
        self.listed.sort();
        self.listed.dedup();
    }

    pub fn add_all(&mut self) {
        self.has_changed_all = true;
    }

    pub fn get(&self) -> Changed<'_> {
        if self.has_changed_all { Changed::All } else { Changed::Listed(&self.listed) }
    }
}
