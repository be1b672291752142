//! Numerical stability on hard cases: errors of means, covariances and responsibilities against
//! exact arithmetic, positive definiteness of covariances, and non-finite values.
//!
//! Engines read f32 points and means, so the exact reference starts from the same rounded values.
//! The errors are thus those of the arithmetic, not of the input. They are maxima rather than
//! means, because an average hides a single broken component, which is a visible hole.

mod exact;

use super::oracle::{PosteriorErrors, Shares, posterior_errors, total_variation};
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use crate::bench::plot::draw::{Mark, Panel, Series};
use crate::bench::plot::{Axis, draw};
use crate::eval::metrics::Spread;
use crate::eval::report;
use crate::math::measured_pixel::Normalization;
use crate::math::rng::{Purpose, Rng};
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::observation::points::Points;
use crate::train::paper::config::{
    Candidates, PaperConfig, PaperOverrides, Precision, ReassignPolicy,
};
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner;
use crate::train::paper::learner::PaperLearner;
use exact::RationalMixture;
use glam::{DMat3, DVec3};
use serde::Serialize;

pub const PRECISIONS: [Precision; 3] = [Precision::F64, Precision::Mixed, Precision::F32];

/// One case in one precision.
#[derive(Clone, Debug, Serialize)]
pub struct StabilityRow {
    pub case: &'static str,
    pub precision: Precision,
    /// Points per frame.
    pub points: usize,
    /// Non-finite points, which the engine must ignore.
    pub points_broken: usize,
    /// Number of times the frame is trained on.
    pub frames: u32,
    /// Number of components, including unused ones.
    pub components: usize,
    /// Components with statistics.
    pub used: usize,
    /// Largest total variation of a point's responsibilities.
    pub responsibility_error: f64,
    /// Largest relative error of a count `N_k`.
    pub count_error: f64,
    /// Largest relative error of a posterior mean.
    pub mean_error: f64,
    /// Largest relative error of a posterior covariance.
    pub covariance_error: f64,
    /// Largest distance of a splat's centre from the exact posterior mean, in half-widths of the
    /// scene.
    pub splat_error: f64,
    /// Smallest eigenvalue of any scale matrix `U⁻¹`, relative to the prior's. At least 1 in exact
    /// arithmetic.
    pub smallest_eigenvalue: f64,
    pub positive_definite: bool,
    /// Non-finite values among posteriors, ELBO and splats.
    pub non_finite: usize,
}

pub fn run(options: BenchOptions, progress: Progress) -> Result<Bench, BenchError> {
    let cases = all(options.seed);
    let steps = cases.len() * PRECISIONS.len();
    let mut rows = Vec::with_capacity(steps);
    for case in &cases {
        let truth = Truth::new(case)?;
        for precision in PRECISIONS {
            rows.push(truth.measure(precision)?);
            progress(rows.len(), steps);
        }
    }
    Findings {
        name: "stability",
        dataset: "constructed cases",
        adapter: None,
        options,
        notes: notes(),
        table: text(&rows),
        plot: draw::draw("Stability: error against exact arithmetic", &panels(&rows))?,
        rows,
        summary: (),
    }
    .into_bench()
}

/// A case with its results in exact arithmetic.
pub struct Truth<'a> {
    case: &'a Case,
    config: PaperConfig,
    draw: InitialDraw,
    frame: Points<f32>,
    /// True for finite points.
    sound: Vec<bool>,
    responsibilities: Vec<Shares>,
    posteriors: Vec<ComponentPosterior>,
}

impl<'a> Truth<'a> {
    /// Trains the exact mixture on points and means rounded to f32, as every engine reads them.
    pub fn new(case: &'a Case) -> Result<Self, BenchError> {
        let overrides = PaperOverrides {
            components: Some(case.draw.means.len()),
            candidates: Some(Candidates::Nearest(case.candidates)),
            reassign: Some(ReassignPolicy::Off),
            ..PaperOverrides::default()
        };
        let config = PaperConfig::paper().with(&overrides)?;
        let single = |rows: &[[f64; 6]]| -> Vec<[f64; 6]> {
            rows.iter().map(|row| row.map(|v| f64::from(v as f32))).collect()
        };
        let draw = InitialDraw { means: single(&case.draw.means), alpha: case.draw.alpha.clone() };
        let rows = single(&case.points);
        let sound: Vec<bool> = rows.iter().map(|r| r.iter().all(|v| v.is_finite())).collect();
        let finite: Vec<[f64; 6]> =
            rows.iter().zip(&sound).filter(|(_, sound)| **sound).map(|(row, _)| *row).collect();
        let mut exact =
            RationalMixture::new(config.hyper(), &draw.means, &draw.alpha, case.candidates);
        let responsibilities = exact.learn(&finite).into_iter().map(Shares::from_iter).collect();
        exact.repeat(case.frames);
        Ok(Self {
            case,
            config,
            draw,
            frame: Points::from_rows(&rows),
            sound,
            responsibilities,
            posteriors: exact.posteriors(),
        })
    }

