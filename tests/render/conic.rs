//! The rational conic and the tight bounds of the fast renderers (`rendering.md`, Rational conic),
//! implemented here from the specification and compared with the oracle's vector form.

use crate::common::oracle::{Oracle, SplatF64};
use crate::common::scenes::exact;
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::render::{ALPHA_CUT, Antialias, Lens, RenderOptions, Response};

const OPACITY: f64 = 0.9;

/// Camera at the origin facing +z, so that world and camera space are the same.
fn camera() -> Camera {
    let intrinsics = Intrinsics { fy: 70.0, ..Intrinsics::from_horizontal_fov(120, 90, 1.5) };
    Camera { intrinsics, pose: Pose::IDENTITY }
}

/// Oracle of one white splat over black, without alpha cut.
fn oracle(splat: SplatF64) -> Oracle {
    let options = RenderOptions {
        near: 0.0,
        ..RenderOptions::evaluation(exact(Response::Ray, Antialias::None, Lens::Pinhole), [0.0; 3])
    };
    Oracle::new(&[splat], &camera(), &options).with_thresholds(0.0, 0.0)
}

fn random_splat(rng: &mut Rng, scale: (f64, f64)) -> SplatF64 {
    let ahead = DVec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), 1.0);
    SplatF64 {
        mean: ahead * rng.range(0.3, 4.0),
        opacity: OPACITY,
        color: DVec3::ONE,
        scale: DVec3::from_array([0; 3].map(|_| rng.range(scale.0.ln(), scale.1.ln()).exp())),
        rotation: DQuat::from_xyzw(rng.normal(), rng.normal(), rng.normal(), rng.normal())
            .normalize(),
        appearance: None,
    }
}

/// `D² = δᵀQδ / (1 + l·δ + δᵀGδ)` where the maximum lies ahead of the camera, `|p|²` elsewhere.
struct Conic {
    centre: DVec2,
    q: DMat2,
    l: DVec2,
    g: DMat2,
    p2: f64,
}

impl Conic {
    fn new(splat: &SplatF64, k: &Intrinsics) -> Self {
        let m = splat.mean;
        let axes = DMat3::from_quat(splat.rotation);
        let whitening = DMat3::from_diagonal(splat.scale.recip()) * axes.transpose();
        let g0 = whitening * (m / m.z);
        let a = [whitening.x_axis / k.fx, whitening.y_axis / k.fy];
        let b = a.map(|column| column.cross(g0));
        let gram = |v: [DVec3; 2]| {
            let xy = v[0].dot(v[1]);
            DMat2::from_cols_array(&[v[0].dot(v[0]), xy, xy, v[1].dot(v[1])])
        };
        let square = g0.length_squared();
        Self {
            centre: DVec2::new(k.fx * m.x / m.z + k.cx, k.fy * m.y / m.z + k.cy),
            q: gram(b) * (m.z * m.z / square),
            l: 2.0 / square * DVec2::new(a[0].dot(g0), a[1].dot(g0)),
            g: gram(a) * square.recip(),
            p2: m.z * m.z * square,
        }
    }

    fn distance2(&self, point: DVec2) -> f64 {
        let d = point - self.centre;
        if 1.0 + 0.5 * self.l.dot(d) < 0.0 {
            return self.p2;
        }
        d.dot(self.q * d) / (1.0 + self.l.dot(d) + d.dot(self.g * d))
    }
}

#[test]
fn the_rational_conic_is_the_vector_form() {
    let mut rng = Rng::new(6, Purpose::Synthetic, 0);
    let k = camera().intrinsics;
    let (mut worst, mut n_compared, mut n_behind) = (0f64, 0, 0);
    for _ in 0..400 {
        let splat = random_splat(&mut rng, (1e-2, 2.0));
        let (conic, oracle) = (Conic::new(&splat, &k), oracle(splat));
        for _ in 0..25 {
            let point = DVec2::new(rng.range(-40.0, 160.0), rng.range(-40.0, 130.0));
            let expected = -2.0 * (oracle.at(point).rgba[0] / OPACITY).ln();
            if expected > 600.0 {
                continue;
            }
            let found = conic.distance2(point);
            worst = worst.max((found - expected).abs() / expected.max(1e-2));
            n_behind += usize::from(found == conic.p2);
            n_compared += 1;
        }
    }
    println!(
        "rational conic: {n_compared} points, {n_behind} behind, worst relative error {worst:.1e}"
    );
    assert!(worst <= 1e-11, "{worst:e}");
    assert!(n_compared > 2000 && n_behind > 100, "{n_compared} {n_behind}");
}

