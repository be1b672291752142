//! Training of the paper preset with arbitrary settings and commands.

use super::{MAX_COMMANDS, frame, read_back};
use crate::entries::bytes::Bytes;
use vbgs_studio::dataset::unproject::{
    CameraConvention, EdgeFilter, UnprojectSettings, Unprojector,
};
use vbgs_studio::export::checkpoint::StoredModel;
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::model::conjugate::posterior::Conversion;
use vbgs_studio::model::paper::merging;
use vbgs_studio::model::paper::state::ModelState;
use vbgs_studio::observation::points::Points;
use vbgs_studio::train::learner::Changed;
use vbgs_studio::train::outcome::FrameOutcome;
use vbgs_studio::train::paper::config::{
    Candidates, Init, Operations, PaperConfig, PaperOverrides, Precision, ReassignPolicy,
    UpdateWidth, Width,
};
use vbgs_studio::train::paper::init::InitialDraw;
use vbgs_studio::train::paper::learner;
use vbgs_studio::train::paper::learner::PaperLearner;

/// Maximum number of components.
// More would only slow down a pass: tiles hold 64 points, frames up to 192.
const MAX_COMPONENTS: usize = 80;

/// Reads settings, then executes commands until the bytes end.
pub fn train(kind: u8, mut input: Bytes) {
    let Some(config) = config(kind, &mut input) else { return };
    let Some(settings) = preparation(&mut input) else { return };
    let (mut unprojector, mut points) = (Unprojector::new(), Points::new());
    if config.init == Init::Data
        && let Some(frame) = frame(&mut input)
        && unprojector.unproject(&frame, &settings, &mut points).is_err()
    {
        points.clear();
    }
    let draw = match config.init {
        Init::Random => InitialDraw::random(config.components, config.seed),
        Init::Data => InitialDraw::from_points(&points, config.components, config.seed),
    };
    let Ok(mut mixture) = learner::begin(&config, &draw, settings.normalization) else { return };
    for _ in 0..MAX_COMMANDS {
        if input.is_empty() {
            break;
        }
        match input.byte() % 8 {
            0..=2 => {
                let Some(frame) = frame(&mut input) else { continue };
                if unprojector.unproject(&frame, &settings, &mut points).is_err() {
                    points.clear();
                }
                learn(&config, &mut *mixture, &points);
            }
            3 => learn(&config, &mut *mixture, &points),
            4 => learn_beside_copy(&config, &mut *mixture, &points, settings.normalization),
            5 => mixture = doubled(&config, &*mixture, settings.normalization),
            6 => check_shares(&mut *mixture, &points),
            _ => match input.flag() {
                true => mixture.component_elbo_mut().start(),
                false => mixture.component_elbo_mut().stop(),
            },
        }
        check(&*mixture);
    }
}

/// Reads settings; `None` if they are refused.
fn config(kind: u8, input: &mut Bytes) -> Option<PaperConfig> {
    let policies = [
        ReassignPolicy::Padded,
        ReassignPolicy::Dense,
        ReassignPolicy::Forwarded,
        ReassignPolicy::Off,
    ];
    let reassign = policies[usize::from(kind) % policies.len()];
    let components = usize::from(input.byte()) % (MAX_COMPONENTS + 1);
    let candidates = match input.byte() % 10 {
        9 => Candidates::Dense,
        n => Candidates::Nearest(n.into()),
    };
    let flags = input.byte();
    let overrides = PaperOverrides {
        seed: Some(input.byte().into()),
        components: Some(components),
        candidates: Some(candidates),
        init: (flags & 8 != 0).then_some(Init::Data),
        reassign: Some(reassign),
        reassign_fraction: Some(input.number().into()),
        scale_factor: (flags & 16 != 0).then(|| input.number().into()),
        ..precision(input)
    };
    let mut config = PaperConfig::paper().with(&overrides).ok()?;
    // No option sets this value: runs have the published one, tests others.
    config.low_elbo_floor = 1 + usize::from(input.byte());
    config.is_plain = flags & 1 != 0;
    if flags & 32 != 0 {
        config.conversion = Conversion::legacy();
    }
    Some(config)
}

/// Reads a precision, by name or with one bit per operation.
fn precision(input: &mut Bytes) -> PaperOverrides {
    let bits = input.byte();
    let named = |precision| PaperOverrides { precision: Some(precision), ..Default::default() };
    let width = |place: u8| if bits >> place & 1 == 0 { Width::F32 } else { Width::F64 };
    match bits % 3 {
        0 => named(Precision::Mixed),
        1 => named(Precision::F64),
        _ => PaperOverrides {
            operations: Some(Operations {
                distance: width(2),
                log_score: width(3),
                normaliser: width(4),
                moments: width(5),
                update: [UpdateWidth::Fixed64, UpdateWidth::Fixed128][usize::from(bits >> 6) % 2],
            }),
            ..Default::default()
        },
    }
}

