//! Hard cases: degenerate data, scales and shifts, sizes, extremes, drift and broken numbers.

use glam::{DMat3, DVec3};
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::train::paper::init::InitialDraw;

/// One hard case.
#[derive(Clone, Debug)]
pub struct Case {
    pub name: &'static str,
    /// Rows `[x, y, z, r, g, b]` of the frame in model coordinates. Some may be non-finite.
    pub points: Vec<[f64; 6]>,
    /// Number of times the frame is trained on.
    pub frames: u32,
    /// Initial means and weights.
    pub draw: InitialDraw,
    pub candidates: usize,
    /// Maps world to model coordinates.
    pub normalization: Normalization,
}

/// Number of frames accumulated in the drift case.
const DRIFT_FRAMES: u32 = 100_000;

/// All hard cases. `seed` selects their random numbers.
pub fn all(seed: u64) -> Vec<Case> {
    let mut cases = degenerate_data(seed);
    cases.extend(scales_and_shifts(seed));
    cases.extend(sizes(seed));
    cases.extend(extremes(seed));
    cases.push(drift(seed));
    cases.extend(broken_numbers(seed));
    cases
}

/// A case in the cube [−1, 1]³.
fn case(name: &'static str, points: Vec<[f64; 6]>, draw: InitialDraw) -> Case {
    let normalization = Normalization::from_range(DVec3::NEG_ONE, DVec3::ONE);
    Case { name, points, frames: 1, draw, candidates: 4, normalization }
}

/// Draws means close to the points, so that components compete.
fn near(points: &[[f64; 6]], components: usize, seed: u64) -> InitialDraw {
    let mut draw = InitialDraw::random(components, seed);
    let mut rng = Rng::new(seed, Purpose::Synthetic, 1);
    for mean in &mut draw.means {
        *mean = points[rng.below(points.len())].map(|v| v + 0.01 * rng.normal());
    }
    draw
}

fn row(position: DVec3, rng: &mut Rng) -> [f64; 6] {
    let [x, y, z] = position.to_array();
    let mut color = || rng.range(-1.7, 1.7);
    [x, y, z, color(), color(), color()]
}

fn rows(n: usize, seed: u64, mut place: impl FnMut(&mut Rng) -> DVec3) -> Vec<[f64; 6]> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
    (0..n)
        .map(|_| {
            let position = place(&mut rng);
            row(position, &mut rng)
        })
        .collect()
}

