use super::log_sum_exp;
use super::reference::{
    check_posterior, check_sums, expected_ln_det, hyper, nearest, points, trainer,
};
use crate::common::golden::{Case, Tolerance::*};
use glam::DVec3;
use vbgs_studio::math::sym3::Sym3;
use vbgs_studio::model::conjugate::niw::Niw;
use vbgs_studio::model::conjugate::prior;
use vbgs_studio::observation::points::Points;
use vbgs_studio::train::paper::config::Candidates;
use vbgs_studio::train::paper::trainer::PaperTrainer;

fn log_scores(
    trainer: &PaperTrainer<f64>,
    points: &Points<f64>,
    i: usize,
    ids: &[u32],
) -> Vec<f64> {
    let (scoring, model) = trainer.scoring();
    let distance =
        |&id: &u32| scoring.distance(model, id as usize, points.position(i), points.color(i));
    ids.iter().map(|id| scoring.elbo(distance(id))).collect()
}

#[test]
fn dense_scores_and_responsibilities() {
    let case = Case::open("rand_soft");
    let trainer = trainer::<f64>(&case, Candidates::Dense);
    let x0 = points::<f64>(&case, 0);
    let all: Vec<u32> = (0..64).collect();
    let (mut scores, mut r) = (vec![], vec![]);
    for i in 0..x0.len() {
        scores.extend(log_scores(&trainer, &x0, i, &all));
        let (scoring, model) = trainer.scoring();
        let mut row: Vec<f64> =
            (0..64).map(|k| scoring.distance(model, k, x0.position(i), x0.color(i))).collect();
        scoring.responsibilities::<f64>(&mut row);
        r.extend(row);
    }
    case.check("score0", &scores, Rel(1e-13, 1.0));
    case.check("resp0", &r, Abs(1e-12));
    let ln_weights = prior::expected_ln_weights(&case.f64("alpha_init"));
    case.check("elogpi_init", &ln_weights, Rel(1e-12, 1e-3));
}

/// Per-block likelihoods and KL terms computed from the Normal-Wishart distribution itself.
#[test]
fn block_likelihoods_and_divergences() {
    let case = Case::open("rand_soft");
    let h = hyper(&case);
    let means = case.rows::<6>("mean_init");
    let law = |mean, kappa, u| Niw::new(mean, kappa, Sym3::diagonal(u), h.nu0).unwrap();
    let space = |k: usize| DVec3::from_slice(&means[k][..3]);
    let color = |k: usize| DVec3::from_slice(&means[k][3..]);
    let x0 = case.rows::<6>("x0");
    let (mut ell_s, mut ell_c) = (vec![], vec![]);
    for x in &x0[..64] {
        for k in 0..64 {
            let s = law(space(k), h.kappa_init_space, h.u0_space);
            let c = law(color(k), h.kappa_init_color, h.u0_color);
            ell_s.push(s.expected_ln_likelihood(DVec3::from_slice(&x[..3])));
            ell_c.push(c.expected_ln_likelihood(DVec3::from_slice(&x[3..])));
        }
    }
    case.check("ell_s_head", &ell_s, Rel(1e-13, 1.0));
    case.check("ell_c_head", &ell_c, Rel(1e-13, 1.0));

    let prior_s = law(DVec3::ZERO, h.kappa0_space, h.u0_space);
    let prior_c = law(DVec3::ZERO, h.kappa0_color, h.u0_color);
    let kl_s: Vec<f64> =
        (0..64).map(|k| law(space(k), h.kappa_init_space, h.u0_space).kl(&prior_s)).collect();
    let kl_c: Vec<f64> =
        (0..64).map(|k| law(color(k), h.kappa_init_color, h.u0_color).kl(&prior_c)).collect();
    let kl_d = prior::kl(&case.f64("alpha_init"), &[h.alpha0; 64]);
    case.check("kl_space", &kl_s, Rel(1e-13, 1.0));
    case.check("kl_color", &kl_c, Rel(1e-13, 1.0));
    case.check("kl_dirichlet", &[kl_d], Rel(1e-13, 1.0));

    let total = kl_d + kl_s.iter().sum::<f64>() + kl_c.iter().sum::<f64>();
    for frame in 0..2 {
        let x = points::<f64>(&case, frame);
        let trainer = trainer::<f64>(&case, Candidates::Dense);
        let all: Vec<u32> = (0..64).collect();
        let elbo: Vec<f64> =
            (0..x.len()).map(|i| log_sum_exp(&log_scores(&trainer, &x, i, &all)) - total).collect();
        case.check(&format!("elbo{frame}"), &elbo, Rel(1e-13, 1.0));
    }
}

#[test]
fn cumulative_posteriors_dense_and_truncated() {
    let case = Case::open("rand_soft");
    for (name, candidates) in [("dense", Candidates::Dense), ("trunc", Candidates::Nearest(4))] {
        let mut trainer = trainer::<f64>(&case, candidates);
        let frames = [points::<f64>(&case, 0), points::<f64>(&case, 1)];
        for (t, frame) in frames.iter().enumerate() {
            let prefix = format!("{name}_f{t}");
            trainer.train(frame).unwrap();
            let elbo_name =
                if name == "dense" { format!("lse{t}") } else { format!("trunc_elbo{t}") };
            case.check(&elbo_name, &trainer.elbo(), Rel(1e-13, 1.0));
            let counts: Vec<f64> = (0..64).map(|k| trainer.moments(k).count).collect();
            let largest = counts.iter().fold(0.0f64, |m, v| m.max(*v));
            case.check(&format!("{prefix}_N"), &counts, Abs(1e-12 * largest));
            check_sums(&case, &prefix, &trainer);
            check_posterior(&case, &prefix, &trainer, &[&frames[0], &frames[1]]);
            case.check(&format!("{prefix}_elogdet"), &expected_ln_det(&trainer), Rel(1e-9, 1.0));
            if name == "trunc" {
                check_candidates(&case, t, &trainer, frame);
            }
        }
    }
}

fn check_candidates(case: &Case, t: usize, trainer: &PaperTrainer<f64>, frame: &Points<f64>) {
    let ids = nearest(trainer, frame);
    let scores: Vec<f64> =
        (0..frame.len()).flat_map(|i| log_scores(trainer, frame, i, &ids[4 * i..][..4])).collect();
    case.check_exact(&format!("trunc_cand{t}"), &ids);
    case.check(&format!("trunc_score{t}"), &scores, Rel(1e-13, 1.0));
}

/// Soft data in mixed precision: there is no golden tolerance, but sums must stay within f32 rounding.
#[test]
fn mixed_path_stays_close_to_the_oracle() {
    let case = Case::open("rand_soft");
    let (mut exact, mut mixed) = (
        trainer::<f64>(&case, Candidates::Nearest(4)),
        trainer::<f32>(&case, Candidates::Nearest(4)),
    );
    for t in 0..2 {
        exact.train(&points(&case, t)).unwrap();
        mixed.train(&points(&case, t)).unwrap();
    }
    for k in 0..64 {
        let (a, b) = (exact.posterior(k), mixed.posterior(k));
        assert!(
            (a.count - b.count).abs() < 1e-5 * a.count.max(1.0),
            "N of {k}: {} {}",
            a.count,
            b.count
        );
        assert!((a.mean_space - b.mean_space).length() < 1e-5, "mean of {k}");
        assert!((a.mean_color - b.mean_color).length() < 1e-5, "colour of {k}");
    }
}
