//! What matched views say of all unknowns together: surfaces must be thin and of one colour.
//!
//! Residuals are weighed down the farther they lie off what is usual (Cauchy's weights), once before every
//! fit: silhouettes, mirrors and things that moved belong to no calibration. So that both kinds can be added
//! to one another and to what is known of sensors, they count what they are worth. Of colours, points of a
//! component in one view are one witness, whose noise is that of the residuals, and every view's pose takes
//! what it can of them, within what poses are known by: that tells nothing of cameras. Thickness counts as
//! many times less as its views' gradients scatter wider than independent points would make them.

use super::camera::Projector;
use super::color::{self, ColorOffset, Photos, color_offsets};
use super::covariance::Covariance;
use super::exposure::exposure;
use super::matches::Matches;
use super::normal_equations::NormalEquations;
use super::pyramid::Pyramid;
use super::thickness::{PlaneOffset, plane_offsets};
use super::unknowns::{DEPTH, Estimate, N, SensorPrior, Twist, Unknowns, WITH_POSE};
use crate::math::cholesky::Cholesky;
use rayon::prelude::*;

/// Components of one partial sum: sums do not depend on the number of threads.
const CHUNK: usize = 1024;
/// Every so-many-th component tells what residual is usual.
const SAMPLED: usize = 5;
/// Median residuals at which a point counts half.
const OUTLYING: f64 = 4.0;
/// Least variance of either kind's residuals: a tenth of the sensor's noise, and a step of a byte in three
/// channels. Pictures of a program may have none.
const LEAST_VARIANCE: [f64; 2] = [0.01, 3.0 / (255.0 * 255.0)];
/// Views whose gradients tell by how much they scatter.
const SCATTERED: usize = 5;
/// Fits of gains and poses before a loss is taken.
const LOSS_ROUNDS: usize = 2;
/// Steps of a fit.
const MAX_STEPS: usize = 12;
/// Fall of the cost, relative, at which a fit ends.
const MIN_STEP: f64 = 1e-6;
/// Damping that a fit begins with, and does not fall below.
const MIN_DAMPING: f64 = 1e-3;
/// Damping at which a fit gives up: the cost is rough where points leave images, and shorter steps fall
/// into its dents.
const MAX_DAMPING: f64 = 10.0;

/// Kinds of residuals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Off the plane.
    Thickness,
    /// Off the colour.
    Color,
}

/// Equations of both kinds.
type Both = [NormalEquations<WITH_POSE>; 2];
const NOTHING: Both = [NormalEquations::ZERO; 2];

/// Matched views with the weights of their points.
pub(super) struct Evidence<'a> {
    pub matches: Matches,
    images: &'a [Pyramid],
    level: usize,
    /// Factors of red, green and blue, by view.
    pub gains: Vec<[f64; 3]>,
    /// By kind, of every point; 1 until they are weighed.
    weights: [Vec<f32>; 2],
    /// By kind: what a point's square counts.
    information: [f64; 2],
    /// By kind: sum of the weights when they were weighed. Points leave images as cameras move.
    points: [f64; 2],
    /// By kind: square at which a point counts half.
    knees: [f64; 2],
    /// By how much views scatter more than their equations say, as far as halves of them told.
    scatter: f64,
}

/// Buffers of one thread.
#[derive(Default)]
struct Buffers {
    planes: Vec<PlaneOffset>,
    colors: Vec<ColorOffset>,
}

impl<'a> Evidence<'a> {
    /// Every point alike; `images` and `gains` are those of the matches' views.
    pub fn new(
        matches: Matches,
        images: &'a [Pyramid],
        gains: Vec<[f64; 3]>,
        level: usize,
    ) -> Self {
        let weights = [(); 2].map(|()| vec![1.0; matches.samples().len()]);
        let [information, points, knees] = [[1.0; 2]; 3];
        Self { matches, images, level, gains, weights, information, points, knees, scatter: 1.0 }
    }

