//! One splat's step: from what a photograph says of it to where it goes, and what is known of it then
//! (`photometric.md`, Step).

use super::rule::{PhotometricRule, PriorDeviations};
use crate::math::cholesky::SmallCholesky;
use crate::model::scene::photometric::{N_COLOR, N_COLOR_PRECISION, N_FORM, N_FORM_PRECISION};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use crate::render::cpu::photometric::ParameterSums;
use glam::{DQuat, DVec3};

/// Bounds of an opacity: a splat that photographs call transparent stays in sight of later ones.
const OPACITY: [f64; 2] = [0.01, 3.0];
/// Largest standard deviation over the smallest: thinner needles would be no surface.
const MAX_ASPECT: f64 = 1e4;

/// A splat with its precision, borrowed from the columns of a scene.
pub struct SplatSlot<'a> {
    pub splat: &'a mut Splat,
    pub appearance: &'a mut Appearance,
    pub form: &'a mut [f32; N_FORM_PRECISION],
    pub color: &'a mut [f32; N_COLOR_PRECISION],
}

impl SplatSlot<'_> {
    /// Forgets what photographs taught: the splat is what points say, and its precision the prior's.
    pub fn begin(&mut self, splat: Splat, appearance: Appearance, prior: &PriorDeviations) {
        (*self.splat, *self.appearance) = (splat, appearance);
        let (form, color) = prior_precision(&splat, prior);
        *self.form = diagonal(&form);
        *self.color = diagonal(&color);
    }

    /// Takes the step that a photograph asks for, whose pixels have the variance `variance`, and keeps
    /// what it says; whether the precision had to be taken back to the prior's.
    pub fn learn(&mut self, sums: &ParameterSums, variance: f64, rule: &PhotometricRule) -> bool {
        let per_variance = 1.0 / variance;
        let (prior_form, prior_color) = prior_precision(self.splat, &rule.prior);
        let extent = largest(self.splat);
        let form = absorb(self.form, &prior_form, &sums.curvature, per_variance, rule);
        if let Some(factor) = &form {
            self.move_by(factor.solve(sums.gradient.map(|g| g * per_variance)), rule.trust);
        }
        let color = absorb(self.color, &prior_color, &sums.color_curvature, per_variance, rule);
        if let Some(factor) = &color {
            for (k, gradient) in sums.color.iter().enumerate() {
                let step = factor.solve(gradient.map(|g| g * per_variance));
                self.recolor(k, step, 3.0 * rule.trust, extent);
            }
        }
        form.is_none() || color.is_none()
    }

    /// Moves and forms the splat anew, the whole step shortened to the trust region.
    fn move_by(&mut self, step: [f64; N_FORM], trust: f64) {
        let extent = largest(self.splat);
        let mean = DVec3::new(step[0], step[1], step[2]);
        let far = step[3..9].iter().fold(mean.length() / extent, |far, x| far.max(x.abs()));
        let far = far.max(step[9].abs() / 3.0) / trust;
        if !far.is_finite() {
            return;
        }
        let step = step.map(|x| x / far.max(1.0));
        let at = DVec3::from_array(self.splat.mean.map(f64::from));
        self.splat.mean = (at + DVec3::new(step[0], step[1], step[2])).as_vec3().to_array();
        let mut scale: [f64; 3] =
            std::array::from_fn(|i| f64::from(self.splat.scale[i]) * libm::exp(step[3 + i]));
        let least = scale.iter().fold(0.0f64, |a, &b| a.max(b)) / MAX_ASPECT;
        scale.iter_mut().for_each(|s| *s = s.max(least));
        self.splat.scale = scale.map(|s| s as f32);
        let [w, x, y, z] = self.splat.rotation.map(f64::from);
        // About the splat's own axes, to first order and back onto the sphere.
        let turn = DQuat::from_xyzw(0.5 * step[6], 0.5 * step[7], 0.5 * step[8], 1.0);
        let turned = (DQuat::from_xyzw(x, y, z, w) * turn).normalize();
        self.splat.rotation = [turned.w, turned.x, turned.y, turned.z].map(|q| q as f32);
        let opacity = f64::from(self.splat.opacity) * libm::exp(step[9]);
        self.splat.opacity = opacity.clamp(OPACITY[0], OPACITY[1]) as f32;
    }

    fn recolor(&mut self, k: usize, step: [f64; N_COLOR], limit: f64, extent: f64) {
        let squared = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>();
        let far = (squared(&step[..4]) + squared(&step[4..]) * extent * extent).sqrt() / limit;
        if !far.is_finite() {
            return;
        }
        let step = step.map(|x| x / far.max(1.0));
        self.splat.color[k] += step[0] as f32;
        for axis in 0..3 {
            self.appearance.directional[k][axis] += step[1 + axis] as f32;
            self.appearance.gradient[k][axis] += step[4 + axis] as f32;
        }
    }
}

fn largest(splat: &Splat) -> f64 {
    f64::from(splat.scale.iter().fold(f32::MIN_POSITIVE, |a, &s| a.max(s)))
}

fn prior_precision(splat: &Splat, prior: &PriorDeviations) -> ([f64; N_FORM], [f64; N_COLOR]) {
    let extent = largest(splat);
    let per = |deviation: f64| 1.0 / (deviation * deviation);
    let (mean, scale, turn) = (per(prior.mean * extent), per(prior.scale), per(prior.turn));
    let (directional, gradient) = (per(prior.directional), per(prior.gradient / extent));
    let form = [mean, mean, mean, scale, scale, scale, turn, turn, turn, per(prior.opacity)];
    let color =
        [per(prior.color), directional, directional, directional, gradient, gradient, gradient];
    (form, color)
}

