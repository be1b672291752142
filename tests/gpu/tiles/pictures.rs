//! Images against the f64 oracle with a tight tolerance.

use super::scenes::{appearance, camera, cloud};
use crate::common::oracle::Oracle;
use crate::compare::largest_difference;
use crate::device::Gpu;
use glam::DVec3;
use vbgs_studio::math::camera::Camera;
use vbgs_studio::math::image::Image;
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::{
    ALPHA_CUT, Antialias, DisplayStyle, ExactOptions, Lens, Paint, RenderMethod, RenderOptions,
    Response, TRANSMITTANCE_STOP,
};

/// Half-float rounding at the end of f32 sums.
const TOLERANCE: f64 = 2e-3;
/// Relative distance to the alpha cut and the transmittance stop within which f32 may take either branch.
const HINGE: f64 = 1e-3;

const FISHEYE: RenderMethod = RenderMethod::Exact(ExactOptions {
    response: Response::Ray,
    antialias: Antialias::Footprint,
    lens: Lens::Fisheye,
});
const SHARP: RenderMethod = RenderMethod::Exact(ExactOptions {
    response: Response::Ray,
    antialias: Antialias::None,
    lens: Lens::Pinhole,
});

fn options(method: RenderMethod) -> RenderOptions {
    RenderOptions::evaluation(method, [0.0; 3])
}

/// Asserts that every pixel is within the tolerance of the oracle, with thresholds moved slightly.
fn assert_agrees(
    name: &str,
    image: &Image<[f32; 4]>,
    splats: SplatView<'_>,
    camera: &Camera,
    options: &RenderOptions,
) {
    let oracle = Oracle::of(splats, camera, options);
    let lower =
        oracle.with_thresholds(ALPHA_CUT * (1.0 - HINGE), TRANSMITTANCE_STOP * (1.0 - HINGE));
    let upper =
        oracle.with_thresholds(ALPHA_CUT * (1.0 + HINGE), TRANSMITTANCE_STOP * (1.0 + HINGE));
    let mut worst = 0.0f64;
    for row in 0..image.height {
        for column in 0..image.width {
            // The oracle clamps its image to 1.
            let found = image.at(column, row).map(|v| f64::from(v.min(1.0)));
            let expected = oracle.pixel(column, row).rgba;
            for channel in 0..4 {
                let error = (found[channel] - expected[channel]).abs();
                if error <= TOLERANCE {
                    worst = worst.max(error);
                    continue;
                }
                let hinges = [lower.pixel(column, row), upper.pixel(column, row)];
                let between = hinges.map(|sample| sample.rgba[channel]);
                let low = expected[channel].min(between[0]).min(between[1]) - TOLERANCE;
                let high = expected[channel].max(between[0]).max(between[1]) + TOLERANCE;
                assert!(
                    (low..=high).contains(&found[channel]),
                    "{name}: pixel {column},{row} channel {channel}: {} for {}",
                    found[channel],
                    expected[channel]
                );
            }
        }
    }
    println!("{name}: worst {worst:.1e}");
}

#[test]
fn random_scenes_agree_with_the_oracle() {
    let Some(gpu) = Gpu::new() else { return };
    let scenes = [
        ("small", cloud(1, 400, 0.05, 0.01, [0.0, 1.0])),
        ("large", cloud(2, 60, 2.0, 0.05, [0.0, 1.0])),
        ("needles", cloud(3, 150, 1.0, 0.001, [0.1, 1.0])),
        ("flat tops", cloud(4, 200, 0.1, 0.1, [0.5, 3.0])),
    ];
    let views = [
        camera(101, 73, DVec3::new(4.0, -3.0, 1.0), 0.8),
        // Among the splats, some of them behind the camera; tall image, wide angle.
        camera(40, 97, DVec3::new(0.3, -0.4, 0.1), 2.2),
    ];
    for (name, splats) in &scenes {
        let extras = appearance(5, splats.len());
        for (view, method) in views.iter().flat_map(|view| {
            [RenderMethod::PROJECTED, RenderMethod::EXACT, SHARP, FISHEYE]
                .map(|method| (view, method))
        }) {
            let options = options(method);
            for splats in [splats.into(), SplatView::new(splats, &extras).unwrap()] {
                let kind = if splats.appearance().is_empty() { "plain" } else { "shaded" };
                let name = format!("{name}, {kind}, {}, {method:?}", view.intrinsics.width);
                let image = gpu.image(splats, view, &options);
                assert_agrees(&name, &image, splats, view, &options);
            }
        }
    }
    gpu.assert_no_faults();
}