    /// Trains an engine on the case and compares it with the exact results.
    pub fn measure(&self, precision: Precision) -> Result<StabilityRow, BenchError> {
        let overrides = PaperOverrides { precision: Some(precision), ..PaperOverrides::default() };
        let config = self.config.clone().with(&overrides)?;
        let mut engine = learner::begin(&config, &self.draw, self.case.normalization)?;
        for _ in 0..self.case.frames {
            engine.learn(&self.frame)?;
        }
        let found: Vec<ComponentPosterior> =
            (0..engine.components()).map(|k| engine.posterior(k)).collect();
        let PosteriorErrors { mean_max, covariance_max, .. } =
            posterior_errors(&found, &self.posteriors);
        let smallest =
            found.iter().map(eigenvalue_over_prior(&config)).fold(f64::INFINITY, f64::min);
        Ok(StabilityRow {
            case: self.case.name,
            precision,
            points: self.frame.len(),
            points_broken: self.sound.iter().filter(|sound| !**sound).count(),
            frames: self.case.frames,
            components: engine.components(),
            used: engine.used(),
            responsibility_error: self.responsibility_error(&mut *engine),
            count_error: self.count_error(&found),
            mean_error: mean_max,
            covariance_error: covariance_max,
            splat_error: self.splat_error(&*engine),
            smallest_eigenvalue: smallest,
            positive_definite: found.iter().all(|p| p.expected_covariance().cholesky().is_some()),
            non_finite: self.non_finite(&*engine, &found),
        })
    }

    fn responsibility_error(&self, engine: &mut dyn PaperLearner) -> f64 {
        let found = engine.responsibilities(&self.frame).into_iter().map(Shares::from_iter);
        // The exact mixture skips non-finite points. Skipping them here too keeps the pairs
        // aligned.
        let sound = found.zip(&self.sound).filter(|(_, sound)| **sound).map(|(r, _)| r);
        let pairs = sound.zip(&self.responsibilities);
        largest(pairs.map(|(found, truth)| total_variation(truth, &found)))
    }

    fn count_error(&self, found: &[ComponentPosterior]) -> f64 {
        let pairs = found.iter().zip(&self.posteriors);
        largest(pairs.map(|(f, t)| (f.count - t.count).abs() / t.count.max(1.0)))
    }

    fn splat_error(&self, engine: &dyn PaperLearner) -> f64 {
        let normalization = &self.case.normalization;
        // The scale is the standard deviation of a uniform distribution: half its range over √3.
        let half_width = normalization.scale[0] * 3f64.sqrt();
        let splats = engine.splats();
        let used =
            splats.view().splats().iter().zip(&self.posteriors).filter(|(_, t)| t.count > 0.0);
        largest(used.map(|(splat, truth)| {
            let centre = DVec3::from_array(splat.mean.map(f64::from));
            centre.distance(normalization.denormalize(truth.mean_space)) / half_width
        }))
    }

    fn non_finite(&self, engine: &dyn PaperLearner, found: &[ComponentPosterior]) -> usize {
        let posterior = found.iter().flat_map(|p| {
            let scalars = [p.count, p.alpha, p.kappa_space, p.nu_space, p.kappa_color];
            let vectors = [p.mean_space, p.mean_color].map(|v| v.to_array());
            scalars
                .into_iter()
                .chain(vectors.into_iter().flatten())
                .chain(p.inverse_scale.to_array())
        });
        let splats = engine.splats();
        let drawn = splats.view().splats().iter().filter(|s| s.opacity > 0.0);
        let drawn = drawn.flat_map(|s| bytemuck::cast::<_, [f32; 14]>(*s).map(f64::from));
        // Skipped points have no ELBO.
        let elbo = engine.point_elbo().into_iter().filter(|e| !e.is_nan());
        posterior.chain(drawn).chain(elbo).filter(|v| !v.is_finite()).count()
    }
}

