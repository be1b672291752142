//! The candidate search against brute force and against `kiddo`.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use proptest::prelude::*;
use rayon::prelude::*;
use std::num::NonZero;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::math::simd::Isa;
use vbgs_studio::observation::points::Points;
use vbgs_studio::train::candidates::{
    CandidateSearch, MeanGrid, nearest_in_tile, nearest_in_tile_wide,
};

type Mean = [f32; 3];
/// Draws the mean of an id.
type Draw = Box<dyn FnMut(&mut Rng, usize) -> Mean>;

/// Numbers of means tested with every shape; one million has its own test.
const SIZES: [usize; 11] = [1, 2, 3, 4, 7, 9, 63, 64, 1000, 10_000, 100_000];
const RANKS: [usize; 8] = [1, 2, 3, 4, 5, 6, 7, 8];

fn distance2(a: Mean, b: Mean) -> f32 {
    let d: Mean = std::array::from_fn(|i| a[i] - b[i]);
    (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
}

/// Nearest means by definition: all means sorted by (squared distance, id).
fn brute_force(means: &[Mean], query: Mean, n: usize) -> Vec<u32> {
    let mut keys: Vec<(u32, u32)> =
        means.iter().zip(0..).map(|(&m, id)| (distance2(m, query).to_bits(), id)).collect();
    if n < keys.len() {
        keys.select_nth_unstable(n);
        keys.truncate(n);
    }
    keys.sort_unstable();
    keys.into_iter().map(|(_, id)| id).collect()
}

fn points(tiles: &[Vec<Mean>]) -> Points<f32> {
    let mut points = Points::new();
    for tile in tiles {
        tile.iter().for_each(|&[x, y, z]| points.push([x, y, z, 0.0, 0.0, 0.0]));
        points.close_tile();
    }
    points
}

fn instruction_sets() -> impl Iterator<Item = Isa> {
    [Isa::PORTABLE].into_iter().chain(Isa::avx2())
}

/// Searches tile by tile with shared scratch memory; all instruction sets must return the same ids.
fn search(grid: &MeanGrid, points: &Points<f32>, n: usize) -> Vec<u32> {
    let mut all = instruction_sets().map(|isa| search_on(isa, grid, points, n));
    let first = all.next().unwrap();
    assert!(all.all(|ids| ids == first));
    first
}

fn search_on(isa: Isa, grid: &MeanGrid, points: &Points<f32>, n: usize) -> Vec<u32> {
    let (mut memory, mut ids) = Default::default();
    for tile in 0..points.n_tiles() {
        search_tile(isa, grid, &mut memory, points, tile, n, &mut ids);
    }
    ids
}

fn search_tile(
    isa: Isa,
    grid: &MeanGrid,
    memory: &mut CandidateSearch,
    points: &Points<f32>,
    tile: usize,
    n: usize,
    ids: &mut Vec<u32>,
) {
    let range = points.tile(tile);
    let tile = [&points.x[range.clone()], &points.y[range.clone()], &points.z[range]];
    nearest_in_tile(isa, grid, memory, tile, NonZero::new(n).unwrap(), ids);
}

fn check(name: &str, means: &[Mean], tiles: &[Vec<Mean>], ranks: &[usize]) {
    let index = MeanGrid::new(means).unwrap();
    let points = points(tiles);
    for &n in ranks {
        let found = search(&index, &points, n);
        let rank = n.min(means.len());
        assert_eq!(found.len(), points.len() * rank, "{name}, C = {n}");
        for (i, found) in found.chunks(rank).enumerate() {
            let expected = brute_force(means, points.position(i), n);
            assert_eq!(found, expected, "{name}, K = {}, C = {n}, point {i}", means.len());
        }
    }
}

fn uniform(rng: &mut Rng, half: f64) -> Mean {
    std::array::from_fn(|_| rng.range(-half, half) as f32)
}

fn normal(rng: &mut Rng, centre: Mean, sd: f64) -> Mean {
    centre.map(|c| c + (sd * rng.normal()) as f32)
}

/// Patch of a smooth surface, 8×8 points, at a random place in the cube.
fn patch(rng: &mut Rng, pitch: f32) -> Vec<Mean> {
    let (origin, u, v) = (uniform(rng, 1.7), uniform(rng, 1.0), uniform(rng, 1.0));
    let at = |i: usize, j: usize| {
        std::array::from_fn(|k| origin[k] + pitch * (i as f32 * u[k] + j as f32 * v[k]))
    };
    (0..64).map(|k| at(k % 8, k / 8)).collect()
}

fn shapes(n: usize, rng: &mut Rng) -> Vec<(&'static str, Vec<Mean>)> {
    let mut make = |name, mut mean: Draw| (name, (0..n).map(|k| mean(rng, k)).collect());
    vec![
        make("uniform", Box::new(|rng, _| uniform(rng, 1.7))),
        make(
            "clustered",
            Box::new(|rng, k| match k % 10 {
                0 => uniform(rng, 1.7),
                _ => normal(rng, [0.3, -0.2, 0.1], 0.02),
            }),
        ),
        make("planar", Box::new(|rng, _| [uniform(rng, 1.7)[0], 0.25, uniform(rng, 1.7)[2]])),
        make(
            "tilted plane",
            Box::new(|rng, _| {
                let [a, b, _] = uniform(rng, 1.7);
                [a, b, 0.3 * a - 0.7 * b]
            }),
        ),
        make("collinear", Box::new(|rng, _| [uniform(rng, 1.7)[0]; 3])),
        make("lattice", Box::new(|_, k| [k % 13, k / 13 % 13, k / 169].map(|v| v as f32 * 0.125))),
        make("few places", Box::new(|rng, _| [rng.below(5) as f32 * 0.5, 0.0, 0.25])),
        make("one place", Box::new(|_, _| [0.5; 3])),
        make(
            "far outliers",
            Box::new(|rng, k| match k % 50 {
                0 => uniform(rng, 1e6),
                1 => uniform(rng, 1e30),
                _ => uniform(rng, 1.0),
            }),
        ),
        make("tiny", Box::new(|rng, _| uniform(rng, 1e-25))),
        make("far from the origin", Box::new(|rng, _| uniform(rng, 1.0).map(|v| v + 3e4))),
    ]
}

/// Tiles of every kind: smooth, with depth edges, with stray points, on means, scattered, of a single point.
fn tiles(means: &[Mean], rng: &mut Rng) -> Vec<Vec<Mean>> {
    let mut tiles: Vec<Vec<Mean>> = (0..4).map(|_| patch(rng, 0.005)).collect();
    let mut edge = patch(rng, 0.004);
    edge.iter_mut().step_by(3).for_each(|p| p[2] += 0.9);
    tiles.push(edge);
    let mut stray = patch(rng, 0.004);
    stray[5][0] += 1000.0;
    stray[40] = [-1000.0, 1000.0, 1000.0];
    tiles.push(stray);
    tiles.push((0..64).map(|_| means[rng.below(means.len())]).collect());
    let centre = means[rng.below(means.len())];
    tiles.push(
        (0..37).map(|k| if k % 5 == 0 { centre } else { normal(rng, centre, 0.01) }).collect(),
    );
    tiles.push((0..64).map(|_| uniform(rng, 1.8)).collect());
    tiles.push(vec![centre; 64]);
    tiles.push(vec![uniform(rng, 2.0)]);
    tiles
}

#[test]
fn equals_brute_force_on_every_shape_and_size() {
    for (stream, n) in SIZES.into_iter().enumerate() {
        let mut rng = Rng::new(5, Purpose::Init, stream as u64);
        for (name, means) in shapes(n, &mut rng) {
            let mut tiles = tiles(&means, &mut rng);
            let ranks = match n {
                // Brute force over this many means dominates the run time.
                100_000 => {
                    tiles.iter_mut().for_each(|tile| tile.truncate(17));
                    &[4][..]
                }
                10_000 => &[1, 4, 8][..],
                _ => &RANKS[..],
            };
            check(name, &means, &tiles, ranks);
        }
    }
}

#[test]
fn equals_brute_force_for_a_million_means() {
    let mut rng = Rng::new(6, Purpose::Init, 0);
    for (name, means) in shapes(1_000_000, &mut rng) {
        if ["uniform", "clustered", "tilted plane"].contains(&name) {
            let tiles: Vec<_> = (0..2).map(|_| patch(&mut rng, 0.005)[..20].to_vec()).collect();
            check(name, &means, &tiles, &[4]);
        }
    }
}

#[test]
fn finds_as_many_as_asked_for_or_as_there_are() {
    let mut rng = Rng::new(7, Purpose::Init, 0);
    for n in [1, 5, 9, 16, 17, 40, 300, 2000] {
        for (name, means) in shapes(n, &mut rng) {
            let tiles = tiles(&means, &mut rng);
            check(name, &means, &tiles[3..], &[9, 16, 17, 64, n, n + 1, 1024]);
        }
    }
}

/// Compares distances only: `kiddo` orders ties differently.
#[test]
fn equals_kiddo() {
    let mut rng = Rng::new(8, Purpose::Init, 0);
    for (name, means) in shapes(100_000, &mut rng) {
        if ["one place", "few places", "tiny", "far outliers"].contains(&name) {
            continue; // `kiddo` treats ties and overflow differently
        }
        let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(&means).unwrap();
        let index = MeanGrid::new(&means).unwrap();
        let points = points(&tiles(&means, &mut rng));
        for n in [1, 4, 8, 20] {
            for (i, found) in search(&index, &points, n).chunks(n).enumerate() {
                let q = points.position(i);
                let found = found.iter().map(|&id| distance2(means[id as usize], q));
                let query =
                    tree.query(&q).nearest_n::<SquaredEuclidean<f32>>(NonZero::new(n).unwrap());
                for (a, b) in found.zip(query.execute().iter()) {
                    let b = b.distance;
                    assert!((a - b).abs() <= 1e-6 * b, "{name}, C = {n}, point {i}: {a:e} {b:e}");
                }
            }
        }
    }
}

/// Neither leftovers in the scratch memory nor the number of threads change the result.
#[test]
fn order_and_threads_do_not_matter() {
    let mut rng = Rng::new(9, Purpose::Init, 0);
    let (_, means) = shapes(20_000, &mut rng).swap_remove(1);
    let tiles: Vec<Vec<Mean>> = (0..40).flat_map(|_| tiles(&means, &mut rng)).collect();
    let forward = points(&tiles);
    let by_threads = |threads| -> (Vec<u32>, Vec<u32>) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let index = MeanGrid::new(&means).unwrap();
            let one_by_one = (0..forward.n_tiles()).into_par_iter().map_init(
                Default::default,
                |scratch, tile| {
                    let mut ids = Vec::new();
                    search_tile(Isa::best(), &index, scratch, &forward, tile, 4, &mut ids);
                    ids
                },
            );
            let parts: Vec<Vec<u32>> = one_by_one.collect();
            (parts.concat(), search(&index, &forward, 4))
        })
    };
    let one = by_threads(1);
    assert_eq!(one.0, one.1);
    assert_eq!(one, by_threads(2));
    assert_eq!(one, by_threads(3));
    let index = MeanGrid::new(&means).unwrap();
    let backward: Vec<Vec<Mean>> = tiles.iter().rev().cloned().collect();
    let mut found: Vec<&[u32]> = Vec::new();
    let ids = search(&index, &points(&backward), 4);
    let mut rest = &ids[..];
    for tile in &backward {
        let (own, others) = rest.split_at(4 * tile.len());
        found.push(own);
        rest = others;
    }
    found.reverse();
    assert_eq!(found.concat(), one.0);
}

