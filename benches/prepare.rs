//! Time to prepare a frame on one thread, without decoding its images.
//!
//! `cargo bench --bench prepare` prints a table for Lego at 400 and 800 pixels (doubled) and for the Kinect,
//! from `../shared/data` if present, and for the synthetic room. `-- 400` selects one image width.
//! `VBGS_SIMD=portable` disables AVX2.

#![allow(clippy::print_stdout, clippy::expect_used)]

mod common;
#[path = "common/scenes.rs"]
#[allow(dead_code)] // its point frames are used by other benches
mod scenes;

use common::times_ms;
use glam::DVec3;
use scenes::doubled;
use std::path::Path;
use vbgs_studio::dataset::frame::Frame;
use vbgs_studio::dataset::surface::{Preparer, SurfaceSettings};
use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
use vbgs_studio::dataset::{Dataset, LoadOptions, open};
use vbgs_studio::math::simd::Isa;
use vbgs_studio::observation::surface::Observation;

/// Repetitions of a measurement, of which the median is printed.
const REPETITIONS: usize = 21;

fn main() {
    let sizes: Vec<u32> = std::env::args().filter_map(|word| word.parse().ok()).collect();
    println!("{}; medians of {REPETITIONS}", Isa::best().name());
    if let Some(lego) = shared("lego400") {
        for index in [0, 20, 100] {
            row(&lego, index, &sizes, |frame| frame);
            row(&lego, index, &sizes, doubled);
        }
    }
    if let Some(kinect) = shared("kinect_office") {
        row(&kinect, 0, &sizes, |frame| frame);
    }
    let room = synthetic::dataset(&SyntheticParams { n_train: 1, ..SyntheticParams::demo() });
    row(&room.expect("parameters in range"), 0, &sizes, |frame| frame);
}

fn shared(name: &str) -> Option<Dataset> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name);
    let dataset = open(&path, &LoadOptions::default()).ok();
    if dataset.is_none() {
        println!("skipped: {} not found", path.display());
    }
    dataset
}

/// Measures one frame if its width is among `sizes` or `sizes` is empty.
fn row(dataset: &Dataset, index: usize, sizes: &[u32], change: impl Fn(Frame) -> Frame) {
    let split = dataset.splits.iter().position(|s| s.has_depth).expect("a split with depth");
    let frame = change(dataset.load(split, index).expect("a sound frame"));
    let k = frame.camera.intrinsics;
    if !sizes.is_empty() && !sizes.contains(&k.width) {
        return;
    }
    let settings = SurfaceSettings::new(dataset, DVec3::ZERO);
    let (mut preparer, mut out) = (Preparer::new(), Observation::empty());
    let times = times_ms(REPETITIONS, || {
        preparer.prepare(&frame, &settings, &mut out).expect("a frame with depth");
    });
    let counts = preparer.prepare(&frame, &settings, &mut out).expect("a frame with depth");
    println!(
        "{:15} {index:3} {:4}x{:<4} {:7} measured {:7} points {:6.2} ms, least {:6.2}",
        dataset.name,
        k.width,
        k.height,
        counts.kept + counts.dropped(),
        counts.kept,
        times[REPETITIONS / 2],
        times[0]
    );
}
