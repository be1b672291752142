//! The engine's variants against each other: alternative computations must agree bit for bit,
//! approximations must stay close to the f64 oracle.

use super::common::wavy::wavy_frame;
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::model::paper::state::ModelState;
use vbgs_studio::observation::points::Points;
use vbgs_studio::train::paper::config::{
    Candidates, Operations, PaperConfig, PaperOverrides, Precision, ReassignPolicy, UpdateWidth,
    Width,
};
use vbgs_studio::train::paper::init::InitialDraw;
use vbgs_studio::train::paper::learner;
use vbgs_studio::train::paper::learner::PaperLearner;
use vbgs_studio::train::setting::table::SettingLayer;

const COMPONENTS: usize = 3000;
const POLICIES: [ReassignPolicy; 3] =
    [ReassignPolicy::Off, ReassignPolicy::Padded, ReassignPolicy::Forwarded];

fn frames() -> Vec<Points<f32>> {
    (0..4).map(|t| wavy_frame(0.3 * t as f32, 40)).collect()
}

fn config(overrides: &PaperOverrides) -> PaperConfig {
    let base = PaperOverrides { components: Some(COMPONENTS), ..PaperOverrides::default() };
    PaperConfig::paper().with(&overrides.clone().or(base)).unwrap()
}

fn trained(overrides: &PaperOverrides, frames: &[Points<f32>]) -> Box<dyn PaperLearner> {
    trained_by(&config(overrides), frames)
}

/// Trains the plain engine, the reference of the fused kernels.
fn plain(overrides: &PaperOverrides, frames: &[Points<f32>]) -> Box<dyn PaperLearner> {
    trained_by(&PaperConfig { is_plain: true, ..config(overrides) }, frames)
}

fn trained_by(config: &PaperConfig, frames: &[Points<f32>]) -> Box<dyn PaperLearner> {
    let draw = InitialDraw::random(config.components, config.seed);
    let mut engine = learner::begin(config, &draw, Normalization::IDENTITY).unwrap();
    for frame in frames {
        engine.learn(frame).unwrap();
    }
    engine
}

fn state(overrides: &PaperOverrides, frames: &[Points<f32>]) -> ModelState {
    trained(overrides, frames).state()
}

fn in_pool<T: Send>(threads: usize, run: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(run)
}

#[test]
fn ways_of_computing_give_the_same_bits() {
    let frames = frames();
    for reassign in POLICIES {
        let base = PaperOverrides { reassign: Some(reassign), ..PaperOverrides::default() };
        let expected = state(&base, &frames);
        assert!(plain(&base, &frames).state() == expected, "{reassign:?}");
        for threads in [1, 2, 3] {
            let found = in_pool(threads, || state(&base, &frames));
            assert!(found == expected, "{threads} threads, {reassign:?}");
        }
    }
}

/// One pass that reruns the tiles affected by moves equals two passes, frame by frame: from many moves
/// that affect nearly all tiles to few that affect almost none.
#[test]
fn fits_ahead_of_moves_give_the_bits_of_two_passes() {
    let frames: Vec<_> = (0..24).map(|t| wavy_frame(0.05 * t as f32, 24)).collect();
    for fraction in [0.2, 0.02, 0.004] {
        let once = PaperOverrides {
            reassign: Some(ReassignPolicy::Padded),
            reassign_fraction: Some(fraction),
            ..PaperOverrides::default()
        };
        // The plain engine always runs two passes.
        let mut twice = plain(&once, &frames[..1]);
        let mut once = trained(&once, &frames[..1]);
        once.component_elbo_mut().start();
        twice.component_elbo_mut().start();
        for frame in &frames[1..] {
            let [a, b] = [&mut once, &mut twice].map(|engine| engine.learn(frame).unwrap());
            assert!(a.reassigned > 0, "{fraction}");
            assert_eq!((a.reassigned, a.elbo_mean), (b.reassigned, b.elbo_mean), "{fraction}");
            assert!(once.point_elbo() == twice.point_elbo(), "{fraction}");
            let owned = |engine: &dyn PaperLearner| {
                (0..COMPONENTS)
                    .map(|k| engine.last_frame().component_elbo.mean_elbo_of(k))
                    .collect::<Vec<_>>()
            };
            assert!(owned(&*once) == owned(&*twice), "{fraction}");
        }
        assert!(once.state() == twice.state(), "{fraction}");
    }
}

