//! Fusion of photometric estimates of one component from several scenes.
//!
//! Each scene's estimate is a Gaussian about its splat. With `Λ₀, θ₀` at the start and `Λᵢ, θᵢ` after scene
//! `i`'s own frames, these frames add the precision `Δᵢ = Λᵢ − dᵢ Λ₀` (`dᵢ` is the share of the start that
//! forgetting has left) and the information `Λᵢ (θᵢ − θ₀)`. Both add, and
//! `θ = θ₀ + (d Λ₀ + Σ Δᵢ)⁻¹ Σ Λᵢ (θᵢ − θ₀)` with `d` the product of all `dᵢ`: the result of a single run
//! over all frames if pictures were linear in the parameters. They are for colours, and approximately for
//! position and form near the start; rotations and log scales are compared to first order.

use crate::math::cholesky::Cholesky;
use crate::math::lane_cholesky::at;
use crate::model::scene::photometric::{
    N_COLOR, N_COLOR_PRECISION, N_FORM, N_FORM_PRECISION, PhotometricState,
};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use crate::train::scene::photometric::rule::PhotometricRule;
use crate::train::scene::photometric::{LEAST_OPACITY, is_trained, prior_precision};
use glam::{DQuat, DVec3};

/// Maximum rotation between two estimates of one splat whose forms are compared, radians: beyond it their
/// axes do not correspond.
const MAX_TURN: f64 = 0.5;

/// Photometric estimate of one splat: parameters and precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    splat: Splat,
    appearance: Appearance,
    form: [f32; N_FORM_PRECISION],
    color: [f32; N_COLOR_PRECISION],
}

/// Estimate that continued from the start.
#[derive(Clone, Copy)]
pub struct Later {
    pub estimate: Estimate,
    /// Frames since the start that showed the component.
    pub frames: u16,
}

impl Estimate {
    /// Reads the estimate of a component; `None` without a splat.
    pub fn of(state: &PhotometricState, component: usize) -> Option<Self> {
        state.has_splat(component).then(|| Self {
            splat: state.splats[component],
            appearance: state.appearance[component],
            form: state.form[component],
            color: state.color[component],
        })
    }

    /// True if a photograph has increased its precision.
    pub fn is_taught(&self, rule: &PhotometricRule) -> bool {
        is_trained(&self.color, &rule.prior)
    }

    /// Writes the estimate into the row of a component.
    pub fn put(&self, state: &mut PhotometricState, component: usize) {
        state.splats[component] = self.splat;
        state.appearance[component] = self.appearance;
        state.form[component] = self.form;
        state.color[component] = self.color;
    }

    /// Returns the difference in position and form from `other`, in the other's parameters; `None` if their
    /// axes do not correspond.
    fn form_difference(&self, other: &Self) -> Option<[f64; N_FORM]> {
        let (a, b) = (&self.splat, &other.splat);
        let turn = (rotation(b).conjugate() * rotation(a)).normalize();
        let turn = if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis();
        if turn.length() > MAX_TURN {
            return None;
        }
        let mut step = [0.0; N_FORM];
        for i in 0..3 {
            step[i] = f64::from(a.mean[i]) - f64::from(b.mean[i]);
            step[3 + i] = log_ratio(a.scale[i], b.scale[i]);
            step[6 + i] = turn[i];
        }
        step[9] = log_ratio(a.opacity, b.opacity);
        step.iter().all(|x| x.is_finite()).then_some(step)
    }

    /// Returns the difference of a channel's coefficients from those of `other`.
    fn color_difference(&self, other: &Self, channel: usize) -> [f64; N_COLOR] {
        let (a, b) = (self.coefficients(channel), other.coefficients(channel));
        std::array::from_fn(|i| f64::from(a[i]) - f64::from(b[i]))
    }

    fn coefficients(&self, channel: usize) -> [f32; N_COLOR] {
        let ([a, b, c], [d, e, f]) =
            (self.appearance.directional[channel], self.appearance.gradient[channel]);
        [self.splat.color[channel], a, b, c, d, e, f]
    }

    fn apply_form_step(&mut self, step: &[f64], precision: &[f64], most_opacity: f64) {
        let splat = &mut self.splat;
        for i in 0..3 {
            splat.mean[i] = (f64::from(splat.mean[i]) + step[i]) as f32;
            splat.scale[i] = (f64::from(splat.scale[i]) * libm::exp(step[3 + i])) as f32;
        }
        let turn = DQuat::from_scaled_axis(DVec3::new(step[6], step[7], step[8]));
        let turned = (rotation(splat) * turn).normalize();
        splat.rotation = [turned.w, turned.x, turned.y, turned.z].map(|q| q as f32);
        let opacity = f64::from(splat.opacity) * libm::exp(step[9]);
        splat.opacity = opacity.clamp(LEAST_OPACITY, most_opacity) as f32;
        put_triangle::<N_FORM>(&mut self.form, precision);
    }

    fn apply_color_step(&mut self, steps: &[Vec<f64>; 3], precision: &[f64]) {
        for (channel, step) in steps.iter().enumerate() {
            let old = self.coefficients(channel);
            let new: [f32; N_COLOR] = std::array::from_fn(|i| (f64::from(old[i]) + step[i]) as f32);
            self.splat.color[channel] = new[0];
            self.appearance.directional[channel] = [new[1], new[2], new[3]];
            self.appearance.gradient[channel] = [new[4], new[5], new[6]];
        }
        put_triangle::<N_COLOR>(&mut self.color, precision);
    }
}

