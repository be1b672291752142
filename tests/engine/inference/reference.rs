//! Runs a trainer through the steps that produced the golden cases.

use super::sampler;
use crate::common::golden::{Case, Tolerance::*};

use glam::DVec3;
use std::collections::BTreeMap;
use vbgs_studio::math::special::mv_digamma3;
use vbgs_studio::model::conjugate::posterior::ComponentPosterior;
use vbgs_studio::model::conjugate::prior;
use vbgs_studio::model::conjugate::prior::Hyper;
use vbgs_studio::observation::points::Points;
use vbgs_studio::train::paper::config::{Candidates, Operations, PaperConfig, ReassignPolicy};
use vbgs_studio::train::paper::index::PaperScalar;
use vbgs_studio::train::paper::init::InitialDraw;
use vbgs_studio::train::paper::reassign::DestinationChooser;
use vbgs_studio::train::paper::trainer::PaperTrainer;

pub fn hyper(case: &Case) -> Hyper {
    Hyper {
        components: case.hyper("K") as usize,
        alpha0: case.hyper("alpha0"),
        kappa0_space: case.hyper("kappa0_s"),
        kappa_init_space: case.hyper("kappa_init_s"),
        u0_space: case.hyper("u0_s"),
        nu0: case.hyper("n0"),
        kappa0_color: case.hyper("kappa0_c"),
        kappa_init_color: case.hyper("kappa_init_c"),
        u0_color: case.hyper("u0_c"),
    }
}

/// Trainer in the initial state of the case, with reassignment off.
pub fn trainer<R: PaperScalar>(case: &Case, candidates: Candidates) -> PaperTrainer<R> {
    let is_wide = size_of::<R>() == size_of::<f64>();
    let config = PaperConfig {
        candidates,
        reassign: ReassignPolicy::Off,
        operations: if is_wide { Operations::F64 } else { Operations::MIXED },
        ..PaperConfig::paper()
    };
    let draw = InitialDraw { means: case.rows("mean_init"), alpha: case.f64("alpha_init") };
    PaperTrainer::with_hyper(&config, hyper(case), &draw).unwrap()
}

pub fn points<R: PaperScalar>(case: &Case, frame: usize) -> Points<R> {
    Points::from_rows(&case.rows(&format!("x{frame}")))
}

pub fn posteriors<R: PaperScalar>(trainer: &PaperTrainer<R>) -> Vec<ComponentPosterior> {
    (0..trainer.components()).map(|k| trainer.posterior(k)).collect()
}

/// Checks the raw sums `prefix_Sx`, `Sxx` and `Sc` to an absolute tolerance scaled by the largest entry.
pub fn check_sums(case: &Case, prefix: &str, trainer: &PaperTrainer<f64>) {
    let (mut sx, mut sxx, mut sc) = (vec![], vec![], vec![]);
    for k in 0..trainer.components() {
        let moments = trainer.moments(k);
        let (a, b) = moments.raw(trainer.mean_init(k));
        sx.extend(a.to_array());
        sxx.extend(b.to_array());
        sc.extend(moments.color.to_array());
    }
    for (name, found) in [("Sx", sx), ("Sxx", sxx), ("Sc", sc)] {
        let name = format!("{prefix}_{name}");
        let largest = case.f64(&name).iter().fold(0.0f64, |m, v| m.max(v.abs()));
        case.check(&name, &found, Abs(1e-12 * largest));
    }
}

/// Checks all arrays of a posterior that the case stores.
pub fn check_posterior(
    case: &Case,
    prefix: &str,
    trainer: &PaperTrainer<f64>,
    points_seen: &[&Points<f64>],
) {
    let p = posteriors(trainer);
    let column = |f: &dyn Fn(&ComponentPosterior) -> f64| p.iter().map(f).collect::<Vec<f64>>();
    let vectors = |f: &dyn Fn(&ComponentPosterior) -> DVec3| {
        p.iter().flat_map(|c| f(c).to_array()).collect::<Vec<f64>>()
    };
    let alpha = column(&|c| c.alpha);
    let reach = points_seen
        .iter()
        .flat_map(|p| (0..p.len()).map(|i| DVec3::from_array(p.position(i)).length_squared()));
    let max_square = reach.fold(0.0f64, f64::max);
    let inv_u: Vec<f64> = p.iter().flat_map(|c| c.inverse_scale.to_array()).collect();
    let sigma: Vec<f64> = p.iter().flat_map(|c| c.expected_covariance().to_array()).collect();
    let matrix_tolerance = |name: String, divide: bool| {
        let expected = case.f64(&name);
        let counts: Vec<f64> = p.iter().map(|c| c.count).collect();
        move |i: usize| {
            let k = i / 6;
            let largest = expected[6 * k..6 * k + 6].iter().fold(0.0f64, |m, v| m.max(v.abs()));
            let cancellation = 1e-14 * counts[k] * max_square;
            1e-12 * largest + cancellation / if divide { counts[k] + 1.0 } else { 1.0 }
        }
    };
    for (name, found, tolerance) in [
        ("alpha", alpha.clone(), Rel(1e-12, 1e-3)),
        ("kappa_s", column(&|c| c.kappa_space), Rel(1e-12, 1e-3)),
        ("n_s", column(&|c| c.nu_space), Rel(1e-12, 1e-3)),
        ("kappa_c", column(&|c| c.kappa_color), Rel(1e-12, 1e-3)),
        ("mean_s", vectors(&|c| c.mean_space), Rel(1e-11, 1e-3)),
        ("mean_c", vectors(&|c| c.mean_color), Rel(1e-11, 1e-3)),
    ] {
        let name = format!("{prefix}_{name}");
        if case.has(&name) {
            case.check(&name, &found, tolerance);
        }
    }
    let name = format!("{prefix}_inv_u");
    let tolerance = matrix_tolerance(name.clone(), false);
    case.check_each(&name, &inv_u, |i, _| tolerance(i));
    let name = format!("{prefix}_sigma");
    if case.has(&name) {
        let tolerance = matrix_tolerance(name.clone(), true);
        case.check_each(&name, &sigma, |i, _| tolerance(i));
        case.check(
            &format!("{prefix}_elogpi"),
            &prior::expected_ln_weights(&alpha),
            Rel(1e-12, 1e-3),
        );
    }
}