    /// Weighs points by their residuals, and either kind by how large those are.
    pub fn weigh(&mut self, at: &Estimate) {
        self.weights.iter_mut().for_each(|weights| weights.fill(1.0));
        self.knees =
            self.usual(at).map(|usual| (OUTLYING * OUTLYING * usual).max(f64::MIN_POSITIVE));
        let squares = self.squares(at);
        for ((weights, squares), knee) in self.weights.iter_mut().zip(squares).zip(self.knees) {
            let weigh = |(weight, square): (&mut f32, Option<f64>)| {
                *weight = square.map_or(1.0, |square| 1.0 / (1.0 + square / knee)) as f32;
            };
            weights.iter_mut().zip(squares).for_each(weigh);
        }
        let views = self.by_view(at);
        let [thickness, colors] =
            [0, 1].map(|k| views.iter().map(|both| both[k]).collect::<Vec<_>>());
        let [planes, seen] = [&thickness, &colors].map(NormalEquations::total);
        self.points = [planes.n, seen.n];
        let witnesses = self.matches.n_sightings() as f64 / self.matches.samples().len() as f64;
        self.information = [
            1.0 / overdispersion(&thickness).max(LEAST_VARIANCE[0]),
            witnesses / seen.variance().max(LEAST_VARIANCE[1]),
        ]
        .map(|information| information / self.scatter);
    }

    /// How far points move in the images from one camera to another, in pixels of the images' size, or how
    /// far their depths do in shares of what the sensor's noise hides.
    pub fn moved(&self, from: &Unknowns, to: &Unknowns) -> f64 {
        let shift = color::distance(&self.matches, from, to) / f64::from(1u32 << self.level);
        let [offset, scale] = self.hidden();
        let [nearer, larger] = [0, 1].map(|i| (to.depth[i] - from.depth[i]).abs());
        shift.max(nearer / offset).max(larger / scale)
    }

    /// Estimates every view's gains anew.
    pub fn expose(&mut self, at: &Estimate) {
        let patches = color::patches(&self.matches, &self.photos(), at);
        self.gains = exposure(&patches, self.images.len()).gains;
    }

