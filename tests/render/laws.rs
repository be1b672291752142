//! The oracle against the definition of the exact renderer's response (`rendering.md`, Exact renderer).

use crate::common::oracle::{Oracle, SplatF64};
use crate::common::ray::GaussianOnRay;
use crate::common::scenes::{SCENES, exact, random_appearance};
use glam::{DMat3, DQuat, DVec2, DVec3};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::render::{Antialias, Lens, RenderMethod, RenderOptions, Response};

const RAY: RenderMethod = exact(Response::Ray, Antialias::None, Lens::Pinhole);
const LINE: RenderMethod = exact(Response::Line, Antialias::None, Lens::Pinhole);
const FISHEYE: RenderMethod = exact(Response::Ray, Antialias::None, Lens::Fisheye);
/// Below the cap, so that alpha is proportional to the response everywhere.
const OPACITY: f64 = 0.9;

/// Alpha without cut along a unit world direction, which must be visible to the camera's lens.
fn alpha(splat: &SplatF64, camera: &Camera, method: RenderMethod, direction: DVec3) -> f64 {
    let options = RenderOptions::evaluation(method, [0.0; 3]);
    let oracle = Oracle::new(std::slice::from_ref(splat), camera, &options);
    let point = image_point(camera, method.lens(), direction);
    // Reads the colour of a white splat: coverage is a difference from 1 and loses small alphas.
    oracle.with_thresholds(0.0, 0.0).at(point).rgba[0]
}

/// Image point of a world direction.
fn image_point(camera: &Camera, lens: Lens, direction: DVec3) -> DVec2 {
    let k = &camera.intrinsics;
    let d = camera.pose.rotation().transpose() * direction;
    let across = d.truncate();
    let rho = match lens {
        Lens::Pinhole => across / d.z,
        Lens::Fisheye => across.normalize_or_zero() * across.length().atan2(d.z),
    };
    rho * DVec2::new(k.fx, k.fy) + DVec2::new(k.cx, k.cy)
}

fn random_unit(rng: &mut Rng) -> DVec3 {
    DVec3::from_array([0; 3].map(|_| rng.normal())).normalize()
}

/// Random splat 1 to 4 units ahead of an eye facing `forward`, at most 30° off axis.
fn random_splat(eye: DVec3, forward: DVec3, rng: &mut Rng) -> SplatF64 {
    let towards = (forward * 2.0 + random_unit(rng)).normalize();
    SplatF64 {
        mean: eye + towards * rng.range(1.0, 4.0),
        opacity: OPACITY,
        color: DVec3::ONE,
        scale: DVec3::from_array([0; 3].map(|_| rng.range(0.05f64.ln(), 1.5f64.ln()).exp())),
        rotation: DQuat::from_xyzw(rng.normal(), rng.normal(), rng.normal(), rng.normal())
            .normalize(),
        appearance: None,
    }
}

fn random_camera(rng: &mut Rng) -> Camera {
    let anywhere = |rng: &mut Rng| DVec3::from_array([0; 3].map(|_| rng.range(-2.0, 2.0)));
    let pose = Pose::look_at(anywhere(rng), anywhere(rng), DVec3::Z).unwrap();
    Camera { intrinsics: Intrinsics::from_horizontal_fov(90, 70, 1.2), pose }
}

/// Random unit direction at most 75° off the camera's axis.
fn random_direction(camera: &Camera, rng: &mut Rng) -> DVec3 {
    loop {
        let direction = (camera.pose.forward() + random_unit(rng)).normalize();
        if direction.dot(camera.pose.forward()) > 75f64.to_radians().cos() {
            return direction;
        }
    }
}

