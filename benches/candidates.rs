//! Time of the candidate search and of building its index, compared with `kiddo`.
//!
//! `cargo bench --bench candidates` prints the times of the search (`training.md`, Candidate search), from
//! which its thresholds were chosen. `-- quick` leaves out `kiddo`; `-- K C` runs another size. Lego is read
//! from `../shared/data/lego400` if present, and doubled to 800 pixels.

#![allow(clippy::print_stdout, clippy::expect_used)]

mod common;
#[path = "common/scenes.rs"]
mod scenes;

use common::times_ms;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use scenes::{draws, lego, smooth, together};
use std::hint::black_box;
use std::num::NonZero;
use vbgs_studio::math::simd::Isa;
use vbgs_studio::observation::points::Points;
use vbgs_studio::train::candidates::{CandidateSearch, MeanGrid, nearest_in_tile};

type Mean = [f32; 3];

/// Repetitions of a measurement, of which the median is printed.
const REPETITIONS: usize = 15;
/// Repetitions for `kiddo`, which is slow.
const KIDDO_REPETITIONS: usize = 3;
/// Tiles per task, as in the trainer.
const TASK_TILES: usize = 16;

fn main() {
    // Parsing skips the `--bench` that cargo adds.
    let words: Vec<String> = std::env::args().skip(1).collect();
    let numbers: Vec<usize> = words.iter().filter_map(|word| word.parse().ok()).collect();
    let with_kiddo = !words.iter().any(|word| word == "quick");
    let frames = lego([100, 20, 50, 80, 110, 140, 170]);
    let frames = frames.map(|frames| [frames[0].clone(), together(&frames[1..])]);
    let smooth = [smooth(0.0), smooth(1.3)];
    if let [components, n] = numbers[..] {
        for (name, [frame, other]) in
            frames.iter().map(|f| ("lego", f)).chain([("smooth", &smooth)])
        {
            for (kind, means) in means(components, other) {
                search_row(name, kind, frame, &means, n, with_kiddo);
            }
        }
        return;
    }
    println!("search, ms: grid 1 / 2 threads, kiddo 1 / 2 threads");
    for (name, [frame, other]) in frames.iter().map(|f| ("lego", f)).chain([("smooth", &smooth)]) {
        for (kind, means) in means(100_000, other) {
            for n in [1, 4, 8] {
                search_row(name, kind, frame, &means, n, with_kiddo);
            }
        }
    }
    println!("build, ms: grid 1 / 2 threads, kiddo");
    for components in [1000, 10_000, 100_000, 300_000] {
        for (kind, means) in means(components, &smooth[1]) {
            build_row(kind, &means);
        }
    }
    println!("where kiddo might win: many neighbours, few means");
    let few = head(&smooth[0], 40);
    for (components, n) in
        [(100_000, 9), (100_000, 16), (100_000, 64), (100_000, 1024), (10, 4), (100, 4), (1000, 4)]
    {
        for (kind, means) in means(components, &smooth[1]) {
            search_row("head", kind, &few, &means, n, with_kiddo);
        }
    }
}

fn search_row(name: &str, kind: &str, frame: &Points<f32>, means: &[Mean], n: usize, kiddo: bool) {
    let n = NonZero::new(n).expect("positive");
    let grid = [1, 2].map(|threads| grid_ms(frame, means, n, threads));
    print!(
        "{name:7} {kind:8} {:6} points K {:6} C {n:2}: grid {:6.2} / {:6.2}",
        frame.len(),
        means.len(),
        grid[0],
        grid[1]
    );
    if kiddo {
        let kiddo = [1, 2].map(|threads| kiddo_ms(frame, means, n, threads));
        print!("   kiddo {:6.1} / {:6.1}   {:5.1} times", kiddo[0], kiddo[1], kiddo[0] / grid[0]);
    }
    println!();
}

fn build_row(kind: &str, means: &[Mean]) {
    let grid = [1, 2].map(|threads| {
        pool(threads).install(|| {
            let mut index = MeanGrid::new(means).expect("finite means");
            median_ms(REPETITIONS, || index.rebuild(means).expect("finite means"))
        })
    });
    let kiddo = median_ms(KIDDO_REPETITIONS, || {
        black_box(ImmutableKdTree::<f32, 3>::new_from_slice(means).expect("finite means"));
    });
    println!(
        "{kind:8} K {:6}: grid {:5.2} / {:5.2}   kiddo {kiddo:5.2}",
        means.len(),
        grid[0],
        grid[1]
    );
}

fn grid_ms(points: &Points<f32>, means: &[Mean], n: NonZero<usize>, threads: usize) -> f64 {
    let index = MeanGrid::new(means).expect("finite means");
    let mut tasks = tasks(points, |_| (CandidateSearch::default(), Vec::new()));
    pool(threads).install(|| {
        median_ms(REPETITIONS, || {
            tasks.par_iter_mut().with_max_len(1).for_each(|(tiles, (scratch, ids))| {
                for tile in tiles.clone() {
                    ids.clear();
                    let range = points.tile(tile);
                    let tile =
                        [&points.x[range.clone()], &points.y[range.clone()], &points.z[range]];
                    nearest_in_tile(Isa::best(), &index, scratch, tile, n, ids);
                }
                black_box(ids);
            });
        })
    })
}

fn kiddo_ms(points: &Points<f32>, means: &[Mean], n: NonZero<usize>, threads: usize) -> f64 {
    let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(means).expect("finite");
    let mut tasks = tasks(points, |_| Vec::new());
    pool(threads).install(|| {
        median_ms(KIDDO_REPETITIONS, || {
            tasks.par_iter_mut().with_max_len(1).for_each(|(tiles, ids)| {
                ids.clear();
                for point in points.tile(tiles.start).start..points.tile(tiles.end - 1).end {
                    let query = points.position(point);
                    let found = tree.query(&query).nearest_n::<SquaredEuclidean<f32>>(n).execute();
                    ids.extend(found.iter().map(|f| f.item));
                }
                black_box(ids);
            });
        })
    })
}

fn tasks<T>(
    points: &Points<f32>,
    mut memory: impl FnMut(usize) -> T,
) -> Vec<(std::ops::Range<usize>, T)> {
    let n = points.n_tiles();
    (0..n).step_by(TASK_TILES).map(|t| (t..(t + TASK_TILES).min(n), memory(t))).collect()
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads")
}

fn median_ms(repetitions: usize, run: impl FnMut()) -> f64 {
    times_ms(repetitions, run)[repetitions / 2]
}

/// Positions of the means among which the search runs.
fn means(components: usize, other: &Points<f32>) -> [(&'static str, Vec<Mean>); 3] {
    draws(components, other).map(|(kind, draw)| {
        (kind, draw.means.iter().map(|m| [m[0] as f32, m[1] as f32, m[2] as f32]).collect())
    })
}

/// Points of the first tiles.
fn head(points: &Points<f32>, n_tiles: usize) -> Points<f32> {
    let mut head = Points::new();
    for tile in 0..n_tiles.min(points.n_tiles()) {
        for i in points.tile(tile) {
            let ([x, y, z], [r, g, b]) = (points.position(i), points.color(i));
            head.push([x, y, z, r, g, b]);
        }
        head.close_tile();
    }
    head
}