/// `Q = (J S Jᵀ)⁻¹`, so one record per splat serves both renderers.
#[test]
fn the_conic_is_the_inverse_of_the_projected_covariance() {
    let mut rng = Rng::new(7, Purpose::Synthetic, 0);
    let k = camera().intrinsics;
    for _ in 0..300 {
        let splat = random_splat(&mut rng, (1e-2, 2.0));
        let m = splat.mean;
        let axes = DMat3::from_quat(splat.rotation);
        let s = axes * DMat3::from_diagonal(splat.scale * splat.scale) * axes.transpose();
        let j = [
            DVec3::new(k.fx / m.z, 0.0, -k.fx * m.x / (m.z * m.z)),
            DVec3::new(0.0, k.fy / m.z, -k.fy * m.y / (m.z * m.z)),
        ];
        let entry = |a: usize, b: usize| j[a].dot(s * j[b]);
        let covariance =
            DMat2::from_cols_array(&[entry(0, 0), entry(0, 1), entry(1, 0), entry(1, 1)]);
        let off = Conic::new(&splat, &k).q * covariance - DMat2::IDENTITY;
        assert!(off.to_cols_array().iter().all(|v| v.abs() < 1e-9), "{splat:?}: {off}");
    }
}

/// Row of the table of bounds that applies.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Outline {
    Shadow,
    InFront,
    CrossesRight,
    CrossesLeft,
}

/// Range of `x/z` (axis 0) or `y/z` (axis 1) over the ellipsoid of `k` standard deviations.
fn tangent_range(s: &DMat3, m: DVec3, axis: usize, k2: f64) -> (Outline, [f64; 2]) {
    let t = |i: usize, j: usize| k2 * s.col(i)[j] - m[i] * m[j];
    let (t00, t02, t22) = (t(axis, axis), t(axis, 2), t(2, 2));
    let disc = t02 * t02 - t22 * t00;
    if disc <= 0.0 {
        return (Outline::Shadow, [f64::NEG_INFINITY, f64::INFINITY]);
    }
    let q = t02 + disc.sqrt().copysign(t02);
    let (a, b) = (q / t22, t00 / q);
    let (lo, hi) = (a.min(b), a.max(b));
    if t22 < 0.0 {
        (Outline::InFront, [lo, hi])
    } else if m[axis] - s.col(axis)[2] / s.col(2)[2] * m.z > 0.0 {
        (Outline::CrossesRight, [hi, f64::INFINITY])
    } else {
        (Outline::CrossesLeft, [f64::NEG_INFINITY, lo])
    }
}

#[test]
fn bounds_hold_all_that_passes_the_cut_and_no_more() {
    let mut rng = Rng::new(8, Purpose::Synthetic, 0);
    let k2 = 2.0 * (OPACITY / ALPHA_CUT).ln();
    let (mut n_shadow, mut n_in_front, mut n_crossing) = (0, 0, 0);
    for _ in 0..3000 {
        let splat = random_splat(&mut rng, (2e-2, 1.0));
        let axes = DMat3::from_quat(splat.rotation);
        let s = axes * DMat3::from_diagonal(splat.scale * splat.scale) * axes.transpose();
        let (oracle, radius) = (oracle(splat), k2.sqrt());
        let surface: Vec<DVec3> = (0..200)
            .map(|_| DVec3::from_array([0; 3].map(|_| rng.normal())).normalize())
            .map(|v| splat.mean + axes * (splat.scale * v) * radius)
            .filter(|point| point.z > 0.0)
            .collect();
        for axis in 0..2 {
            let (outline, [lo, hi]) = tangent_range(&s, splat.mean, axis, k2);
            *match outline {
                Outline::Shadow => &mut n_shadow,
                Outline::InFront => &mut n_in_front,
                Outline::CrossesRight | Outline::CrossesLeft => &mut n_crossing,
            } += 1;
            for point in &surface {
                let tangent = point[axis] / point.z;
                let rounding = 1e-9 * (1.0 + tangent.abs());
                let holds = lo - rounding <= tangent && tangent <= hi + rounding;
                assert!(holds, "{tangent} in {lo} {hi}, {outline:?} {splat:?}");
            }
            for end in [lo, hi].into_iter().filter(|end| end.is_finite()) {
                let alpha = alpha_at_bound(&oracle, &s, splat.mean, axis, end);
                let error = (alpha / ALPHA_CUT - 1.0).abs();
                assert!(error < 1e-6, "{alpha} at {end}, {outline:?} {splat:?}");
            }
        }
    }
    println!("bounds: shadow {n_shadow}, in front {n_in_front}, crossing z = 0 {n_crossing}");
    assert!(n_shadow > 100 && n_in_front > 100 && n_crossing > 100);
}

/// Alpha where the plane `x = end·z` (or `y`) touches the ellipsoid; a tight bound gives the alpha cut.
fn alpha_at_bound(oracle: &Oracle, s: &DMat3, m: DVec3, axis: usize, end: f64) -> f64 {
    let mut n = DVec3::new(0.0, 0.0, -end);
    n[axis] = 1.0;
    let touching = m - *s * n * (n.dot(m) / n.dot(*s * n));
    assert!(touching.z > 0.0, "the bound touches behind the camera: {touching}");
    let k = camera().intrinsics;
    let point = touching.truncate() / touching.z * DVec2::new(k.fx, k.fy);
    oracle.at(point + DVec2::new(k.cx, k.cy)).rgba[0]
}
