//! Time of one frame of training, by stage.
//!
//! `cargo bench --bench frame` prints the stages of a frame (`training.md`, Speed) at N = 100,000 and C = 4
//! on about 190,000 points: frames of Lego (from `../shared/data/lego400` if present, doubled to 800 pixels)
//! and of a smooth surface. `VBGS_SIMD=portable` disables AVX2.

#![allow(clippy::print_stdout, clippy::expect_used)]

#[path = "common/scenes.rs"]
mod scenes;

use scenes::{draws, lego, smooth, together};
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::math::simd::Isa;
use vbgs_studio::observation::points::Points;
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides, ReassignPolicy};
use vbgs_studio::train::paper::init::InitialDraw;
use vbgs_studio::train::paper::learner;
use vbgs_studio::train::timing::StageMs;

/// Frames per measurement.
const FRAMES: usize = 100;
/// Number of different frames, used cyclically.
const DISTINCT: usize = 24;

fn main() {
    println!("{}; medians of {FRAMES} frames, ms", Isa::best().name());
    let lego = lego((0..DISTINCT).map(|t| 8 * t));
    let smooth: Vec<_> = (0..DISTINCT).map(|t| smooth(t as f32)).collect();
    for (name, frames) in lego.iter().map(|f| ("lego", f)).chain([("smooth", &smooth)]) {
        let [(_, random), (_, surface), _] = draws(100_000, &together(&frames[..8]));
        let only = std::env::args().nth(1).unwrap_or_default();
        for (start, draw, policy) in [
            ("random", &random, ReassignPolicy::Off),
            ("surface", &surface, ReassignPolicy::Off),
            ("growing", &random, ReassignPolicy::Forwarded),
            ("growing", &random, ReassignPolicy::Padded),
        ] {
            if !format!("{name} {start} {policy:?}").contains(only.trim_start_matches("--bench")) {
                continue;
            }
            let [one, two] = [1, 2].map(|threads| medians(frames, draw, policy, threads));
            println!(
                "{name:6} {start:7} {policy:9?} 1T {:5.1}   2T {:5.1}   ratio {:.2}   {}",
                one.train,
                two.train,
                one.train / two.train,
                two.stages()
                    .map(|(stage, ms)| format!("{} {ms:.2} ", stage.key))
                    .collect::<String>()
            );
        }
    }
}

/// Median of every stage over [`FRAMES`] frames.
fn medians(
    frames: &[Points<f32>],
    draw: &InitialDraw,
    policy: ReassignPolicy,
    threads: usize,
) -> StageMs {
    let overrides = PaperOverrides { reassign: Some(policy), ..PaperOverrides::default() };
    let config = PaperConfig::paper().with(&overrides).expect("settings in range");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    let times: Vec<StageMs> = pool.install(|| {
        let mut engine =
            learner::begin(&config, draw, Normalization::IDENTITY).expect("finite means");
        let frames = frames.iter().cycle().take(FRAMES);
        frames.map(|frame| engine.learn(frame).expect("finite means").ms).collect()
    });
    StageMs::combine(&times, |mut values| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    })
}
