//! Whole images of random scenes against the f64 oracle.

use super::compare::{TOLERANCE, assert_close, error, largest_difference, oracle};
use super::device::{Gpu, PLAIN, camera, outside, random_scene};
use crate::common::scenes::{
    NATIVE_SCENES, SCENES, camera_of, exact, options, random_appearance, textured_splats,
};
use glam::{DMat3, DQuat, DVec3};
use std::sync::Arc;
use vbgs_studio::math::image::Image;
use vbgs_studio::math::pose::Pose;
use vbgs_studio::model::splat::appearance::{Finishing, SplatSet, SplatView};
use vbgs_studio::model::splat::pose_log::{ExposureLog, FrameExposure};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::finish::MARKER_COLOR;
use vbgs_studio::render::{
    Antialias, DisplayStyle, Exposing, Lens, Paint, RenderMethod, RenderOptions, Response,
};

/// Every renderer with every option that changes the shaders' formulas.
const METHODS: [RenderMethod; 6] = [
    RenderMethod::PROJECTED,
    RenderMethod::EXACT,
    exact(Response::Ray, Antialias::None, Lens::Pinhole),
    exact(Response::Ray, Antialias::Reference, Lens::Pinhole),
    exact(Response::Ray, Antialias::Footprint, Lens::Fisheye),
    exact(Response::Ray, Antialias::None, Lens::Fisheye),
];

const N_VEILS: usize = 100;

#[test]
fn every_method_agrees_with_the_oracle() {
    let Some(gpu) = Gpu::new() else { return };
    for (seed, scene) in SCENES.iter().enumerate() {
        // Without antialiasing, needles of a hundredth of a pixel are below the resolution of f32
        // pixel positions.
        let resolves = |method| match method {
            RenderMethod::Projected => true,
            RenderMethod::Exact(exact) => {
                exact.antialias == Antialias::Footprint || scene.scale.0 > 1e-3
            }
        };
        for method in METHODS.into_iter().filter(|method| resolves(*method)) {
            let mut splats = scene.splats(seed as u64);
            if scene.opacity.1 < 0.7 {
                // Half floats lose the sum of hundreds of faint layers.
                splats.truncate(N_VEILS);
            }
            let (view, options) = (camera_of(method), options(method));
            let image = gpu.image(&splats, &view, &options);
            let label = format!("{} {method:?}", scene.name);
            assert_close(&image, &oracle(&splats, &view, &options), &label);
        }
    }
    gpu.assert_no_faults();
}

#[test]
fn every_method_finishes_pixels() {
    let Some(gpu) = Gpu::new() else { return };
    let splats = NATIVE_SCENES[1].splats(9);
    let appearance = random_appearance(&splats, 9);
    let frames = vec![FrameExposure::new(&Pose::IDENTITY, [2.0, 1.0, 0.8])];
    let exposures = Some(Arc::new(ExposureLog::new(frames, 0.1)));
    let set = SplatSet::new(splats, appearance).finished(Finishing {
        photograph_poses: None,
        full_coverage: 0.4,
        is_antialiased: false,
        exposures,
        poses: None,
        textures: None,
    });
    for method in METHODS {
        let options = RenderOptions { exposure_mode: Exposing::Recorded, ..options(method) };
        let view = camera_of(method);
        let image = gpu.image(&set, &view, &options);
        assert_close(&image, &oracle(&set, &view, &options), &format!("finished {method:?}"));
    }
    gpu.assert_no_faults();
}

