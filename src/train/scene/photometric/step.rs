//! Photometric steps of splats and updates of their precision (`photographs.md`, Step). Eight splats are
//! processed at a time, one per SIMD lane.

use super::rule::{PhotometricRule, PriorDeviations};
use crate::math::cholesky::{at, factor, substitute};
use crate::math::simd::{Kernel, LANES, Vector, gather_rows, scatter_rows};
use crate::model::scene::photometric::{N_COLOR, N_COLOR_PRECISION, N_FORM, N_FORM_PRECISION};
use crate::model::scene::splat_rule::PointExtent;
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::{Splat, rotation_array};
use crate::render::cpu::photometric::{ParameterSums, PhotometricSums, VisibleSplat};
use glam::{DMat3, DQuat, DVec3};

/// Minimum opacity after a photometric step. So a splat that one photograph makes transparent still
/// appears in later photographs.
pub const LEAST_OPACITY: f64 = 0.01;
// Deviation of a colour coefficient that is not trained, colour units: so small that its row in a block has
// no effect.
const HELD: f64 = 1e-4;
// Maximum ratio of standard deviations: thinner needles represent no surface.
const MAX_ASPECT: f64 = 1e4;

/// Maximum scale of a splat along each of its axes, relative to the splat derived from its component's
/// points. The mean stays within one standard deviation of the derived splat.
const MOST_SCALE: f64 = 2.0;

/// Consecutive splats of a scene with their precisions, borrowed for one task.
pub struct SplatRun<'a> {
    pub first: usize,
    pub splats: &'a mut [Splat],
    pub appearance: &'a mut [Appearance],
    pub form: &'a mut [[f32; N_FORM_PRECISION]],
    pub color: &'a mut [[f32; N_COLOR_PRECISION]],
}

/// Kernel that takes the photometric steps of a run of splats for one photograph. Returns the number of
/// splats whose precision was reset to the prior.
pub struct LearnRun<'a> {
    pub run: SplatRun<'a>,
    pub compared: &'a PhotometricSums<'a>,
    pub seen: &'a [VisibleSplat],
    pub variance: f64,
    pub rule: &'a PhotometricRule,
    pub extents: &'a PointExtents<'a>,
}

/// Function that returns mean and extent of a component's points; `None` if there are no points.
pub type PointExtents<'a> = dyn Fn(usize) -> Option<PointExtent> + Sync + 'a;

impl Kernel for LearnRun<'_> {
    type Output = u64;

    #[inline(always)]
    fn run<V: Vector>(self) -> u64 {
        let Self { mut run, compared, seen, variance, rule, extents } = self;
        let mut repaired = 0;
        let (mut group, mut rows) = (Vec::with_capacity(LANES), Vec::with_capacity(LANES));
        for seen in seen.chunks(LANES) {
            group.clear();
            rows.clear();
            for &seen in seen {
                let row = seen.id as usize - run.first;
                group.push((seen, run.splats[row], run.appearance[row]));
                rows.push(row);
            }
            let sums = compared.parameter_sums::<V>(&group);
            repaired += run.step_rows(&rows, &sums, variance, rule);
            for (&row, &(_, splat, look)) in rows.iter().zip(&group) {
                if let Some(extent) = extents(run.first + row) {
                    // Clamped after the step, since its trust region does not bound the sum of many
                    // steps.
                    clamp_to_points(&mut run.splats[row], &extent);
                }
                // Malformed files hold sums whose points have no extent.
                if !(run.splats[row].is_valid() && run.appearance[row].is_valid()) {
                    (run.splats[row], run.appearance[row]) = (splat, look);
                }
            }
        }
        repaired
    }
}

