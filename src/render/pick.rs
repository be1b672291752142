//! Finds the splat with the largest blending weight in a pixel (`rendering.md`, Picking).
//!
//! One pixel needs neither tiles nor a sort of the whole scene: alphas are computed in parallel, and only
//! the visible splats are sorted and blended. The formulas are evaluated in f64 instead of the renderers'
//! f32 records, so that rounding does not decide the result; a test checks that both agree. The weight
//! decides rather than depth, because the first splat of a pixel is often a faint one.

use super::cpu::projected::distance_squared;
use super::cpu::view::{CameraSplat, CpuView};
use super::options::{
    ALPHA_CAP, ALPHA_CUT, DisplayStyle, RenderMethod, RenderOptions, Response, TRANSMITTANCE_STOP,
};
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatView;
use crate::model::splat::splats::Splat;
use glam::{DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Splat selected in a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// Index of the splat in the searched list.
    pub index: usize,
    /// Weight `α·T` of the splat in the pixel's colour, in `[0, 1]`.
    pub weight: f64,
}

/// Returns the splat with the largest blending weight at a continuous image position in pixels. `None`
/// if no splat is visible there.
pub fn pick<'a>(
    splats: impl Into<SplatView<'a>>,
    camera: &Camera,
    position: DVec2,
    options: &RenderOptions,
) -> Option<Pick> {
    // `None` outside the lens's field of view.
    let ray = options.method.lens().ray(&camera.intrinsics, position)?;
    let splats: SplatView = splats.into();
    let is_antialiased = splats.finishing().is_antialiased;
    let view = CpuView { is_antialiased, ..CpuView::new(camera, options) };
    let mut layers: Vec<(usize, f64, f64)> = splats
        .splats()
        .par_iter()
        .enumerate()
        .filter_map(|(index, splat)| {
            let (depth, alpha) = depth_and_alpha(&view, splat, position, ray)?;
            Some((index, depth, alpha))
        })
        .collect();
    // Stable, so ties keep the order of the list, as in the renderers.
    layers.sort_by(|(_, a, _), (_, b, _)| a.total_cmp(b));
    let mut transmittance = 1.0;
    let mut best: Option<Pick> = None;
    for (index, _, alpha) in layers {
        let left = transmittance * (1.0 - alpha);
        // Stops before this splat, as the renderers do: a splat that is not blended cannot be picked.
        if left < TRANSMITTANCE_STOP {
            break;
        }
        let weight = alpha * transmittance;
        if best.is_none_or(|b| weight > b.weight) {
            best = Some(Pick { index, weight });
        }
        transmittance = left;
    }
    best
}

/// Returns the sort depth (world units) and alpha of a splat in the pixel at `position`; `None` if it
/// is invisible there. `ray` passes through the pixel in camera axes and may have any length.
fn depth_and_alpha(
    view: &CpuView,
    splat: &Splat,
    position: DVec2,
    ray: DVec3,
) -> Option<(f64, f64)> {
    if !splat.is_drawable() {
        return None;
    }
    let placed = view.to_camera(splat)?;
    let (depth, opacity, distance2) = match view.method {
        RenderMethod::Projected => {
            (placed.m.z, placed.opacity, distance_squared(view, &placed, position))
        }
        RenderMethod::Exact(exact) => {
            let placed = placed.apply_antialiasing(exact, &view.intrinsics)?;
            let distance2 = ray_distance_squared(&placed, ray, exact.response);
            (placed.m.length(), placed.opacity, distance2)
        }
    };
    let alpha = ALPHA_CAP.min(opacity * (-0.5 * distance2).exp());
    // `min` ignores NaN, so the distance is compared too.
    (distance2 >= 0.0 && alpha >= ALPHA_CUT).then_some((depth, alpha))
}

/// Returns the smallest squared Mahalanobis distance from a splat to the points of a ray, or of the
/// whole line for [`Response::Line`] (`rendering.md`, Exact renderer).
fn ray_distance_squared(placed: &CameraSplat, ray: DVec3, response: Response) -> f64 {
    let p = placed.axes.transpose_mul_vec3(placed.m) / placed.scale;
    let g = placed.axes.transpose_mul_vec3(ray) / placed.scale;
    // If the maximum lies behind the camera, the response on the ray is largest at the camera.
    if response == Response::Line || g.dot(p) >= 0.0 {
        g.cross(p).length_squared() / g.length_squared()
    } else {
        p.length_squared()
    }
}