/// Random point on a bumpy sheet in [−1, 1]³.
fn sheet(rng: &mut Rng) -> DVec3 {
    let (u, v) = (rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
    DVec3::new(u, v, 0.3 * (3.0 * u).sin() * (2.0 * v).cos())
}

fn degenerate_data(seed: u64) -> Vec<Case> {
    let identical = vec![[0.31, -0.72, 0.55, 0.2, -0.4, 1.1]; 200];
    let line = rows(200, seed, |rng| DVec3::new(0.3, -0.5, 0.8) * rng.range(-1.0, 1.0));
    let plane = rows(200, seed, |rng| {
        DVec3::new(0.8, 0.1, 0.2) * rng.range(-1.0, 1.0)
            + DVec3::new(-0.2, 0.9, 0.4) * rng.range(-1.0, 1.0)
    });
    let one = vec![[0.4, 0.1, -0.9, 0.0, 0.5, -0.5]];
    // All means but one are far away, so that one component has the prior of a large mixture.
    let flat = plane.clone();
    let mut alone = InitialDraw::random(100_000, seed);
    alone.means[1..].iter_mut().for_each(|mean| mean[0] += 50.0);
    let flattest = Case { frames: 50, ..case("plane under one of 1e5 components", flat, alone) };
    let mut cases: Vec<Case> = [
        ("identical points", identical),
        ("points on a line", line),
        ("points on a plane", plane),
        ("one point", one),
    ]
    .map(|(name, points)| {
        let draw = near(&points, 8, seed);
        case(name, points, draw)
    })
    .into();
    cases.push(flattest);
    cases
}

/// The sheet in other world units, normalised by its own range like a dataset.
fn scales_and_shifts(seed: u64) -> Vec<Case> {
    let moved = |name, scale: f64, shift: f64| {
        let normalization =
            Normalization::from_range(DVec3::splat(shift - scale), DVec3::splat(shift + scale));
        let points: Vec<[f64; 6]> = rows(200, seed, |rng| {
            normalization.normalize(DVec3::splat(shift) + scale * sheet(rng))
        });
        let draw = near(&points, 16, seed);
        Case { normalization, ..case(name, points, draw) }
    };
    // A tiny off-centre scene in a layout with a fixed range.
    let tiny = rows(200, seed, |rng| DVec3::splat(0.01) + 1e-6 * sheet(rng));
    let draw = InitialDraw { means: tiny[..16].to_vec(), ..near(&tiny, 16, seed) };
    vec![
        moved("scene of size 1", 1.0, 0.0),
        moved("scene scaled by 1e-6", 1e-6, 0.0),
        moved("scene scaled by 1e6", 1e6, 0.0),
        moved("scene shifted by 1e6", 1.0, 1e6),
        case("scene of size 1e-6 in a range of 1", tiny, draw),
    ]
}

fn sizes(seed: u64) -> Vec<Case> {
    let points = rows(200, seed, sheet);
    let sized = |name, components, candidates| {
        let draw = near(&points, components, seed);
        Case { candidates, ..case(name, points.clone(), draw) }
    };
    let corners = [[1.0; 6], [-1.0; 6], [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]];
    let few = vec![
        [1.01, 1.0, 1.0, 0.5, 0.5, 0.5],
        [-1.0, -1.01, -1.0, -0.5, 0.5, 0.5],
        [-1.0, -1.0, -0.99, 0.5, -0.5, 0.5],
    ];
    let draw = InitialDraw { means: corners.to_vec(), alpha: vec![1.0 / 3.0; 3] };
    vec![
        sized("N = 1", 1, 4),
        sized("C > N", 3, 8),
        sized("C = N", 12, 12),
        Case {
            // `case` requires a draw, which is replaced here.
            draw: InitialDraw::random(100_000, seed),
            ..case("N = 1e5, few points each", points.clone(), near(&points, 1, seed))
        },
        Case {
            draw: near(&points, 100_000, seed),
            ..case("N = 1e5, many means a point", points.clone(), near(&points, 1, seed))
        },
        case("components with 0, 1 and 2 points", few, draw),
    ]
}

fn extremes(seed: u64) -> Vec<Case> {
    let turn = DMat3::from_rotation_x(0.7) * DMat3::from_rotation_z(1.1);
    let needle = rows(300, seed, |rng| {
        let local = DVec3::new(rng.normal(), 1e-4 * rng.normal(), 1e-7 * rng.normal());
        DVec3::splat(0.2) + turn * local
    });
    let pair = rows(100, seed, |rng| {
        DVec3::splat(0.5) + DVec3::X * if rng.uniform() < 0.5 { 0.0 } else { 1e-7 }
    });
    let sheet_points = rows(200, seed, sheet);
    // Far from every point, so that all densities underflow.
    let far = InitialDraw {
        means: near(&sheet_points, 64, seed).means.iter().map(|m| m.map(|v| v + 50.0)).collect(),
        ..near(&sheet_points, 64, seed)
    };
    let mut skewed = near(&sheet_points, 25, seed);
    for (k, alpha) in skewed.alpha.iter_mut().enumerate() {
        *alpha = 10f64.powi(k as i32 - 12);
    }
    let crowd = rows(200, seed, |rng| DVec3::splat(0.2) + 3e-4 * sheet(rng));
    let crowd: Vec<[f64; 6]> = crowd.iter().map(|r| [r[0], r[1], r[2], 0.1, 0.1, 0.1]).collect();
    let among = InitialDraw { means: crowd[..8].to_vec(), alpha: vec![0.125; 8] };
    let one = |points: &[[f64; 6]]| InitialDraw { means: vec![points[0]], alpha: vec![1.0] };
    vec![
        case("axes of 1, 1e-4 and 1e-7", needle.clone(), one(&needle)),
        case("near-singular: points 1e-7 apart", pair.clone(), one(&pair)),
        Case { candidates: 8, ..case("responsibilities shared by all", crowd, among) },
        case("responsibilities that underflow", sheet_points.clone(), far),
        Case { candidates: 25, ..case("weights from 1e-12 to 1e12", sheet_points, skewed) },
    ]
}

fn drift(seed: u64) -> Case {
    // Few points, because every precision trains on the frame 1e5 times.
    let points = rows(64, seed, sheet);
    let draw = near(&points, 8, seed);
    Case { frames: DRIFT_FRAMES, ..case("statistics of 1e5 frames", points, draw) }
}

fn broken_numbers(seed: u64) -> Vec<Case> {
    let sound = rows(100, seed, sheet);
    let draw = near(&sound, 8, seed);
    let broken = |name, value: f64| {
        let mut points = sound.clone();
        for (i, axis) in [(3, 0), (40, 1), (64, 2), (70, 3), (99, 5)] {
            points[i][axis] = value;
        }
        case(name, points, draw.clone())
    };
    let denormal = rows(100, seed, |rng| 1e-40 * sheet(rng));
    let denormal: Vec<[f64; 6]> =
        denormal.iter().map(|r| [r[0], r[1], r[2], 1e-41, -1e-40, 1e-44]).collect();
    let near_zero = near(&denormal, 8, seed);
    vec![
        broken("points with NaN", f64::NAN),
        broken("points with infinities", f64::INFINITY),
        case("denormals", denormal, near_zero),
    ]
}