impl SplatRun<'_> {
    /// Returns the entries of an ascending `list` that refer to splats of this run. `splat` returns the
    /// splat number of an entry.
    pub fn own<'l, T>(&self, list: &'l [T], splat: impl Fn(&T) -> u32) -> &'l [T] {
        let before = |end: usize| list.partition_point(|entry| (splat(entry) as usize) < end);
        &list[before(self.first)..before(self.first + self.splats.len())]
    }

    pub fn has(&self, row: usize) -> bool {
        self.splats[row].opacity > 0.0
    }

    /// Initialises the splat in `row` with the given parameters and the prior's precision.
    pub fn begin(&mut self, row: usize, splat: Splat, look: Appearance, prior: &PriorDeviations) {
        (self.splats[row], self.appearance[row]) = (splat, look);
        let (form, color) = prior_precision(&splat, prior);
        self.form[row] = diagonal(&form);
        self.color[row] = diagonal(&color);
    }

    /// Takes the photometric step of up to eight splats, one per SIMD lane, and updates their
    /// precisions. `variance` is the colour variance of a pixel. Returns the number of splats whose
    /// precision was reset to the prior.
    #[inline(always)]
    fn step_rows<V: Vector>(
        &mut self,
        rows: &[usize],
        sums: &ParameterSums<V>,
        variance: f64,
        rule: &PhotometricRule,
    ) -> u64 {
        let weight = V::splat((1.0 / variance) as f32);
        let mut priors = ([[0.0; LANES]; N_FORM], [[0.0; LANES]; N_COLOR]);
        for (lane, &row) in rows.iter().enumerate() {
            let (form, color) = prior_precision(&self.splats[row], &rule.prior);
            (0..N_FORM).for_each(|i| priors.0[i][lane] = form[i] as f32);
            (0..N_COLOR).for_each(|i| priors.1[i][lane] = color[i] as f32);
        }
        let (form, form_is_sound) = update_precision::<V, N_FORM, N_FORM_PRECISION>(
            self.form,
            rows,
            &priors.0,
            &sums.curvature,
            weight,
            rule,
        );
        let (color, color_is_sound) = update_precision::<V, N_COLOR, N_COLOR_PRECISION>(
            self.color,
            rows,
            &priors.1,
            &sums.color_curvature,
            weight,
            rule,
        );
        let step = solved(&form, &sums.gradient, weight);
        let mut recolor = [[[0.0; LANES]; N_COLOR]; 3];
        for (recolor, gradient) in recolor.iter_mut().zip(&sums.color) {
            *recolor = solved(&color, gradient, weight);
        }
        for (lane, &row) in rows.iter().enumerate() {
            let (splat, look) = (&mut self.splats[row], &mut self.appearance[row]);
            let extent = largest(splat);
            if form_is_sound & (1 << lane) != 0 {
                apply_form_step(splat, std::array::from_fn(|i| f64::from(step[i][lane])), rule);
            }
            if color_is_sound & (1 << lane) != 0 {
                for (k, recolored) in recolor.iter().enumerate() {
                    let step = std::array::from_fn(|i| f64::from(recolored[i][lane]));
                    apply_color_step(splat, look, k, step, rule, extent);
                }
            }
        }
        let is_repaired = |lane: &usize| form_is_sound & color_is_sound & (1 << lane) == 0;
        (0..rows.len()).filter(is_repaired).count() as u64
    }
}

/// Updates precisions `Λ` with the curvature `F` of a frame: `Λ ← (1 − f)·Λ + f·Λ⁰ + µF`. Here `f` is
/// `rule.forgotten`, `Λ⁰` the prior precision and `µ` is `rule.kept`. Also returns the Cholesky factors
/// of `Λ + cF`, with `c = rule.damping`, and a bit mask of the lanes whose factorisation succeeded.
/// Where `Λ + cF` is not positive definite, the precision is reset to the prior.
#[inline(always)]
fn update_precision<V: Vector, const N: usize, const P: usize>(
    triangles: &mut [[f32; P]],
    rows: &[usize],
    prior: &[[f32; LANES]; N],
    curvature: &[V; P],
    weight: V,
    rule: &PhotometricRule,
) -> ([V; P], u32) {
    // Unused lanes hold the unit matrix.
    let mut unit = [0.0; P];
    (0..N).for_each(|i| unit[at(i, i)] = 1.0);
    let row = |lane: usize| rows.get(lane).map_or(&unit, |&row| &triangles[row]);
    let mut kept: [V; P] = gather_rows(std::array::from_fn(row));
    let (damping, gained) =
        (weight * V::splat(rule.damping as f32), weight * V::splat(rule.kept as f32));
    let mut factors = kept;
    for (damped, curvature) in factors.iter_mut().zip(curvature) {
        *damped = *damped + damping * *curvature;
    }
    let sound = factor::<V, N, P>(&mut factors);
    let remembered = V::splat((1.0 - rule.forgotten) as f32);
    for i in 0..N {
        for j in 0..=i {
            // The prior has no correlations.
            let prior = if i == j { V::load(&prior[i]) } else { V::splat(0.0) };
            let back = V::splat(rule.forgotten as f32) * prior;
            let kept = &mut kept[at(i, j)];
            let new = remembered * *kept + back + gained * curvature[at(i, j)];
            *kept = V::select(sound, new, prior);
        }
    }
    scatter_rows(&kept, rows, triangles);
    (factors, sound.sign_bits())
}

#[inline(always)]
fn solved<V: Vector, const N: usize, const P: usize>(
    factors: &[V; P],
    gradient: &[V; N],
    weight: V,
) -> [[f32; LANES]; N] {
    let mut x = *gradient;
    for x in &mut x {
        *x = *x * weight;
    }
    substitute(factors, &mut x);
    let mut lanes = [[0.0; LANES]; N];
    for (lanes, x) in lanes.iter_mut().zip(x) {
        x.store(lanes);
    }
    lanes
}

