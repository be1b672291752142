//! Normal equations of a least-squares problem over a few unknowns.

use super::cholesky::Cholesky;

/// Normal equations of a linearised sum of weighted squared residuals. They hold the cost, half its
/// gradient and half its Gauss-Newton curvature.
///
/// The residuals of a problem are divided into blocks, each with its own equations. Blocks are added in
/// a fixed order, so sums do not depend on the number of threads. For standard errors, blocks can be
/// left out or compared.
#[derive(Clone, Copy, Debug)]
pub struct NormalEquations<const N: usize> {
    /// Weighted sum of squared residuals.
    pub cost: f64,
    /// Number of contributing points, or their total weight.
    pub n: f64,
    /// Lower triangle of half the Gauss-Newton curvature of the cost.
    curvature: [[f64; N]; N],
    /// Half the gradient of the cost.
    pub gradient: [f64; N],
}

impl<const N: usize> NormalEquations<N> {
    /// Normal equations without residuals.
    pub const ZERO: Self = Self { cost: 0.0, n: 0.0, curvature: [[0.0; N]; N], gradient: [0.0; N] };

    /// Adds a residual with its weight. `slope` holds the residual's derivatives with respect to the
    /// first `slope.len()` unknowns; the other derivatives are zero.
    #[inline(always)]
    pub fn add_residual(&mut self, residual: f64, slope: &[f64], weight: f64) {
        self.add_residuals([residual], [slope], weight);
    }

    /// Adds several residuals of equal weight, as [`Self::add_residual`] does, but reads and writes each
    /// accumulator only once.
    #[inline(always)]
    pub fn add_residuals<const M: usize>(
        &mut self,
        residuals: [f64; M],
        slopes: [&[f64]; M],
        weight: f64,
    ) {
        for residual in residuals {
            self.cost += weight * residual * residual;
        }
        for j in 0..slopes[0].len() {
            let mut pull = self.gradient[j];
            let mut weighted = [0.0; M];
            for i in 0..M {
                weighted[i] = weight * slopes[i][j];
                pull += weighted[i] * residuals[i];
            }
            self.gradient[j] = pull;
            for (k, sum) in self.curvature[j][..=j].iter_mut().enumerate() {
                let mut curvature = *sum;
                for i in 0..M {
                    curvature += weighted[i] * slopes[i][k];
                }
                *sum = curvature;
            }
        }
    }

    /// Adds a Gaussian prior on unknown `i`, with standard deviation `deviation`. `value` is the
    /// difference between the unknown's current value and the prior mean.
    pub fn add_prior(&mut self, i: usize, value: f64, deviation: f64) {
        let weight = deviation.powi(-2);
        self.cost += weight * value * value;
        self.gradient[i] += weight * value;
        self.curvature[i][i] += weight;
    }

    /// Adds `factor` times `other`. A factor of −1 removes a block from a total.
    pub fn add(&mut self, other: &Self, factor: f64) {
        self.cost += factor * other.cost;
        self.n += factor * other.n;
        for i in 0..N {
            self.gradient[i] += factor * other.gradient[i];
            for j in 0..=i {
                self.curvature[i][j] += factor * other.curvature[i][j];
            }
        }
    }

