//! What photographs have taught a scene's splats: parameters and their precision, row by component.

use super::waiting::WaitingPhotograph;
use crate::math::cholesky::Cholesky;
use crate::math::lane_cholesky::at;
use crate::model::splat::appearance::Appearance;
use crate::model::splat::observed_cone::ObservedCone;
use crate::model::splat::splats::Splat;
use rayon::prelude::*;

/// Parameters of position and form: mean (world units), logarithms of the scales, turns about the
/// splat's own axes (radians), logarithm of the opacity.
pub const N_FORM: usize = 10;
/// Coefficients of a channel's colour: constant, by direction, by place (per world unit).
pub const N_COLOR: usize = 7;
/// Numbers of the lower triangle of the precision of position and form.
pub const N_FORM_PRECISION: usize = N_FORM * (N_FORM + 1) / 2;
/// Numbers of the lower triangle of the precision of a channel's colour.
pub const N_COLOR_PRECISION: usize = N_COLOR * (N_COLOR + 1) / 2;

/// Splats as photographs have corrected them. Rows are components; one of opacity 0 has no splat.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotometricState {
    /// The splats, world units.
    pub splats: Vec<Splat>,
    /// How their colour varies.
    pub appearance: Vec<Appearance>,
    /// Precision of mean, logarithms of scales, turns and logarithm of opacity: the lower triangle,
    /// row by row.
    pub form: Vec<[f32; N_FORM_PRECISION]>,
    /// Precision of the colour's coefficients, which all channels share.
    pub color: Vec<[f32; N_COLOR_PRECISION]>,
    /// Running mean square of the differences between photographs and the pictures drawn before
    /// these were learnt, per channel; and the weight behind it.
    pub noise: [f64; 2],
    /// The same of the colours of points and the means of their components, before these were learnt.
    pub points: [f64; 2],
    /// Running mean share of surfaces in view that frames saw through; and the weight behind it.
    pub seen_through: [f64; 2],
    /// Photographs that are still to be learnt, in no order.
    pub waiting: Vec<WaitingPhotograph>,
}

impl PhotometricState {
    /// Bytes of a component, beside those of its sums.
    pub const BYTES: usize = size_of::<Splat>()
        + size_of::<Appearance>()
        + size_of::<[f32; N_FORM_PRECISION]>()
        + size_of::<[f32; N_COLOR_PRECISION]>();

    /// Bytes that it takes of the model, without what waits.
    pub fn bytes(&self) -> usize {
        self.splats.len() * Self::BYTES
    }

    /// Makes room for so many components; new ones have no splat.
    pub fn grow(&mut self, n: usize) {
        self.splats.resize(n, Splat::default());
        self.appearance.resize(n, Appearance::default());
        self.form.resize(n, [0.0; N_FORM_PRECISION]);
        self.color.resize(n, [0.0; N_COLOR_PRECISION]);
    }

    /// Those of the listed components, in their order, without observed directions, which follow from the
    /// sums of the components.
    pub fn listed(&self, components: &[u32]) -> Self {
        let mut appearance = listed_rows(&self.appearance, components, Appearance::default());
        appearance.par_iter_mut().for_each(|look| look.observed = ObservedCone::default());
        Self {
            splats: listed_rows(&self.splats, components, Splat::default()),
            appearance,
            form: listed_rows(&self.form, components, [0.0; N_FORM_PRECISION]),
            color: listed_rows(&self.color, components, [0.0; N_COLOR_PRECISION]),
            noise: self.noise,
            points: self.points,
            seen_through: self.seen_through,
            waiting: self.waiting.clone(),
        }
    }

    /// Splat and appearance of a component, if it has any.
    pub fn splat(&self, component: usize) -> Option<(Splat, Appearance)> {
        self.has(component).then(|| (self.splats[component], self.appearance[component]))
    }

    /// Whether a component has a splat.
    pub fn has(&self, component: usize) -> bool {
        self.splats.get(component).is_some_and(|splat| splat.opacity > 0.0)
    }
}

/// What photographs leave uncertain of a splat: standard deviations of its posterior, each parameter's
/// with all others of its block free.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotometricDeviations {
    /// Of the mean along the world's axes, world units.
    pub mean: [f64; 3],
    /// Of each scale, as a share of it.
    pub scale: [f64; 3],
    /// Of turns about the splat's own axes, radians.
    pub turn: [f64; 3],
    /// Of the opacity, as a share of it.
    pub opacity: f64,
    /// Of a channel's constant colour, colour units.
    pub color: f64,
}

impl PhotometricDeviations {
    /// Of one component; `None` without a splat or where the precision is none.
    pub fn of(state: &PhotometricState, component: usize) -> Option<Self> {
        if !state.has(component) {
            return None;
        }
        let form: [f64; N_FORM] = deviations(&state.form[component])?;
        let color: [f64; N_COLOR] = deviations(&state.color[component])?;
        let three = |first: usize| std::array::from_fn(|i| form[first + i]);
        let (mean, scale, turn) = (three(0), three(3), three(6));
        Some(Self { mean, scale, turn, opacity: form[N_FORM - 1], color: color[0] })
    }

    /// Standard deviation of the mean's position, world units.
    pub fn position(&self) -> f64 {
        self.mean.iter().map(|x| x * x).sum::<f64>().sqrt()
    }
}

/// Roots of the diagonal of the inverse of a matrix given by its lower triangle.
fn deviations<const N: usize>(triangle: &[f32]) -> Option<[f64; N]> {
    let entry = |i: usize| f64::from(triangle[at((i / N).max(i % N), (i / N).min(i % N))]);
    let matrix: Vec<f64> = (0..N * N).map(entry).collect();
    let factor = Cholesky::new(N, &matrix)?;
    Some(std::array::from_fn(|i| {
        let mut unit = vec![0.0; N];
        unit[i] = 1.0;
        factor.solve(&unit)[i].sqrt()
    }))
}

/// Rows that are not there yet are `none`.
fn listed_rows<T: Copy + Send + Sync>(rows: &[T], list: &[u32], none: T) -> Vec<T> {
    // On all threads: these are most bytes of a scene, and training waits while they are copied.
    let row = |&i: &u32| rows.get(i as usize).copied().unwrap_or(none);
    list.par_iter().with_min_len(4096).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviations_are_those_of_the_inverse() {
        let mut state = PhotometricState::default();
        state.grow(2);
        state.splats[1].opacity = 0.5;
        for i in 0..N_FORM {
            state.form[1][at(i, i)] = 4.0;
        }
        (0..N_COLOR).for_each(|i| state.color[1][at(i, i)] = 100.0);
        // Two parameters that pixels mix up are less certain than either alone: 4/(4·4 − 3·3).
        state.form[1][at(4, 3)] = 3.0;
        let found = PhotometricDeviations::of(&state, 1).unwrap();
        assert_eq!((found.mean, found.opacity, found.color), ([0.5; 3], 0.5, 0.1));
        assert!((found.scale[0] - (4.0f64 / 7.0).sqrt()).abs() < 1e-12);
        assert!((found.position() - 0.75f64.sqrt()).abs() < 1e-12);
        assert_eq!(PhotometricDeviations::of(&state, 0), None);
        state.form[1][0] = -1.0;
        assert_eq!(PhotometricDeviations::of(&state, 1), None);
    }
}