// Corners of the silhouette. At 1,000 pixels across, the polygon deviates by less than a pixel.
const N_CORNERS: usize = 96;

/// Returns line segments, in pixels, of the silhouette of the ellipsoid at `radius` standard
/// deviations. The silhouette ignores antialiasing and is the same for both renderers. Empty if the
/// splat is invalid or invisible, or if the camera is inside the ellipsoid.
///
/// In whitened coordinates the splat is a ball and the camera is at `−p`. The silhouette is the circle
/// where the tangent cone touches the ball.
pub fn outline(
    splat: &Splat,
    camera: &Camera,
    method: RenderMethod,
    look: &DisplayStyle,
    radius: f64,
) -> Vec<[DVec2; 2]> {
    if !splat.is_valid() {
        return Vec::new();
    }
    let [w, x, y, z] = splat.rotation.map(f64::from);
    let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let axes = camera.pose.rotation().transpose() * rotation;
    let scale = look.display_scales(splat);
    let mean = DVec3::from_array(splat.mean.map(f64::from)) - camera.pose.centre();
    let p = rotation.transpose_mul_vec3(mean) / scale;
    let depth = 1.0 - radius * radius / p.length_squared();
    // The camera is inside the ellipsoid or at its centre: there is no tangent cone.
    if depth.is_nan() || depth <= 0.0 {
        return Vec::new();
    }
    let (centre, size) = (p * depth, radius * depth.sqrt());
    let (u, v) = p.normalize().any_orthonormal_pair();
    let corner = |i: usize| {
        let (sin, cos) = (TAU * i as f64 / N_CORNERS as f64).sin_cos();
        let point = axes * ((centre + (u * cos + v * sin) * size) * scale);
        method.lens().project(&camera.intrinsics, point)
    };
    // One extra corner closes the polygon.
    let corners: Vec<Option<DVec2>> = (0..=N_CORNERS).map(corner).collect();
    corners.windows(2).filter_map(|pair| Some([pair[0]?, pair[1]?])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::camera::Intrinsics;
    use crate::math::pose::Pose;
    use crate::render::cpu::CpuRenderer;
    use crate::render::options::{Antialias, ExactOptions, Lens};

    fn camera() -> Camera {
        Camera { intrinsics: Intrinsics::from_horizontal_fov(64, 48, 1.0), pose: Pose::IDENTITY }
    }

    fn ball(x: f32, z: f32, opacity: f32) -> Splat {
        Splat { mean: [x, 0.0, z], opacity, color: [1.0; 3], scale: [0.2; 3], ..Splat::default() }
    }

    fn turned() -> [f32; 4] {
        let q = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 1.1);
        [q.w, q.x, q.y, q.z].map(|v| v as f32)
    }

    fn exact(lens: Lens, antialias: Antialias) -> RenderMethod {
        RenderMethod::Exact(ExactOptions { response: Response::Ray, antialias, lens })
    }

    #[test]
    fn the_heaviest_and_not_the_first_is_picked() {
        let splats =
            [ball(0.0, 5.0, 0.9), ball(0.0, 3.0, 0.3), Splat::default(), ball(1.0, 3.0, 0.9)];
        let centre = DVec2::new(32.0, 24.0);
        for method in
            [RenderMethod::PROJECTED, RenderMethod::EXACT, exact(Lens::Fisheye, Antialias::None)]
        {
            let options = RenderOptions::evaluation(method, [0.0; 3]);
            let pick_at = |at| pick(&splats, &camera(), at, &options);
            let found = pick_at(centre).unwrap();
            assert_eq!(found.index, 0, "{method:?}");
            assert!((found.weight - 0.9 * 0.7).abs() < 1e-6, "{method:?} {}", found.weight);
            let seen = method.lens().project(&camera().intrinsics, DVec3::new(1.0, 0.0, 3.0));
            assert_eq!(pick_at(seen.unwrap()).unwrap().index, 3);
            assert_eq!(pick_at(DVec2::new(1.0, 1.0)), None);
            let look = DisplayStyle { opacity_cut: 0.5, ..DisplayStyle::PLAIN };
            let cut = RenderOptions { style: look, ..options };
            assert!((pick(&splats, &camera(), centre, &cut).unwrap().weight - 0.9).abs() < 1e-6);
        }
    }

    /// For a single splat, the picked weight equals the coverage of the rendered image.
    #[test]
    fn weights_are_what_the_renderer_blends() {
        let scale = [0.5, 0.1, 0.02];
        let splat = Splat { scale, rotation: turned(), ..ball(0.7, 2.0, 0.8) };
        let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let image = CpuRenderer::new().render(&[splat], &camera(), &options);
        for (x, y) in [(50, 24), (56, 20), (44, 28), (54, 26)] {
            let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let weight = pick(&[splat], &camera(), at, &options).map_or(0.0, |p| p.weight);
            assert!(
                (weight - f64::from(*image.coverage.at(x, y))).abs() < 1e-4,
                "{x} {y} {weight}"
            );
        }
    }

    #[test]
    fn nothing_is_picked_of_what_is_not_drawn() {
        let hidden = [
            ball(0.0, 0.1, 0.9),
            ball(0.0, -3.0, 0.9),
            ball(f32::NAN, 3.0, 0.9),
            ball(0.0, 3.0, 0.001),
        ];
        for method in [RenderMethod::PROJECTED, RenderMethod::EXACT] {
            let options = RenderOptions::evaluation(method, [0.0; 3]);
            assert_eq!(pick(&hidden, &camera(), DVec2::new(32.0, 24.0), &options), None);
        }
    }

    fn outside() -> Camera {
        let intrinsics = Intrinsics::from_horizontal_fov(200, 160, 1.2);
        let pose = Pose::look_at(DVec3::new(0.0, -4.0, 1.0), DVec3::ZERO, DVec3::Z).unwrap();
        Camera { intrinsics, pose }
    }

    fn pancake() -> Splat {
        let mean = [0.6, 0.2, -0.3];
        Splat { mean, scale: [0.5, 0.2, 0.05], rotation: turned(), ..ball(0.0, 0.0, 0.9) }
    }

    /// On the silhouette at `k` standard deviations, the nearest ray has a Mahalanobis distance of `k`.
    /// The exact renderer's response there is `o·exp(−k²/2)` with opacity `o`.
    #[test]
    fn the_rim_is_where_the_exact_response_says() {
        let (camera, splat) = (outside(), pancake());
        for lens in [Lens::Pinhole, Lens::Fisheye] {
            let method = exact(lens, Antialias::None);
            for radius in [1.0, 2.0] {
                let rim = outline(&splat, &camera, method, &DisplayStyle::PLAIN, radius);
                assert_eq!(rim.len(), N_CORNERS);
                for [corner, _] in rim {
                    let options = RenderOptions::evaluation(method, [0.0; 3]);
                    let picked = pick(&[splat], &camera, corner, &options);
                    let expected = 0.9f32 as f64 * (-0.5 * radius * radius).exp();
                    let weight = picked.unwrap().weight;
                    assert!((weight - expected).abs() < 1e-6, "{lens} {radius}: {weight}");
                }
            }
        }
        let image = CpuRenderer::new().render(
            &[splat],
            &camera,
            &RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]),
        );
        let rim = outline(&splat, &camera, RenderMethod::PROJECTED, &DisplayStyle::PLAIN, 1.0);
        let [corner, _] = rim[0];
        let there = *image.coverage.at(corner.x as usize, corner.y as usize);
        assert!((there - 0.9 * (-0.5f32).exp()).abs() < 0.1, "{there}");
    }

    #[test]
    fn what_cannot_be_outlined_is_left_out() {
        let around = ([0.0, -4.0, 1.0], RenderMethod::EXACT);
        let broken = ([f32::NAN; 3], RenderMethod::EXACT);
        let behind = ([0.0, -40.0, 1.0], RenderMethod::PROJECTED);
        for (mean, method) in [around, broken, behind] {
            let splat = Splat { mean, ..pancake() };
            let rim = outline(&splat, &outside(), method, &DisplayStyle::PLAIN, 1.0);
            assert!(rim.is_empty(), "{mean:?}");
        }
    }
}