#[test]
fn a_rebuilt_index_is_a_new_one() {
    let mut rng = Rng::new(10, Purpose::Init, 0);
    let mut index = MeanGrid::new(&[[0.0; 3]; 10]).unwrap();
    for n in [5000, 3, 700, 20_000, 1] {
        for (name, means) in shapes(n, &mut rng) {
            index.rebuild(&means).unwrap();
            let points = points(&tiles(&means, &mut rng));
            let fresh = MeanGrid::new(&means).unwrap();
            assert_eq!(search(&index, &points, 4), search(&fresh, &points, 4), "{name}");
        }
    }
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert_eq!(index.rebuild(&[[0.0; 3], [0.0, bad, 0.0]]).unwrap_err().components, 2);
    }
    let points = points(&[vec![[1.0; 3]]]);
    assert_eq!(search(&index, &points, 4), [0]);
}

#[test]
fn points_that_are_no_numbers_have_neighbours_and_harm_no_others() {
    let mut rng = Rng::new(11, Purpose::Init, 0);
    let means: Vec<Mean> = (0..3000).map(|_| uniform(&mut rng, 1.0)).collect();
    let index = MeanGrid::new(&means).unwrap();
    let mut tile = patch(&mut rng, 0.01);
    let bad = [
        (3, [f32::NAN; 3]),
        (17, [0.0, f32::INFINITY, 0.0]),
        (18, [f32::NEG_INFINITY, f32::INFINITY, 0.0]),
        (30, [0.0, 0.0, f32::NAN]),
        (50, [f32::MAX, f32::MIN, f32::MAX]),
        (51, [1e19, 0.0, 0.0]),
    ];
    bad.iter().for_each(|&(i, p)| tile[i] = p);
    for n in [1, 4, 8, 30] {
        let found = search(&index, &points(std::slice::from_ref(&tile)), n);
        for (i, found) in found.chunks(n).enumerate() {
            if tile[i].iter().all(|v| v.is_finite()) {
                assert_eq!(found, brute_force(&means, tile[i], n), "point {i}");
            }
            let mut distinct = found.to_vec();
            distinct.sort_unstable();
            distinct.dedup();
            assert_eq!(distinct.len(), n, "point {i}");
        }
    }
    assert!(search(&index, &Points::new(), 4).is_empty());
}