/// Returns the smallest eigenvalue of `U⁻¹` relative to the prior's. `U⁻¹` is the prior's plus
/// terms that are not negative.
fn eigenvalue_over_prior(config: &PaperConfig) -> impl Fn(&ComponentPosterior) -> f64 {
    let prior = 1.0 / config.hyper().u0_space;
    // Eigenvalues are descending: z is the smallest.
    move |posterior| posterior.inverse_scale.eigen().values.z / prior
}

fn text(rows: &[StabilityRow]) -> String {
    let cells = |row: &StabilityRow| {
        [
            row.case.to_owned(),
            precision_name(row.precision).to_owned(),
            report::error(row.responsibility_error),
            report::error(row.count_error),
            report::error(row.mean_error),
            report::error(row.covariance_error),
            report::error(row.splat_error),
            if row.positive_definite { "yes" } else { "NO" }.to_owned(),
            row.non_finite.to_string(),
        ]
    };
    let header = [
        "case",
        "precision",
        "responsibility",
        "count",
        "mean",
        "covariance",
        "splat",
        "definite",
        "not finite",
    ];
    report::text(header, &rows.iter().map(cells).collect::<Vec<_>>())
}

fn precision_name(precision: Precision) -> &'static str {
    match precision {
        Precision::F64 => "f64",
        Precision::Mixed => "mixed",
        Precision::F32 => "f32",
        Precision::Custom => "custom",
    }
}

fn notes() -> Vec<String> {
    vec![
        "Largest errors against rational arithmetic on the same f32 points and means: total variation of responsibilities; relative errors of counts, posterior means and covariances; distance of splat centres in half-widths of the scene.".to_owned(),
        "Splats are f32 in world units: a scene shifted by 1e6 is drawn in steps of 0.06 with every precision of the engine.".to_owned(),
        "Non-finite points must be ignored. definite: every posterior covariance has a Cholesky factor. not finite: non-finite values of posteriors, ELBO and splats.".to_owned(),
    ]
}

fn panels(rows: &[StabilityRow]) -> [Panel; 2] {
    let mut names: Vec<String> = rows.iter().map(|r| r.case.to_owned()).collect();
    names.dedup();
    let position = |row: &StabilityRow| names.iter().position(|n| n == row.case).unwrap_or(0);
    // Offset the series, because equal errors would hide each other.
    let shift = |i: usize| 0.22 * (i as f64 - 1.0);
    let panel = |title: &str, names: Vec<String>, error: &dyn Fn(&StabilityRow) -> f64| Panel {
        title: title.to_owned(),
        x: Axis::Log("largest relative error".to_owned()),
        y: Axis::Names(names),
        series: PRECISIONS
            .iter()
            .enumerate()
            .map(|(i, &precision)| Series {
                name: precision_name(precision).to_owned(),
                marks: rows
                    .iter()
                    .filter(|r| r.precision == precision)
                    .map(|r| Mark {
                        x: Spread::exact(error(r)),
                        y: Spread::exact(position(r) as f64 + shift(i)),
                        label: None,
                    })
                    .collect(),
                connected: false,
            })
            .collect(),
    };
    let blank = vec![String::new(); names.len()];
    [
        panel("posterior means", names.clone(), &|r| r.mean_error),
        panel("posterior covariances", blank, &|r| r.covariance_error),
    ]
}

/// Largest error. NaN counts as infinite, whereas `f64::max` would ignore it.
fn largest(errors: impl Iterator<Item = f64>) -> f64 {
    errors.map(|e| if e.is_nan() { f64::INFINITY } else { e }).fold(0.0, f64::max)
}

/// One hard case.
#[derive(Clone, Debug)]
pub struct Case {
    pub name: &'static str,
    /// Rows `[x, y, z, r, g, b]` of the frame in model coordinates. Some may be non-finite.
    pub points: Vec<[f64; 6]>,
    /// Number of times the frame is trained on.
    pub frames: u32,
    /// Initial means and weights.
    pub draw: InitialDraw,
    pub candidates: usize,
    /// Maps world to model coordinates.
    pub normalization: Normalization,
}

/// Number of frames accumulated in the drift case.
const DRIFT_FRAMES: u32 = 100_000;

