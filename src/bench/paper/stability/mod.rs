//! Hard cases for arithmetic, each against exact sums: how far means, covariances and
//! responsibilities are off, whether covariances stay positive definite, whether anything but a
//! number comes out.
//!
//! Engines read f32 points and means, so the exact reference is given those, rounded likewise: what
//! remains is the error of the arithmetic, not of its input. Errors are largest ones, not means:
//! one broken component is a hole that no average shows.

mod cases;
mod exact;

pub use cases::{Case, all};

use super::oracle::{PosteriorErrors, Shares, posterior_errors, total_variation};
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use crate::bench::plot::axis::Axis;
use crate::bench::plot::draw;
use crate::bench::plot::draw::{Mark, Panel, Series};
use crate::eval::spread::Spread;
use crate::eval::table;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::observation::points::Points;
use crate::train::paper::config::{
    Candidates, PaperConfig, PaperOverrides, Precision, ReassignPolicy,
};
use crate::train::paper::engine;
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner::PaperLearner;
use exact::RationalMixture;
use glam::DVec3;
use serde::Serialize;

/// Precisions that every case runs in.
pub const PRECISIONS: [Precision; 3] = [Precision::F64, Precision::Mixed, Precision::F32];

/// One case in one precision.
#[derive(Clone, Debug, Serialize)]
pub struct StabilityRow {
    /// What is hard about it.
    pub case: &'static str,
    /// Arithmetic of the engine.
    pub precision: Precision,
    /// Points of a frame.
    pub points: usize,
    /// Points that are no finite numbers and must not count.
    pub points_broken: usize,
    /// Times the frame was learnt.
    pub frames: u32,
    /// Components of the model, used or not.
    pub components: usize,
    /// Components with statistics.
    pub used: usize,
    /// Largest total variation of a point's responsibilities.
    pub responsibility_error: f64,
    /// Largest difference of a count `N_k`, relative.
    pub count_error: f64,
    /// Largest relative error of a posterior mean.
    pub mean_error: f64,
    /// Largest relative error of a posterior covariance.
    pub covariance_error: f64,
    /// Largest distance of a splat's centre from the exact posterior mean, in half-widths of the
    /// scene.
    pub splat_error: f64,
    /// Smallest eigenvalue of any posterior covariance over the prior's part in it; 1 or more where
    /// nothing rounds.
    pub smallest_eigenvalue: f64,
    /// Whether every posterior covariance is positive definite.
    pub positive_definite: bool,
    /// Values of posteriors, ELBO and splats that are no finite numbers.
    pub non_finite: usize,
}

/// Runs every case in every precision.
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

/// A case and what exact arithmetic makes of it.
pub struct Truth<'a> {
    case: &'a Case,
    config: PaperConfig,
    draw: InitialDraw,
    frame: Points<f32>,
    /// Which points are numbers.
    sound: Vec<bool>,
    responsibilities: Vec<Shares>,
    posteriors: Vec<ComponentPosterior>,
}

impl<'a> Truth<'a> {
    /// Learns the case exactly, from points and means as every engine reads them: in f32.
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

    /// Runs an engine through the case and compares.
    pub fn measure(&self, precision: Precision) -> Result<StabilityRow, BenchError> {
        let overrides = PaperOverrides { precision: Some(precision), ..PaperOverrides::default() };
        let config = self.config.clone().with(&overrides)?;
        let mut engine = engine::begin(&config, &self.draw, self.case.normalization)?;
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
        // Exact arithmetic never saw the broken points: without this pairs would be shifted.
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
        // The scale is the standard deviation of a uniform law, half its range over √3.
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
        // Points left out have no score.
        let elbo = engine.point_elbo().into_iter().filter(|e| !e.is_nan());
        posterior.chain(drawn).chain(elbo).filter(|v| !v.is_finite()).count()
    }
}

/// `U⁻¹` is the prior's plus terms that are not negative.
fn eigenvalue_over_prior(config: &PaperConfig) -> impl Fn(&ComponentPosterior) -> f64 {
    let prior = 1.0 / config.hyper().u0_space;
    // Descending: z is the least.
    move |posterior| posterior.inverse_scale.eigen().values.z / prior
}

fn text(rows: &[StabilityRow]) -> String {
    let cells = |row: &StabilityRow| {
        [
            row.case.to_owned(),
            precision_name(row.precision).to_owned(),
            table::error(row.responsibility_error),
            table::error(row.count_error),
            table::error(row.mean_error),
            table::error(row.covariance_error),
            table::error(row.splat_error),
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
    table::text(header, &rows.iter().map(cells).collect::<Vec<_>>())
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
        "Largest errors against rational arithmetic on the same f32 points and means: total variation of responsibilities, relative errors of counts, posterior means and covariances; the splat's centre in half-widths of the scene.".to_owned(),
        "Splats are f32 in world units: a scene shifted by 1e6 is drawn in steps of 0.06, whatever the precision of the engine.".to_owned(),
        "Points that are no finite numbers must not count. definite: every posterior covariance has a Cholesky factor.".to_owned(),
    ]
}

fn panels(rows: &[StabilityRow]) -> [Panel; 2] {
    let mut names: Vec<String> = rows.iter().map(|r| r.case.to_owned()).collect();
    names.dedup();
    let position = |row: &StabilityRow| names.iter().position(|n| n == row.case).unwrap_or(0);
    // Side by side, or equal errors would hide each other.
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

/// The largest error; what is no number is the largest of all, where `f64::max` would pass it over.
fn largest(errors: impl Iterator<Item = f64>) -> f64 {
    errors.map(|e| if e.is_nan() { f64::INFINITY } else { e }).fold(0.0, f64::max)
}
