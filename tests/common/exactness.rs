//! Compares an exact renderer with the numerically searched maximum of each splat along each pixel's ray:
//! 1,000 single splats of difficult kinds in four views.

use super::oracle::SplatF64;
use super::ray::GaussianOnRay;
use super::scenes::{exact, random_rotation};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::image::Image;
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::{
    ALPHA_CAP, ALPHA_CUT, Antialias, ExactOptions, FOOTPRINT_PX2, Lens, RenderMethod,
    RenderOptions, Response,
};

/// Total number of splats.
pub const N_SPLATS: usize = 1000;
/// Image size, pixels: several tiles, the last of each row and column incomplete.
const SIZE: [u32; 2] = [50, 37];
/// Lenses and their horizontal fields of view, degrees.
const VIEWS: [(Lens, f64); 4] =
    [(Lens::Pinhole, 60.0), (Lens::Pinhole, 110.0), (Lens::Pinhole, 150.0), (Lens::Fisheye, 200.0)];
/// Largest difference between the searched maximum and the quadrature of the line integral.
const INTEGRAL_TOLERANCE: f64 = 1e-9;

/// Difficulty of a splat.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Ball,
    /// One long axis, often past the camera.
    Needle,
    /// One short axis.
    Pancake,
    /// Contains the camera.
    Inside,
    /// More than 90° off the axis, and large enough to reach in front.
    Behind,
    /// A few pixels in size, at a corner of tiles.
    TileCorner,
}

const KINDS: [Kind; 6] =
    [Kind::Ball, Kind::Needle, Kind::Pancake, Kind::Inside, Kind::Behind, Kind::TileCorner];

/// One splat in one view.
pub struct Case {
    kind: Kind,
    pub splat: Splat,
    pub camera: Camera,
    pub options: RenderOptions,
}

/// Error allowed for a renderer.
#[derive(Clone, Copy)]
pub struct Tolerance {
    /// Largest absolute error of alpha.
    pub alpha: f64,
    /// Relative distance to the cut within which an alpha may be drawn or not.
    pub cut_band: f64,
}

/// Statistics of the comparison.
#[derive(Debug, Default)]
pub struct Figures {
    pub n_splats: usize,
    /// Splats visible in some pixel.
    pub n_visible: usize,
    /// Pixels in which a splat is visible.
    pub n_rays: usize,
    /// Those of them whose line integral was computed as well.
    pub n_integrated: usize,
    /// Pixels with alpha near the cut; those without the splat are not compared.
    pub n_on_cut: usize,
    /// Largest error of alpha.
    pub worst: f64,
}

/// Compares a renderer with the numerical oracle on the first `n_splats` of [`N_SPLATS`] cases. `alpha` draws
/// the single splat of a case.
///
/// # Panics
/// Panics if an error exceeds the tolerance or a kind is rarely visible.
pub fn check(
    n_splats: usize,
    mut alpha: impl FnMut(&Case) -> Image<f64>,
    tolerance: Tolerance,
) -> Figures {
    let mut figures = Figures::default();
    let mut seen = KINDS.map(|kind| (kind, 0));
    for case in cases().take(n_splats) {
        let found = alpha(&case);
        let truth = case.truth();
        assert_eq!((found.width, found.height), (truth.width, truth.height), "{case:?}");
        let mut shows = false;
        for (index, (&found, ray)) in found.data.iter().zip(&truth.data).enumerate() {
            let pixel = [index % truth.width, index / truth.width];
            figures.n_integrated += usize::from(ray.is_integrated);
            shows |= figures.compare(found, ray.alpha, tolerance, || format!("{pixel:?} {case:?}"));
        }
        figures.n_splats += 1;
        figures.n_visible += usize::from(shows);
        seen.iter_mut()
            .filter(|(kind, _)| *kind == case.kind)
            .for_each(|s| s.1 += usize::from(shows));
    }
    assert!(
        seen.iter().all(|(_, n)| *n * KINDS.len() * 10 > n_splats),
        "too few visible: {seen:?}"
    );
    figures
}