/// All hard cases. `seed` selects their random numbers.
pub fn all(seed: u64) -> Vec<Case> {
    let mut cases = degenerate_data(seed);
    cases.extend(scales_and_shifts(seed));
    cases.extend(sizes(seed));
    cases.extend(extremes(seed));
    cases.push(drift(seed));
    cases.extend(broken_numbers(seed));
    cases
}

/// A case in the cube [−1, 1]³.
fn case(name: &'static str, points: Vec<[f64; 6]>, draw: InitialDraw) -> Case {
    let normalization = Normalization::from_range(DVec3::NEG_ONE, DVec3::ONE);
    Case { name, points, frames: 1, draw, candidates: 4, normalization }
}

/// Draws means close to the points, so that components compete.
fn near(points: &[[f64; 6]], components: usize, seed: u64) -> InitialDraw {
    let mut draw = InitialDraw::random(components, seed);
    let mut rng = Rng::new(seed, Purpose::Synthetic, 1);
    for mean in &mut draw.means {
        *mean = points[rng.below(points.len())].map(|v| v + 0.01 * rng.normal());
    }
    draw
}

fn row(position: DVec3, rng: &mut Rng) -> [f64; 6] {
    let [x, y, z] = position.to_array();
    let mut color = || rng.range(-1.7, 1.7);
    [x, y, z, color(), color(), color()]
}

fn rows(n: usize, seed: u64, mut place: impl FnMut(&mut Rng) -> DVec3) -> Vec<[f64; 6]> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
    (0..n)
        .map(|_| {
            let position = place(&mut rng);
            row(position, &mut rng)
        })
        .collect()
}

