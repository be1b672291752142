//! Contributions of recent frames, stored so that they can be moved with the frame (`scene.md`, Second
//! alignment).

use super::state::QUANTUM;
use super::sums::{MAX_TERM, MIXED, N_SUMS, SceneSums, clamp_moments};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

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

impl StoredFrame {
    /// Rotates the sums with the world.
    pub fn rotated(mut self, turn: DMat3) -> Self {
        self.taught.rotate(turn);
        self
    }
}

impl FrameContribution {
    /// Rotates the sums with the world.
    pub fn rotate(&mut self, turn: DMat3) {
        self.change(|_, sums| moved(sums, turn, DVec3::ZERO));
    }

    /// Returns the change of the sums if the same points are rotated by `turn` about the seed of each
    /// component and then shifted by `shift(component)`, in structural scales. Sums that would leave their
    /// bounds do not change.
    pub fn change_under_motion(mut self, turn: DMat3, shift: impl Fn(u32) -> DVec3 + Sync) -> Self {
        self.change(|id, sums| {
            let now = moved(sums, turn, shift(id));
            std::array::from_fn(|i| now[i].wrapping_sub(sums[i]))
        });
        self
    }

    fn change(&mut self, change: impl Fn(u32, &[i32; N_SUMS]) -> [i32; N_SUMS] + Sync) {
        let components = self.ids.par_iter().zip(&mut self.sums).with_min_len(256);
        components.for_each(|(&id, sums)| *sums = change(id, sums));
    }
}

/// Converts sums from whole quanta to numbers.
pub fn quanta_to_values(quanta: &[i32; N_SUMS]) -> [f64; N_SUMS] {
    quanta.map(|quanta| f64::from(quanta) * QUANTUM)
}

/// Returns the sums of the rotated and then shifted points; the old sums if the new ones are out of bounds.
fn moved(sums: &[i32; N_SUMS], turn: DMat3, shift: DVec3) -> [i32; N_SUMS] {
    let mut moved = SceneSums::new(&quanta_to_values(sums), 1.0)
        .rotated(turn)
        .about_shifted_seed(shift)
        .to_array();
    moved.iter_mut().for_each(|sum| *sum = whole(*sum / QUANTUM) * QUANTUM);
    clamp_moments(&mut moved, MIXED);
    let most = MAX_TERM * moved[0];
    match moved.iter().all(|sum| sum.abs() <= most) {
        true => moved.map(|sum| (sum / QUANTUM) as i32),
        false => *sums,
    }
}

/// Rounds to the nearest whole number, ties to even, for |x| below 2⁵¹. Adding and subtracting a large
/// constant avoids a function call on processors without a rounding instruction.
fn whole(x: f64) -> f64 {
    const SHIFTER: f64 = 1.5 * (1u64 << 52) as f64;
    x + SHIFTER - SHIFTER
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

#[cfg(test)]
mod kept_motion_tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};
    use crate::model::scene::sums::terms;
    use glam::DQuat;

    fn sum(points: &[[DVec3; 4]]) -> [i32; N_SUMS] {
        let mut sums = [0.0; N_SUMS];
        for &[place, color, normal, direction] in points {
            let [normal, direction] = [normal, direction].map(|v| v.as_vec3().to_array());
            let terms = terms::<f64>(place.to_array(), color.to_array(), normal, direction);
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        }
        sums.map(|sum| (sum / QUANTUM).round_ties_even() as i32)
    }

    fn points(n: usize, reach: f64) -> Vec<[DVec3; 4]> {
        let mut rng = Rng::new(5, Purpose::Synthetic, 0);
        let mut vector = |low: f64| DVec3::from_array([0; 3].map(|_| rng.range(low, 1.0)));
        let point = |_| {
            let [place, color] = [reach * vector(-1.0), vector(0.0)];
            [place, color, vector(-1.0).normalize(), vector(-1.0).normalize()]
        };
        (0..n).map(point).collect()
    }

    #[test]
    fn what_was_taught_moves_as_its_points() {
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.03, -0.2, 0.1)));
        let shift = DVec3::new(0.3, -0.1, 0.2);
        let before = points(20, 0.9);
        let after: Vec<_> = before
            .iter()
            .map(|&[place, color, n, v]| [turn * place + shift, color, turn * n, turn * v])
            .collect();
        let taught = FrameContribution { ids: vec![7], sums: vec![sum(&before)] };
        let by = |id: u32| if id == 7 { shift } else { DVec3::ZERO };
        let change = taught.clone().change_under_motion(turn, by);
        let now = sum(&after);
        let expected = now.iter().zip(taught.sums[0]).map(|(now, then)| now - then);
        // Rounding before and after the motion; the shift amplifies the former.
        assert!(change.sums[0].iter().zip(expected).all(|(a, b)| (a - b).abs() < 8));
        assert_eq!(change.ids, [7]);
        let nothing = taught.change_under_motion(DMat3::IDENTITY, |_| DVec3::ZERO);
        assert_eq!(nothing.sums, [[0; N_SUMS]]);
    }

    #[test]
    fn what_would_leave_its_bounds_stays() {
        let taught = FrameContribution { ids: vec![0], sums: vec![sum(&points(20, 0.9))] };
        let change =
            |by: f64| taught.clone().change_under_motion(DMat3::IDENTITY, |_| DVec3::X * by).sums;
        assert_eq!(change(3.0), [[0; N_SUMS]]);
        assert_ne!(change(0.5), [[0; N_SUMS]]);
    }
}