impl Figures {
    /// Compares one pixel; returns whether the splat is visible in it.
    fn compare(
        &mut self,
        found: f64,
        truth: f64,
        tolerance: Tolerance,
        label: impl Fn() -> String,
    ) -> bool {
        let on_cut = (truth / ALPHA_CUT - 1.0).abs() <= tolerance.cut_band;
        self.n_on_cut += usize::from(on_cut);
        if on_cut && found == 0.0 {
            return false;
        }
        let shows = on_cut || truth >= ALPHA_CUT;
        assert_eq!(found > 0.0, shows, "found {found}, expected {truth} at {}", label());
        let error = if shows { (found - truth).abs() } else { 0.0 };
        assert!(error <= tolerance.alpha, "found {found}, expected {truth} at {}", label());
        self.n_rays += usize::from(shows);
        self.worst = self.worst.max(error);
        shows
    }
}

/// Numerical result for a pixel's ray.
struct Ray {
    alpha: f64,
    is_integrated: bool,
}

impl Case {
    /// Computes alpha before the cut in every pixel.
    fn truth(&self) -> Image<Ray> {
        let (width, height) = (SIZE[0] as usize, SIZE[1] as usize);
        let pixels = (0..width * height).into_par_iter();
        let rays = pixels.map(|i| self.ray((i % width) as f64 + 0.5, (i / width) as f64 + 0.5));
        Image::from_vec(width, height, rays.collect())
    }

    fn ray(&self, x: f64, y: f64) -> Ray {
        let unseen = Ray { alpha: 0.0, is_integrated: false };
        let settings = self.settings();
        let direction = direction(settings.lens, &self.camera.intrinsics, DVec2::new(x, y));
        let Some(direction) = direction.filter(|_| !self.is_too_near()) else { return unseen };
        let eye = self.camera.pose.centre();
        let ray = GaussianOnRay::new(&self.widened(), eye, self.camera.pose.rotation() * direction);
        let (peak, density) = ray.maximum();
        let alpha = ALPHA_CAP.min(f64::from(self.splat.opacity) * density);
        let shows = alpha >= ALPHA_CUT;
        let integral = shows.then(|| ray.integral_ahead(peak)).flatten();
        if let Some(integral) = integral {
            assert!((integral - density).abs() <= INTEGRAL_TOLERANCE, "{integral} {density}");
        }
        Ray { alpha, is_integrated: integral.is_some() }
    }

    fn settings(&self) -> ExactOptions {
        match self.options.method {
            RenderMethod::Exact(settings) => settings,
            RenderMethod::Projected => unreachable!("every case is one of the exact renderer"),
        }
    }

    /// True if the centre lies on or before the near plane, where splats are not drawn.
    fn is_too_near(&self) -> bool {
        let m = self.offset_from_eye();
        match self.settings().lens {
            Lens::Pinhole => m.dot(self.camera.pose.forward()) <= self.options.near,
            Lens::Fisheye => m.length() <= self.options.near,
        }
    }

    fn offset_from_eye(&self) -> DVec3 {
        SplatF64::from(&self.splat).mean - self.camera.pose.centre()
    }

    /// Adds the antialiasing variance to the splat.
    fn widened(&self) -> SplatF64 {
        let mut splat = SplatF64::from(&self.splat);
        if self.settings().antialias == Antialias::Footprint {
            let k = &self.camera.intrinsics;
            let variance = FOOTPRINT_PX2 * self.offset_from_eye().length_squared() / (k.fx * k.fy);
            splat.scale = (splat.scale * splat.scale + variance).sqrt();
        }
        splat
    }
}

impl std::fmt::Debug for Case {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?} {:?} {:?} {:?}", self.kind, self.settings(), self.camera, self.splat)
    }
}

/// Returns the [`N_SPLATS`] cases, identical in every run.
pub fn cases() -> impl Iterator<Item = Case> {
    (0..N_SPLATS).map(|i| {
        let mut rng = Rng::new(17, Purpose::Synthetic, i as u64);
        let (lens, degrees) = VIEWS[i % VIEWS.len()];
        let kind = KINDS[i / VIEWS.len() % KINDS.len()];
        let antialias = [Antialias::None, Antialias::Footprint][i / VIEWS.len() / KINDS.len() % 2];
        let camera = camera(lens, degrees.to_radians(), &mut rng);
        Case {
            kind,
            splat: random_splat(kind, lens, &camera, &mut rng),
            camera,
            options: RenderOptions::evaluation(exact(Response::Ray, antialias, lens), [0.0; 3]),
        }
    })
}

