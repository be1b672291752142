use super::log_sum_exp;
use super::reference::{self, *};
use crate::common::golden::{Case, Tolerance::*};
use vbgs_studio::model::conjugate::prior;
use vbgs_studio::train::paper::config::Candidates;
use vbgs_studio::train::paper::index::PaperScalar;

const LOW_ELBO: usize = 100;
const TRUNCATED: Candidates = Candidates::Nearest(4);

fn tolerance() -> Option<ReassignTolerance> {
    Some(ReassignTolerance { elbo: 1e-6, p: 5e-5 })
}

#[test]
fn scores_and_assignments() {
    let case = Case::open("rand_hard");
    let trainer = trainer::<f64>(&case, Candidates::Dense);
    let x0 = points::<f64>(&case, 0);
    let (scoring, model) = trainer.scoring();
    let row = |i: usize| -> Vec<f64> {
        (0..64)
            .map(|k| scoring.elbo(scoring.distance(model, k, x0.position(i), x0.color(i))))
            .collect()
    };
    let scores: Vec<f64> = (0..200).flat_map(row).collect();
    let elbo: Vec<f64> = (0..500).map(|i| log_sum_exp(&row(i))).collect();
    case.check("score0", &scores, Rel(1e-12, 1.0));
    case.check("score0_ref", &scores, Rel(1e-6, 1.0));
    case.check("elbo0", &elbo, Rel(1e-12, 1.0));
    case.check("elbo0_ref", &elbo, Rel(1e-6, 1.0));
    case.check(
        "elogpi_init",
        &prior::expected_ln_weights(&case.f64("alpha_init")),
        Rel(1e-12, 1e-3),
    );
}

fn assignments_and_candidates<R: PaperScalar>(case: &Case) {
    let trainer = trainer::<R>(case, Candidates::Dense);
    let x0 = points::<R>(case, 0);
    case.check_exact("assign0", &assignments(&trainer, &x0));
    let truncated = reference::trainer::<R>(case, TRUNCATED);
    case.check_exact("trunc_cand0", &nearest(&truncated, &x0));
}

#[test]
fn assignments_are_exact_in_both_paths() {
    let case = Case::open("rand_hard");
    assignments_and_candidates::<f64>(&case);
    assignments_and_candidates::<f32>(&case);
}

#[test]
fn forwarded() {
    let case = Case::open("rand_hard");
    let mut trainer = trainer::<f64>(&case, TRUNCATED);
    let frames = [points::<f64>(&case, 0), points::<f64>(&case, 1)];
    for (t, frame) in frames.iter().enumerate() {
        let prefix = format!("fwd_f{t}");
        trainer.train(frame).unwrap();
        check_counts(&case, &prefix, &trainer);
        check_sums(&case, &prefix, &trainer);
        check_posterior(&case, &prefix, &trainer, &[&frames[0], &frames[1]]);
        case.check(&format!("{prefix}_elogdet"), &expected_ln_det(&trainer), Abs(1e-2));
        check_reassign(&case, &format!("{prefix}_re"), &mut trainer, frame, LOW_ELBO, tolerance());
        check_means(&case, &format!("{prefix}_re_means"), &trainer, 1e-15);
    }
}

#[test]
fn before_fit() {
    let case = Case::open("rand_hard");
    let mut trainer = trainer::<f64>(&case, TRUNCATED);
    let frames = [points::<f64>(&case, 0), points::<f64>(&case, 1)];
    for (t, frame) in frames.iter().enumerate() {
        let prefix = format!("bef_f{t}");
        if t > 0 {
            trainer.evaluate(frame, TRUNCATED);
            check_reassign(
                &case,
                &format!("{prefix}_re"),
                &mut trainer,
                frame,
                LOW_ELBO,
                tolerance(),
            );
            check_means(&case, &format!("{prefix}_re_means"), &trainer, 1e-15);
        }
        trainer.train(frame).unwrap();
        check_counts(&case, &prefix, &trainer);
        check_sums(&case, &prefix, &trainer);
        check_posterior(&case, &prefix, &trainer, &[&frames[0], &frames[1]]);
    }
}

#[test]
fn dense_rescan() {
    let case = Case::open("rand_hard");
    let mut trainer = trainer::<f64>(&case, TRUNCATED);
    trainer.train(&points(&case, 0)).unwrap();
    let x1 = points::<f64>(&case, 1);
    trainer.evaluate(&x1, Candidates::Dense);
    check_reassign(&case, "dense_re", &mut trainer, &x1, usize::MAX, tolerance());
    check_means(&case, "dense_re_means", &trainer, 1e-15);
}

fn check_counts<R: PaperScalar>(
    case: &Case,
    prefix: &str,
    trainer: &vbgs_studio::train::paper::trainer::PaperTrainer<R>,
) {
    let counts: Vec<f64> = (0..trainer.components()).map(|k| trainer.moments(k).count).collect();
    case.check(&format!("{prefix}_N"), &counts, Abs(0.0));
}

/// Hard assignments give integer N, which is exact in f32 too.
#[test]
fn mixed_path_counts_exactly() {
    let case = Case::open("rand_hard");
    let mut trainer = trainer::<f32>(&case, TRUNCATED);
    for t in 0..2 {
        trainer.train(&points(&case, t)).unwrap();
        let prefix = format!("fwd_f{t}");
        check_counts(&case, &prefix, &trainer);
        check_reassign(
            &case,
            &format!("{prefix}_re"),
            &mut trainer,
            &points(&case, t),
            LOW_ELBO,
            None,
        );
    }
}
