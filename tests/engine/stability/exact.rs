//! E-step and posterior in rational arithmetic. Only one exponential and the final conversion to
//! f64 round.
//!
//! Fractions of unbounded integers are the only reference that is not itself under test: beside a
//! squared coordinate, f64 retains little of the paper's prior of 4e-15. The exponential has no
//! exact value, but its argument is an exact difference. Candidates are preselected in f64, with a
//! surplus, and then ordered exactly. Exact distances to 10⁵ components would take too long.

use glam::DVec3;
use num_rational::BigRational;
use num_traits::{ToPrimitive, Zero};
use std::collections::BTreeMap;
use vbgs_studio::math::sym3::Sym3;
use vbgs_studio::model::conjugate::posterior::ComponentPosterior;
use vbgs_studio::model::conjugate::prior;
use vbgs_studio::model::conjugate::prior::Hyper;

/// `[x, y, z, r, g, b]`, exact.
type RationalPoint = [BigRational; 6];

/// Converts a finite number exactly. Other values become zero.
fn exact(value: f64) -> BigRational {
    BigRational::from_float(value).unwrap_or_else(BigRational::zero)
}

fn rounded(value: &BigRational) -> f64 {
    value.to_f64().unwrap_or(f64::NAN)
}

/// Mixture with exact sufficient statistics.
pub struct RationalMixture {
    hyper: Hyper,
    means: Vec<[f64; 6]>,
    /// `−2 E[ln π] / E_s`.
    penalties: Vec<f64>,
    color_ratio: BigRational,
    n_candidates: usize,
    /// Raw moments by component. Components without points have no entry.
    sums: BTreeMap<usize, Sums>,
}

/// Number of surplus candidates whose distance is computed exactly. The f64 order is off by fewer
/// places.
const DOUBTFUL: usize = 16;

/// Raw moments of one component.
struct Sums {
    count: BigRational,
    first: [BigRational; 3],
    /// xx, xy, xz, yy, yz, zz.
    second: [BigRational; 6],
    color: [BigRational; 3],
}

const PAIRS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

impl Sums {
    fn zero() -> Self {
        let zero = BigRational::zero;
        Self {
            count: zero(),
            first: std::array::from_fn(|_| zero()),
            second: std::array::from_fn(|_| zero()),
            color: std::array::from_fn(|_| zero()),
        }
    }

    fn each(&mut self, mut change: impl FnMut(&mut BigRational)) {
        let Self { count, first, second, color } = self;
        let all = std::iter::once(count).chain(first).chain(second).chain(color);
        all.for_each(&mut change);
    }
}

impl RationalMixture {
    /// Creates a model without data. Each point is compared with its `n_candidates` nearest
    /// components.
    pub fn new(hyper: Hyper, means: &[[f64; 6]], alpha: &[f64], n_candidates: usize) -> Self {
        let to_penalty = -2.0 / hyper.expected_precision_space();
        Self {
            hyper,
            means: means.to_vec(),
            penalties: prior::expected_ln_weights(alpha)
                .into_iter()
                .map(|w| w * to_penalty)
                .collect(),
            color_ratio: exact(hyper.expected_precision_color() / hyper.expected_precision_space()),
            n_candidates,
            sums: BTreeMap::new(),
        }
    }

    /// Adds finite points. Returns the non-zero responsibilities of each.
    pub fn learn(&mut self, points: &[[f64; 6]]) -> Vec<Vec<(u32, f64)>> {
        let mut all = Vec::with_capacity(points.len());
        for row in points {
            let point = row.map(exact);
            let responsibilities = self.responsibilities(row, &point);
            for &(k, r) in &responsibilities {
                self.add(k as usize, &exact(r), &point);
            }
            all.push(responsibilities);
        }
        all
    }

    /// Multiplies all statistics, as if the data had been added `times` times.
    pub fn repeat(&mut self, times: u32) {
        // Each repetition adds the same sums, since the E-step reads only the initial model
        // (`model.md`, Three models). Adding 1e5 of them in fractions would take too long.
        let factor = exact(f64::from(times));
        self.sums.values_mut().for_each(|sums| sums.each(|sum| *sum *= &factor));
    }

