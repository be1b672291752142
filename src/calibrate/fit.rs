//! Minimisation of the evidence over the unknowns and poses, and the covariance of the minimum.

use super::covariance::{Covariance, Scatter};
use super::evidence::{Evidence, ResidualKind};
use super::unknowns::{Estimate, N, SensorPrior, Unknowns, WITH_POSE};
use crate::math::cholesky::Cholesky;
use crate::math::least_squares::NormalEquations;

/// Number of alternating fits of gains and poses before a loss is evaluated.
const LOSS_ROUNDS: usize = 2;
const MAX_STEPS: usize = 12;
/// Relative decrease of the cost at which a fit has converged.
const MIN_STEP: f64 = 1e-6;
const MIN_DAMPING: f64 = 1e-3;
/// Maximum damping, at which a fit stops. The cost is rough where points leave images, so stronger
/// damping (shorter steps) would end in spurious local minima.
const MAX_DAMPING: f64 = 10.0;

impl Evidence<'_> {
    /// Minimises the cost over the `free` unknowns and all poses by the Levenberg-Marquardt algorithm;
    /// updates `at`.
    pub fn fit(&self, prior: &SensorPrior, at: &mut Estimate, free: &[usize]) {
        let mut now = self.linearise(prior, at);
        let mut damping = MIN_DAMPING;
        for _ in 0..MAX_STEPS {
            let Some(next) = now.step(at, free, damping) else { break };
            let then = self.linearise(prior, &next);
            let fall = 1.0 - then.cost / now.cost;
            if fall > 0.0 {
                (*at, now) = (next, then);
                damping = (0.2 * damping).max(MIN_DAMPING);
            } else {
                damping *= 10.0;
            }
            // A step that raises the cost is retried with more damping.
            if (0.0..MIN_STEP).contains(&fall) || damping > MAX_DAMPING {
                break;
            }
        }
    }

    fn linearise(&self, prior: &SensorPrior, at: &Estimate) -> Linearised {
        let views = self.weighted_equations(prior, at);
        let mut total = prior.equations(&at.unknowns);
        let cost = total.cost + views.iter().map(|view| view.cost).sum::<f64>();
        let eliminated = views.iter().filter_map(|view| view.eliminate_after());
        eliminated.for_each(|view| total.add(&view, 1.0));
        Linearised { views, total, cost }
    }

    /// Refits the `free` unknowns and the poses with the `held` unknowns fixed to `values`.
    pub fn fit_with_held(
        &self,
        prior: &SensorPrior,
        at: &Estimate,
        free: &[usize],
        (held, values): (&[usize], &Unknowns),
    ) -> Estimate {
        let here = self.linearise(prior, at);
        let mut change = [0.0; N];
        held.iter().for_each(|&i| change[i] = values.get(i) - at.unknowns.get(i));
        // Starts from the quadratic prediction: from the old minimum the fit would not converge.
        let mut next = here.predict_change(at, free, change).unwrap_or_else(|| at.clone());
        held.iter().for_each(|&i| next.unknowns.set(i, values.get(i)));
        self.fit(prior, &mut next, free);
        next
    }

    /// Returns the mean Cauchy loss of one kind of residual, after fitting gains and poses to the given
    /// unknowns. Unlike the weighted squares, the loss does not favour the unknowns at which the weights
    /// were computed.
    pub fn loss(&mut self, prior: &SensorPrior, unknowns: &Unknowns, kind: ResidualKind) -> f64 {
        let mut at = Estimate::as_recorded(*unknowns, self.matches.poses.len());
        for _ in 0..LOSS_ROUNDS {
            self.update_gains(&at);
            // Poses alone: the unknowns are the hypothesis under test.
            self.fit(prior, &mut at, &[]);
        }
        let knee = self.half_weight_squares[kind as usize];
        let [thickness, colors] = self.squared_residuals(&at);
        let squares = if kind == ResidualKind::Thickness { thickness } else { colors };
        let (mut sum, mut n) = (0.0, 0.0);
        for square in squares.into_iter().flatten() {
            sum += (square / knee).ln_1p();
            n += 1.0;
        }
        sum / n
    }

    /// Returns the squared distance between the estimates `a` and `b` of two halves of the views. It is
    /// relative to the variance that the equations of all views predict.
    pub fn normalised_disagreement(
        &self,
        prior: &SensorPrior,
        at: &Estimate,
        free: &[usize],
        [a, b]: [&Unknowns; 2],
    ) -> f64 {
        let total = self.linearise(prior, at).total;
        let apart = |i: usize| a.get(i) - b.get(i);
        let square: f64 = free
            .iter()
            .flat_map(|&i| free.iter().map(move |&j| (i, j)))
            .map(|(i, j)| apart(i) * total.curvature_at(i, j) * apart(j))
            .sum();
        // Each half has twice the variance of the whole, so their difference has four times.
        square / (4.0 * free.len() as f64)
    }

    /// Returns the covariance of the `free` unknowns at the minimum, by the sandwich estimator `A⁻¹ B
    /// A⁻¹` (Huber 1967; Godambe 1960). `A` is the curvature; `B` is the scatter of the gradients of
    /// views and prior.
    pub fn covariance(&self, prior: &SensorPrior, at: &Estimate, free: &[usize]) -> Covariance {
        let posed = self.weighted_equations(prior, at);
        let views: Vec<NormalEquations<N>> =
            posed.iter().filter_map(|v| v.eliminate_after()).collect();
        let known = prior.equations(&at.unknowns);
        let mut total = NormalEquations::total(&views);
        total.add(&known, 1.0);
        let n = free.len();
        let Some(factor) = Cholesky::new(n, &total.curvature_of(free)) else {
            return Covariance::open(n);
        };
        let mut covariance = Covariance::zero(n);
        let scatter = Scatter::of(&views, free);
        for gradient in &scatter.gradients {
            covariance.add(&factor.solve(gradient), scatter.weight);
        }
        for (place, &i) in free.iter().enumerate() {
            // The prior has no views that scatter: its gradient has the variance that its curvature
            // states.
            let mut gradient = vec![0.0; n];
            gradient[place] = known.curvature_at(i, i).sqrt();
            covariance.add(&factor.solve(&gradient), 1.0);
        }
        // A few views may scatter little by chance: the residuals and the prior set a lower bound.
        for place in 0..n {
            let mut unit = vec![0.0; n];
            unit[place] = 1.0;
            covariance.raise_variance(place, factor.solve(&unit)[place]);
        }
        let floors = self.quantisation_floor();
        for (place, floor) in free.iter().map(|&i| floors.get(i)).enumerate() {
            covariance.add_independent_variance(place, floor.map_or(0.0, |floor| floor * floor));
        }
        covariance
    }
}