/// Camera at a random position with a random orientation.
fn camera(lens: Lens, fov: f64, rng: &mut Rng) -> Camera {
    let [width, height] = SIZE;
    let mut intrinsics = Intrinsics::from_horizontal_fov(width, height, 1.0);
    let half = 0.5 * f64::from(width);
    let focal = match lens {
        Lens::Pinhole => half / (0.5 * fov).tan(),
        Lens::Fisheye => half / (0.5 * fov),
    };
    (intrinsics.fx, intrinsics.fy) = (focal, focal * 1.07);
    intrinsics.cx += 1.3;
    let mut anywhere = || DVec3::from_array([0; 3].map(|_| rng.range(-3.0, 3.0)));
    let (eye, towards) = (anywhere(), anywhere());
    Camera { intrinsics, pose: Pose::look_at(eye, towards, DVec3::Z).unwrap() }
}

fn random_splat(kind: Kind, lens: Lens, camera: &Camera, rng: &mut Rng) -> Splat {
    let k = &camera.intrinsics;
    let mut even = |lo: f64, hi: f64| rng.range(lo.ln(), hi.ln()).exp();
    let distance = if kind == Kind::Inside { even(0.21, 1.2) } else { even(0.4, 8.0) };
    let pixel = distance / k.fx;
    let scale = match kind {
        Kind::Ball => [0; 3].map(|_| distance * even(0.02, 0.4)),
        // For thinner needles the f32 rounding of pixel offsets is a visible share of the width.
        Kind::Needle => [distance * even(0.1, 2.0), pixel * even(0.1, 1.0), pixel * even(0.1, 1.0)],
        Kind::Pancake => {
            [distance * even(0.05, 1.0), distance * even(0.05, 1.0), pixel * even(0.1, 1.0)]
        }
        Kind::Inside => [0; 3].map(|_| even(0.5, 2.0)),
        Kind::Behind => [0; 3].map(|_| distance * even(0.2, 1.5)),
        Kind::TileCorner => [0; 3].map(|_| pixel * even(0.3, 2.0)),
    };
    let towards = match kind {
        Kind::Behind => behind(rng),
        Kind::TileCorner => {
            let corner = DVec2::new(16.0, 16.0) * (1 + rng.below(2)) as f64;
            let off = DVec2::new(rng.range(-0.02, 0.02), rng.range(-0.02, 0.02));
            direction(lens, k, corner + off).unwrap()
        }
        _ => {
            let [width, height] = SIZE.map(f64::from);
            // Some centres lie outside the image.
            let point = DVec2::new(rng.range(-0.1, 1.1) * width, rng.range(-0.1, 1.1) * height);
            direction(lens, k, point).unwrap()
        }
    };
    Splat {
        mean: camera.pose.transform_point(towards * distance).as_vec3().to_array(),
        opacity: rng.range(0.02, 1.5) as f32,
        color: [1.0; 3],
        scale: scale.map(|s| s as f32),
        rotation: random_rotation(rng),
    }
}

/// A unit vector with `z < 0`.
fn behind(rng: &mut Rng) -> DVec3 {
    let v = DVec3::from_array([0; 3].map(|_| rng.normal())).normalize();
    DVec3::new(v.x, v.y, -v.z.abs())
}

/// Unit vector in camera space through a point of the image; `None` outside a fisheye's image.
fn direction(lens: Lens, k: &Intrinsics, point: DVec2) -> Option<DVec3> {
    let (x, y) = ((point.x - k.cx) / k.fx, (point.y - k.cy) / k.fy);
    match lens {
        Lens::Pinhole => Some(DVec3::new(x, y, 1.0).normalize()),
        Lens::Fisheye => {
            let (angle, turn) = (x.hypot(y), y.atan2(x));
            let across = angle.sin();
            (angle <= std::f64::consts::PI)
                .then(|| DVec3::new(across * turn.cos(), across * turn.sin(), angle.cos()))
        }
    }
}
