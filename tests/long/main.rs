//! A camera circles the same room many times: memory and time per frame stay flat, and sums do not drift. The
//! test has a process of its own, since it measures the memory of the process.
//!
//! `VBGS_LONG_FRAMES=10000 cargo test --release --test long -- --nocapture` is the long run.
#![allow(clippy::unwrap_used)]

#[path = "../common/mod.rs"]
mod common;
mod leaks;

use common::live::{Counted, bytes};
use glam::DVec3;
use std::fs::DirEntry;
use std::sync::OnceLock;
use std::time::Instant;
use vbgs_studio::dataset::surface::{Preparer, Sensor, SurfaceSettings};
use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
use vbgs_studio::eval::report::rss_bytes;
use vbgs_studio::model::attributes::StoredModel;
use vbgs_studio::model::scene::state::{QUANTUM, StoredSums};
use vbgs_studio::model::scene::sums::N_SUMS;
use vbgs_studio::model::splat::pose_log::FrameExposure;
use vbgs_studio::model::splat::pose_log::FramePose;
use vbgs_studio::observation::surface::Observation;
use vbgs_studio::train::learner::{Learner, Learns};
use vbgs_studio::train::scene::config::SceneConfig;
use vbgs_studio::train::scene::photometric::rule::PhotometricMode;
use vbgs_studio::train::scene::trainer::SceneTrainer;

#[global_allocator]
static ALLOCATOR: Counted = Counted;

const ROUND: usize = 24;
/// Default number of rounds, as in CI.
const ROUNDS: usize = 25;
/// Structural scale, world units. Coarse, so that all components are born in the first round.
const H: f64 = 0.15;

/// Parameters of a small synthetic room.
fn small() -> SyntheticParams {
    SyntheticParams {
        width: 64,
        height: 48,
        n_train: ROUND,
        n_eval: 0,
        depth_noise: 1.0,
        ..SyntheticParams::demo()
    }
}

/// Observations of one round of the camera.
fn round(surface: &SurfaceSettings) -> Vec<Observation> {
    let room = dataset(&small()).unwrap();
    let mut preparer = Preparer::new();
    let observed = (0..ROUND).map(|i| {
        let mut seen = Observation::empty();
        preparer.prepare(&room.load(0, i).unwrap(), surface, &mut seen).unwrap();
        seen
    });
    observed.collect()
}

fn rounds() -> usize {
    let asked = std::env::var("VBGS_LONG_FRAMES").ok().and_then(|n| n.parse::<usize>().ok());
    asked.map_or(ROUNDS, |frames| frames.div_ceil(ROUND)).max(10)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// CPU milliseconds of all threads of the process so far, on which other load has little influence. Falls
/// back to wall-clock milliseconds if the system does not report CPU time.
fn computed_ms() -> f64 {
    static STARTED: OnceLock<Instant> = OnceLock::new();
    let of_thread = |task: DirEntry| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    };
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    match threads.filter_map(of_thread).sum::<f64>() {
        ns if ns > 0.0 => 1e-6 * ns,
        _ => 1e3 * STARTED.get_or_init(Instant::now).elapsed().as_secs_f64(),
    }
}

/// Relative rise from the second tenth of the values (one per round) to the last tenth.
fn rise(by_round: &[f64]) -> f64 {
    let tenth = (by_round.len() / 10).max(2);
    let of = |part: &[f64]| median(part.to_vec());
    of(&by_round[by_round.len() - tenth..]) / of(&by_round[tenth..2 * tenth]) - 1.0
}

/// Growth per round: the median of the slopes between all pairs of values (Theil–Sen estimator), which is
/// robust against single slow rounds.
fn slope(by_round: &[f64]) -> f64 {
    let n = by_round.len();
    let from = |i: usize| (i + 1..n).map(move |j| (by_round[j] - by_round[i]) / (j - i) as f64);
    median((0..n).flat_map(from).collect())
}

/// Bytes of the wide rows. A component gets its single wide row after 4,096 points.
fn of_wide_rows(scene: &SceneTrainer) -> usize {
    let StoredModel::Scene(state) = scene.checkpoint_model() else {
        panic!("a scene is stored as one")
    };
    let StoredSums { wide, .. } = state.sums;
    assert!(wide.len() <= scene.status().used);
    wide.len() * size_of::<[f64; N_SUMS]>()
}

/// Bytes stored permanently per frame (gains, pose, and pose of the photograph), in vectors whose capacity
/// doubles.
fn of_frames(n_frames: u64) -> usize {
    let of_each = size_of::<FrameExposure>() + 2 * size_of::<FramePose>();
    n_frames.next_power_of_two() as usize * of_each
}

/// Sums of all components.
fn totals(scene: &SceneTrainer) -> Vec<[f64; N_SUMS]> {
    let StoredModel::Scene(state) = scene.checkpoint_model() else {
        panic!("a scene is stored as one")
    };
    let StoredSums { rows, wide } = state.sums;
    let mut totals: Vec<[f64; N_SUMS]> =
        rows.iter().map(|row| row.map(|quanta| f64::from(quanta) * QUANTUM)).collect();
    for row in wide {
        totals[row.id as usize] = row.sums;
    }
    totals
}

