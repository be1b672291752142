//! State of a trained mixture as columns of numbers, as stored in checkpoints.

use crate::math::real::Real;
use crate::model::conjugate::prior;
use crate::model::conjugate::prior::Hyper;
use crate::model::conjugate::statistics::N_SUMS;

/// A trained mixture between two frames. Row `k` of every column is component `k`; coordinates are
/// normalised.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelState {
    /// Dirichlet parameters of the initial model.
    pub alpha_init: Vec<f64>,
    /// Initial means, moved by reassignment.
    pub means: InitialMeans,
    /// Sums over all points so far, about the initial spatial means.
    pub totals: Totals,
}

/// Initial means in the precision used by the E-step.
#[derive(Clone, Debug, PartialEq)]
pub enum InitialMeans {
    /// Means in f32, for runs of mixed precision.
    F32 {
        /// Spatial means, one row per component.
        space: Vec<[f32; 3]>,
        /// Colour means, one row per component.
        color: Vec<[f32; 3]>,
    },
    /// Means in f64, for runs in f64 throughout.
    F64 {
        /// Spatial means, one row per component.
        space: Vec<[f64; 3]>,
        /// Colour means, one row per component.
        color: Vec<[f64; 3]>,
    },
}

impl InitialMeans {
    /// Returns the means as rows of position and colour, in f64 without rounding.
    pub fn rows(&self) -> Vec<[f64; 6]> {
        let row = |s: [f64; 3], c: [f64; 3]| [s[0], s[1], s[2], c[0], c[1], c[2]];
        match self {
            Self::F32 { space, color } => {
                let widened = |v: &[f32; 3]| v.map(f64::from);
                space.iter().zip(color).map(|(s, c)| row(widened(s), widened(c))).collect()
            }
            Self::F64 { space, color } => {
                space.iter().zip(color).map(|(&s, &c)| row(s, c)).collect()
            }
        }
    }
}

/// Totals of all components: one row of sums per component, in the order listed at [`N_SUMS`].
#[derive(Clone, Debug, PartialEq)]
pub enum Totals {
    /// 64-bit fixed point, with high limbs for sums that overflow. The unit depends on the sum (see
    /// [`super::totals`]).
    Fixed64 {
        /// Low 64 bits of every sum.
        rows: Vec<[i64; N_SUMS]>,
        /// High limbs of sums that exceed 64 bits, by ascending component id.
        carries: Vec<Carry>,
    },
    /// 128-bit fixed point.
    Fixed128(Vec<[i128; N_SUMS]>),
}

impl Totals {
    /// Number of components.
    pub fn len(&self) -> usize {
        match self {
            Self::Fixed64 { rows, .. } => rows.len(),
            Self::Fixed128(rows) => rows.len(),
        }
    }

    /// True if there are no components.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// High limbs of a component's sums: a sum is `limb · 2⁶⁴ + row` quanta.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Carry {
    /// Index of the component.
    pub id: u32,
    /// High limb of each sum.
    pub limbs: [i32; N_SUMS],
}

/// Means and weights of the initial model, normalised coordinates.
#[derive(Clone, Debug)]
pub struct InitialModel<R> {
    /// Spatial means, one row per component, normalised.
    pub space: Vec<[R; 3]>,
    /// Colour means, one row per component, normalised.
    pub color: Vec<[R; 3]>,
    /// `w_k = 2 E[ln π_k] / E_s`: the log weight in units of squared distance. `E_s` is the expected
    /// spatial precision.
    pub weight: Vec<R>,
    /// Largest entry of `weight`.
    pub max_weight: R,
    /// Prior and initial hyper-parameters.
    pub hyper: Hyper,
}

impl<R: Real> InitialModel<R> {
    /// Builds the model from rows of position and colour and from the initial Dirichlet parameters. Both
    /// have length `hyper.components`.
    pub fn new(hyper: Hyper, means: &[[f64; 6]], alpha: &[f64]) -> Self {
        assert_eq!(means.len(), hyper.components, "one mean per component");
        assert_eq!(alpha.len(), hyper.components, "one concentration per component");
        // Scores are squared distances: at 10⁹ nats f32 would resolve hundreds only.
        let to_weight = 2.0 / hyper.expected_precision_space();
        let ln_weights = prior::expected_ln_weights(alpha);
        let weight: Vec<R> = ln_weights.into_iter().map(|w| R::of(w * to_weight)).collect();
        Self {
            // Generic numbers have no total order, hence the comparison.
            max_weight: weight.iter().fold(-R::INFINITY, |m, &w| if w > m { w } else { m }),
            weight,
            space: means.iter().map(|m| [m[0], m[1], m[2]].map(R::of)).collect(),
            color: means.iter().map(|m| [m[3], m[4], m[5]].map(R::of)).collect(),
            hyper,
        }
    }

    /// Replaces a component's mean (position and colour) and returns the old mean.
    pub fn replace_mean(
        &mut self,
        component: usize,
        (space, color): ([R; 3], [R; 3]),
    ) -> ([R; 3], [R; 3]) {
        let old_space = std::mem::replace(&mut self.space[component], space);
        (old_space, std::mem::replace(&mut self.color[component], color))
    }

    /// Number of components.
    pub fn len(&self) -> usize {
        self.space.len()
    }

    /// True if there are no components.
    pub fn is_empty(&self) -> bool {
        self.space.is_empty()
    }
}