    fn photos(&self) -> Photos<'_> {
        Photos { images: self.images, gains: &self.gains, level: self.level }
    }

    /// What is told of a component's points.
    fn look(&self, at: (&Projector, &Estimate), component: usize, buffers: &mut Buffers) -> usize {
        let first = self.matches.start_of(component);
        let run = self.matches.of(component);
        let weight = |k: usize| move |i: usize| f64::from(self.weights[k][first + i]);
        plane_offsets(&self.matches, run, at.1, weight(0), &mut buffers.planes);
        color_offsets(&self.matches, &self.photos(), run, at, &mut buffers.colors);
        first
    }

    /// Median square of either kind's residuals, over some of the components.
    fn usual(&self, at: &Estimate) -> [f64; 2] {
        let projector = Projector::new(&at.unknowns.camera);
        let (mut buffers, mut found) = (Buffers::default(), [Vec::new(), Vec::new()]);
        for component in (0..self.matches.len()).step_by(SAMPLED) {
            self.look((&projector, at), component, &mut buffers);
            found[0].extend(buffers.planes.iter().map(|p| p.off * p.off * p.precision));
            found[1].extend(buffers.colors.iter().map(ColorOffset::square));
        }
        found.map(|mut squares| {
            if squares.is_empty() {
                return 0.0;
            }
            let middle = squares.len() / 2;
            *squares.select_nth_unstable_by(middle, f64::total_cmp).1
        })
    }

    /// Square of either kind's residual of every point, where it has one.
    fn squares(&self, at: &Estimate) -> [Vec<Option<f64>>; 2] {
        let projector = Projector::new(&at.unknowns.camera);
        let parts: Vec<[Vec<Option<f64>>; 2]> = (0..self.matches.len())
            .into_par_iter()
            .chunks(CHUNK)
            .map(|components| {
                let mut buffers = Buffers::default();
                let mut found = [Vec::new(), Vec::new()];
                for component in components {
                    let end = found[0].len() + self.matches.of(component).len();
                    let first = found[0].len();
                    found.iter_mut().for_each(|squares| squares.resize(end, None));
                    self.look((&projector, at), component, &mut buffers);
                    for (i, plane) in buffers.planes.iter().enumerate() {
                        found[0][first + i] = Some(plane.off * plane.off * plane.precision);
                    }
                    for color in &buffers.colors {
                        found[1][first + color.index] = Some(color.square());
                    }
                }
                found
            })
            .collect();
        let mut whole = [Vec::new(), Vec::new()];
        for part in parts {
            whole.iter_mut().zip(part).for_each(|(whole, part)| whole.extend(part));
        }
        whole
    }

    /// Equations of every view by itself, about the means over all of them.
    pub fn by_view(&self, at: &Estimate) -> Vec<Both> {
        let projector = Projector::new(&at.unknowns.camera);
        let n = self.matches.poses.len();
        let parts: Vec<Vec<Both>> = (0..self.matches.len())
            .into_par_iter()
            .chunks(CHUNK)
            .map(|components| {
                let (mut views, mut buffers) = (vec![NOTHING; n], Buffers::default());
                for component in components {
                    let first = self.look((&projector, at), component, &mut buffers);
                    for (i, plane) in buffers.planes.iter().enumerate() {
                        let weight = f64::from(self.weights[0][first + i]);
                        plane.add(weight, &mut views[plane.view][0]);
                    }
                    for color in &buffers.colors {
                        let weight = f64::from(self.weights[1][first + color.index]);
                        color.add(weight, &mut views[color.view][1]);
                    }
                }
                views
            })
            .collect();
        let mut views = vec![NOTHING; n];
        for part in &parts {
            for (view, part) in views.iter_mut().zip(part) {
                view.iter_mut().zip(part).for_each(|(view, part)| view.add(part, 1.0));
            }
        }
        views
    }

    /// Mean weighted square of a kind's residuals.
    pub fn variance(&self, at: &Estimate, kind: Kind) -> f64 {
        let views = self.by_view(at);
        NormalEquations::total(views.iter().map(|both| &both[kind as usize])).variance()
    }

    /// What every view counts, with its pose.
    fn counted(&self, prior: &SensorPrior, at: &Estimate) -> Vec<NormalEquations<WITH_POSE>> {
        let views = self.by_view(at);
        // Of the mean, not of the sum: else a camera would gain by losing points.
        let factors = [0, 1].map(|k| {
            let n: f64 = views.iter().map(|both| both[k].n).sum();
            self.information[k] * self.points[k] / n.max(f64::MIN_POSITIVE)
        });
        let of_view = |(both, pose): (&Both, &Twist)| {
            let mut sum = NormalEquations::ZERO;
            both.iter().zip(factors).for_each(|(of_kind, factor)| sum.add(of_kind, factor));
            prior.add_pose(pose, &mut sum);
            sum
        };
        views.iter().zip(&at.poses).map(of_view).collect()
    }

    /// Moves the `free` unknowns and all poses to the minimum, by Levenberg and Marquardt's steps; what is
    /// found there.
    pub fn fit(&self, prior: &SensorPrior, at: &mut Estimate, free: &[usize]) {
        let mut now = Linearised::new(self.counted(prior, at), prior, at);
        let mut damping = MIN_DAMPING;
        for _ in 0..MAX_STEPS {
            let Some(next) = now.step(at, free, damping) else { break };
            let then = Linearised::new(self.counted(prior, &next), prior, &next);
            let fall = 1.0 - then.cost / now.cost;
            if fall > 0.0 {
                (*at, now) = (next, then);
                damping = (0.2 * damping).max(MIN_DAMPING);
            } else {
                damping *= 10.0;
            }
            // A step that raises the cost is not the end: the next is shorter.
            if (0.0..MIN_STEP).contains(&fall) || damping > MAX_DAMPING {
                break;
            }
        }
    }

    /// Where the `free` unknowns and the poses are best if others are held at some values.
    pub fn fit_without(
        &self,
        prior: &SensorPrior,
        at: &Estimate,
        free: &[usize],
        (held, values): (&[usize], &Unknowns),
    ) -> Estimate {
        let here = Linearised::new(self.counted(prior, at), prior, at);
        let mut change = [0.0; N];
        held.iter().for_each(|&i| change[i] = values.get(i) - at.unknowns.get(i));
        // As the curvature says, then fitted: from where they were they would not find back.
        let mut next = here.with_change(at, free, change).unwrap_or_else(|| at.clone());
        held.iter().for_each(|&i| next.unknowns.set(i, values.get(i)));
        self.fit(prior, &mut next, free);
        next
    }

    /// Mean loss of a kind's residuals (Cauchy's, which weighs no hypothesis's outliers beforehand), with gains
    /// and poses that suit the unknowns.
    pub fn loss(&mut self, prior: &SensorPrior, unknowns: &Unknowns, kind: Kind) -> f64 {
        let mut at = Estimate::as_recorded(*unknowns, self.matches.poses.len());
        for _ in 0..LOSS_ROUNDS {
            self.expose(&at);
            self.fit(prior, &mut at, &[]);
        }
        let knee = self.knees[kind as usize];
        let [thickness, colors] = self.squares(&at);
        let squares = if kind == Kind::Thickness { thickness } else { colors };
        let (mut sum, mut n) = (0.0, 0.0);
        for square in squares.into_iter().flatten() {
            sum += (square / knee).ln_1p();
            n += 1.0;
        }
        sum / n
    }

    /// How far two estimates from halves of the views are apart, in what these views' equations allow the
    /// mean of both to err.
    pub fn disagreement(
        &self,
        prior: &SensorPrior,
        at: &Estimate,
        free: &[usize],
        [a, b]: [&Unknowns; 2],
    ) -> f64 {
        let total = Linearised::new(self.counted(prior, at), prior, at).total;
        let apart = |i: usize| a.get(i) - b.get(i);
        let square: f64 = free
            .iter()
            .flat_map(|&i| free.iter().map(move |&j| (i, j)))
            .map(|(i, j)| apart(i) * total.curvature_at(i, j) * apart(j))
            .sum();
        // Halves have twice the variance of the whole, their difference four times.
        square / (4.0 * free.len() as f64)
    }

    /// Counts everything so many times less from now on.
    pub fn doubt(&mut self, times: f64) {
        self.scatter *= times;
        self.information = self.information.map(|information| information / times);
    }

    /// Covariance of the `free` unknowns at the minimum, by what the views' own gradients and what is known of
    /// sensors would move them by: `A⁻¹ B A⁻¹` with the curvature `A` and the gradients' scatter `B` (Huber
    /// 1967; Godambe 1960).
    pub fn covariance(&self, prior: &SensorPrior, at: &Estimate, free: &[usize]) -> Covariance {
        let posed = self.counted(prior, at);
        let views: Vec<NormalEquations<N>> = posed.iter().filter_map(|v| v.reduced()).collect();
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
            let mut gradient = vec![0.0; n];
            gradient[place] = known.curvature_at(i, i).sqrt();
            covariance.add(&factor.solve(&gradient), 1.0);
        }
        // Few views scatter little by chance: no less than what residuals and beliefs leave open.
        for place in 0..n {
            let mut unit = vec![0.0; n];
            unit[place] = 1.0;
            covariance.widen(place, factor.solve(&unit)[place]);
        }
        let floors = self.hidden();
        for (place, floor) in free.iter().map(|&i| floors.get(i)).enumerate() {
            covariance.blur(place, floor.map_or(0.0, |floor| floor * floor));
        }
        covariance
    }

    /// What quantisation hides of depth's offset and scale: it shifts all points of a surface alike, which
    /// no view contradicts.
    fn hidden(&self) -> [f64; 2] {
        let samples = self.matches.samples();
        let n = samples.len().max(1) as f64;
        let noise = samples.iter().map(|s| f64::from(s.point.noise)).sum::<f64>() / n;
        let range = samples.iter().map(|s| f64::from(s.point.range)).sum::<f64>() / n;
        [0.25 * noise, 0.25 * noise / range]
    }
}