    fn responsibilities(&self, row: &[f64; 6], point: &RationalPoint) -> Vec<(u32, f64)> {
        let square = |k: usize, axes: std::ops::Range<usize>| -> BigRational {
            axes.map(|i| &point[i] - exact(self.means[k][i])).map(|d| &d * &d).sum()
        };
        let mut nearest: Vec<(BigRational, usize)> =
            self.about_nearest(row).into_iter().map(|k| (square(k, 0..3), k)).collect();
        nearest.sort();
        nearest.truncate(self.n_candidates);
        let scores: Vec<(usize, BigRational)> = nearest
            .into_iter()
            .map(|(d, k)| (k, d + &self.color_ratio * square(k, 3..6) + exact(self.penalties[k])))
            .collect();
        let Some(least) = scores.iter().map(|(_, q)| q).min() else { return Vec::new() };
        let half_precision = 0.5 * self.hyper.expected_precision_space();
        // Subtract exactly: at the paper's precision of 1e15, rounding a score of 1 costs 0.06 nats
        // even in f64.
        let weight = |q: &BigRational| (-half_precision * rounded(&(q - least))).exp();
        let total: f64 = scores.iter().map(|(_, q)| weight(q)).sum();
        let shares = scores.iter().map(|(k, q)| (*k as u32, weight(q) / total));
        shares.filter(|(_, r)| *r > 0.0).collect()
    }

    fn about_nearest(&self, row: &[f64; 6]) -> Vec<usize> {
        let square = |k: usize| (0..3).map(|i| (row[i] - self.means[k][i]).powi(2)).sum::<f64>();
        let mut nearest: Vec<(f64, usize)> =
            (0..self.means.len()).map(|k| (square(k), k)).collect();
        nearest.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        nearest.into_iter().take(self.n_candidates + DOUBTFUL).map(|(_, k)| k).collect()
    }

    fn add(&mut self, k: usize, r: &BigRational, point: &RationalPoint) {
        let sums = self.sums.entry(k).or_insert_with(Sums::zero);
        sums.count += r;
        for i in 0..3 {
            sums.first[i] += r * &point[i];
            sums.color[i] += r * &point[i + 3];
        }
        for (sum, (i, j)) in sums.second.iter_mut().zip(PAIRS) {
            *sum += r * &point[i] * &point[j];
        }
    }

    /// Posterior `η_0 + S` of each component (`model.md`, Posterior), rounded only at the end.
    pub fn posteriors(&self) -> Vec<ComponentPosterior> {
        let unused = self.posterior(&Sums::zero());
        let of = |k| self.sums.get(&k).map_or(unused, |sums| self.posterior(sums));
        (0..self.means.len()).map(of).collect()
    }

    fn posterior(&self, sums: &Sums) -> ComponentPosterior {
        let hyper = &self.hyper;
        let plus = |prior: f64| exact(prior) + &sums.count;
        let (kappa_space, kappa_color) = (plus(hyper.kappa0_space), plus(hyper.kappa0_color));
        let mean = |sum: &[BigRational; 3], kappa: &BigRational| {
            DVec3::from_array(std::array::from_fn(|i| rounded(&(&sum[i] / kappa))))
        };
        let prior_scale = exact(1.0) / exact(hyper.u0_space);
        let entry = |(sum, (i, j)): (&BigRational, (usize, usize))| {
            // The raw form cancels in f64, but not in fractions.
            let spread = sum - &sums.first[i] * &sums.first[j] / &kappa_space;
            rounded(&if i == j { spread + &prior_scale } else { spread })
        };
        let mut inverse_scale = [0.0; 6];
        for (value, item) in inverse_scale.iter_mut().zip(sums.second.iter().zip(PAIRS)) {
            *value = entry(item);
        }
        ComponentPosterior {
            count: rounded(&sums.count),
            alpha: rounded(&plus(hyper.alpha0)),
            kappa_space: rounded(&kappa_space),
            nu_space: rounded(&plus(hyper.nu0)),
            kappa_color: rounded(&kappa_color),
            mean_space: mean(&sums.first, &kappa_space),
            inverse_scale: Sym3::from_array(inverse_scale),
            mean_color: mean(&sums.color, &kappa_color),
        }
    }
}
