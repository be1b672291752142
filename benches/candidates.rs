//! Time of the candidate search and of building its index, against `kiddo`.
//!
//! `cargo bench --bench candidates` prints the table of `engine.md` section 4 and what its switches
//! are set by; `-- quick` leaves out `kiddo`, `-- K C` runs other sizes. Lego is read from
//! `../shared/data/lego400`, if that is there, and doubled to 800 pixels.

#![allow(clippy::print_stdout, clippy::expect_used)]

mod common;

use common::times_ms;
use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::hint::black_box;
use std::num::NonZero;
use std::path::Path;
use vbgs_studio::dataset::frame::{DepthCodes, Frame};
use vbgs_studio::dataset::points::{CameraConvention, EdgeFilter, UnprojectSettings, Unprojector};
use vbgs_studio::dataset::{LoadOptions, open};
use vbgs_studio::math::image::Image;
use vbgs_studio::math::points::{Normalization, Points};
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::train::candidates::{Grid, Search, nearest_in_tile};
use vbgs_studio::train::init::InitialDraw;
use vbgs_studio::train::simd::Isa;

type Mean = [f32; 3];

/// Repetitions of a measurement; the median is printed.
const REPETITIONS: usize = 15;
/// The same for `kiddo`, which is slow.
const KIDDO_REPETITIONS: usize = 3;
/// Tiles of one task, as in the trainer.
const TASK_TILES: usize = 16;
/// Pixels on a side of the smooth surface, a multiple of the tile's.
const SMOOTH_SIDE: usize = 440;

fn main() {
    // Cargo adds `--bench`.
    let words: Vec<String> = std::env::args().skip(1).collect();
    let numbers: Vec<usize> = words.iter().filter_map(|word| word.parse().ok()).collect();
    let with_kiddo = !words.iter().any(|word| word == "quick");
    let frames = lego();
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
            let mut index = Grid::new(means).expect("finite means");
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
    let index = Grid::new(means).expect("finite means");
    let mut tasks = tasks(points, |_| (Search::default(), Vec::new()));
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

/// The paper's start, the state after reassignment (points of another frame) and a cluster: 90 % in
/// a ball of sd 0.02.
fn means(components: usize, other: &Points<f32>) -> [(&'static str, Vec<Mean>); 3] {
    let space = |draw: InitialDraw| -> Vec<Mean> {
        draw.means.iter().map(|m| [m[0] as f32, m[1] as f32, m[2] as f32]).collect()
    };
    let random = space(InitialDraw::random(components, 0));
    let mut rng = Rng::new(1, Purpose::Synthetic, 0);
    // Without replacement, as reassignment draws, until the points run out.
    let mut order: Vec<usize> = (0..other.len()).collect();
    rng.shuffle(&mut order);
    let surface = order.iter().cycle().take(components).map(|&i| other.position(i)).collect();
    let mut cluster = random.clone();
    let centre = other.position(other.len() / 2);
    for (_, mean) in cluster.iter_mut().enumerate().filter(|(k, _)| k % 10 != 0) {
        *mean = centre.map(|c| c + 0.02 * rng.normal() as f32);
    }
    [("random", random), ("surface", surface), ("cluster", cluster)]
}

/// A wavy surface seen from above, tile by tile.
fn smooth(phase: f32) -> Points<f32> {
    let mut points = Points::new();
    let pitch = 3.0 / SMOOTH_SIDE as f32;
    for tile in 0..(SMOOTH_SIDE / 8).pow(2) {
        let (column, row) = (tile % (SMOOTH_SIDE / 8) * 8, tile / (SMOOTH_SIDE / 8) * 8);
        for k in 0..64 {
            let (quad, line, i) = (k / 16, k / 4 % 4, k % 4);
            let x = (column + quad % 2 * 4 + i) as f32 * pitch - 1.5 + 1e-3 * phase;
            let y = (row + quad / 2 * 4 + line) as f32 * pitch - 1.5;
            let z = 0.5 * (2.0 * x + 0.01 * phase).sin() * (1.5 * y).cos();
            points.push([x, y, z, 0.0, 0.0, 0.0]);
        }
        points.close_tile();
    }
    points
}

/// The first tiles.
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

/// Points of one frame of Lego, and of several others together, at 800 pixels.
fn lego() -> Option<[Points<f32>; 2]> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/lego400");
    let Ok(dataset) = open(&path, &LoadOptions::default()) else {
        println!("skipped: {} not found", path.display());
        return None;
    };
    let split = dataset.splits.iter().position(|s| s.has_depth)?;
    let settings = UnprojectSettings {
        convention: CameraConvention::Paper,
        filter: EdgeFilter::DropMixed,
        normalization: Normalization::from_range(DVec3::NEG_ONE, DVec3::ONE),
    };
    let load = |index| {
        let mut points = Points::new();
        let frame = doubled(dataset.load(split, index).expect("a sound frame"));
        Unprojector::new().unproject(&frame, &settings, &mut points).expect("a frame with depth");
        points
    };
    let mut others = Points::new();
    for index in [20, 50, 80, 110, 140, 170] {
        let frame = load(index);
        for i in 0..frame.len() {
            let ([x, y, z], [r, g, b]) = (frame.position(i), frame.color(i));
            others.push([x, y, z, r, g, b]);
        }
        others.close_tile();
    }
    Some([load(100), others])
}

/// The same view with every pixel four times.
fn doubled(mut frame: Frame) -> Frame {
    let k = &mut frame.camera.intrinsics;
    (k.width, k.height) = (2 * k.width, 2 * k.height);
    (k.fx, k.fy, k.cx, k.cy) = (2.0 * k.fx, 2.0 * k.fy, 2.0 * k.cx, 2.0 * k.cy);
    frame.color = double(&frame.color);
    if let Some(depth) = &mut frame.depth {
        match &mut depth.codes {
            DepthCodes::Inverse8(codes) => *codes = double(codes),
            DepthCodes::Linear16 { codes, .. } => *codes = double(codes),
        }
    }
    frame
}

fn double<T: Copy>(image: &Image<T>) -> Image<T> {
    let (width, height) = (2 * image.width, 2 * image.height);
    let at = |i: usize| *image.at(i % width / 2, i / width / 2);
    Image::from_vec(width, height, (0..width * height).map(at).collect())
}