/// Splats around a pixel wide lose most of their opacity, on the GPU as on the CPU.
#[test]
fn every_method_lowers_opacities_of_antialiased_scenes() {
    let Some(gpu) = Gpu::new() else { return };
    let finishing = Finishing { is_antialiased: true, ..Finishing::default() };
    let plain = SplatSet::from(random_scene(12, 400, 0.06));
    let set = plain.clone().finished(finishing);
    for method in METHODS {
        let options = RenderOptions { method, ..PLAIN };
        let view = outside(96, 64);
        let coverage = |set: &SplatSet| CpuRenderer::new().render(set, &view, &options).coverage;
        let (expected, whole) = (coverage(&set), coverage(&plain));
        let found = gpu.image(&set, &view, &options);
        let far = |(a, b): (&[f32; 4], &f32)| (a[3] - b).abs() > 0.006;
        let n_far = found.data.iter().zip(&expected.data).filter(|pair| far(*pair)).count();
        // At the threshold of alpha f32 may decide otherwise.
        assert!(n_far <= found.data.len() / 200, "{method:?}: {n_far} pixels differ");
        let sum = |image: &Image<f32>| image.data.iter().sum::<f32>();
        let lowers =
            !matches!(method, RenderMethod::Exact(e) if e.antialias != Antialias::Footprint);
        assert_eq!(sum(&expected) < 0.8 * sum(&whole), lowers, "{method:?}");
    }
    gpu.assert_no_faults();
}

#[test]
fn every_method_draws_appearance() {
    let Some(gpu) = Gpu::new() else { return };
    for (seed, scene) in NATIVE_SCENES.iter().enumerate() {
        let splats = scene.splats(seed as u64);
        let appearance = random_appearance(&splats, seed as u64);
        let native = SplatView::new(&splats, &appearance).unwrap();
        for method in METHODS {
            let (view, options) = (camera_of(method), options(method));
            let image = gpu.image(native, &view, &options);
            let label = format!("native {} {method:?}", scene.name);
            assert_close(&image, &oracle(native, &view, &options), &label);
        }
    }
    gpu.assert_no_faults();
}

#[test]
fn every_method_draws_textures() {
    let Some(gpu) = Gpu::new() else { return };
    let mut set = textured_splats(3);
    // A marked splat keeps its colour.
    set.splats_mut()[0].color = MARKER_COLOR;
    let finishing = Finishing { full_coverage: 0.6, ..set.finishing().clone() };
    let set = set.finished(finishing.clone());
    let untextured = set.clone().finished(Finishing { textures: None, ..finishing });
    for method in METHODS {
        let (view, options) = (camera_of(method), options(method));
        let image = gpu.image(&set, &view, &options);
        let label = format!("textures {method:?}");
        assert_close(&image, &oracle(&set, &view, &options), &label);
        let plain = gpu.image(&untextured, &view, &options);
        let n_changed =
            image.data.iter().zip(&plain.data).filter(|(a, b)| (a[0] - b[0]).abs() > 0.02).count();
        assert!(10 * n_changed > image.data.len(), "{label}: {n_changed} pixels show textures");
    }
    // Without appearance a splat has the same colour in every direction.
    let plain = SplatSet::from(set.to_vec()).finished(set.finishing().clone());
    let (view, options) = (camera_of(METHODS[0]), options(METHODS[0]));
    let image = gpu.image(&plain, &view, &options);
    assert_close(&image, &oracle(&plain, &view, &options), "textures without appearance");
    gpu.assert_no_faults();
}

#[test]
fn other_paints_show_no_texture() {
    let Some(gpu) = Gpu::new() else { return };
    let set = textured_splats(4);
    let untextured = set.clone().finished(Finishing::default());
    let view = outside(80, 60);
    let style = DisplayStyle { paint: Paint::Normal, ..DisplayStyle::PLAIN };
    let options = RenderOptions { style, ..PLAIN };
    let [a, b] = [&set, &untextured].map(|set| gpu.image(set, &view, &options));
    assert_eq!(largest_difference(&a, &b), 0.0);
    let [a, b] = [&set, &untextured].map(|set| gpu.image(set, &view, &PLAIN));
    assert!(largest_difference(&a, &b) > 0.1);
    gpu.assert_no_faults();
}