/// A single test, since a second one would add to the measured memory.
#[test]
fn a_long_run_is_flat_and_its_sums_are_exact() {
    let n = rounds();
    memory_and_time_stay_flat(n);
    sums_do_not_drift(n);
    let params = SyntheticParams { n_train: 49, ..small() };
    leaks::nothing_is_left(dataset(&params).unwrap());
}

/// Checks memory and time of training with depth and photographs.
fn memory_and_time_stay_flat(n: usize) {
    let mut surface = SurfaceSettings::of_sensor(Sensor::Kinect, DVec3::ZERO);
    surface.photograph = true;
    let frames = round(&surface);
    let photometric = PhotometricMode::Light.rule();
    let config = SceneConfig { photometric, max_components: 4000, ..SceneConfig::coarse(H) };
    let mut scene = SceneTrainer::new(&config, surface.origin);
    let (mut model, mut ms, mut used) = (vec![], vec![], vec![]);
    let (mut memory, mut resident) = (Vec::with_capacity(n), Vec::with_capacity(n));
    for _ in 0..n {
        let start = computed_ms();
        for frame in &frames {
            scene.learn(frame).unwrap();
        }
        ms.push((computed_ms() - start) / ROUND as f64);
        let wide = of_wide_rows(&scene);
        model.push((scene.memory().bytes - wide) as f64);
        used.push(scene.status().used as f64);
        // Wide rows are stored in a tree whose nodes are two thirds full.
        let kept = scene.memory().bytes + wide / 2 + of_frames(scene.status().frames);
        memory.push(bytes() as f64 - kept as f64);
        resident.extend(rss_bytes().map(|bytes| bytes as f64));
    }
    let [of_model, of_components, of_time] = [&model, &used, &ms].map(|values| rise(values));
    eprintln!(
        "{} frames: {} components, {:.1} KB; from the second to the last tenth: components \
         {:+.2} %, model {:+.2} %, CPU ms per frame {:+.1} % of {:.2}",
        n * ROUND,
        scene.status().used,
        model[model.len() - 1] / 1e3,
        100.0 * of_components,
        100.0 * of_model,
        100.0 * of_time,
        ms[n / 10],
    );
    assert!(of_model <= 0.03, "the model grows by {of_model}");
    // The bound allows for other load on the machine; real growth with the number of frames is far larger.
    assert!(of_time <= 0.5, "the time per frame grows by {of_time}");
    let warm = &ms[n / 10..];
    let slope = slope(warm);
    let growth = slope * warm.len() as f64 / median(warm.to_vec());
    eprintln!(
        "slope of CPU ms per frame {:+.4} per 1,000 frames, {:+.1} % from the second tenth on",
        slope * 1e3 / ROUND as f64,
        100.0 * growth
    );
    // In a short run other load dominates the slope: two hyperthreads of one core each take a third more time
    // than one alone.
    if n > ROUNDS {
        assert!(growth <= 0.5, "the time per frame grows by {growth} in all");
    }
    let of_memory = rise(&memory);
    eprintln!(
        "allocated beside the model and {:.2} MB of frames: {:.2} MB, {:+.2} %",
        of_frames(scene.status().frames) as f64 / 1e6,
        memory[n - 1] / 1e6,
        100.0 * of_memory
    );
    assert!(of_memory <= 0.03, "memory grows by {of_memory}");
    if !resident.is_empty() {
        // Includes files that the system maps or drops, so it is only printed, not checked.
        let of_resident = 100.0 * rise(&resident);
        eprintln!("resident in all: {:.1} MB, {of_resident:+.2} %", resident[n - 1] / 1e6);
    }
}

/// Order-independent sums are exact: every round after the first adds exactly the same.
fn sums_do_not_drift(n: usize) {
    let surface = SurfaceSettings::of_sensor(Sensor::Kinect, DVec3::ZERO);
    let frames = round(&surface);
    let config = SceneConfig { refine: false, ..SceneConfig::fine(H) };
    let mut scene = SceneTrainer::new(&config, surface.origin);
    // Points of the first round may find nearer seeds that were born after them, so the second counts.
    let (mut first, mut once) = (Vec::new(), Vec::new());
    for i in 0..n {
        for frame in &frames {
            scene.learn(frame).unwrap();
        }
        match i {
            0 => first = totals(&scene),
            1 => once = totals(&scene),
            _ => {}
        }
    }
    let times = (n - 1) as f64;
    let expected = first
        .iter()
        .zip(&once)
        .map(|(first, second)| std::array::from_fn(|i| first[i] + (second[i] - first[i]) * times));
    assert_eq!(totals(&scene), expected.collect::<Vec<[f64; N_SUMS]>>());
    eprintln!("{} sums are exact after {} frames", once.len() * N_SUMS, n * ROUND);
}