/// Random point on a bumpy sheet in [−1, 1]³.
fn sheet(rng: &mut Rng) -> DVec3 {
    let (u, v) = (rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
    DVec3::new(u, v, 0.3 * (3.0 * u).sin() * (2.0 * v).cos())
}

fn degenerate_data(seed: u64) -> Vec<Case> {
    let identical = vec![[0.31, -0.72, 0.55, 0.2, -0.4, 1.1]; 200];
    let line = rows(200, seed, |rng| DVec3::new(0.3, -0.5, 0.8) * rng.range(-1.0, 1.0));
    let plane = rows(200, seed, |rng| {
        DVec3::new(0.8, 0.1, 0.2) * rng.range(-1.0, 1.0)
            + DVec3::new(-0.2, 0.9, 0.4) * rng.range(-1.0, 1.0)
    });
    let one = vec![[0.4, 0.1, -0.9, 0.0, 0.5, -0.5]];
    // All means but one are far away, so that one component has the prior of a large mixture.
    let flat = plane.clone();
    let mut alone = InitialDraw::random(100_000, seed);
    alone.means[1..].iter_mut().for_each(|mean| mean[0] += 50.0);
    let flattest = Case { frames: 50, ..case("plane under one of 1e5 components", flat, alone) };
    let mut cases: Vec<Case> = [
        ("identical points", identical),
        ("points on a line", line),
        ("points on a plane", plane),
        ("one point", one),
    ]
    .map(|(name, points)| {
        let draw = near(&points, 8, seed);
        case(name, points, draw)
    })
    .into();
    cases.push(flattest);
    cases
}

/// The sheet in other world units, normalised by its own range like a dataset.
fn scales_and_shifts(seed: u64) -> Vec<Case> {
    let moved = |name, scale: f64, shift: f64| {
        let normalization =
            Normalization::from_range(DVec3::splat(shift - scale), DVec3::splat(shift + scale));
        let points: Vec<[f64; 6]> = rows(200, seed, |rng| {
            normalization.normalize(DVec3::splat(shift) + scale * sheet(rng))
        });
        let draw = near(&points, 16, seed);
        Case { normalization, ..case(name, points, draw) }
    };
    // A tiny off-centre scene in a layout with a fixed range.
    let tiny = rows(200, seed, |rng| DVec3::splat(0.01) + 1e-6 * sheet(rng));
    let draw = InitialDraw { means: tiny[..16].to_vec(), ..near(&tiny, 16, seed) };
    vec![
        moved("scene of size 1", 1.0, 0.0),
        moved("scene scaled by 1e-6", 1e-6, 0.0),
        moved("scene scaled by 1e6", 1e6, 0.0),
        moved("scene shifted by 1e6", 1.0, 1e6),
        case("scene of size 1e-6 in a range of 1", tiny, draw),
    ]
}

fn sizes(seed: u64) -> Vec<Case> {
    let points = rows(200, seed, sheet);
    let sized = |name, components, candidates| {
        let draw = near(&points, components, seed);
        Case { candidates, ..case(name, points.clone(), draw) }
    };
    let corners = [[1.0; 6], [-1.0; 6], [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]];
    let few = vec![
        [1.01, 1.0, 1.0, 0.5, 0.5, 0.5],
        [-1.0, -1.01, -1.0, -0.5, 0.5, 0.5],
        [-1.0, -1.0, -0.99, 0.5, -0.5, 0.5],
    ];
    let draw = InitialDraw { means: corners.to_vec(), alpha: vec![1.0 / 3.0; 3] };
    vec![
        sized("N = 1", 1, 4),
        sized("C > N", 3, 8),
        sized("C = N", 12, 12),
        Case {
            // `case` requires a draw, which is replaced here.
            draw: InitialDraw::random(100_000, seed),
            ..case("N = 1e5, few points each", points.clone(), near(&points, 1, seed))
        },
        Case {
            draw: near(&points, 100_000, seed),
            ..case("N = 1e5, many means a point", points.clone(), near(&points, 1, seed))
        },
        case("components with 0, 1 and 2 points", few, draw),
    ]
}

fn extremes(seed: u64) -> Vec<Case> {
    let turn = DMat3::from_rotation_x(0.7) * DMat3::from_rotation_z(1.1);
    let needle = rows(300, seed, |rng| {
        let local = DVec3::new(rng.normal(), 1e-4 * rng.normal(), 1e-7 * rng.normal());
        DVec3::splat(0.2) + turn * local
    });
    let pair = rows(100, seed, |rng| {
        DVec3::splat(0.5) + DVec3::X * if rng.uniform() < 0.5 { 0.0 } else { 1e-7 }
    });
    let sheet_points = rows(200, seed, sheet);
    // Far from every point, so that all densities underflow.
    let far = InitialDraw {
        means: near(&sheet_points, 64, seed).means.iter().map(|m| m.map(|v| v + 50.0)).collect(),
        ..near(&sheet_points, 64, seed)
    };
    let mut skewed = near(&sheet_points, 25, seed);
    for (k, alpha) in skewed.alpha.iter_mut().enumerate() {
        *alpha = 10f64.powi(k as i32 - 12);
    }
    let crowd = rows(200, seed, |rng| DVec3::splat(0.2) + 3e-4 * sheet(rng));
    let crowd: Vec<[f64; 6]> = crowd.iter().map(|r| [r[0], r[1], r[2], 0.1, 0.1, 0.1]).collect();
    let among = InitialDraw { means: crowd[..8].to_vec(), alpha: vec![0.125; 8] };
    let one = |points: &[[f64; 6]]| InitialDraw { means: vec![points[0]], alpha: vec![1.0] };
    vec![
        case("axes of 1, 1e-4 and 1e-7", needle.clone(), one(&needle)),
        case("near-singular: points 1e-7 apart", pair.clone(), one(&pair)),
        Case { candidates: 8, ..case("responsibilities shared by all", crowd, among) },
        case("responsibilities that underflow", sheet_points.clone(), far),
        Case { candidates: 25, ..case("weights from 1e-12 to 1e12", sheet_points, skewed) },
    ]
}

fn drift(seed: u64) -> Case {
    // Few points, because every precision trains on the frame 1e5 times.
    let points = rows(64, seed, sheet);
    let draw = near(&points, 8, seed);
    Case { frames: DRIFT_FRAMES, ..case("statistics of 1e5 frames", points, draw) }
}

fn broken_numbers(seed: u64) -> Vec<Case> {
    let sound = rows(100, seed, sheet);
    let draw = near(&sound, 8, seed);
    let broken = |name, value: f64| {
        let mut points = sound.clone();
        for (i, axis) in [(3, 0), (40, 1), (64, 2), (70, 3), (99, 5)] {
            points[i][axis] = value;
        }
        case(name, points, draw.clone())
    };
    let denormal = rows(100, seed, |rng| 1e-40 * sheet(rng));
    let denormal: Vec<[f64; 6]> =
        denormal.iter().map(|r| [r[0], r[1], r[2], 1e-41, -1e-40, 1e-44]).collect();
    let near_zero = near(&denormal, 8, seed);
    vec![
        broken("points with NaN", f64::NAN),
        broken("points with infinities", f64::INFINITY),
        case("denormals", denormal, near_zero),
    ]
}
