//! Which components the viewport has yet to be told of.

/// Components that changed since the viewport was last told.
#[derive(Default)]
pub struct Dirty {
    // The list, since most frames change few components; the flags, since a frame may list one that
    // still waits from the frame before.
    ids: Vec<u32>,
    is_dirty: Vec<bool>,
}

impl Dirty {
    /// Whether the viewport knows of every change.
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Adds components; new ones may be among them.
    pub fn mark(&mut self, ids: &[u32]) {
        for &id in ids {
            let n = self.is_dirty.len().max(id as usize + 1);
            self.is_dirty.resize(n, false);
            if !std::mem::replace(&mut self.is_dirty[id as usize], true) {
                self.ids.push(id);
            }
        }
    }

    /// Adds all of so many components.
    pub fn mark_all(&mut self, components: usize) {
        self.ids = (0..components as u32).collect();
        self.is_dirty = vec![true; components];
    }

    /// The components, each once; none are left.
    pub fn take(&mut self) -> Vec<u32> {
        // One by one: to clear all flags would cost as much as the scene is large, at every update.
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