/// Gradients of views about their mean.
struct Scatter {
    gradients: Vec<Vec<f64>>,
    /// Of a square, since the mean and the minimum take freedom away.
    weight: f64,
}

impl Scatter {
    fn of<const M: usize>(views: &[NormalEquations<M>], free: &[usize]) -> Self {
        let n = views.len() as f64;
        let of = |view: &NormalEquations<M>| free.iter().map(|&i| view.gradient[i]).collect();
        let mut gradients: Vec<Vec<f64>> = views.iter().map(of).collect();
        for place in 0..free.len() {
            let mean = gradients.iter().map(|g| g[place]).sum::<f64>() / n;
            gradients.iter_mut().for_each(|g| g[place] -= mean);
        }
        let freedom = (n - free.len() as f64).max(1.0);
        Self { gradients, weight: n / freedom }
    }
}

/// By how much the views' gradients by depth scatter more than independent points of variance 1 would make
/// them: the mean over both directions. Of few views all points of a view count as one.
fn overdispersion(views: &[NormalEquations<WITH_POSE>]) -> f64 {
    let total = NormalEquations::total(views);
    let Some(factor) = Cholesky::new(DEPTH.len(), &total.curvature_of(&DEPTH)) else { return 1.0 };
    if views.len() < SCATTERED {
        return total.n / views.len() as f64;
    }
    let scatter = Scatter::of(views, &DEPTH);
    let square = |gradient: &Vec<f64>| -> f64 {
        factor.solve(gradient).iter().zip(gradient).map(|(step, g)| step * g).sum()
    };
    let sum: f64 = scatter.gradients.iter().map(square).sum();
    scatter.weight * sum / DEPTH.len() as f64
}