struct Linearised {
    views: Vec<NormalEquations<WITH_POSE>>,
    /// Normal equations of the unknowns after elimination of the poses (Schur complement).
    total: NormalEquations<N>,
    cost: f64,
}

impl Linearised {
    /// Returns the estimate after a damped step of the `free` unknowns and the resulting steps of the
    /// poses.
    fn step(&self, at: &Estimate, free: &[usize], damping: f64) -> Option<Estimate> {
        let step = self.total.damped_step(free, damping)?;
        let mut change = [0.0; N];
        free.iter().zip(step).for_each(|(&i, step)| change[i] = step);
        // Poses are damped like the unknowns.
        self.apply_change(at, &change, 1.0 / (1.0 + damping))
    }

    fn predict_change(
        &self,
        at: &Estimate,
        free: &[usize],
        mut change: [f64; N],
    ) -> Option<Estimate> {
        let factor = Cholesky::new(free.len(), &self.total.curvature_of(free))?;
        let pull = |i: usize| -> f64 {
            change.iter().enumerate().map(|(j, by)| -by * self.total.curvature_at(i, j)).sum()
        };
        let pulls: Vec<f64> = free.iter().map(|&i| pull(i)).collect();
        free.iter().zip(factor.solve(&pulls)).for_each(|(&i, step)| change[i] = step);
        self.apply_change(at, &change, 1.0)
    }

