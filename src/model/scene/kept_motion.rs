//! Rigid motion of a frame's stored contributions to the sums.

use super::bounds::{MIXED, clamp_moments};
use super::kept::{FrameContribution, StoredFrame};
use super::state::QUANTUM;
use super::sums::{MAX_TERM, N_SUMS, SceneSums};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

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
