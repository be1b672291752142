//! The training loop and the preparation of frames allocate nothing once they are warm. Only watched
//! threads are counted, so other tests may run in parallel.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use vbgs_studio::dataset::surface::{Preparer, SurfaceSettings};
use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::observation::points::Points;
use vbgs_studio::observation::surface::Observation;
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides, ReassignPolicy};
use vbgs_studio::train::paper::init::InitialDraw;
use vbgs_studio::train::paper::learner;

struct Counting;

/// Allocations of all watched threads.
static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    // The allocator may read it at any time: it needs a `const` initialiser and no destructor.
    static IS_WATCHED: Cell<bool> = const { Cell::new(false) };
}

fn count() {
    if IS_WATCHED.get() {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
    }
}

// SAFETY: forwards every call to the system's allocator; counting does not allocate.
#[allow(unsafe_code)] // only a global allocator sees every allocation
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        unsafe { System.realloc(old, layout, size) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Runs `work` on two threads of its own, the only watched ones.
fn watched<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    /// Held while allocations are counted, so that only one test counts at a time.
    static ALONE: Mutex<()> = Mutex::new(());
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2);
    let pool = pool.start_handler(|_| IS_WATCHED.set(true)).build().unwrap();
    pool.install(work)
}

/// Allocations of watched threads during `work`.
fn allocations_of(work: impl FnOnce()) -> usize {
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    work();
    ALLOCATIONS.load(Ordering::Relaxed) - before
}

#[test]
fn the_watch_sees_its_own_threads_alone() {
    const N: usize = 1000;
    let allocate = || (0..N).for_each(|i| drop(std::hint::black_box(Box::new(i))));
    watched(|| {
        assert!(allocations_of(allocate) >= N);
        let on_both = || {
            rayon::join(allocate, allocate);
        };
        assert!(allocations_of(on_both) >= 2 * N);
        // Starting a thread allocates a little here; the allocations inside it are not counted.
        let elsewhere = allocations_of(|| std::thread::scope(|scope| drop(scope.spawn(allocate))));
        assert!(elsewhere < N / 10, "{elsewhere}");
    });
}

/// Points of a surface that changes a little from frame to frame.
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

/// Counts over 100 frames, after 300 frames of warm-up in which components still spread, on two threads.
#[test]
fn a_warm_training_loop_allocates_nothing() {
    let frames: Vec<Points<f32>> = (0..10).map(frame).collect();
    for reassign in [ReassignPolicy::Off, ReassignPolicy::Padded, ReassignPolicy::Forwarded] {
        let overrides = PaperOverrides {
            reassign: Some(reassign),
            components: Some(20_000),
            ..PaperOverrides::default()
        };
        let config = PaperConfig::paper().with(&overrides).unwrap();
        let draw = InitialDraw::random(20_000, 0);
        let mut engine = learner::begin(&config, &draw, Normalization::IDENTITY).unwrap();
        engine.component_elbo_mut().start();
        let allocations = watched(|| {
            let mut train = |n| {
                for frame in frames.iter().cycle().take(n) {
                    engine.learn(frame).unwrap();
                }
            };
            train(300);
            allocations_of(|| train(100))
        });
        assert_eq!(allocations, 0, "{reassign:?}");
    }
}

#[test]
fn a_warm_preparer_allocates_nothing() {
    let params = SyntheticParams { n_train: 4, ..SyntheticParams::demo() };
    let dataset = synthetic::dataset(&params).unwrap();
    let settings = SurfaceSettings::new(&dataset, glam::DVec3::ZERO);
    let frames: Vec<_> = (0..4).map(|i| dataset.load(0, i).unwrap()).collect();
    let (mut preparer, mut out) = (Preparer::new(), Observation::empty());
    let allocations = watched(|| {
        let mut prepare_all = || {
            for frame in &frames {
                preparer.prepare(frame, &settings, &mut out).unwrap();
            }
        };
        prepare_all();
        allocations_of(prepare_all)
    });
    assert_eq!(allocations, 0);
}
