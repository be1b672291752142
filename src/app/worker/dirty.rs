//! Components whose changes the viewport has not received.

/// Set of components that changed since the last update of the viewport.
#[derive(Default)]
pub struct Dirty {
    // The list, because most frames change few components; the flags, because a frame may list a
    // component that is already in the list.
    ids: Vec<u32>,
    is_dirty: Vec<bool>,
}

impl Dirty {
    /// True if the viewport has received every change.
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Adds components, which may be new.
    pub fn mark(&mut self, ids: &[u32]) {
        for &id in ids {
            let n = self.is_dirty.len().max(id as usize + 1);
            self.is_dirty.resize(n, false);
            if !std::mem::replace(&mut self.is_dirty[id as usize], true) {
                self.ids.push(id);
            }
        }
    }

    /// Adds all components.
    pub fn mark_all(&mut self, components: usize) {
        self.ids = (0..components as u32).collect();
        self.is_dirty = vec![true; components];
    }

    /// Returns each component once, and empties the set.
    pub fn take(&mut self) -> Vec<u32> {
        // One by one: clearing all flags would cost time in proportion to the scene at every update.
        for &id in &self.ids {
            self.is_dirty[id as usize] = false;
        }
        std::mem::take(&mut self.ids)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_told_once_and_may_be_new() {
        let mut dirty = Dirty::default();
        dirty.mark(&[2, 0, 2]);
        dirty.mark(&[7, 0]);
        assert_eq!(dirty.take(), [2, 0, 7]);
        assert!(dirty.is_empty());
        dirty.mark(&[1]);
        dirty.mark_all(3);
        dirty.mark(&[2, 3]);
        assert_eq!(dirty.take(), [0, 1, 2, 3]);
    }
}
