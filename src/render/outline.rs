//! Silhouette of a splat in the image.

use super::options::{DisplayStyle, RenderMethod};
use crate::math::camera::Camera;
use crate::model::splat::splats::Splat;
use glam::{DMat3, DQuat, DVec2, DVec3};
use std::f64::consts::TAU;

/// Corners of the silhouette. At 1,000 pixels across, the polygon deviates by less than a pixel.
const N_CORNERS: usize = 96;

/// Line segments, in pixels, of the silhouette of the ellipsoid at `radius` standard deviations. It
/// ignores antialiasing and is the same for both renderers. Empty if the splat is invalid or invisible, or
/// if the camera is inside the ellipsoid.
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
    use crate::render::options::{Antialias, ExactOptions, Lens, RenderOptions, Response};

    fn camera() -> Camera {
        let intrinsics = Intrinsics::from_horizontal_fov(200, 160, 1.2);
        Camera {
            intrinsics,
            pose: Pose::look_at(DVec3::new(0.0, -4.0, 1.0), DVec3::ZERO, DVec3::Z).unwrap(),
        }
    }

    fn splat() -> Splat {
        let q = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 1.1);
        Splat {
            mean: [0.6, 0.2, -0.3],
            opacity: 0.9,
            color: [1.0; 3],
            scale: [0.5, 0.2, 0.05],
            rotation: [q.w, q.x, q.y, q.z].map(|v| v as f32),
        }
    }

    /// On the silhouette at k standard deviations, the nearest ray has a Mahalanobis distance of k. The exact
    /// renderer's response there is `o·exp(−k²/2)`.
    #[test]
    fn the_rim_is_where_the_exact_response_says() {
        let (camera, splat) = (camera(), splat());
        for lens in [Lens::Pinhole, Lens::Fisheye] {
            let settings =
                ExactOptions { response: Response::Ray, antialias: Antialias::None, lens };
            let method = RenderMethod::Exact(settings);
            for radius in [1.0, 2.0] {
                let rim = outline(&splat, &camera, method, &DisplayStyle::PLAIN, radius);
                assert_eq!(rim.len(), N_CORNERS);
                for [corner, _] in rim {
                    let options = RenderOptions::evaluation(method, [0.0; 3]);
                    let picked = super::super::pick::pick(&[splat], &camera, corner, &options);
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
        let around = Splat { mean: [0.0, -4.0, 1.0], ..splat() };
        assert!(
            outline(&around, &camera(), RenderMethod::EXACT, &DisplayStyle::PLAIN, 1.0).is_empty()
        );
        let broken = Splat { mean: [f32::NAN; 3], ..splat() };
        assert!(
            outline(&broken, &camera(), RenderMethod::EXACT, &DisplayStyle::PLAIN, 1.0).is_empty()
        );
        let behind = Splat { mean: [0.0, -40.0, 1.0], ..splat() };
        assert!(
            outline(&behind, &camera(), RenderMethod::PROJECTED, &DisplayStyle::PLAIN, 1.0)
                .is_empty()
        );
    }
}