/// All views' equations around an estimate.
struct Linearised {
    views: Vec<NormalEquations<WITH_POSE>>,
    /// Of the unknowns alone, poses being as it suits the views.
    total: NormalEquations<N>,
    cost: f64,
}

impl Linearised {
    fn new(views: Vec<NormalEquations<WITH_POSE>>, prior: &SensorPrior, at: &Estimate) -> Self {
        let mut total = prior.equations(&at.unknowns);
        let cost = total.cost + views.iter().map(|view| view.cost).sum::<f64>();
        views.iter().filter_map(|view| view.reduced()).for_each(|view| total.add(&view, 1.0));
        Self { views, total, cost }
    }

    /// A step of the `free` unknowns, and of the poses after them.
    fn step(&self, at: &Estimate, free: &[usize], damping: f64) -> Option<Estimate> {
        let step = self.total.step(free, damping)?;
        let mut change = [0.0; N];
        free.iter().zip(step).for_each(|(&i, step)| change[i] = step);
        self.moved(at, &change, 1.0 / (1.0 + damping))
    }

    /// What follows where some unknowns are changed and the `free` ones may follow.
    fn with_change(&self, at: &Estimate, free: &[usize], mut change: [f64; N]) -> Option<Estimate> {
        let factor = Cholesky::new(free.len(), &self.total.curvature_of(free))?;
        let pull = |i: usize| -> f64 {
            change.iter().enumerate().map(|(j, by)| -by * self.total.curvature_at(i, j)).sum()
        };
        let pulls: Vec<f64> = free.iter().map(|&i| pull(i)).collect();
        free.iter().zip(factor.solve(&pulls)).for_each(|(&i, step)| change[i] = step);
        self.moved(at, &change, 1.0)
    }