/// Combines everything that `later` gained since `start`; without a start all estimates count equally. `None`
/// if there are none.
pub fn fused(start: Option<Estimate>, later: &[Later], rule: &PhotometricRule) -> Option<Estimate> {
    let base = start.or(later.first().map(|later| later.estimate))?;
    let (form_prior, color_prior) = prior_precision(&base.splat, &rule.prior);
    // Without a start every estimate began with the prior alone.
    let known = if start.is_some() { 1.0 } else { 0.0 };
    let remembers = |later: &Later| known * (1.0 - rule.forgotten).powi(later.frames.into());
    let mut form = Joint::<N_FORM, 1>::new();
    let mut color = Joint::<N_COLOR, 3>::new();
    for one in later {
        let (estimate, remembered) = (&one.estimate, remembers(one));
        if let Some(step) = estimate.form_difference(&base) {
            form.add(&estimate.form, [step], &base.form, &form_prior, remembered);
        }
        let steps = std::array::from_fn(|channel| estimate.color_difference(&base, channel));
        color.add(&estimate.color, steps, &base.color, &color_prior, remembered);
    }
    let mut result = base;
    if let Some(([step], precision)) = form.solved(&base.form, &form_prior, known) {
        result.apply_form_step(&step, &precision, rule.most_opacity);
    }
    if let Some((steps, precision)) = color.solved(&base.color, &color_prior, known) {
        result.apply_color_step(&steps, &precision);
    }
    let sound = result.splat.is_drawable() && result.appearance.is_valid();
    Some(if sound { result } else { base })
}

/// Sums of precision and information over scenes, for `M` right-hand sides.
struct Joint<const N: usize, const M: usize> {
    precision: Vec<f64>,
    information: [Vec<f64>; M],
    /// Remaining share of the start's precision.
    remembered: f64,
}

impl<const N: usize, const M: usize> Joint<N, M> {
    fn new() -> Self {
        let information = std::array::from_fn(|_| vec![0.0; N]);
        Self { precision: vec![0.0; N * N], information, remembered: 1.0 }
    }

    /// Adds what an estimate has gained since the start; `steps` is its distance from the start.
    fn add(
        &mut self,
        own: &[f32],
        steps: [[f64; N]; M],
        start: &[f32],
        prior: &[f64; N],
        remembered: f64,
    ) {
        self.remembered *= remembered;
        for i in 0..N {
            for j in 0..N {
                let before = blended_precision(entry(start, i, j), prior, (i, j), remembered);
                self.precision[i * N + j] += entry(own, i, j) - before;
                for (sum, step) in self.information.iter_mut().zip(&steps) {
                    sum[i] += entry(own, i, j) * step[j];
                }
            }
        }
    }

    /// Returns the steps from the start and the total precision; `None` if that is not positive definite.
    /// `known` is 1 with a start, 0 without.
    fn solved(
        mut self,
        start: &[f32],
        prior: &[f64; N],
        known: f64,
    ) -> Option<([Vec<f64>; M], Vec<f64>)> {
        for i in 0..N {
            for j in 0..N {
                let remembered = known * self.remembered;
                self.precision[i * N + j] +=
                    blended_precision(entry(start, i, j), prior, (i, j), remembered);
            }
        }
        let factor = Cholesky::new(N, &self.precision)?;
        let steps = self.information.map(|information| factor.solve(&information));
        steps.iter().flatten().all(|x| x.is_finite()).then_some((steps, self.precision))
    }
}

/// Blends a precision with the prior's: `remembered` is its share.
fn blended_precision<const N: usize>(
    value: f64,
    prior: &[f64; N],
    (i, j): (usize, usize),
    remembered: f64,
) -> f64 {
    let prior = if i == j { prior[i] } else { 0.0 };
    remembered * value + (1.0 - remembered) * prior
}

/// Returns an entry of a symmetric matrix stored as its lower triangle.
fn entry(triangle: &[f32], i: usize, j: usize) -> f64 {
    triangle[at(i.max(j), i.min(j))].into()
}

fn put_triangle<const N: usize>(triangle: &mut [f32], matrix: &[f64]) {
    for i in 0..N {
        for j in 0..=i {
            triangle[at(i, j)] = matrix[i * N + j] as f32;
        }
    }
}

fn log_ratio(a: f32, b: f32) -> f64 {
    libm::log(f64::from(a) / f64::from(b))
}

fn rotation(splat: &Splat) -> DQuat {
    let [w, x, y, z] = splat.rotation.map(f64::from);
    DQuat::from_xyzw(x, y, z, w).normalize()
}

/// Sets the running means of photographs to those over all scenes, weighted by their frames.
pub fn average_residuals<'a>(
    state: &mut PhotometricState,
    scenes: impl Iterator<Item = &'a PhotometricState>,
) {
    for scene in scenes {
        let pairs = [
            (&mut state.noise, scene.noise),
            (&mut state.points, scene.points),
            (&mut state.seen_through, scene.seen_through),
        ];
        for ([mean, weight], [value, more]) in pairs {
            *weight += more;
            if *weight > 0.0 {
                *mean += (value - *mean) * more / *weight;
            }
        }
    }
}
