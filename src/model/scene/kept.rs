//! What a frame taught, kept for a while so that it can be moved with the frame
//! (`train/scene/scene.md`, A second look).

use super::sums::N_SUMS;
use glam::DVec3;

/// What a frame shows of a component: means of some of its points there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Number of the component.
    pub component: u32,
    /// Where the points are from the recorded pose, world units from the scene's origin.
    pub place: DVec3,
    /// Their colour in the scene's exposure.
    pub color: DVec3,
    /// Half-width of their depth's noise, world units.
    pub noise: f64,
}

impl Shown {
    /// Of no points.
    pub fn nothing(component: u32) -> Self {
        Self { component, place: DVec3::ZERO, color: DVec3::ZERO, noise: 0.0 }
    }
}

/// What a frame added to the sums of components.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Taught {
    /// Components, ascending.
    pub ids: Vec<u32>,
    /// What each of them received, in whole quanta and in the order of [`N_SUMS`].
    pub sums: Vec<[i32; N_SUMS]>,
}

/// A frame that may still move, with all that it taught of points.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptFrame {
    /// Frames that were learnt before it.
    pub frame: u64,
    /// Its place among the corrected poses.
    pub logged: u64,
    /// Standard deviation of its recorded place, world units.
    pub deviation: f64,
    /// What it shows of components that were known before it.
    pub shown: Vec<Shown>,
    /// What it added.
    pub taught: Taught,
}

impl KeptFrame {
    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.shown[..]) + self.taught.bytes()
    }

    /// The same where component `k` has the number `numbers[k]`.
    pub fn renumbered(&self, numbers: &[u32]) -> Self {
        let mut kept = self.clone();
        let number = |id: u32| numbers.get(id as usize).copied().unwrap_or(u32::MAX);
        kept.shown.iter_mut().for_each(|shown| shown.component = number(shown.component));
        kept.taught = self.taught.iter().map(|(id, sums)| (number(id), *sums)).collect();
        kept
    }
}

impl Taught {
    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.ids[..]) + size_of_val(&self.sums[..])
    }

    /// Adds components behind the others.
    pub fn append(&mut self, ids: &[u32], sums: &[[i32; N_SUMS]]) {
        self.ids.extend_from_slice(ids);
        self.sums.extend_from_slice(sums);
    }

    /// The same with its components in ascending order.
    pub fn in_order(self) -> Self {
        if self.ids.is_sorted() {
            self
        } else {
            self.iter().map(|(id, sums)| (id, *sums)).collect()
        }
    }

    /// Every component with what it received.
    pub fn iter(&self) -> impl Iterator<Item = (u32, &[i32; N_SUMS])> {
        self.ids.iter().copied().zip(&self.sums)
    }

    /// What a component received, if anything.
    pub fn of(&self, component: u32) -> Option<&[i32; N_SUMS]> {
        self.sums.get(self.ids.binary_search(&component).ok()?)
    }

    /// Leaves out components that are not `known` any more.
    pub fn retain(&mut self, known: impl Fn(u32) -> bool) {
        let kept = std::mem::take(self);
        *self = kept.ids.into_iter().zip(kept.sums).filter(|(id, _)| known(*id)).collect();
    }
}

/// In any order.
impl FromIterator<(u32, [i32; N_SUMS])> for Taught {
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
        let shown = |component: u32| Shown {
            component,
            place: DVec3::ZERO,
            color: DVec3::ZERO,
            noise: 0.01,
        };
        let mut kept = KeptFrame {
            frame: 3,
            logged: 2,
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