#[test]
fn a_ball_follows_the_sine_of_the_angle() {
    let camera = Camera { pose: Pose::IDENTITY, ..random_camera(&mut rng(1)) };
    let (towards, distance, sigma) = (DVec3::new(0.3, -0.2, 1.0).normalize(), 2.5, 0.8);
    let ball = SplatF64 {
        mean: towards * distance,
        scale: DVec3::splat(sigma),
        ..random_splat(DVec3::ZERO, DVec3::Z, &mut rng(2))
    };
    let axis = towards.cross(DVec3::Y).normalize();
    let mut worst = 0f64;
    for step in 0..20 {
        let angle = f64::from(step) * 0.15;
        let direction = DQuat::from_axis_angle(axis, angle) * towards;
        // On a ray that leads away from the ball, the nearest point is the camera.
        let sine = if angle < 0.5 * std::f64::consts::PI { angle.sin() } else { 1.0 };
        let expected = OPACITY * (-0.5 * (distance / sigma * sine).powi(2)).exp();
        let mut found = vec![alpha(&ball, &camera, FISHEYE, direction)];
        if direction.z > 0.0 {
            found.push(alpha(&ball, &camera, RAY, direction));
        }
        worst = found.iter().fold(worst, |worst, found| worst.max((found - expected).abs()));
    }
    println!("isotropic closed form: worst {worst:.1e}");
    assert!(worst <= 1e-12, "{worst:e}");
}

#[test]
fn alpha_is_the_largest_response_on_the_ray() {
    let (mut worst, mut n_behind, mut n_seen) = (0f64, 0, 0);
    for index in 0..300 {
        let mut rng = rng(1000 + index);
        let camera = random_camera(&mut rng);
        let eye = camera.pose.centre();
        let splat = random_splat(eye, camera.pose.forward(), &mut rng);
        let direction = random_direction(&camera, &mut rng);
        let (peak, density) = GaussianOnRay::new(&splat, eye, direction).maximum();
        let found = alpha(&splat, &camera, RAY, direction);
        worst = worst.max((found - OPACITY * density).abs());
        n_behind += usize::from(peak < 1e-6);
        n_seen += usize::from(found > 1e-2);
    }
    println!("largest response: worst {worst:.1e}, {n_behind} at the camera, {n_seen} of 300 seen");
    assert!(worst <= 1e-12, "{worst:e}");
    assert!(n_behind >= 20 && n_seen >= 60, "{n_behind} {n_seen}");
}

#[test]
fn alpha_of_the_line_is_the_normalised_integral() {
    let (mut worst, mut n_compared) = (0f64, 0);
    for index in 0..300 {
        let mut rng = rng(2000 + index);
        let camera = random_camera(&mut rng);
        let eye = camera.pose.centre();
        let splat = random_splat(eye, camera.pose.forward(), &mut rng);
        let direction = random_direction(&camera, &mut rng);
        let response = alpha(&splat, &camera, LINE, direction) / OPACITY;
        if response < 1e-6 {
            continue;
        }
        let ray = GaussianOnRay::new(&splat, eye, direction);
        let (peak, _) = ray.maximum_of_line();
        let integral = ray.integral_around(peak);
        worst = worst.max((response / integral - 1.0).abs());
        n_compared += 1;
    }
    println!("line integral: {n_compared} lines, worst relative error {worst:.1e}");
    assert!(worst <= 1e-10, "{worst:e}");
    assert!(n_compared >= 100, "{n_compared}");
}

/// Checks the published form `∫ N(x; µ, Σ) dℓ = (2π)^−3/2 |Σ|^−1/2 √2π / |M d̂| · exp(−D²/2)`.
#[test]
fn the_integral_of_the_normal_density_has_its_closed_form() {
    let mut worst = 0f64;
    for index in 0..50 {
        let mut rng = rng(3000 + index);
        let camera = random_camera(&mut rng);
        let eye = camera.pose.centre();
        let splat = random_splat(eye, camera.pose.forward(), &mut rng);
        // The ray passes close to the mean, where the density is far from 0.
        let beside = splat.scale.min_element() * random_unit(&mut rng);
        let direction = (splat.mean + beside - eye).normalize();
        let axes = DMat3::from_quat(splat.rotation);
        let covariance = axes * DMat3::from_diagonal(splat.scale * splat.scale) * axes.transpose();
        let precision = covariance.inverse();
        let normalisation =
            (std::f64::consts::TAU.powi(3) * covariance.determinant()).sqrt().recip();
        let density = |t: f64| {
            let x = eye + direction * t - splat.mean;
            normalisation * (-0.5 * x.dot(precision * x)).exp()
        };
        let response = alpha(&splat, &camera, LINE, direction) / OPACITY;
        let thickness = direction.dot(precision * direction).sqrt().recip();
        let expected = normalisation * std::f64::consts::TAU.sqrt() * thickness * response;
        // An equidistant sum over a Gaussian is exact to rounding once the step is below its deviation.
        let reach = (splat.mean - eye).length() + 12.0 * splat.scale.max_element();
        let step = 0.5 * thickness;
        let n = (reach / step).ceil() as i64;
        let sum: f64 = (-n..=n).map(|i| density(i as f64 * step) * step).sum();
        worst = worst.max((sum / expected - 1.0).abs());
    }
    println!("integral of the normal density: worst relative error {worst:.1e}");
    assert!(worst <= 1e-10, "{worst:e}");
}