    fn apply_change(&self, at: &Estimate, change: &[f64; N], share: f64) -> Option<Estimate> {
        let mut next = at.clone();
        (0..N).for_each(|i| next.unknowns.set(i, at.unknowns.get(i) + change[i]));
        for (pose, view) in next.poses.iter_mut().zip(&self.views) {
            let steps = view.eliminated_step(change)?;
            pose.iter_mut().zip(steps).for_each(|(value, step)| *value += share * step);
        }
        Some(next)
    }
}
#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::matches::Matches;
    use crate::calibrate::test_views::{MEASURED, begin, prior, ramps, stand, wall};
    use crate::calibrate::unknowns::DEPTH;
    use crate::observation::surface::SurfacePoint;
    use glam::DVec3;

    /// Simulates a wall and a floor seen from several distances. Measured depth needs a correction by
    /// `offset` and `scale`. Recorded view positions are wrong by about `jitter` (world units).
    fn room(offset: f64, scale: f64, jitter: f64) -> Matches {
        let (mut views, mut poses) = (Vec::new(), Vec::new());
        for view in 0..8 {
            let centre = DVec3::new(0.3 * f64::from(view), -0.2, -0.25 * f64::from(view));
            let wrong = jitter * (2.7 * f64::from(view)).sin() * DVec3::new(0.3, 0.5, 1.0);
            let mut points = Vec::new();
            for i in 0..400 {
                let (x, y) = (0.05 * f64::from(i % 20) - 0.5, 0.05 * f64::from(i / 20) - 0.5);
                let wall = (DVec3::new(x, y, 2.0), DVec3::NEG_Z);
                let floor = (DVec3::new(x, 0.8, y + 1.0), DVec3::NEG_Y);
                for (place, normal) in [wall, floor] {
                    let true_range = (place - centre).length();
                    let direction = (place - centre) / true_range;
                    // The inverse of a correction by `offset` and `scale`.
                    let range = (true_range - offset) / scale;
                    points.push(SurfacePoint {
                        position: (centre + wrong + range * direction).as_vec3().to_array(),
                        range: range as f32,
                        noise: 0.002,
                        normal: normal.as_vec3().to_array(),
                        direction: direction.as_vec3().to_array(),
                        ..SurfacePoint::default()
                    });
                }
            }
            views.push(points);
            poses.push(stand(centre + wrong));
        }
        Matches::from_views(&views, poses, MEASURED, 0.25)
    }

    fn fitted(matches: Matches) -> (Unknowns, Vec<f64>) {
        let images = ramps(matches.poses.len());
        let gains = vec![[1.0; 3]; images.len()];
        let mut evidence = Evidence::new(matches, &images, gains, 0);
        let mut at = Estimate::as_recorded(begin(), evidence.matches.poses.len());
        evidence.update_weights(&at);
        evidence.fit(&prior(), &mut at, &DEPTH);
        evidence.update_weights(&at);
        let covariance = evidence.covariance(&prior(), &at, &DEPTH);
        (at.unknowns, vec![covariance.error(0), covariance.error(1)])
    }

    #[test]
    fn offset_and_scale_are_found_within_their_errors() {
        for (offset, scale, jitter) in
            [(0.01, 1.004, 0.0), (0.0, 1.0, 0.0), (0.01, 1.02, 0.003), (-0.008, 0.98, 0.003)]
        {
            let (at, errors) = fitted(room(offset, scale, jitter));
            let off = [at.depth[0] - offset, at.depth[1] - scale];
            let case = format!("{offset} {scale} {jitter}: {:?} {errors:?}", at.depth);
            assert!((0..2).all(|i| off[i].abs() < 3.0 * errors[i]), "{case}");
            assert!(errors[0] < 0.01 && errors[1] < 0.01, "{case}");
            assert!(errors[0] >= 0.0005, "a quarter of the noise is hidden: {case}");
        }
    }

    #[test]
    fn what_views_do_not_tell_stays_what_sensors_are() {
        // Two views of one wall side by side do not determine depth.
        let (at, errors) = fitted(wall(0.0));
        assert!(at.depth[0].abs() < 0.01 && (at.depth[1] - 1.0).abs() < 0.02, "{:?}", at.depth);
        assert!(errors[0] > 0.005 && errors[1] > 0.01, "{errors:?}");
    }

    #[test]
    fn a_few_points_that_lie_far_off_change_little() {
        let mut matches = room(0.01, 1.0, 0.0);
        matches.spoil(50, |place| place + DVec3::new(0.0, 0.03, 0.08));
        let (at, _) = fitted(matches);
        assert!((at.depth[0] + 2.0 * (at.depth[1] - 1.0) - 0.01).abs() < 0.003, "{:?}", at.depth);
    }
}