    fn moved(&self, at: &Estimate, change: &[f64; N], share: f64) -> Option<Estimate> {
        let mut next = at.clone();
        (0..N).for_each(|i| next.unknowns.set(i, at.unknowns.get(i) + change[i]));
        for (pose, view) in next.poses.iter_mut().zip(&self.views) {
            let steps = view.followed(change)?;
            pose.iter_mut().zip(steps).for_each(|(value, step)| *value += share * step);
        }
        Some(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::matches::{CameraPose, MatchedDepth};
    use crate::dataset::calibration::{Calibration, ColorCamera};
    use crate::math::image::Image;
    use crate::observation::surface::SurfacePoint;
    use glam::{DMat3, DVec3};

    const CAMERA: ColorCamera = ColorCamera {
        focal: [80.0, 80.0],
        principal: [40.0, 30.0],
        offset: [0.01, -0.02, 0.0],
        rotation: [0.0, 0.0, 0.02],
        size: None,
    };

    fn begin() -> Unknowns {
        Unknowns::of(&Calibration::NONE, CAMERA)
    }

    fn prior() -> SensorPrior {
        SensorPrior::new(CAMERA, &begin(), 1.0)
    }

    fn stand(centre: DVec3) -> CameraPose {
        CameraPose { rotation: DMat3::IDENTITY, centre }
    }

    const MEASURED: MatchedDepth = MatchedDepth { values: [0.0, 1.0], along_z: false };

    /// Photographs that are ramps.
    fn ramps(n: usize) -> Vec<Pyramid> {
        let ramp = |i: usize| [(3 * (i % 80)) as u8, (4 * (i / 80)) as u8, 100, 255];
        let image = || Image::from_vec(80, 60, (0..80 * 60).map(ramp).collect());
        (0..n).map(|_| Pyramid::new(image(), 1)).collect()
    }

    /// A wall before two cameras, the second nearer by so much.
    fn wall(nearer: f64) -> Matches {
        let (mut views, mut poses) = (Vec::new(), Vec::new());
        for view in 0..2 {
            let centre = DVec3::new(0.1 * f64::from(view), 0.0, nearer * f64::from(view));
            let point = |i: u32| {
                let place = DVec3::new(
                    0.03 * f64::from(i % 16) - 0.2,
                    0.03 * f64::from(i / 16) - 0.2,
                    2.0 + 0.01 * f64::from(view),
                );
                SurfacePoint {
                    position: place.as_vec3().to_array(),
                    direction: (place - centre).normalize().as_vec3().to_array(),
                    normal: [0.0, 0.0, -1.0],
                    noise: 0.003,
                    ..SurfacePoint::default()
                }
            };
            views.push((0..256).map(point).collect());
            poses.push(stand(centre));
        }
        Matches::together(&views, poses, MEASURED, 0.1)
    }

    #[test]
    fn gradients_are_those_of_finite_differences() {
        let images = ramps(2);
        let gains = vec![[1.0; 3], [1.1, 0.9, 1.0]];
        let evidence = Evidence::new(wall(0.3), &images, gains, 0);
        // Off where points were matched.
        let mut at = Estimate::as_recorded(begin(), 2);
        at.unknowns.depth = [0.004, 1.003];
        at.poses[1] = [0.003, -0.002, 0.001, 0.002, 0.001, -0.003];
        let views = evidence.by_view(&at);
        for k in 0..2 {
            let total = NormalEquations::total(views.iter().map(|both| &both[k]));
            assert!(total.cost > 0.1 && total.n == 512.0, "{k}: {} {}", total.cost, total.n);
            for i in 0..WITH_POSE {
                let step = 1e-5;
                let cost = |sign: f64| {
                    let mut moved = at.clone();
                    match i.checked_sub(N) {
                        Some(i) => moved.poses[1][i] += sign * step,
                        None => moved.unknowns.set(i, moved.unknowns.get(i) + sign * step),
                    }
                    let views = evidence.by_view(&moved);
                    // A pose is fitted to its own view's residuals.
                    match i < N {
                        true => NormalEquations::total(views.iter().map(|both| &both[k])).cost,
                        false => views[1][k].cost,
                    }
                };
                let expected = (cost(1.0) - cost(-1.0)) / (4.0 * step);
                let found = if i < N { total.gradient[i] } else { views[1][k].gradient[i] };
                let error = (found - expected).abs();
                assert!(error < 1e-3 * expected.abs().max(1.0), "{k} {i}: {found} {expected}");
            }
        }
    }

    #[test]
    fn distances_are_in_pixels() {
        let matches = wall(0.3);
        let mut moved = begin();
        moved.set(6, moved.get(6) + 3.0);
        moved.set(7, moved.get(7) - 4.0);
        assert!((color::distance(&matches, &begin(), &moved) - 5.0).abs() < 1e-9);
        assert!((color::shifts(&matches, &begin())[7] - 1.0).abs() < 1e-12);
    }

    /// A wall and a floor seen from places at several distances, as a depth camera with this error
    /// measures them; every view's place is known as well as `jitter` says.
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
                    // What a correction by `offset` and `scale` makes right.
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
        Matches::together(&views, poses, MEASURED, 0.25)
    }

    fn fitted(matches: Matches) -> (Unknowns, Vec<f64>) {
        let images = ramps(matches.poses.len());
        let gains = vec![[1.0; 3]; images.len()];
        let mut evidence = Evidence::new(matches, &images, gains, 0);
        let mut at = Estimate::as_recorded(begin(), evidence.matches.poses.len());
        evidence.weigh(&at);
        evidence.fit(&prior(), &mut at, &DEPTH);
        evidence.weigh(&at);
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
        // Two views of one wall side by side: depth may be anything.
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