#[test]
fn turning_the_camera_changes_no_alpha_but_the_projected_one() {
    let turned = |method: RenderMethod| -> f64 {
        let mut spread = 0f64;
        for index in 0..40 {
            let mut rng = rng(4000 + index);
            let camera = random_camera(&mut rng);
            let (eye, forward) = (camera.pose.centre(), camera.pose.forward());
            let splat = random_splat(eye, forward, &mut rng);
            let direction = (splat.mean + 0.3 * random_unit(&mut rng) - eye).normalize();
            let alphas = (0..10).map(|_| {
                let target = eye + forward + 0.5 * random_unit(&mut rng);
                let pose = Pose::look_at(eye, target, random_unit(&mut rng)).unwrap();
                alpha(&splat, &Camera { pose, ..camera }, method, direction)
            });
            let (lo, hi) = alphas.fold((1.0f64, 0.0f64), |(lo, hi), a| (lo.min(a), hi.max(a)));
            spread = spread.max(hi - lo);
        }
        spread
    };
    let footprint = exact(Response::Ray, Antialias::Footprint, Lens::Pinhole);
    let spreads = [RAY, footprint, FISHEYE].map(turned);
    let projected = turned(RenderMethod::PROJECTED);
    println!("turning the camera: exact {spreads:?}, projected {projected:.2}");
    assert!(spreads.iter().all(|spread| *spread <= 1e-12), "{spreads:?}");
    assert!(projected > 0.1, "the projected renderer should depend on the camera's rotation");
}

#[test]
fn lenses_agree_on_shared_rays() {
    let splats = SCENES[1].splats(7);
    let appearance = random_appearance(&splats, 7);
    let view = SplatView::new(&splats, &appearance).unwrap();
    let eye = DVec3::new(2.0, -2.5, 1.0);
    let camera = Camera {
        intrinsics: Intrinsics::from_horizontal_fov(90, 70, 1.2),
        pose: Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap(),
    };
    let (mut worst, mut n_blended) = (0f64, 0);
    for antialias in [Antialias::None, Antialias::Footprint] {
        let [pinhole, fisheye] = [Lens::Pinhole, Lens::Fisheye].map(|lens| {
            let method = exact(Response::Ray, antialias, lens);
            Oracle::of(view, &camera, &RenderOptions::evaluation(method, [0.2; 3]))
        });
        let mut rng = rng(5);
        for _ in 0..200 {
            let direction = random_direction(&camera, &mut rng);
            let a = pinhole.at(image_point(&camera, Lens::Pinhole, direction));
            let b = fisheye.at(image_point(&camera, Lens::Fisheye, direction));
            let colors = a.rgba.iter().zip(b.rgba).map(|(a, b)| (a - b).abs());
            worst = colors.fold(worst.max((a.depth - b.depth).abs()), f64::max);
            n_blended += a.n_blended;
        }
    }
    println!("pinhole against fisheye: worst {worst:.1e}, {n_blended} splats blended");
    assert!(worst <= 1e-11, "{worst:e}");
    assert!(n_blended > 1000);
}

fn rng(index: u64) -> Rng {
    Rng::new(5, Purpose::Synthetic, index)
}