#[test]
fn wide_fields_of_view_agree_with_the_oracle() {
    let Some(gpu) = Gpu::new() else { return };
    let splats = SCENES[3].splats(21);
    let view = camera(160, 90, DVec3::new(0.3, -0.4, 0.1), 150f64.to_radians());
    for method in [RenderMethod::PROJECTED, RenderMethod::EXACT] {
        let options = options(method);
        let image = gpu.image(&splats, &view, &options);
        assert_close(&image, &oracle(&splats, &view, &options), &format!("150 degrees {method:?}"));
    }
    gpu.assert_no_faults();
}

#[test]
fn long_needles_keep_their_width_in_f32() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(200, 200, DVec3::new(0.0, -3.0, 0.0), 0.9);
    for angle in [0.0, 0.3, std::f64::consts::FRAC_PI_4, 1.2] {
        let q = DQuat::from_mat3(&DMat3::from_rotation_y(angle));
        let needle = Splat {
            mean: [0.1, 0.2, -0.1],
            opacity: 0.9,
            color: [1.0, 0.5, 0.25],
            // About 7000 px long, and much thinner than a pixel.
            scale: [100.0, 1e-4, 1e-4],
            rotation: [q.w as f32, q.x as f32, q.y as f32, q.z as f32],
        };
        for method in [RenderMethod::PROJECTED, RenderMethod::EXACT] {
            let options = RenderOptions { method, ..PLAIN };
            let image = gpu.image(&[needle], &view, &options);
            let label = format!("{angle} {method:?}");
            assert_close(&image, &oracle(&[needle], &view, &options), &label);
            assert!(image.data.iter().any(|p| p[3] > 0.5), "{label}: nothing is drawn");
        }
    }
}

#[test]
fn a_scene_far_from_the_origin_looks_the_same() {
    let Some(gpu) = Gpu::new() else { return };
    // Multiples of 2⁻⁸, so a shift by 4096 is exact in f32; the camera's position is not.
    let dyadic = |v: f32| (v * 256.0).round() / 256.0;
    let splats: Vec<Splat> = random_scene(15, 300, 0.1)
        .into_iter()
        .map(|s| Splat { mean: s.mean.map(dyadic), ..s })
        .collect();
    let far: Vec<Splat> =
        splats.iter().map(|s| Splat { mean: s.mean.map(|v| v + 4096.0), ..*s }).collect();
    let near_view = outside(80, 60);
    let mut far_view = near_view;
    far_view.pose = vbgs_studio::math::pose::Pose::look_at(
        near_view.pose.centre() + 4096.0 + 1e-5,
        DVec3::new(0.1, 0.2, 0.0) + 4096.0 + 1e-5,
        DVec3::Z,
    )
    .unwrap();
    for method in [RenderMethod::PROJECTED, RenderMethod::EXACT] {
        let options = RenderOptions { method, ..PLAIN };
        let image = gpu.image(&far, &far_view, &options);
        let label = format!("{method:?} at 4096");
        assert_close(&image, &oracle(&far, &far_view, &options), &label);
    }
    gpu.assert_no_faults();
}

#[test]
fn a_camera_inside_a_splat_sees_it_everywhere() {
    let Some(gpu) = Gpu::new() else { return };
    for method in METHODS {
        let view = camera_of(method);
        let ahead = view.pose.centre() + 0.5 * view.pose.forward();
        let around = Splat {
            mean: ahead.as_vec3().to_array(),
            opacity: 0.6,
            color: [0.2, 0.5, 0.9],
            scale: [1.0, 2.0, 1.5],
            rotation: [1.0, 0.0, 0.0, 0.0],
        };
        let options = options(method);
        let image = gpu.image(&[around], &view, &options);
        let oracle = oracle(&[around], &view, &options);
        for (found, expected) in image.data.iter().zip(&oracle.render().data) {
            assert!(error(found, expected) < TOLERANCE, "{method:?}: {found:?} {expected:?}");
            // A fisheye sees up to 180° from its axis; a field of view of 190° stays well within.
            assert!(method == RenderMethod::PROJECTED || found[3] > 0.1, "{method:?}: {found:?}");
        }
    }
    gpu.assert_no_faults();
}