/// Reads a normalization as of a range of positions: finite, and wide on every axis.
fn preparation(input: &mut Bytes) -> Option<UnprojectSettings> {
    let flags = input.byte();
    let [offset, scale] = [input.number(), input.number()].map(f64::from);
    if !offset.is_finite() || !(1e-6..=1e6).contains(&scale) {
        return None;
    }
    Some(UnprojectSettings {
        convention: [CameraConvention::Exact, CameraConvention::Paper][usize::from(flags & 1)],
        filter: [EdgeFilter::Off, EdgeFilter::DropMixed][usize::from(flags >> 1 & 1)],
        normalization: Normalization { offset: [offset; 3], scale: [scale; 3] },
    })
}

/// Trains on a frame. If the index cannot be built, the frame may or may not count.
fn learn(config: &PaperConfig, mixture: &mut dyn PaperLearner, points: &Points<f32>) {
    let before = mixture.status().frames;
    let Ok(outcome) = mixture.learn(points) else { return };
    assert_eq!(mixture.status().frames, before + 1);
    let FrameOutcome { points: learnt, elbo_mean, reassigned, .. } = outcome;
    assert!(learnt <= points.len(), "{learnt} of {} points", points.len());
    assert!(!elbo_mean.is_nan(), "an evidence that is no number");
    assert!(reassigned <= config.components, "{reassigned} of {} move", config.components);
    assert!(reassigned == 0 || config.reassign != ReassignPolicy::Off, "{reassigned} move");
    assert_eq!(mixture.point_elbo().len(), points.len());
}

/// Checks that a copy from a checkpoint trains like the original.
fn learn_beside_copy(
    config: &PaperConfig,
    mixture: &mut dyn PaperLearner,
    points: &Points<f32>,
    normalization: Normalization,
) {
    let model = read_back(mixture.checkpoint_model(), mixture.status().frames);
    assert!(model == mixture.checkpoint_model(), "another mixture is read");
    let StoredModel::Mixture { state, .. } = model else { panic!("a mixture is stored as one") };
    let mut copy = restored(config, state, mixture.status().frames, normalization);
    assert!(copy.checkpoint_model() == mixture.checkpoint_model(), "another mixture comes back");
    learn(config, mixture, points);
    learn(config, &mut *copy, points);
    assert!(copy.checkpoint_model() == mixture.checkpoint_model(), "the copy learns otherwise");
}

/// Merges the mixture with itself. Returns it unchanged if its sums cannot be added exactly.
fn doubled(
    config: &PaperConfig,
    mixture: &dyn PaperLearner,
    normalization: Normalization,
) -> Box<dyn PaperLearner> {
    let state = mixture.state();
    let Ok(totals) = merging::add(&state.totals, &state.totals) else {
        return restored(config, state, mixture.status().frames, normalization);
    };
    let hyper = config.hyper();
    let model =
        StoredModel::Mixture { normalization, hyper, state: ModelState { totals, ..state } };
    let StoredModel::Mixture { state, .. } = read_back(model, 2 * mixture.status().frames) else {
        panic!("a mixture is stored as one")
    };
    let twice = restored(config, state, 2 * mixture.status().frames, normalization);
    assert_eq!(twice.status().used, mixture.status().used);
    twice
}

fn restored(
    config: &PaperConfig,
    state: ModelState,
    frames: u64,
    normalization: Normalization,
) -> Box<dyn PaperLearner> {
    let restored = learner::restore(config, state, frames, normalization);
    restored.expect("means that were indexed before")
}

/// Checks that the responsibilities of every point sum to 1.
fn check_shares(mixture: &mut dyn PaperLearner, points: &Points<f32>) {
    let shares = mixture.responsibilities(points);
    assert_eq!(shares.len(), points.len());
    for shares in shares.iter().filter(|shares| !shares.is_empty()) {
        let whole: f64 = shares.iter().map(|(_, share)| share).sum();
        assert!((whole - 1.0).abs() < 1e-3, "shares of a point add up to {whole}");
        assert!(shares.iter().all(|(k, _)| (*k as usize) < mixture.status().components));
    }
}

/// Checks the invariants of a model.
fn check(mixture: &dyn PaperLearner) {
    let components = mixture.status().components;
    assert!(mixture.status().used <= components, "{} of {components} used", mixture.status().used);
    let stored = mixture.splats();
    let drawn = stored.iter().filter(|splat| splat.opacity > 0.0);
    drawn.for_each(|splat| assert!(splat.is_valid(), "{splat:?}"));
    if let Changed::Listed(changed) = mixture.last_frame().changed {
        assert!(changed.iter().all(|&k| (k as usize) < components), "{changed:?}");
    }
    for component in 0..components {
        let posterior = mixture.component(component).posterior;
        assert!(posterior.count >= 0.0, "{}", posterior.count);
    }
}