#[test]
fn without_reassignment_the_order_of_frames_does_not_matter() {
    let mut frames = frames();
    for precision in [Precision::Mixed, Precision::F64] {
        let off = PaperOverrides {
            reassign: Some(ReassignPolicy::Off),
            precision: Some(precision),
            ..PaperOverrides::default()
        };
        let expected = state(&off, &frames);
        frames.reverse();
        assert!(state(&off, &frames) == expected, "{precision:?}");
    }
}

/// With the paper's hyper-parameters, C = 4 candidates assign every point as all components do.
#[test]
fn truncation_assigns_as_the_dense_e_step() {
    let frames = frames();
    let with = |candidates, precision| PaperOverrides {
        candidates: Some(candidates),
        precision: Some(precision),
        components: Some(1000),
        reassign: Some(ReassignPolicy::Off),
        ..PaperOverrides::default()
    };
    for precision in [Precision::Mixed, Precision::F64] {
        let dense = state(&with(Candidates::Dense, precision), &frames[..1]);
        assert!(state(&with(Candidates::Nearest(4), precision), &frames[..1]) == dense);
    }
}

#[test]
fn precisions_stay_close_to_the_oracle() {
    let frames = frames();
    let base = PaperOverrides { reassign: Some(ReassignPolicy::Off), ..PaperOverrides::default() };
    let f64 = PaperOverrides { precision: Some(Precision::F64), ..base.clone() };
    let oracle = trained(&f64, &frames).posteriors();
    let mut single = vec![Operations::MIXED];
    for operation in 0..4 {
        let mut widths = [Width::F32; 4];
        widths[operation] = Width::F64;
        let [distance, log_score, normaliser, moments] = widths;
        let update = UpdateWidth::Fixed64;
        single.push(Operations { distance, log_score, normaliser, moments, update });
    }
    single.push(Operations::all(Width::F64, UpdateWidth::Fixed128));
    for operations in single {
        let custom = PaperOverrides { operations: Some(operations), ..base.clone() };
        let found = trained(&custom, &frames).posteriors();
        for (k, (a, b)) in oracle.iter().zip(&found).enumerate() {
            assert_eq!(a.count, b.count, "{operations:?}, component {k}");
            assert!((a.mean_space - b.mean_space).length() < 1e-6, "{operations:?}, {k}");
            assert!((a.mean_color - b.mean_color).length() < 1e-5, "{operations:?}, {k}");
        }
    }
}

#[test]
fn points_that_are_no_numbers_are_left_out() {
    let clean = wavy_frame(0.1, 40);
    let mut dirty = Points::new();
    let bad = [
        [f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, f32::INFINITY, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, f32::NAN, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, f32::NEG_INFINITY, 0.0],
        [1e30, 0.0, 0.0, 0.0, 0.0, 0.0],
    ];
    for tile in 0..clean.n_tiles() {
        for i in clean.tile(tile) {
            let ([x, y, z], [r, g, b]) = (clean.position(i), clean.color(i));
            dirty.push([x, y, z, r, g, b]);
        }
        dirty.close_tile();
        if tile < bad.len() {
            dirty.push(bad[tile]);
            dirty.close_tile();
        }
    }
    for precision in [Precision::Mixed, Precision::F64] {
        for is_plain in [false, true] {
            let overrides = PaperOverrides {
                precision: Some(precision),
                reassign: Some(ReassignPolicy::Off),
                ..PaperOverrides::default()
            };
            let mut engine =
                if is_plain { plain(&overrides, &[]) } else { trained(&overrides, &[]) };
            let outcome = engine.learn(&dirty).unwrap();
            // The square of 1e30 overflows f32 only, so f64 accepts the last point.
            let left_out = if precision == Precision::F64 { 4 } else { 5 };
            assert_eq!(outcome.points, dirty.len() - left_out);
            assert!(outcome.elbo_mean.is_finite());
            if precision == Precision::Mixed {
                let expected = state(&overrides, std::slice::from_ref(&clean));
                assert!(engine.state() == expected, "plain: {is_plain}");
            }
        }
    }
}