/// The lowest ids win ties in f64 too, in the grid over rounded means.
#[test]
fn f64_searches_break_ties_by_id() {
    let lattice: Vec<[f64; 3]> =
        (0..1000).map(|k| [k % 10, k / 10 % 10, k / 100].map(|v: i32| f64::from(v))).collect();
    for n in [1, 2, 4, 8, 9, 999, 1000, 1001] {
        for query in [[4.5; 3], [4.0; 3], [4.5, 4.0, 4.0], [-3.0, 4.5, 20.0]] {
            let found = search_wide(&lattice, &[query], n);
            assert_eq!(found, brute_force_wide(&lattice, query, n), "C = {n}, {query:?}");
        }
    }
}

/// The grid over means rounded to f32 still ranks means that differ only in f64.
#[test]
fn the_grid_is_exact_in_f64() {
    let mut rng = Rng::new(12, Purpose::Init, 0);
    for spread in [1.0, 1e-7, 1e-12] {
        let mut near = |centre: f64| -> [f64; 3] {
            std::array::from_fn(|_| centre + spread * rng.range(-1.0, 1.0))
        };
        let means: Vec<[f64; 3]> =
            (0..3000).map(|k| near(if k % 2 == 0 { 0.7 } else { -300.1 })).collect();
        let queries: Vec<[f64; 3]> = (0..64).map(|_| near(0.7)).collect();
        for n in [1, 4, 8, 20] {
            let found = search_wide(&means, &queries, n);
            for (found, &query) in found.chunks(n).zip(&queries) {
                assert_eq!(found, brute_force_wide(&means, query, n), "spread {spread}, C = {n}");
            }
        }
    }
}