/// Applies a step to position, scales, rotation and opacity of a splat. A step beyond the trust region
/// is scaled down as a whole.
fn apply_form_step(splat: &mut Splat, step: [f64; N_FORM], rule: &PhotometricRule) {
    let extent = largest(splat);
    let mean = DVec3::new(step[0], step[1], step[2]);
    let far = step[3..9].iter().fold(mean.length() / extent, |far, x| far.max(x.abs()));
    // Opacities may change three times as much.
    let far = far.max(step[9].abs() / 3.0) / rule.trust;
    // A step that is not finite has no direction.
    if !far.is_finite() {
        return;
    }
    // As a whole, so that the direction of the step is kept.
    let step = step.map(|x| x / far.max(1.0));
    let at = DVec3::from_array(splat.mean.map(f64::from));
    splat.mean = (at + DVec3::new(step[0], step[1], step[2])).as_vec3().to_array();
    let mut scale: [f64; 3] =
        // Steps of scales and opacity are logarithmic: both stay positive.
        std::array::from_fn(|i| f64::from(splat.scale[i]) * libm::exp(step[3 + i]));
    let least = scale.iter().fold(0.0f64, |a, &b| a.max(b)) / MAX_ASPECT;
    scale.iter_mut().for_each(|s| *s = s.max(least));
    splat.scale = scale.map(|s| s as f32);
    // Rotation about the splat's own axes: first order, then normalised.
    let turn = DQuat::from_xyzw(0.5 * step[6], 0.5 * step[7], 0.5 * step[8], 1.0);
    splat.rotation = rotation_array((splat.quaternion() * turn).normalize());
    let opacity = f64::from(splat.opacity) * libm::exp(step[9]);
    splat.opacity = opacity.clamp(LEAST_OPACITY, rule.most_opacity) as f32;
}

/// Applies a step to one colour channel of a splat. A step beyond the trust region is scaled down.
/// `extent` is the splat's largest scale, world units.
fn apply_color_step(
    splat: &mut Splat,
    look: &mut Appearance,
    channel: usize,
    mut step: [f64; N_COLOR],
    rule: &PhotometricRule,
    extent: f64,
) {
    // A deviation of 0 excludes coefficients; their precision `HELD` is finite, so they would
    // still move a little.
    if rule.prior.directional == 0.0 {
        step[1..4].fill(0.0);
    }
    if rule.prior.gradient == 0.0 {
        step[4..].fill(0.0);
    }
    let squared = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>();
    let far =
        (squared(&step[..4]) + squared(&step[4..]) * extent * extent).sqrt() / (3.0 * rule.trust);
    if !far.is_finite() {
        return;
    }
    let step = step.map(|x| x / far.max(1.0));
    splat.color[channel] += step[0] as f32;
    for axis in 0..3 {
        look.directional[channel][axis] += step[1 + axis] as f32;
        look.gradient[channel][axis] += step[4 + axis] as f32;
    }
}

/// Limits position and scales of a splat to the extent of its component's points. Photographs from one
/// side alone determine neither the size nor the position along the view direction.
fn clamp_to_points(splat: &mut Splat, extent: &PointExtent) {
    let axes = DMat3::from_quat(splat.quaternion().normalize());
    let at = DVec3::from_array(splat.mean.map(f64::from));
    let mut offset = axes.transpose() * (at - extent.mean);
    let mut is_beyond = false;
    for axis in 0..3 {
        // Rounding can make the variance of a flat component slightly negative.
        let deviation = extent.covariance.quadratic_form(axes.col(axis)).max(0.0).sqrt();
        splat.scale[axis] = splat.scale[axis].min((MOST_SCALE * deviation) as f32);
        is_beyond |= offset[axis].abs() > deviation;
        offset[axis] = offset[axis].clamp(-deviation, deviation);
    }
    // Otherwise left unchanged, so that the bits are exactly those of the step.
    if is_beyond {
        splat.mean = (extent.mean + axes * offset).as_vec3().to_array();
    }
}

fn largest(splat: &Splat) -> f64 {
    // Never 0, since steps are divided by it.
    f64::from(splat.scale.iter().fold(f32::MIN_POSITIVE, |a, &s| a.max(s)))
}

/// Returns the prior precisions of position, scales, rotation and opacity of a splat, and of one colour
/// channel.
pub fn prior_precision(splat: &Splat, prior: &PriorDeviations) -> ([f64; N_FORM], [f64; N_COLOR]) {
    let extent = largest(splat);
    let (mean, scale, turn) =
        (precision_of(prior.mean * extent), precision_of(prior.scale), precision_of(prior.turn));
    let directional = precision_of(prior.directional.max(HELD));
    let gradient = precision_of(prior.gradient.max(HELD) / extent);
    let form =
        [mean, mean, mean, scale, scale, scale, turn, turn, turn, precision_of(prior.opacity)];
    let color = [
        precision_of(prior.color),
        directional,
        directional,
        directional,
        gradient,
        gradient,
        gradient,
    ];
    (form, color)
}

