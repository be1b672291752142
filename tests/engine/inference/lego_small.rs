use super::reference::*;
use crate::common::golden::{Case, Tolerance::*};
use vbgs_studio::observation::points::Points;
use vbgs_studio::train::paper::config::Candidates;
use vbgs_studio::train::paper::index::PaperScalar;
use vbgs_studio::train::paper::trainer::PaperTrainer;

const TRUNCATED: Candidates = Candidates::Nearest(4);

fn frames<R: PaperScalar>(case: &Case) -> Vec<Points<R>> {
    (0..3).map(|t| points(case, t)).collect()
}

fn low_elbo(case: &Case) -> usize {
    case.hyper("low_elbo_count") as usize
}

fn tolerance() -> Option<ReassignTolerance> {
    Some(ReassignTolerance { elbo: 2e-9, p: 1e-7 })
}

fn check_frame(case: &Case, prefix: &str, trainer: &PaperTrainer<f64>, frames: &[Points<f64>]) {
    let counts: Vec<f64> = (0..trainer.components()).map(|k| trainer.moments(k).count).collect();
    case.check(&format!("{prefix}_N"), &counts, Abs(0.0));
    check_posterior(case, prefix, trainer, &frames.iter().collect::<Vec<_>>());
}

#[test]
fn without_reassignment() {
    let case = Case::open("lego_small");
    let mut trainer = trainer::<f64>(&case, TRUNCATED);
    let frames = frames::<f64>(&case);
    case.check_exact("none_cand0", &nearest(&trainer, &frames[0]));
    for (t, frame) in frames.iter().enumerate() {
        case.check_exact(&format!("none_assign{t}"), &assignments(&trainer, frame));
        trainer.train(frame).unwrap();
        case.check(&format!("none_elbo{t}"), &trainer.elbo(), Rel(2e-9, 1.0));
        check_frame(&case, &format!("none_f{t}"), &trainer, &frames);
    }
}

#[test]
fn before_fit() {
    let case = Case::open("lego_small");
    let mut trainer = trainer::<f64>(&case, TRUNCATED);
    let frames = frames::<f64>(&case);
    for (t, frame) in frames.iter().enumerate() {
        if t > 0 {
            trainer.evaluate(frame, TRUNCATED);
            let prefix = format!("before_f{t}_re");
            check_reassign(&case, &prefix, &mut trainer, frame, low_elbo(&case), tolerance());
        }
        trainer.train(frame).unwrap();
        check_frame(&case, &format!("before_f{t}"), &trainer, &frames);
    }
}

#[test]
fn forwarded() {
    let case = Case::open("lego_small");
    let mut trainer = trainer::<f64>(&case, TRUNCATED);
    let frames = frames::<f64>(&case);
    for (t, frame) in frames.iter().enumerate() {
        trainer.train(frame).unwrap();
        check_frame(&case, &format!("forward_f{t}"), &trainer, &frames);
        let prefix = format!("forward_f{t}_re");
        check_reassign(&case, &prefix, &mut trainer, frame, low_elbo(&case), tolerance());
    }
}

/// Mixed precision assigns every point as the reference does; its posterior agrees to f32 rounding.
#[test]
fn mixed_path() {
    let case = Case::open("lego_small");
    let (mut exact, mut mixed) =
        (trainer::<f64>(&case, TRUNCATED), trainer::<f32>(&case, TRUNCATED));
    for t in 0..3 {
        let frame = points::<f32>(&case, t);
        case.check_exact(&format!("none_assign{t}"), &assignments(&mixed, &frame));
        exact.train(&points(&case, t)).unwrap();
        mixed.train(&frame).unwrap();
        let counts: Vec<f64> = (0..mixed.components()).map(|k| mixed.moments(k).count).collect();
        case.check(&format!("none_f{t}_N"), &counts, Abs(0.0));
    }
    for k in 0..exact.components() {
        let (a, b) = (exact.posterior(k), mixed.posterior(k));
        assert!((a.mean_space - b.mean_space).length() < 1e-6, "mean of {k}");
        let scale = a.inverse_scale.trace();
        for (x, y) in a.inverse_scale.to_array().iter().zip(b.inverse_scale.to_array()) {
            assert!(
                (x - y).abs() < 1e-5 * scale,
                "component {k} with N = {}: {x:e} {y:e}",
                a.count
            );
        }
    }
}