fn brute_force_wide(means: &[[f64; 3]], query: [f64; 3], n: usize) -> Vec<u32> {
    let distance2 = |m: &[f64; 3]| {
        let d: [f64; 3] = std::array::from_fn(|i| m[i] - query[i]);
        (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
    };
    let mut keys: Vec<(f64, u32)> = means.iter().map(distance2).zip(0..).collect();
    keys.sort_by(|a, b| a.partial_cmp(b).unwrap());
    keys.into_iter().map(|(_, id)| id).take(n).collect()
}

fn search_wide(means: &[[f64; 3]], queries: &[[f64; 3]], n: usize) -> Vec<u32> {
    let rounded: Vec<Mean> = means.iter().map(|m| m.map(|v| v as f32)).collect();
    let grid = MeanGrid::new(&rounded).unwrap();
    let rows: Vec<[f64; 6]> = queries.iter().map(|q| [q[0], q[1], q[2], 0.0, 0.0, 0.0]).collect();
    let points = Points::<f64>::from_rows(&rows);
    let (mut memory, mut ids) = (CandidateSearch::default(), Vec::new());
    let n = NonZero::new(n).unwrap();
    let all = 0..points.len();
    nearest_in_tile_wide(&grid, &mut memory, means, &points, all, n, &mut ids);
    ids
}

fn coordinate() -> impl Strategy<Value = f32> {
    // Few distinct values give ties, many give none; mixed scales stress the bounds of the search.
    prop_oneof![
        4 => -1.0f32..1.0,
        3 => (-4i8..5).prop_map(|v| f32::from(v) * 0.25),
        1 => -1e-3f32..1e-3,
        1 => -2000.0f32..2000.0,
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn equals_brute_force_on_anything(
        means in prop::collection::vec(prop::array::uniform3(coordinate()), 1..400),
        tile in prop::collection::vec(prop::array::uniform3(coordinate()), 1..65),
        n in 1usize..20,
    ) {
        let index = MeanGrid::new(&means).unwrap();
        let points = points(std::slice::from_ref(&tile));
        let rank = n.min(means.len());
        for (found, &point) in search(&index, &points, n).chunks(rank).zip(&tile) {
            prop_assert_eq!(found, brute_force(&means, point, n));
        }
    }
}