/// Takes a frame's curvature into a precision, `Λ ← (1 − f)·Λ + f·Λ⁰ + µF`; the factor of `Λ + cF`, which
/// the frame's step is solved by. A sum that has no factor is no precision: it goes back to the prior's.
fn absorb<const N: usize, const P: usize>(
    triangle: &mut [f32; P],
    prior: &[f64; N],
    curvature: &[[f64; N]; N],
    per_variance: f64,
    rule: &PhotometricRule,
) -> Option<SmallCholesky<N>> {
    let mut precision = unpacked::<N>(triangle);
    let (damping, gained) = (rule.damping * per_variance, rule.kept * per_variance);
    let factor = SmallCholesky::new(std::array::from_fn(|i| {
        std::array::from_fn(|j| precision[i][j] + damping * curvature[i][j])
    }));
    match factor {
        None => *triangle = diagonal(prior),
        Some(_) => {
            for i in 0..N {
                for j in 0..=i {
                    let back = if i == j { rule.forgotten * prior[i] } else { 0.0 };
                    precision[i][j] =
                        (1.0 - rule.forgotten) * precision[i][j] + back + gained * curvature[i][j];
                }
            }
            packed(&precision, triangle);
        }
    }
    factor
}

fn diagonal<const N: usize, const P: usize>(values: &[f64; N]) -> [f32; P] {
    let mut triangle = [0.0; P];
    let matrix: [[f64; N]; N] =
        std::array::from_fn(|i| std::array::from_fn(|j| if i == j { values[i] } else { 0.0 }));
    packed(&matrix, &mut triangle);
    triangle
}

fn packed<const N: usize, const P: usize>(matrix: &[[f64; N]; N], triangle: &mut [f32; P]) {
    let lower = (0..N).flat_map(|i| (0..=i).map(move |j| (i, j)));
    for (to, (i, j)) in triangle.iter_mut().zip(lower) {
        *to = matrix[i][j] as f32;
    }
}

/// The lower triangle; what lies above is 0.
fn unpacked<const N: usize>(triangle: &[f32]) -> [[f64; N]; N] {
    let mut matrix = [[0.0; N]; N];
    let lower = (0..N).flat_map(|i| (0..=i).map(move |j| (i, j)));
    for (&from, (i, j)) in triangle.iter().zip(lower) {
        matrix[i][j] = f64::from(from);
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A splat with its columns.
    struct Own {
        splat: Splat,
        appearance: Appearance,
        form: [f32; N_FORM_PRECISION],
        color: [f32; N_COLOR_PRECISION],
    }

    impl Own {
        fn new() -> Self {
            let splat =
                Splat { opacity: 0.8, color: [0.5; 3], scale: [0.1; 3], ..Splat::default() };
            let mut own = Self {
                splat,
                appearance: Appearance::default(),
                form: [0.0; N_FORM_PRECISION],
                color: [0.0; N_COLOR_PRECISION],
            };
            own.slot().begin(splat, Appearance::default(), &PhotometricRule::DEFAULT.prior);
            own
        }

        fn slot(&mut self) -> SplatSlot<'_> {
            SplatSlot {
                splat: &mut self.splat,
                appearance: &mut self.appearance,
                form: &mut self.form,
                color: &mut self.color,
            }
        }
    }

    /// Ten pixels of full weight whose red is wrong by `residual`.
    fn redder(residual: f64) -> ParameterSums {
        let mut sums = ParameterSums {
            gradient: [0.0; N_FORM],
            curvature: [[0.0; N_FORM]; N_FORM],
            color: [[0.0; N_COLOR]; 3],
            color_curvature: [[0.0; N_COLOR]; N_COLOR],
            weight: 10.0,
        };
        sums.color[0][0] = 10.0 * residual;
        sums.color_curvature[0][0] = 10.0;
        sums
    }

    #[test]
    fn what_was_learnt_holds_against_what_comes() {
        let rule = PhotometricRule { forgotten: 0.0, ..PhotometricRule::DEFAULT };
        let mut own = Own::new();
        let mut steps = Vec::new();
        for _ in 0..3 {
            let before = own.splat.color[0];
            assert!(!own.slot().learn(&redder(0.2), 0.01, &rule));
            steps.push(own.splat.color[0] - before);
        }
        assert!(steps[0] > 0.05 && steps[0] < 0.25, "{steps:?}");
        assert!(steps.is_sorted_by(|a, b| a > b && *b > 0.0), "precision accumulates: {steps:?}");
        assert_eq!((own.splat.color[1], own.splat.mean), (0.5, [0.0; 3]));
    }

    #[test]
    fn a_step_ends_at_the_trust_region() {
        let mut own = Own::new();
        own.slot().learn(&redder(1e6), 0.01, &PhotometricRule::DEFAULT);
        let far = own.splat.color[0] - 0.5;
        assert!((f64::from(far) - 3.0 * PhotometricRule::DEFAULT.trust).abs() < 1e-6, "{far}");
    }

    #[test]
    fn a_block_that_is_none_is_repaired_and_moves_nothing() {
        let mut own = Own::new();
        let mut sums = redder(0.2);
        sums.curvature[0][0] = f64::NEG_INFINITY;
        let (before, prior) = (own.splat, own.form);
        assert!(own.slot().learn(&sums, 0.01, &PhotometricRule::DEFAULT));
        assert_eq!((own.splat.mean, own.splat.scale), (before.mean, before.scale));
        assert!(own.form.iter().zip(prior).all(|(a, b)| (a - b).abs() < 1e-2 * b.abs().max(1.0)));
    }
}