#[test]
fn looks_and_paints_agree_with_the_oracle() {
    let Some(gpu) = Gpu::new() else { return };
    let splats = cloud(6, 200, 0.2, 0.05, [0.0, 1.0]);
    let extras = appearance(7, splats.len());
    let splats = SplatView::new(&splats, &extras).unwrap();
    let view = camera(64, 48, DVec3::new(4.0, -3.0, 1.0), 0.8);
    for paint in [Paint::Stored, Paint::Depth([3.0, 7.0]), Paint::Normal] {
        let look = DisplayStyle { scale: 0.7, opacity_cut: 0.4, paint };
        let options = RenderOptions { style: look, ..options(RenderMethod::EXACT) };
        let image = gpu.image(splats, &view, &options);
        assert_agrees(&format!("{paint:?}"), &image, splats, &view, &options);
    }
    gpu.assert_no_faults();
}

#[test]
fn every_size_of_image_is_whole() {
    let Some(gpu) = Gpu::new() else { return };
    let splats = cloud(8, 120, 0.3, 0.1, [0.2, 0.9]);
    let options = options(RenderMethod::EXACT);
    let eye = DVec3::new(4.0, -3.0, 1.0);
    for (width, height) in [(16, 16), (17, 15), (1, 1), (0, 9), (9, 0), (33, 2), (0, 0), (48, 31)] {
        let mut view = camera(32, 32, eye, 0.8);
        (view.intrinsics.width, view.intrinsics.height) = (width, height);
        let image = gpu.image(&splats, &view, &options);
        assert_eq!((image.width, image.height), (width as usize, height as usize));
        assert_agrees(&format!("{width}x{height}"), &image, (&splats).into(), &view, &options);
    }
    gpu.assert_no_faults();
}

#[test]
fn an_image_without_splats_is_empty() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(40, 20, DVec3::new(4.0, -3.0, 1.0), 0.8);
    let options = options(RenderMethod::PROJECTED);
    let splats = cloud(9, 30, 0.3, 0.5, [0.5, 0.9]);
    let full = gpu.image(&splats, &view, &options);
    assert!(full.data.iter().any(|p| p[3] > 0.5));
    // An empty scene leaves nothing of the image before.
    let none = gpu.image(&[], &view, &options);
    assert!(none.data.iter().flatten().all(|&v| v == 0.0));
    let behind: Vec<Splat> = splats
        .iter()
        .map(|s| Splat { mean: s.mean.map(|v| 10.0 * v.abs() + 50.0), ..*s })
        .collect();
    let mut away = view;
    away.pose = camera(1, 1, DVec3::new(-3.0, -3.0, -1.0), 0.8).pose;
    let around = gpu.image(&behind, &away, &options);
    assert_agrees("far away", &around, (&behind).into(), &away, &options);
    gpu.assert_no_faults();
}

#[test]
fn ties_keep_their_order() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(48, 48, DVec3::new(0.1, -4.0, 0.0), 0.8);
    let options = options(RenderMethod::PROJECTED);
    // A thousand splats at one position: the first in the list is in front.
    let template = cloud(10, 1, 0.3, 1.0, [0.6, 0.7])[0];
    let splats: Vec<Splat> = (0..1000)
        .map(|i| Splat {
            mean: [0.1, 0.2, 0.0],
            color: [(i % 7) as f32 / 7.0, (i % 11) as f32 / 11.0, f32::from(u8::from(i == 0))],
            ..template
        })
        .collect();
    let image = gpu.image(&splats, &view, &options);
    assert_agrees("ties", &image, (&splats).into(), &view, &options);
    let again = gpu.image(&splats, &view, &options);
    assert_eq!(largest_difference(&image, &again), 0.0);
    gpu.assert_no_faults();
}
