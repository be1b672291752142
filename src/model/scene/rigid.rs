//! Rigid motion of the photometric state together with the world.

use super::photometric::{N_COLOR, N_FORM, PhotometricState};
use super::texels::TextureSums;
use crate::math::cholesky::at;
use crate::math::pose::Pose;
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::{Splat, rotation_array};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use std::sync::Arc;

// First indices of vectors in world axes among the parameters of a form and of a channel's colour; all other
// parameters are independent of the world's axes.
const FORM_VECTORS: [usize; 1] = [0];
const COLOR_VECTORS: [usize; 2] = [1, 4];

impl PhotometricState {
    /// Moves splats, their precision and the cameras of buffered photographs. `motion` maps old to new
    /// world coordinates.
    pub fn move_by(&mut self, motion: &Pose) {
        let turn = motion.rotation();
        let rotation = DQuat::from_mat3(&turn);
        let Self { splats, appearance, form, color, textures, .. } = self;
        splats.par_iter_mut().for_each(|splat| *splat = moved(splat, motion, rotation));
        appearance.par_iter_mut().for_each(|look| *look = turned(look, turn));
        form.par_iter_mut()
            .for_each(|lower| rotate_precision::<N_FORM>(lower, &FORM_VECTORS, turn));
        color
            .par_iter_mut()
            .for_each(|lower| rotate_precision::<N_COLOR>(lower, &COLOR_VECTORS, turn));
        textures.par_iter_mut().flatten().for_each(|texture| {
            let TextureSums { lattice, former, .. } = Arc::make_mut(texture);
            former.iter_mut().chain([lattice]).for_each(|lattice| lattice.move_by(motion));
        });
        let photographs = self.photograph_poses.iter_mut();
        // Every entry has a rotation, so all are moved.
        photographs.for_each(|pose| *pose = pose.transformed_by(motion).unwrap_or(*pose));
        self.buffered
            .iter_mut()
            .for_each(|photograph| photograph.view = photograph.view.moved(motion));
    }
}

/// Returns `splat` moved by `motion`. `turn` is the rotation of `motion`.
fn moved(splat: &Splat, motion: &Pose, turn: DQuat) -> Splat {
    let mean = motion.transform_point(DVec3::from_array(splat.mean.map(f64::from)));
    let rotation = rotation_array((turn * splat.quaternion()).normalize());
    Splat { mean: mean.as_vec3().to_array(), rotation, ..*splat }
}

fn turned(look: &Appearance, turn: DMat3) -> Appearance {
    let rows = |rows: [[f32; 3]; 3]| {
        rows.map(|row| (turn * DVec3::from_array(row.map(f64::from))).as_vec3().to_array())
    };
    let observed = look.observed.rotated(turn);
    Appearance { gradient: rows(look.gradient), directional: rows(look.directional), observed }
}

/// Rotates the precision matrix of `N` parameters, given by its lower triangle, to `T Λ Tᵀ`. `T` applies
/// `turn` to the parameter vectors that begin at the indices `vectors`.
fn rotate_precision<const N: usize>(lower: &mut [f32], vectors: &[usize], turn: DMat3) {
    let mut full = [[0.0; N]; N];
    for i in 0..N {
        for j in 0..=i {
            (full[i][j], full[j][i]) = (f64::from(lower[at(i, j)]), f64::from(lower[at(i, j)]));
        }
    }
    for &first in vectors {
        let rows = [0, 1, 2].map(|axis| full[first + axis]);
        for axis in 0..3 {
            let across = turn.row(axis);
            full[first + axis] = std::array::from_fn(|j| {
                across.x * rows[0][j] + across.y * rows[1][j] + across.z * rows[2][j]
            });
        }
        // The second factor: columns of `T Λ`, as the rows are rotated above.
        for row in &mut full {
            let along = turn * DVec3::from_slice(&row[first..first + 3]);
            row[first..first + 3].copy_from_slice(&along.to_array());
        }
    }
    for i in 0..N {
        for j in 0..=i {
            lower[at(i, j)] = full[i][j] as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    /// The quadratic form of any step is invariant under rotation of the world.
    #[test]
    fn precision_turns_with_its_vectors() {
        let mut rng = Rng::new(2, Purpose::Synthetic, 0);
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.5, -1.0, 0.3)));
        let lower: Vec<f32> = (0..28).map(|_| rng.range(-1.0, 1.0) as f32).collect();
        let step: [f64; N_COLOR] = [0; N_COLOR].map(|_| rng.range(-1.0, 1.0));
        let mut turned_step = step;
        for first in COLOR_VECTORS {
            let along = turn * DVec3::from_slice(&step[first..first + 3]);
            turned_step[first..first + 3].copy_from_slice(&along.to_array());
        }
        let form = |lower: &[f32], x: &[f64; N_COLOR]| -> f64 {
            let entry = |i: usize, j: usize| f64::from(lower[at(i.max(j), i.min(j))]);
            let row = |i: usize| (0..N_COLOR).map(move |j| (i, j));
            (0..N_COLOR).flat_map(row).map(|(i, j)| entry(i, j) * x[i] * x[j]).sum()
        };
        let mut turned = lower.clone();
        rotate_precision::<N_COLOR>(&mut turned, &COLOR_VECTORS, turn);
        let [before, after] = [form(&lower, &step), form(&turned, &turned_step)];
        assert!((before - after).abs() < 1e-5, "{before} {after}");
        assert_eq!(turned[0], lower[0]);
        assert!((form(&turned, &step) - before).abs() > 1e-3, "vectors turn");
    }

    #[test]
    fn axes_and_colours_turn_with_the_world() {
        let turn = DQuat::from_scaled_axis(DVec3::new(0.2, 0.7, -0.4));
        let motion = Pose::IDENTITY.attached_camera(DVec3::new(1.0, 2.0, -3.0), turn);
        let splat =
            Splat { mean: [1.0, 0.5, 2.0], rotation: [0.8, 0.0, 0.6, 0.0], ..Splat::default() };
        let axis = |splat: &Splat| splat.quaternion() * DVec3::X;
        let after = moved(&splat, &motion, turn);
        assert!((turn * axis(&splat) - axis(&after)).length() < 1e-6);
        let place = motion.transform_point(DVec3::new(1.0, 0.5, 2.0));
        assert!((place - DVec3::from_array(after.mean.map(f64::from))).length() < 1e-6);
        let row = [0.1, -0.2, 0.3];
        let look =
            Appearance { gradient: [row; 3], directional: [[0.0; 3]; 3], ..Appearance::default() };
        let along = DVec3::from_array(turned(&look, motion.rotation()).gradient[2].map(f64::from));
        // The same point on the splat keeps its colour.
        let offset = DVec3::new(0.3, 0.1, -0.2);
        let [before, after] = [(row.map(f64::from), offset), (along.to_array(), turn * offset)]
            .map(|(row, offset)| DVec3::from_array(row).dot(offset));
        assert!((before - after).abs() < 1e-6);
    }
}