    /// Returns the sum of the blocks `parts`.
    pub fn total<'a>(parts: impl IntoIterator<Item = &'a Self>) -> Self {
        parts.into_iter().fold(Self::ZERO, |mut sum, part| {
            sum.add(part, 1.0);
            sum
        })
    }

    /// Returns the weighted sum of squared residuals, divided by the number of points.
    pub fn variance(&self) -> f64 {
        self.cost / self.n
    }

    /// Returns half the curvature of the cost with respect to the `free` unknowns, as a row-major
    /// matrix.
    pub fn curvature_of(&self, free: &[usize]) -> Vec<f64> {
        free.iter().flat_map(|&i| free.iter().map(move |&j| self.curvature_at(i, j))).collect()
    }

    /// Returns half the curvature of the cost with respect to the unknowns `i` and `j`.
    pub fn curvature_at(&self, i: usize, j: usize) -> f64 {
        self.curvature[i.max(j)][i.min(j)]
    }

    /// Eliminates all but the first `M` unknowns (Schur complement). Returns `None` if the data does not
    /// determine the eliminated unknowns.
    pub fn eliminate_after<const M: usize>(&self) -> Option<NormalEquations<M>> {
        let rest: Vec<usize> = (M..N).collect();
        let factor = Cholesky::new(rest.len(), &self.curvature_of(&rest))?;
        let gradient: Vec<f64> = rest.iter().map(|&i| self.gradient[i]).collect();
        let pull = factor.solve(&gradient);
        let along = |with: &[f64], values: &[f64]| -> f64 {
            with.iter().zip(values).map(|(a, b)| a * b).sum()
        };
        let mut left = NormalEquations::ZERO;
        left.n = self.n;
        left.cost = self.cost - along(&gradient, &pull);
        for i in 0..M {
            let coupled: Vec<f64> = rest.iter().map(|&j| self.curvature_at(i, j)).collect();
            left.gradient[i] = self.gradient[i] - along(&coupled, &pull);
            let followed = factor.solve(&coupled);
            for j in 0..=i {
                let others: Vec<f64> = rest.iter().map(|&k| self.curvature_at(j, k)).collect();
                left.curvature[i][j] = self.curvature[i][j] - along(&others, &followed);
            }
        }
        Some(left)
    }

    /// Returns the change of the remaining unknowns that minimises the cost when the first `step.len()`
    /// unknowns change by `step`. Returns `None` if the data does not determine the change.
    pub fn eliminated_step(&self, step: &[f64]) -> Option<Vec<f64>> {
        let m = step.len();
        let rest: Vec<usize> = (m..N).collect();
        let pull: Vec<f64> = rest
            .iter()
            .map(|&i| {
                let coupled: f64 = (0..m).map(|j| self.curvature_at(i, j) * step[j]).sum();
                -self.gradient[i] - coupled
            })
            .collect();
        Some(Cholesky::new(rest.len(), &self.curvature_of(&rest))?.solve(&pull))
    }

    /// Returns the step to the minimum of the cost. Returns `None` if the data does not determine the
    /// step or the step is not finite.
    pub fn solution(&self) -> Option<[f64; N]> {
        let all: [usize; N] = std::array::from_fn(|i| i);
        let step: [f64; N] = self.damped_step(&all, 0.0)?.try_into().ok()?;
        // The factor does not depend on the gradient: a NaN there shows only here.
        step.iter().all(|x| x.is_finite()).then_some(step)
    }

    /// Returns the damped Gauss-Newton step of the `free` unknowns, in the order of `free`; other
    /// unknowns are held fixed. `damping` is the relative increase of the diagonal, after Marquardt.
    /// Returns `None` if the data does not determine a direction.
    pub fn damped_step(&self, free: &[usize], damping: f64) -> Option<Vec<f64>> {
        let n = free.len();
        let mut matrix = self.curvature_of(free);
        (0..n).for_each(|i| matrix[i * n + i] *= 1.0 + damping);
        let down: Vec<f64> = free.iter().map(|&i| -self.gradient[i]).collect();
        Some(Cholesky::new(n, &matrix)?.solve(&down))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the normal equations of the residuals `x + 2y − 3` and `x − y`, linearised at the origin.
    /// The weights are 1 and 4.
    fn two_lines() -> [NormalEquations<2>; 2] {
        let mut views = [NormalEquations::ZERO; 2];
        views[0].add_residual(-3.0, &[1.0, 2.0], 1.0);
        views[1].add_residual(0.0, &[1.0, -1.0], 4.0);
        views.iter_mut().for_each(|view| view.n += 1.0);
        views
    }

    #[test]
    fn the_step_leads_to_the_minimum_of_the_free_unknowns() {
        let total = NormalEquations::total(&two_lines());
        assert_eq!((total.cost, total.variance()), (9.0, 4.5));
        let step = total.damped_step(&[0, 1], 0.0).unwrap();
        assert!(step.iter().all(|x| (x - 1.0).abs() < 1e-12), "{step:?}");
        // With y held, (x − 3)² + 4x² is smallest at 3/5.
        let step = total.damped_step(&[0], 0.0).unwrap();
        assert!((step[0] - 0.6).abs() < 1e-12, "{step:?}");
        // Damping of 1 doubles the diagonal: 10x − 2y = 3 and 16y − 2x = 6.
        let step = total.damped_step(&[0, 1], 1.0).unwrap();
        assert!((step[0] - 5.0 / 13.0).abs() < 1e-12 && (step[1] - 5.5 / 13.0).abs() < 1e-12);
        let mut held = NormalEquations::<2>::ZERO;
        held.add_prior(1, 3.0, 0.5);
        assert_eq!((held.cost, held.gradient, held.curvature_at(1, 1)), (36.0, [0.0, 12.0], 4.0));
    }

    #[test]
    fn what_is_reduced_has_the_same_minimum() {
        let mut total = NormalEquations::total(&two_lines());
        let whole = total.eliminate_after::<1>().unwrap();
        assert!((whole.damped_step(&[0], 0.0).unwrap()[0] - 1.0).abs() < 1e-12, "{whole:?}");
        // At x = 0, (2y − 3)² + 4y² is smallest at 3/4.
        assert!((whole.cost - 4.5).abs() < 1e-12, "{whole:?}");
        let y = total.eliminated_step(&[1.0]).unwrap();
        assert!((y[0] - 1.0).abs() < 1e-12, "{y:?}");
        // With a strong pull of y to 0 it follows less: (x − 3)² + 4x² in the limit.
        total.add_residual(0.0, &[0.0, 1.0], 1e9);
        let held = total.eliminate_after::<1>().unwrap();
        assert!((held.damped_step(&[0], 0.0).unwrap()[0] - 0.6).abs() < 1e-6, "{held:?}");
    }

    #[test]
    fn a_view_that_is_taken_out_leaves_the_others() {
        let views = two_lines();
        let mut rest = NormalEquations::total(&views);
        rest.add(&views[1], -1.0);
        assert_eq!((rest.cost, rest.n, rest.gradient), (9.0, 1.0, [-3.0, -6.0]));
        assert_eq!(rest.curvature_of(&[0, 1]), [1.0, 2.0, 2.0, 4.0]);
        assert!(
            rest.damped_step(&[0, 1], 0.0).is_none(),
            "one residual leaves a direction undetermined"
        );
    }
}