/// True if a photometric step has changed the colour precision since the splat was initialised.
pub fn is_trained(color: &[f32; N_COLOR_PRECISION], prior: &PriorDeviations) -> bool {
    // An exact comparison suffices, since `begin` stores this very value.
    color[0] != precision_of(prior.color) as f32
}

fn precision_of(deviation: f64) -> f64 {
    1.0 / (deviation * deviation)
}

fn diagonal<const N: usize, const P: usize>(values: &[f64; N]) -> [f32; P] {
    let mut triangle = [0.0; P];
    for (i, value) in values.iter().enumerate() {
        triangle[at(i, i)] = *value as f32;
    }
    triangle
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::simd::Isa;

    struct Own {
        splats: [Splat; 1],
        appearance: [Appearance; 1],
        form: [[f32; N_FORM_PRECISION]; 1],
        color: [[f32; N_COLOR_PRECISION]; 1],
    }

    impl Own {
        fn new() -> Self {
            let splat =
                Splat { opacity: 0.8, color: [0.5; 3], scale: [0.1; 3], ..Splat::default() };
            let mut own = Self {
                splats: [splat],
                appearance: [Appearance::default()],
                form: [[0.0; N_FORM_PRECISION]],
                color: [[0.0; N_COLOR_PRECISION]],
            };
            let prior = PhotometricRule::DEFAULT.prior;
            own.run().begin(0, splat, Appearance::default(), &prior);
            own
        }

        fn run(&mut self) -> SplatRun<'_> {
            SplatRun {
                first: 0,
                splats: &mut self.splats,
                appearance: &mut self.appearance,
                form: &mut self.form,
                color: &mut self.color,
            }
        }

        fn learn(&mut self, residual: f32, curvature: f32, rule: &PhotometricRule) -> u64 {
            Isa::best().run(Redder { run: self.run(), residual, curvature, rule })
        }
    }

    /// Kernel that takes the step for ten pixels of full weight with an error of `residual` in red.
    struct Redder<'a> {
        run: SplatRun<'a>,
        residual: f32,
        /// Curvature of the mean along x.
        curvature: f32,
        rule: &'a PhotometricRule,
    }

    impl Kernel for Redder<'_> {
        type Output = u64;

        #[inline(always)]
        fn run<V: Vector>(mut self) -> u64 {
            let zero = V::splat(0.0);
            let mut sums = ParameterSums {
                gradient: [zero; N_FORM],
                curvature: [zero; N_FORM_PRECISION],
                color: [[zero; N_COLOR]; 3],
                color_curvature: [zero; N_COLOR_PRECISION],
            };
            sums.curvature[0] = V::splat(self.curvature);
            sums.color[0][0] = V::splat(10.0 * self.residual);
            sums.color_curvature[0] = V::splat(10.0);
            self.run.step_rows(&[0], &sums, 0.01, self.rule)
        }
    }

    #[test]
    fn what_was_learnt_holds_against_what_comes() {
        let rule = PhotometricRule { forgotten: 0.0, ..PhotometricRule::DEFAULT };
        let mut own = Own::new();
        let mut steps = Vec::new();
        for _ in 0..3 {
            let before = own.splats[0].color[0];
            assert_eq!(own.learn(0.2, 0.0, &rule), 0);
            steps.push(own.splats[0].color[0] - before);
        }
        assert!(steps[0] > 0.05 && steps[0] < 0.25, "{steps:?}");
        assert!(steps.is_sorted_by(|a, b| a > b && *b > 0.0), "precision accumulates: {steps:?}");
        assert_eq!((own.splats[0].color[1], own.splats[0].mean), (0.5, [0.0; 3]));
    }

    #[test]
    fn a_step_ends_at_the_trust_region() {
        let mut own = Own::new();
        own.learn(1e6, 0.0, &PhotometricRule::DEFAULT);
        let far = own.splats[0].color[0] - 0.5;
        assert!((f64::from(far) - 3.0 * PhotometricRule::DEFAULT.trust).abs() < 1e-6, "{far}");
    }

    #[test]
    fn a_block_that_is_none_is_repaired_and_moves_nothing() {
        let mut own = Own::new();
        let (before, prior) = (own.splats[0], own.form);
        assert_eq!(own.learn(0.2, f32::NEG_INFINITY, &PhotometricRule::DEFAULT), 1);
        let after = own.splats[0];
        assert_eq!((after.mean, after.scale), (before.mean, before.scale));
        assert_eq!(own.form, prior);
    }
}