/// `E[ln|Λ|]` under every component's posterior.
pub fn expected_ln_det<R: PaperScalar>(trainer: &PaperTrainer<R>) -> Vec<f64> {
    let ln_det = |c: &ComponentPosterior| {
        3.0 * 2f64.ln() - c.inverse_scale.ln_det().unwrap() + mv_digamma3(0.5 * c.nu_space)
    };
    posteriors(trainer).iter().map(ln_det).collect()
}

/// Candidate ids of every point, nearest first.
pub fn nearest<R: PaperScalar>(trainer: &PaperTrainer<R>, points: &Points<R>) -> Vec<u32> {
    let of_points = trainer.responsibilities(points);
    of_points.iter().flatten().map(|&(id, _)| id).collect()
}

/// Component of every point (responsibilities must be one-hot).
pub fn assignments<R: PaperScalar>(trainer: &PaperTrainer<R>, points: &Points<R>) -> Vec<u32> {
    let owner = |(i, r): (usize, &Vec<(u32, f64)>)| {
        let owner = r.iter().find(|(_, r)| *r == 1.0);
        owner.unwrap_or_else(|| panic!("point {i} is soft: {r:?}")).0
    };
    trainer.responsibilities(points).iter().enumerate().map(owner).collect()
}

pub struct ReassignTolerance {
    pub elbo: f64,
    pub p: f64,
}

/// Checks the candidate set, the probabilities and the sampler against a stored reassignment, then
/// moves the stored components. The trainer's `elbo` must belong to `points`.
pub fn check_reassign<R: PaperScalar>(
    case: &Case,
    prefix: &str,
    trainer: &mut PaperTrainer<R>,
    points: &Points<R>,
    low_elbo: usize,
    tolerance: Option<ReassignTolerance>,
) {
    let name = |suffix: &str| format!("{prefix}_{suffix}");
    let cand = case.u32(&name("cand"));
    let unused = (trainer.components() - trainer.used()) as u32;
    case.check_exact(&name("unused"), &[unused]);

    let q = trainer.effective_distances();
    let mut mine: Vec<u32> = DestinationChooser::default().lowest_elbo(q, low_elbo).collect();
    mine.sort_unstable();
    let mut expected = cand.clone();
    expected.sort_unstable();
    assert_eq!(mine, expected, "{prefix}: candidate set");

    let all_elbo = trainer.elbo();
    let elbo: BTreeMap<u32, f64> = mine.iter().map(|&p| (p, all_elbo[p as usize])).collect();
    let my_q: Vec<f64> = mine.iter().map(|&p| q[p as usize]).collect();
    let my_p: BTreeMap<u32, f64> =
        mine.iter().copied().zip(sampler::probabilities(&my_q)).collect();
    if let Some(tolerance) = tolerance {
        if case.has(&name("cand_elbo")) {
            let in_order: Vec<f64> = cand.iter().map(|p| elbo[p]).collect();
            case.check(&name("cand_elbo"), &in_order, Rel(tolerance.elbo, 1.0));
        }
        let in_order: Vec<f64> = cand.iter().map(|p| my_p[p]).collect();
        case.check(&name("p"), &in_order, Rel(tolerance.p, 1e-2 / cand.len() as f64));
    }
    check_sampler(case, prefix, &cand);
    let moves: Vec<(u32, u32)> =
        case.u32(&name("comps")).into_iter().zip(case.u32(&name("points"))).collect();
    trainer.move_components(points, &moves).unwrap();
}

fn check_sampler(case: &Case, prefix: &str, cand: &[u32]) {
    let name = |suffix: &str| format!("{prefix}_{suffix}");
    let destinations = case.u32(&name("points"));
    let draws = case.f64(&name("draws"));
    let mut used = 0;
    let chosen = sampler::without_replacement(&case.f64(&name("p")), destinations.len(), || {
        used += 1;
        draws[used - 1]
    });
    let chosen: Vec<u32> = chosen.into_iter().map(|i| cand[i]).collect();
    case.check_exact(&name("points"), &chosen);
    assert_eq!(used, draws.len(), "{prefix}: uniforms consumed");
}

/// Initial means after a reassignment.
pub fn check_means<R: PaperScalar>(
    case: &Case,
    name: &str,
    trainer: &PaperTrainer<R>,
    tolerance: f64,
) {
    let (_, model) = trainer.scoring();
    let rows = model.space.iter().zip(&model.color);
    let found: Vec<f64> =
        rows.flat_map(|(s, c)| s.iter().chain(c).map(|v| v.to_f64()).collect::<Vec<_>>()).collect();
    case.check(name, &found, Abs(tolerance));
}
