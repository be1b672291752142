//! Contributions of recent frames, stored so that they can be moved with the frame (`train/scene/scene.md`, A
//! second look).

use super::sums::N_SUMS;
use glam::DVec3;

/// Means over some of a frame's points of one component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComponentObservation {
    /// Number of the component.
    pub component: u32,
    /// Mean position of the points under the recorded pose, world units from the scene's origin.
    pub position: DVec3,
    /// Mean colour in the scene's exposure.
    pub color: DVec3,
    /// Half-width of the depth noise, world units.
    pub noise: f64,
}

impl ComponentObservation {
    /// Creates the entry of a component without points.
    pub fn empty(component: u32) -> Self {
        Self { component, position: DVec3::ZERO, color: DVec3::ZERO, noise: 0.0 }
    }
}

/// Sums that a frame added to components.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameContribution {
    /// Component numbers, ascending.
    pub ids: Vec<u32>,
    /// Sums added to each, in whole quanta and in the order of [`N_SUMS`].
    pub sums: Vec<[i32; N_SUMS]>,
}

/// A frame whose pose may still be corrected, with all its contributions to the sums.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredFrame {
    /// Number of frames trained before it.
    pub frame: u64,
    /// Index in the log of corrected poses.
    pub log_index: u64,
    /// Standard deviation of its recorded position, world units.
    pub deviation: f64,
    /// Means of its points by component, for components that existed before the frame.
    pub shown: Vec<ComponentObservation>,
    /// Sums that it added.
    pub taught: FrameContribution,
}

impl StoredFrame {
    /// Returns the memory used, in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.shown[..]) + self.taught.bytes()
    }

    /// Returns a copy in which component `k` has the number `numbers[k]`.
    pub fn renumbered(&self, numbers: &[u32]) -> Self {
        let mut kept = self.clone();
        let number = |id: u32| numbers.get(id as usize).copied().unwrap_or(u32::MAX);
        kept.shown.iter_mut().for_each(|shown| shown.component = number(shown.component));
        kept.taught = self.taught.iter().map(|(id, sums)| (number(id), *sums)).collect();
        kept
    }
}

impl FrameContribution {
    /// Returns the memory used, in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.ids[..]) + size_of_val(&self.sums[..])
    }

    /// Appends components.
    pub fn append(&mut self, ids: &[u32], sums: &[[i32; N_SUMS]]) {
        self.ids.extend_from_slice(ids);
        self.sums.extend_from_slice(sums);
    }

    /// Sorts the components in ascending order.
    pub fn sorted(self) -> Self {
        if self.ids.is_sorted() {
            self
        } else {
            self.iter().map(|(id, sums)| (id, *sums)).collect()
        }
    }

    /// Iterates over the components and their sums.
    pub fn iter(&self) -> impl Iterator<Item = (u32, &[i32; N_SUMS])> {
        self.ids.iter().copied().zip(&self.sums)
    }

    /// Returns the sums added to a component, if any.
    pub fn of(&self, component: u32) -> Option<&[i32; N_SUMS]> {
        self.sums.get(self.ids.binary_search(&component).ok()?)
    }

    /// Removes components that are no longer `known`.
    pub fn retain(&mut self, known: impl Fn(u32) -> bool) {
        let kept = std::mem::take(self);
        *self = kept.ids.into_iter().zip(kept.sums).filter(|(id, _)| known(*id)).collect();
    }
}

/// Accepts components in any order.
impl FromIterator<(u32, [i32; N_SUMS])> for FrameContribution {
    fn from_iter<I: IntoIterator<Item = (u32, [i32; N_SUMS])>>(components: I) -> Self {
        let mut components: Vec<_> = components.into_iter().collect();
        components.sort_unstable_by_key(|(id, _)| *id);
        let (ids, sums) = components.into_iter().unzip();
        Self { ids, sums }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_found_by_number() {
        let sums = |value: i32| [value; N_SUMS];
        let shown = |component: u32| ComponentObservation {
            component,
            position: DVec3::ZERO,
            color: DVec3::ZERO,
            noise: 0.01,
        };
        let mut kept = StoredFrame {
            frame: 3,
            log_index: 2,
            deviation: 0.02,
            shown: vec![shown(1), shown(4)],
            taught: [(4, sums(40)), (1, sums(10)), (2, sums(20))].into_iter().collect(),
        };
        assert_eq!(kept.taught.ids, [1, 2, 4]);
        assert_eq!((kept.taught.of(4), kept.taught.of(3)), (Some(&sums(40)), None));
        let stored = kept.renumbered(&[0, 9, 1, 2, 3]);
        assert_eq!(stored.taught.ids, [1, 3, 9]);
        assert_eq!(stored.taught.of(9), Some(&sums(10)));
        assert_eq!(stored.shown.iter().map(|shown| shown.component).collect::<Vec<_>>(), [9, 3]);
        kept.taught.retain(|id| id != 2);
        assert_eq!((kept.taught.ids.len(), kept.taught.of(4)), (2, Some(&sums(40))));
    }
}
