//! Each hot kernel of the engine alone, on one thread: `cargo bench --bench kernels`.
//!
//! Uses a smooth surface of 193,600 points and 100,000 means: random (the paper's start) and on surfaces (the
//! state after reassignment).

#![allow(clippy::print_stdout, clippy::expect_used)]

#[path = "common/scenes.rs"]
#[allow(dead_code)] // Lego is for other benches
mod scenes;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group};
use scenes::{draws, smooth};
use std::hint::black_box;
use std::num::NonZero;
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::math::simd::Isa;
use vbgs_studio::model::conjugate::prior::Hyper;
use vbgs_studio::model::conjugate::statistics::{N_SUMS, TileRecord};
use vbgs_studio::model::paper::totals::{Statistics, UpdateWidth};
use vbgs_studio::observation::points::Points;
use vbgs_studio::train::candidates::{CandidateSearch, MeanGrid, nearest_in_tile};
use vbgs_studio::train::estep::Scoring;
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides, ReassignPolicy};
use vbgs_studio::train::paper::init::InitialDraw;
use vbgs_studio::train::paper::learner;
use vbgs_studio::train::paper::reassign::{DestinationChooser, Quota};

const COMPONENTS: usize = 100_000;

fn positions(draw: &InitialDraw) -> Vec<[f32; 3]> {
    draw.means.iter().map(|m| [m[0] as f32, m[1] as f32, m[2] as f32]).collect()
}

/// The means of [`draws`] without the cluster.
fn starts(other: &Points<f32>) -> impl Iterator<Item = (&'static str, InitialDraw)> {
    draws(COMPONENTS, other).into_iter().take(2)
}

/// Candidate search on every instruction set.
fn search(criterion: &mut Criterion) {
    let (frame, other) = (smooth(0.0), smooth(1.3));
    let mut group = criterion.benchmark_group("search");
    group.throughput(Throughput::Elements(frame.len() as u64)).sample_size(20);
    for (start, draw) in starts(&other) {
        let grid = MeanGrid::new(&positions(&draw)).expect("finite means");
        for isa in [Some(Isa::PORTABLE), Isa::avx2()].into_iter().flatten() {
            let (mut memory, mut ids) = (CandidateSearch::default(), Vec::new());
            group.bench_function(BenchmarkId::new(start, isa.name()), |bencher| {
                bencher.iter(|| {
                    for tile in 0..frame.n_tiles() {
                        let range = frame.tile(tile);
                        let tile =
                            [&frame.x[range.clone()], &frame.y[range.clone()], &frame.z[range]];
                        let n = NonZero::new(4).expect("positive");
                        ids.clear();
                        nearest_in_tile(isa, &grid, &mut memory, tile, n, &mut ids);
                        black_box(&ids);
                    }
                });
            });
        }
    }
}

/// One frame without reassignment: search, E-step, sums and their addition to the totals.
fn frame(criterion: &mut Criterion) {
    let (frame, other) = (smooth(0.0), smooth(1.3));
    let mut group = criterion.benchmark_group("frame");
    group.throughput(Throughput::Elements(frame.len() as u64)).sample_size(20);
    for (start, draw) in starts(&other) {
        let overrides =
            PaperOverrides { reassign: Some(ReassignPolicy::Off), ..PaperOverrides::default() };
        let config = PaperConfig::paper().with(&overrides).expect("settings in range");
        let mut engine =
            learner::begin(&config, &draw, Normalization::IDENTITY).expect("finite means");
        group.bench_function(start, |bencher| {
            bencher.iter(|| engine.learn(&frame).expect("finite means"));
        });
    }
}

/// Full scores of a point that has no clear winner.
fn responsibilities(criterion: &mut Criterion) {
    let scoring = Scoring::new(&Hyper::paper(COMPONENTS, COMPONENTS as f64));
    criterion.bench_function("responsibilities", |bencher| {
        bencher.iter(|| {
            let mut q = black_box([1e-4, 1.000_000_1e-4, 2e-4, 3e-4]);
            black_box(scoring.responsibilities::<f32>(&mut q))
        });
    });
}

/// Addition of one frame's records to the totals.
fn totals(criterion: &mut Criterion) {
    let mut rng = Rng::new(1, Purpose::Synthetic, 0);
    let mut record = |tile| {
        let mut sums = [0.0f32; N_SUMS];
        sums.fill_with(|| rng.normal() as f32);
        sums[0] = 1.0;
        TileRecord { id: rng.below(COMPONENTS) as u32, tile, sums }
    };
    let mut group = criterion.benchmark_group("totals");
    for width in [UpdateWidth::Fixed64, UpdateWidth::Fixed128] {
        let mut statistics = Statistics::new(COMPONENTS, width);
        let mut shards = vec![Vec::new(); statistics.shards()];
        for tile in 0..30_000 {
            let record = record(tile);
            shards[record.id as usize >> statistics.shard_bits()].push(record);
        }
        group.throughput(Throughput::Elements(30_000));
        group.bench_function(format!("{width:?}"), |bencher| {
            bencher.iter(|| statistics.add_frame(|shard, add| add(&shards[shard])));
        });
    }
}

/// Choice of 5,000 reassignment destinations among the 20,000 points with the lowest ELBO.
fn choice(criterion: &mut Criterion) {
    let mut rng = Rng::new(2, Purpose::Synthetic, 0);
    let q: Vec<f64> = (0..193_600).map(|_| 1e-4 * rng.normal().powi(2)).collect();
    let stream = Rng::new(0, Purpose::Reassign, 1);
    let quota = Quota { moves: 5000, low_elbo: 20_000 };
    let mut chooser = DestinationChooser::default();
    criterion.bench_function("destinations", |bencher| {
        bencher.iter(|| black_box(chooser.choose_destinations(&q, quota, &stream).len()));
    });
}

/// Rebuild of the search index after the means moved.
fn rebuild(criterion: &mut Criterion) {
    let other = smooth(1.3);
    let mut group = criterion.benchmark_group("rebuild");
    for (start, draw) in starts(&other) {
        let means = positions(&draw);
        let mut grid = MeanGrid::default();
        group.bench_function(start, |bencher| {
            bencher.iter(|| grid.rebuild(&means).expect("finite means"));
        });
    }
}

criterion_group!(kernels, search, frame, responsibilities, totals, choice, rebuild);

fn main() {
    // One thread, to measure the cost of a kernel without its parallel speedup.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build_global();
    pool.expect("the first pool of the process");
    kernels();
    criterion::Criterion::default().configure_from_args().final_summary();
}
