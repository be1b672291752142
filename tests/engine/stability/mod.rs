//! Numerically hard cases: errors of means, covariances and responsibilities against rational arithmetic.
//!
//! Engines read f32 points and means, so the exact reference starts from the same rounded values.
//! The errors are thus those of the arithmetic, not of the input. They are maxima rather than
//! means, because an average hides a single broken component, which is a visible hole.

mod cases;
mod exact;

use cases::{Case, all};
use exact::RationalMixture;
use glam::DVec3;
use std::collections::BTreeMap;
use vbgs_studio::bench::paper::oracle::{PosteriorErrors, posterior_errors};
use vbgs_studio::model::conjugate::posterior::ComponentPosterior;
use vbgs_studio::observation::points::Points;
use vbgs_studio::train::paper::config::{
    Candidates, PaperConfig, PaperOverrides, Precision, ReassignPolicy,
};
use vbgs_studio::train::paper::init::InitialDraw;
use vbgs_studio::train::paper::learner;
use vbgs_studio::train::paper::learner::PaperLearner;

/// Cases with non-finite points, which the loader normally drops before training.
const BROKEN: [&str; 2] = ["points with NaN", "points with infinities"];
/// Case with a looser bound: splat positions are f32, whose resolution at 1e6 is 0.06.
const SHIFTED: &str = "scene shifted by 1e6";

fn rows(precision: Precision, is_chosen: impl Fn(&Case) -> bool) -> Vec<StabilityRow> {
    let cases = all(0);
    let chosen = cases.iter().filter(|case| is_chosen(case));
    chosen.map(|case| Truth::new(case).measure(precision)).collect()
}

fn sound(case: &Case) -> bool {
    !BROKEN.contains(&case.name)
}

/// Checks what must hold in every precision.
fn check_sane(row: &StabilityRow) {
    assert!(row.positive_definite, "{row:?}");
    assert_eq!(row.non_finite, 0, "{row:?}");
    assert!(row.used >= 1, "{row:?}");
    let resolution = if row.case == SHIFTED { 0.06 } else { 1e-2 };
    assert!(row.splat_error < resolution, "{row:?}");
}

#[test]
fn f64_is_exact_to_its_rounding() {
    let rows = rows(Precision::F64, sound);
    assert!(rows.len() >= 20, "{} cases", rows.len());
    for row in &rows {
        check_sane(row);
        assert!(row.responsibility_error < 1e-12, "{row:?}");
        assert!(row.count_error < 1e-12, "{row:?}");
        assert!(row.mean_error < 1e-13, "{row:?}");
        assert!(row.covariance_error < 1e-11, "{row:?}");
    }
}

#[test]
fn mixed_precision_is_exact_to_the_rounding_of_f32_about_the_mean() {
    // f32 rounding is relative to the distance from the initial mean, which these cases lie far from.
    let far = |case: &str| match case {
        "responsibilities that underflow" => [1e-5, 5e-3],
        "denormals" => [1e-4, 2e-2],
        _ => [3e-7, 1e-3],
    };
    for row in rows(Precision::Mixed, sound) {
        check_sane(&row);
        let [mean, covariance] = far(row.case);
        assert!(row.responsibility_error < 1e-5, "{row:?}");
        assert!(row.count_error < 1e-6, "{row:?}");
        assert!(row.mean_error < mean, "{row:?}");
        assert!(row.covariance_error < covariance, "{row:?}");
    }
}

#[test]
fn points_that_are_no_numbers_do_not_count() {
    for precision in [Precision::F64, Precision::Mixed] {
        for row in rows(precision, |case| !sound(case)) {
            check_sane(&row);
            assert_eq!(row.points_broken, 5);
            assert!(row.count_error < 1e-6 && row.mean_error < 1e-6, "{row:?}");
        }
    }
}

/// One case in one precision.
#[derive(Debug)]
struct StabilityRow {
    case: &'static str,
    /// Non-finite points, which the engine must ignore.
    points_broken: usize,
    /// Components with statistics.
    used: usize,
    /// Largest total variation of a point's responsibilities.
    responsibility_error: f64,
    /// Largest relative error of a count `N_k`.
    count_error: f64,
    /// Largest relative error of a posterior mean.
    mean_error: f64,
    /// Largest relative error of a posterior covariance.
    covariance_error: f64,
    /// Largest distance of a splat's centre from the exact posterior mean, in half-widths of the
    /// scene.
    splat_error: f64,
    positive_definite: bool,
    /// Non-finite values among posteriors, ELBO and splats.
    non_finite: usize,
}

/// A case with its results in exact arithmetic.
struct Truth<'a> {
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
    fn new(case: &'a Case) -> Self {
        let overrides = PaperOverrides {
            components: Some(case.draw.means.len()),
            candidates: Some(Candidates::Nearest(case.candidates)),
            reassign: Some(ReassignPolicy::Off),
            ..PaperOverrides::default()
        };
        let config = PaperConfig::paper().with(&overrides).unwrap();
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
        Self {
            case,
            config,
            draw,
            frame: Points::from_rows(&rows),
            sound,
            responsibilities,
            posteriors: exact.posteriors(),
        }
    }

    /// Trains an engine on the case and compares it with the exact results.
    fn measure(&self, precision: Precision) -> StabilityRow {
        let overrides = PaperOverrides { precision: Some(precision), ..PaperOverrides::default() };
        let config = self.config.clone().with(&overrides).unwrap();
        let mut engine = learner::begin(&config, &self.draw, self.case.normalization).unwrap();
        for _ in 0..self.case.frames {
            engine.learn(&self.frame).unwrap();
        }
        let found = engine.posteriors();
        let PosteriorErrors { mean_max, covariance_max, .. } =
            posterior_errors(&found, &self.posteriors);
        StabilityRow {
            case: self.case.name,
            points_broken: self.sound.iter().filter(|sound| !**sound).count(),
            used: engine.status().used,
            responsibility_error: self.responsibility_error(&mut *engine),
            count_error: self.count_error(&found),
            mean_error: mean_max,
            covariance_error: covariance_max,
            splat_error: self.splat_error(&*engine),
            positive_definite: found.iter().all(|p| p.expected_covariance().cholesky().is_some()),
            non_finite: self.non_finite(&*engine, &found),
        }
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

/// Non-zero responsibilities of one point, by component.
type Shares = BTreeMap<u32, f64>;

/// Half the sum of absolute differences.
fn total_variation(a: &Shares, b: &Shares) -> f64 {
    let here = a.iter().map(|(id, r)| (r - b.get(id).unwrap_or(&0.0)).abs());
    let only_there = b.iter().filter(|(id, _)| !a.contains_key(id)).map(|(_, r)| r.abs());
    0.5 * (here.sum::<f64>() + only_there.sum::<f64>())
}

/// Largest error. NaN counts as infinite, whereas `f64::max` would ignore it.
fn largest(errors: impl Iterator<Item = f64>) -> f64 {
    errors.map(|e| if e.is_nan() { f64::INFINITY } else { e }).fold(0.0, f64::max)
}
