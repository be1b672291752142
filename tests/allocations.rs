//! The training loop and the preparation of frames allocate nothing once they are warm.
#![allow(clippy::unwrap_used, unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use vbgs_studio::dataset::surface::{Preparer, SurfaceSettings};
use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
use vbgs_studio::math::normalization::Normalization;
use vbgs_studio::observation::points::Points;
use vbgs_studio::observation::surface::Observation;
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides, ReassignPolicy};
use vbgs_studio::train::paper::engine;
use vbgs_studio::train::paper::init::InitialDraw;

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: hands everything to the system's allocator; counting does not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.realloc(old, layout, size) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Held while allocations are counted.
static ALONE: Mutex<()> = Mutex::new(());

/// Points of a surface that looks a little different in every frame.
fn frame(t: usize) -> Points<f32> {
    let mut points = Points::new();
    for tile in 0..30 * 30 {
        for k in 0..64 {
            let x = (tile % 30 * 8 + k % 8) as f32 * 0.012 - 1.5;
            let y = (tile / 30 * 8 + k / 8) as f32 * 0.012 - 1.5;
            let z = 0.4 * (2.0 * x + 0.1 * t as f32).sin();
            points.push([x, y, z, x, y, z]);
        }
        points.close_tile();
    }
    points
}

/// 100 frames after 300 others, in which components still spread, on two threads that the loop runs inside of.
#[test]
fn a_warm_training_loop_allocates_nothing() {
    let _alone = ALONE.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let frames: Vec<Points<f32>> = (0..10).map(frame).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    for reassign in [ReassignPolicy::Off, ReassignPolicy::Padded, ReassignPolicy::Forwarded] {
        let overrides = PaperOverrides {
            reassign: Some(reassign),
            components: Some(20_000),
            ..PaperOverrides::default()
        };
        let config = PaperConfig::paper().with(&overrides).unwrap();
        let mut engine =
            engine::begin(&config, &InitialDraw::random(20_000, 0), Normalization::IDENTITY)
                .unwrap();
        engine.component_elbo_mut().start();
        let allocations = pool.install(|| {
            let mut train = |n| {
                for frame in frames.iter().cycle().take(n) {
                    engine.learn(frame).unwrap();
                }
            };
            train(300);
            let before = ALLOCATIONS.load(Ordering::Relaxed);
            train(100);
            ALLOCATIONS.load(Ordering::Relaxed) - before
        });
        assert_eq!(allocations, 0, "{reassign:?}");
    }
}

#[test]
fn a_warm_preparer_allocates_nothing() {
    let _alone = ALONE.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let params = SyntheticParams { n_train: 4, ..SyntheticParams::demo() };
    let dataset = synthetic::dataset(&params).unwrap();
    let settings = SurfaceSettings::new(&dataset, glam::DVec3::ZERO);
    let frames: Vec<_> = (0..4).map(|i| dataset.load(0, i).unwrap()).collect();
    let (mut preparer, mut out) = (Preparer::new(), Observation::empty());
    let mut prepare_all = || {
        for frame in &frames {
            preparer.prepare(frame, &settings, &mut out).unwrap();
        }
    };
    prepare_all();
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    prepare_all();
    assert_eq!(ALLOCATIONS.load(Ordering::Relaxed) - before, 0);
}
