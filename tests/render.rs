//! The CPU renderer against golden pixels and its f64 oracle, and the image metrics.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod common;

use glam::{DMat4, DQuat, DVec3};
use proptest::prelude::*;
use serde_json::Value;
use vbgs_studio::eval::metrics::{
    MetricError, SsimPadding, depth_error, mean_std, psnr, psnr_masked, ssim,
};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::image::{Image, RgbImage};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splats::Splat;
use vbgs_studio::render::cpu::oracle::{Oracle, Sample, SplatF64};
use vbgs_studio::render::cpu::{CpuRenderer, Rendered};
use vbgs_studio::render::{ALPHA_CUT, Method, RenderOptions, Support, TRANSMITTANCE_STOP};

// ---------------------------------------------------------------------------------------------
// Golden pixels

/// Tolerances of `rendering.md` (g).
const F64_TOLERANCE: f64 = 1e-9;
const F32_TOLERANCE: f64 = 2e-5;
/// A pixel lies on a threshold if it is this close to it, relatively.
const THRESHOLD_BAND: f64 = 1e-4;
/// Depth in f32: the quotient by a coverage of 1/255 keeps five digits.
const F32_DEPTH_TOLERANCE: f64 = 1e-4;

const VARIANTS: [(&str, Support); 2] =
    [("projected", Support::Alpha), ("projected_tile3s", Support::Tile3Sigma)];

#[test]
fn golden_pixels() {
    let Some(golden) = golden_json("render_cases.json") else { return };
    let (mut n_pixels, mut n_values, mut on_threshold) = (0, 0, Vec::new());
    for case in golden["cases"].as_array().unwrap() {
        let name = case["name"].as_str().unwrap();
        for (variant, support) in VARIANTS {
            let expected = &case["expected"][variant];
            if expected.is_null() {
                assert_eq!(case["camera"]["model"], "fisheye_equidistant", "{name}");
                continue;
            }
            let scene = GoldenScene::read(case, support);
            let oracle = Oracle::new(&scene.splats, &scene.camera, &scene.options);
            let fast =
                CpuRenderer::new().render(&scene.splats_f32(), &scene.camera, &scene.options);
            for (pixel, expected) in array(&case["pixels"]).iter().zip(array(expected)) {
                let [i, j] = numbers::<2>(pixel).map(|v| v as usize);
                let expected = Sample {
                    rgba: numbers(&expected["rgba"]),
                    depth: expected["depth"].as_f64().unwrap(),
                    n_blended: expected["n"].as_u64().unwrap() as usize,
                };
                let label = format!("{name} {variant} ({i}, {j})");
                assert_close(&oracle.pixel(i, j), &expected, F64_TOLERANCE, &label);
                if !matches(&sample_of(&fast, i, j), &expected) {
                    let either = branches(&oracle, i, j);
                    assert!(
                        either.iter().any(|branch| matches(&sample_of(&fast, i, j), branch)),
                        "{label}: found {:?}, expected {expected:?} or one of {either:?}",
                        sample_of(&fast, i, j)
                    );
                    on_threshold.push(name);
                }
                n_pixels += 1;
                n_values += 6 + 5;
            }
        }
    }
    assert!(on_threshold.iter().all(|n| ["opacity_one_cap", "cutoff_boundary"].contains(n)));
    println!(
        "golden: {n_pixels} pixels, {n_values} values compared, other branch: {on_threshold:?}"
    );
    assert_eq!(n_pixels, 2 * (105 - 7), "every pinhole pixel, both supports");
}

struct GoldenScene {
    splats: Vec<SplatF64>,
    camera: Camera,
    options: RenderOptions,
}

impl GoldenScene {
    fn read(case: &Value, support: Support) -> Self {
        let camera = &case["camera"];
        let number = |key: &str| camera[key].as_f64().unwrap();
        let rows: Vec<[f64; 4]> = array(&camera["c2w_opengl"]).iter().map(numbers).collect();
        let pose = DMat4::from_cols_array_2d(&rows.try_into().unwrap()).transpose();
        let intrinsics = Intrinsics {
            width: number("W") as u32,
            height: number("H") as u32,
            fx: number("fx"),
            fy: number("fy"),
            cx: number("cx"),
            cy: number("cy"),
        };
        let background = numbers(&case["background"]).map(|v| v as f32);
        Self {
            splats: array(&case["splats"]).iter().map(golden_splat).collect(),
            camera: Camera { intrinsics, pose: Pose::from_opengl(pose).unwrap() },
            options: RenderOptions::evaluation(Method::Projected(support), background),
        }
    }

    fn splats_f32(&self) -> Vec<Splat> {
        let narrow = |v: DVec3| v.as_vec3().to_array();
        let splat = |s: &SplatF64| Splat {
            mean: narrow(s.mean),
            opacity: s.opacity as f32,
            color: narrow(s.color),
            scale: narrow(s.scale),
            rotation: [s.rotation.w, s.rotation.x, s.rotation.y, s.rotation.z].map(|v| v as f32),
        };
        self.splats.iter().map(splat).collect()
    }
}

fn golden_splat(splat: &Value) -> SplatF64 {
    let [w, x, y, z] = numbers(&splat["quat_wxyz"]);
    SplatF64 {
        mean: DVec3::from_array(numbers(&splat["mean"])),
        opacity: splat["opacity"].as_f64().unwrap(),
        color: DVec3::from_array(numbers(&splat["rgb"])),
        scale: DVec3::from_array(numbers(&splat["scale"])),
        rotation: DQuat::from_xyzw(x, y, z, w),
    }
}

fn assert_close(found: &Sample, expected: &Sample, tolerance: f64, label: &str) {
    let worst = largest_error(found, expected).max((found.depth - expected.depth).abs());
    // The golden file blends over its background in f64, options hold it in f32.
    assert!(worst <= tolerance + background_rounding(expected), "{label}: {worst:e}");
    assert_eq!(found.n_blended, expected.n_blended, "{label}");
}

/// Options hold the background in f32; 0.1 rounds by 1.5e-9, weighted by the transmittance.
fn background_rounding(expected: &Sample) -> f64 {
    (1.0 - expected.rgba[3]) * f64::from(f32::EPSILON) * 0.5
}

/// Of the four channels.
fn largest_error(found: &Sample, expected: &Sample) -> f64 {
    let pairs = found.rgba.iter().zip(&expected.rgba);
    pairs.fold(0.0, |worst, (f, e)| worst.max((f - e).abs()))
}

fn sample_of(image: &Rendered, i: usize, j: usize) -> Sample {
    let [r, g, b] = image.color.at(i, j).map(f64::from);
    let (a, depth) = (f64::from(*image.coverage.at(i, j)), f64::from(*image.depth.at(i, j)));
    Sample { rgba: [r, g, b, a], depth, n_blended: 0 }
}

fn matches(found: &Sample, expected: &Sample) -> bool {
    let channels =
        found.rgba.iter().zip(&expected.rgba).all(|(f, e)| (f - e).abs() <= F32_TOLERANCE);
    channels && (found.depth - expected.depth).abs() <= F32_DEPTH_TOLERANCE * expected.depth
}

/// What a pixel may look like if rounding moved a value across a threshold it lies on.
fn branches(oracle: &Oracle, i: usize, j: usize) -> Vec<Sample> {
    let moved = [1.0 - THRESHOLD_BAND, 1.0 + THRESHOLD_BAND];
    let pairs = moved.into_iter().flat_map(|cut| moved.map(|stop| (cut, stop)));
    pairs
        .map(|(cut, stop)| {
            oracle.with_thresholds(ALPHA_CUT * cut, TRANSMITTANCE_STOP * stop).pixel(i, j)
        })
        .collect()
}

// ---------------------------------------------------------------------------------------------
// Whole images

/// A random scene around the origin.
#[derive(Clone, Copy, Debug)]
struct Scene {
    name: &'static str,
    n_splats: usize,
    scale: (f64, f64),
    opacity: (f64, f64),
    radius: f64,
}

const SCENES: [Scene; 6] = [
    Scene {
        name: "small",
        n_splats: 1500,
        scale: (0.01, 0.05),
        opacity: (0.95, 0.95),
        radius: 1.0,
    },
    Scene {
        name: "translucent",
        n_splats: 400,
        scale: (0.05, 0.3),
        opacity: (0.01, 0.6),
        radius: 1.0,
    },
    Scene { name: "needles", n_splats: 600, scale: (1e-4, 0.5), opacity: (0.2, 0.95), radius: 1.0 },
    Scene {
        name: "around the camera",
        n_splats: 800,
        scale: (0.02, 0.2),
        opacity: (0.3, 0.9),
        radius: 4.0,
    },
    Scene { name: "over one", n_splats: 500, scale: (0.02, 0.1), opacity: (0.9, 3.0), radius: 1.0 },
    // Rows of tiles with more splats than one batch of the rasteriser.
    Scene {
        name: "crowd",
        n_splats: 7000,
        scale: (0.1, 0.4),
        opacity: (0.004, 0.006),
        radius: 0.5,
    },
];

impl Scene {
    fn splats(&self, seed: u64) -> Vec<Splat> {
        let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
        let (lo, hi) = (self.scale.0.ln(), self.scale.1.ln());
        (0..self.n_splats)
            .map(|_| Splat {
                mean: [0; 3].map(|_| rng.range(-self.radius, self.radius) as f32),
                opacity: rng.range(self.opacity.0, self.opacity.1) as f32,
                color: [0; 3].map(|_| rng.uniform() as f32),
                scale: [0; 3].map(|_| rng.range(lo, hi).exp() as f32),
                rotation: [0; 4].map(|_| rng.normal() as f32),
            })
            .collect()
    }
}

/// Neither side is a multiple of a tile, and the principal point is off centre.
fn camera() -> Camera {
    let mut intrinsics = Intrinsics::from_horizontal_fov(107, 77, 0.8);
    intrinsics.cx += 5.3;
    intrinsics.fy *= 1.1;
    let eye = DVec3::new(2.0, -2.5, 1.0);
    Camera { intrinsics, pose: Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap() }
}

fn options() -> RenderOptions {
    RenderOptions::evaluation(Method::PROJECTED, [0.1, 0.5, 0.9])
}

fn render(splats: &[Splat]) -> Rendered {
    CpuRenderer::new().render(splats, &camera(), &options())
}

#[test]
fn whole_images_agree_with_the_oracle() {
    for (seed, scene) in SCENES.iter().enumerate() {
        for support in [Support::Alpha, Support::Tile3Sigma] {
            let options = RenderOptions { method: Method::Projected(support), ..options() };
            let splats = scene.splats(seed as u64);
            let wide: Vec<SplatF64> = splats.iter().map(SplatF64::from).collect();
            let oracle = Oracle::new(&wide, &camera(), &options);
            let truth = oracle.render();
            let fast = CpuRenderer::new().render(&splats, &camera(), &options);
            let (mut n_loose, mut n_branched, mut sum) = (0, 0, 0.0);
            let (mut worst, mut worst_depth) = (0f64, 0f64);
            for (index, expected) in truth.data.iter().enumerate() {
                let (i, j) = (index % truth.width, index / truth.width);
                let found = sample_of(&fast, i, j);
                let error = largest_error(&found, expected);
                if error > 1e-4 {
                    let branches = branches(&oracle, i, j);
                    let explained = branches.iter().any(|b| largest_error(&found, b) <= 1e-4);
                    assert!(error <= 1e-2, "{} {support:?} ({i}, {j}): {error}", scene.name);
                    n_branched += usize::from(explained);
                    n_loose += usize::from(!explained);
                    continue;
                }
                sum += error;
                worst = worst.max(error);
                worst_depth = worst_depth.max((found.depth - expected.depth).abs());
            }
            let n_pixels = truth.data.len();
            let mean = sum / n_pixels as f64;
            println!(
                "{} {support:?}: mean {mean:.1e}, worst {worst:.1e}, depth {worst_depth:.1e}, on a threshold {n_branched}, else over 1e-4 {n_loose} of {n_pixels}",
                scene.name
            );
            assert!(n_loose * 1000 <= n_pixels, "{} {support:?}: {n_loose}", scene.name);
            assert!(n_branched * 100 <= n_pixels, "{} {support:?}: {n_branched}", scene.name);
            assert!(mean < 1e-5, "{} {support:?}: {mean:e}", scene.name);
            assert!(worst_depth < 1e-3, "{} {support:?}: {worst_depth:e}", scene.name);
            let covered = truth.data.iter().filter(|s| s.rgba[3] > 0.5).count();
            assert!(covered * 20 > n_pixels, "{}: the scene is in the picture", scene.name);
        }
    }
}

#[test]
fn thread_count_and_history_do_not_show() {
    let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
    let mut reused = CpuRenderer::new();
    for scene in SCENES {
        let splats = scene.splats(11);
        let one = pool(1).install(|| render(&splats));
        let two = pool(2).install(|| render(&splats));
        let again = pool(3).install(|| reused.render(&splats, &camera(), &options()));
        for other in [&two, &again] {
            assert_eq!(bits(&one), bits(other), "{}", scene.name);
        }
    }
}

#[test]
fn order_of_splats_with_distinct_depths_does_not_show() {
    // More than one chunk of the preparation.
    let scene = Scene { n_splats: 9000, radius: 0.5, ..SCENES[1] };
    let (rotation, translation) = camera().pose.inverse();
    let depth =
        |s: &Splat| (rotation * DVec3::from_array(s.mean.map(f64::from)) + translation).z as f32;
    let mut splats = scene.splats(5);
    splats.sort_by(|a, b| depth(a).total_cmp(&depth(b)));
    splats.dedup_by(|a, b| depth(a) == depth(b));
    assert!(splats.len() > 8500);
    let sorted = render(&splats);
    let mut rng = Rng::new(3, Purpose::Order, 0);
    for _ in 0..3 {
        rng.shuffle(&mut splats);
        assert_eq!(bits(&sorted), bits(&render(&splats)));
    }
}

#[test]
fn equal_depths_keep_the_order_of_the_input() {
    let facing = |color| Splat {
        mean: [0.0, 0.0, 3.0],
        opacity: 0.9,
        color,
        scale: [0.2; 3],
        rotation: [1.0, 0.0, 0.0, 0.0],
    };
    let camera = Camera { intrinsics: camera().intrinsics, pose: Pose::IDENTITY };
    let (red, blue) = (facing([1.0, 0.0, 0.0]), facing([0.0, 0.0, 1.0]));
    for (splats, front) in [([red, blue], 0), ([blue, red], 2)] {
        let image = CpuRenderer::new().render(
            &splats,
            &camera,
            &RenderOptions::evaluation(Method::PROJECTED, [0.0; 3]),
        );
        let (i, j) = (camera.intrinsics.cx as usize, camera.intrinsics.cy as usize);
        let pixel = image.color.at(i, j);
        assert!(pixel[front] > 0.8 && pixel[2 - front] < 0.2, "{pixel:?}");
    }
}

#[test]
fn a_scene_far_from_the_origin_looks_the_same() {
    // All coordinates are multiples of 2⁻⁸, so moving by 4096 is exact in f32.
    let dyadic = |v: f32| (v * 256.0).round() / 256.0;
    let splats: Vec<Splat> =
        SCENES[0].splats(2).into_iter().map(|s| Splat { mean: s.mean.map(dyadic), ..s }).collect();
    let far: Vec<Splat> =
        splats.iter().map(|s| Splat { mean: s.mean.map(|v| v + 4096.0), ..*s }).collect();
    let mut far_camera = camera();
    let eye = camera().pose.centre() + 4096.0;
    far_camera.pose = Pose::look_at(eye, DVec3::splat(4096.0), DVec3::Z).unwrap();
    let moved = CpuRenderer::new().render(&far, &far_camera, &options());
    assert_eq!(bits(&render(&splats)), bits(&moved));
}

fn bits(image: &Rendered) -> Vec<u32> {
    let planes = image.coverage.data.iter().chain(&image.depth.data);
    image.color.data.as_flattened().iter().chain(planes).map(|v| v.to_bits()).collect()
}

// ---------------------------------------------------------------------------------------------
// Hostile input

#[test]
fn nothing_to_draw_is_background() {
    let behind = Splat { mean: [9.0, -9.0, 2.0], ..solid(0.9) };
    for splats in [&[][..], &[Splat::default(); 3000], &[solid(0.003)], &[behind]] {
        let image = render(splats);
        assert!(image.color.data.iter().all(|c| *c == options().background));
        assert!(image.coverage.data.iter().chain(&image.depth.data).all(|v| *v == 0.0));
        assert_eq!(image.n_invalid, 0);
    }
    for (width, height) in [(0, 0), (0, 5), (5, 0)] {
        let mut camera = camera();
        (camera.intrinsics.width, camera.intrinsics.height) = (width, height);
        let image = CpuRenderer::new().render(&[solid(0.9)], &camera, &options());
        assert_eq!((image.color.width, image.color.height), (width as usize, height as usize));
        assert!(image.color.data.is_empty() && image.depth.data.is_empty());
    }
}

#[test]
fn extreme_splats_draw_what_the_formulas_say() {
    // A splat much larger than the scene is a veil of its opacity; one of scale 0 is a point that
    // the low-pass turns into a blot of 0.3 px².
    let centre = |image: &Rendered| *image.coverage.at(58, 38);
    for scale in [1e4, 1e8, 1e15, 1e30, f32::MAX] {
        let veil = render(&[Splat { scale: [scale; 3], ..solid(0.6) }]);
        assert!(veil.coverage.data.iter().all(|a| (a - 0.6).abs() < 1e-3), "{scale:e}");
    }
    for scale in [[0.0; 3], [-1.0; 3], [1e-30; 3]] {
        let point = render(&[Splat { scale, ..solid(0.9) }]);
        assert!(centre(&point) > 0.3, "{scale:?}: {}", centre(&point));
        assert!(point.coverage.data.iter().filter(|a| **a > 0.0).count() < 16);
    }
    for opacity in [1e3, 1e30, f32::MAX] {
        let disc = render(&[solid(opacity)]);
        assert!((centre(&disc) - 0.99).abs() < 1e-6);
        assert!(disc.coverage.data.iter().all(|a| (0.0..=0.9901).contains(a)), "{opacity:e}");
    }
    let inside = Splat { mean: [1.9, -2.3, 0.9], scale: [2.0; 3], ..solid(0.6) };
    assert!(render(&[inside]).coverage.data.iter().all(|a| (0.3..=0.6001).contains(a)));
    let bright = Splat { color: [9.0, -9.0, 0.5], scale: [50.0; 3], ..solid(0.9) };
    let [r, g, b] = *render(&[bright]).color.at(58, 38);
    assert_eq!(r, 1.0);
    assert!((g - 0.05).abs() < 1e-4 && (b - 0.54).abs() < 1e-4, "{g} {b}");
}

/// A splat at the origin.
fn solid(opacity: f32) -> Splat {
    Splat {
        opacity,
        color: [1.0; 3],
        scale: [0.1; 3],
        rotation: [1.0, 0.0, 0.0, 0.0],
        ..Splat::default()
    }
}

/// Any number, and often a bad one.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => -3.0f32..3.0,
        1 => any::<f32>(),
        1 => proptest::sample::select(vec![
            0.0, -0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN_POSITIVE,
            1e30, -1e30, 1e-40,
        ]),
    ]
}

fn hostile_splat() -> impl Strategy<Value = Splat> {
    let unit = proptest::array::uniform3(0f32..1.0);
    let vector = || proptest::array::uniform3(number());
    let turn = prop_oneof![
        2 => proptest::array::uniform4(-1f32..1.0),
        1 => proptest::array::uniform4(number()),
        1 => Just([0.0; 4]),
    ];
    let color = prop_oneof![3 => unit, 1 => vector()];
    let opacity = prop_oneof![3 => 0f32..1.0, 1 => number()];
    (vector(), opacity, color, vector(), turn).prop_map(
        |(mean, opacity, color, scale, rotation)| Splat { mean, opacity, color, scale, rotation },
    )
}

fn is_broken(splat: &Splat) -> bool {
    let fields = [&splat.mean[..], &splat.color, &splat.scale, &splat.rotation, &[splat.opacity]];
    let empty = splat.opacity <= 0.0;
    !empty && (fields.concat().iter().any(|v| !v.is_finite()) || splat.rotation == [0.0; 4])
}

proptest! {
    #[test]
    fn hostile_splats_neither_break_the_image_nor_touch_the_others(
        hostile in proptest::collection::vec(hostile_splat(), 0..40),
        near in prop_oneof![Just(0.2), Just(0.0), Just(-1.0), Just(1e-30)],
        support in prop_oneof![Just(Support::Alpha), Just(Support::Tile3Sigma)],
        inside in any::<bool>(),
    ) {
        let mut camera = camera();
        if inside {
            camera.pose = Pose::look_at(DVec3::new(0.1, 0.2, 0.0), DVec3::X, DVec3::Z).unwrap();
        }
        let options = RenderOptions { near, method: Method::Projected(support), ..options() };
        let image = CpuRenderer::new().render(&hostile, &camera, &options);
        prop_assert!(image.color.data.as_flattened().iter().all(|v| (0.0..=1.0).contains(v)));
        prop_assert!(image.coverage.data.iter().all(|v| (0.0..=0.9999).contains(v)));
        prop_assert!(image.depth.data.iter().all(|v| v.is_finite() && *v >= 0.0));
        prop_assert_eq!(image.n_invalid, hostile.iter().filter(|s| is_broken(s)).count());

        let sound: Vec<Splat> = hostile.iter().filter(|s| !is_broken(s) && s.opacity > 0.0).copied().collect();
        let without = CpuRenderer::new().render(&sound, &camera, &options);
        prop_assert_eq!(bits(&image), bits(&without));
    }

    #[test]
    fn hostile_cameras_end(values in proptest::array::uniform4(number()), size in 1u32..70) {
        let [fx, fy, cx, cy] = values.map(f64::from);
        let intrinsics = Intrinsics { width: size, height: 33, fx, fy, cx, cy };
        let camera = Camera { intrinsics, pose: camera().pose };
        let image = CpuRenderer::new().render(&SCENES[1].splats(1)[..50], &camera, &options());
        prop_assert!(image.color.data.as_flattened().iter().all(|v| (0.0..=1.0).contains(v)));
    }
}

// ---------------------------------------------------------------------------------------------
// Metrics

#[test]
fn golden_metrics() {
    let Some(golden) = golden_json("render_cases.json") else { return };
    let value = |key: &str| golden["metrics"][key].as_f64().unwrap();
    let (truth, prediction) = formula_images();
    let found = [
        ("psnr", psnr(&prediction, &truth)),
        ("ssim_valid", ssim(&prediction, &truth, SsimPadding::Valid)),
        ("ssim_zero_pad", ssim(&prediction, &truth, SsimPadding::Zero)),
    ];
    for (key, found) in found {
        let (found, expected) = (found.unwrap(), value(key));
        assert!((found - expected).abs() < 1e-9, "{key}: {found} for {expected}");
    }
    let narrow = |image: &Image<[f64; 3]>| -> RgbImage { image.map(|p| p.map(|v| v as f32)) };
    let (truth, prediction) = (narrow(&truth), narrow(&prediction));
    assert!((psnr(&prediction, &truth).unwrap() - value("psnr")).abs() < 1e-5);
    let similarity = ssim(&prediction, &truth, SsimPadding::Valid).unwrap();
    assert!((similarity - value("ssim_valid")).abs() < 1e-6);
}

/// The two images of the golden file's `image_formula`.
fn formula_images() -> (Image<[f64; 3]>, Image<[f64; 3]>) {
    let (width, height) = (32, 24);
    let pixel = |i: usize| ((i % width) as f64, (i / width) as f64);
    let a = (0..width * height).map(|i| {
        let (x, y) = pixel(i);
        let red = 0.5 + 0.4 * (0.3 * x + 0.2 * y).sin();
        [red, 0.5 + 0.4 * (0.25 * x - 0.1 * y).cos(), (x + y) / 56.0]
    });
    let a = Image::from_vec(width, height, a.collect());
    let b = (0..width * height).map(|i| {
        let (x, y) = pixel(i);
        let noise = 0.05 * (1.7 * x).sin() * (1.3 * y).cos();
        a.data[i].map(|v: f64| (v + noise).clamp(0.0, 1.0))
    });
    let b = Image::from_vec(width, height, b.collect());
    (a, b)
}

#[test]
fn golden_psnr_of_the_reference() {
    let Some(folder) = common::shared("golden/splat") else { return };
    let bytes = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let image = |name: &str| -> RgbImage {
        let bytes = bytes(name);
        let values: Vec<f32> = chunks::<4>(&bytes).map(f32::from_le_bytes).collect();
        Image::from_vec(16, 16, chunks3(&values))
    };
    let expected = f64::from_le_bytes(chunks::<8>(&bytes("psnr.f64.bin")).next().unwrap());
    let found = psnr(&image("psnr_pred.f32.bin"), &image("psnr_gt.f32.bin")).unwrap();
    assert!((found - expected).abs() < 1e-5, "{found} for {expected}");
}

fn chunks<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [u8; N]> {
    bytes.chunks_exact(N).map(|chunk| chunk.try_into().unwrap())
}

fn chunks3(values: &[f32]) -> Vec<[f32; 3]> {
    values.chunks_exact(3).map(|chunk| chunk.try_into().unwrap()).collect()
}

#[test]
fn psnr_edges() {
    let grey = Image::filled(6, 5, [0.5f32; 3]);
    assert_eq!(psnr(&grey, &grey).unwrap(), 120.0);
    let glare = Image::filled(6, 5, [7.0f32; 3]);
    assert!((psnr(&glare, &grey).unwrap() - 6.0206).abs() < 1e-4, "the prediction is clamped");
    let mut broken = grey.clone();
    broken.data[3][1] = f32::NAN;
    assert!(psnr(&broken, &grey).unwrap().is_nan(), "NaN is no perfect score");

    let mut half_wrong = grey.clone();
    half_wrong.data[..6].fill([0.0; 3]);
    let mut mask = Image::filled(6, 5, true);
    mask.data[..6].fill(false);
    assert_eq!(psnr_masked(&half_wrong, &grey, &mask).unwrap(), 120.0);
    let inverse = mask.map(|kept| !kept);
    assert!((psnr_masked(&half_wrong, &grey, &inverse).unwrap() - 6.0206).abs() < 1e-4);
    let nothing = Image::filled(6, 5, false);
    assert_eq!(psnr_masked(&grey, &grey, &nothing), Err(MetricError::NoPixels));
    assert_eq!(
        psnr(&Image::filled(0, 0, [0f32; 3]), &Image::filled(0, 0, [0f32; 3])),
        Err(MetricError::NoPixels)
    );
}

#[test]
fn sizes_that_differ_are_named() {
    let (small, large) = (Image::filled(12, 11, [0f32; 3]), Image::filled(12, 13, [0f32; 3]));
    let plane = |height| Image::filled(12, height, 1f32);
    let mask = Image::filled(12, 13, true);
    let errors = [
        psnr(&small, &large).unwrap_err(),
        psnr_masked(&small, &small, &mask).unwrap_err(),
        ssim(&small, &large, SsimPadding::Zero).unwrap_err(),
        depth_error(&plane(11), &plane(11), &plane(13)).unwrap_err(),
        depth_error(&plane(11), &plane(13), &plane(11)).unwrap_err(),
    ];
    for (error, what) in errors.iter().zip([
        "ground truth",
        "mask",
        "ground truth",
        "ground truth depth",
        "coverage",
    ]) {
        let message = error.to_string();
        assert!(message.starts_with(&format!("{what}: expected 12x11")), "{message}");
        assert!(message.contains("found 12x13"), "{message}");
    }
}

#[test]
fn ssim_edges() {
    let (a, b) = formula_images();
    for padding in [SsimPadding::Valid, SsimPadding::Zero] {
        assert!((ssim(&a, &a, padding).unwrap() - 1.0).abs() < 1e-14);
        let forth = ssim(&a, &b, padding).unwrap();
        assert!((forth - ssim(&b, &a, padding).unwrap()).abs() < 1e-14, "symmetric");
    }
    let tiny = Image::filled(10, 40, [0.3f32; 3]);
    assert_eq!(
        ssim(&tiny, &tiny, SsimPadding::Valid),
        Err(MetricError::TooSmall { width: 10, height: 40 })
    );
    for (width, height) in [(1, 1), (3, 2), (10, 40)] {
        let tiny = Image::filled(width, height, [0.3f32; 3]);
        assert!((ssim(&tiny, &tiny, SsimPadding::Zero).unwrap() - 1.0).abs() < 1e-14);
    }
    let none = Image::filled(0, 4, [0f32; 3]);
    assert_eq!(ssim(&none, &none, SsimPadding::Zero), Err(MetricError::NoPixels));
}

#[test]
fn depth_errors_by_hand() {
    // Valid truth: 1, 2, 4, 5; covered: all but the last. Errors 0.1, 0, 2 (ratio 1.5).
    let truth = Image::from_vec(3, 2, vec![1.0, 2.0, 4.0, 5.0, 0.0, f32::NAN]);
    let found = Image::from_vec(3, 2, vec![1.1, 2.0, 6.0, 5.0, 3.0, 3.0]);
    let coverage = Image::from_vec(3, 2, vec![0.5, 1.0, 0.9, 0.49, 1.0, 1.0]);
    let error = depth_error(&found, &coverage, &truth).unwrap();
    let expected = [2.1 / 3.0, (4.01f64 / 3.0).sqrt(), (0.1 + 0.5) / 3.0, 2.0 / 3.0, 0.75];
    let values = [error.mae, error.rmse, error.abs_rel, error.delta_125, error.completeness];
    for (value, expected) in values.iter().zip(expected) {
        assert!((value - expected).abs() < 1e-7, "{values:?}");
    }
    let uncovered = depth_error(&found, &Image::filled(3, 2, 0.0), &truth).unwrap();
    assert!(uncovered.completeness == 0.0 && uncovered.mae.is_nan());
    let no_truth = Image::filled(3, 2, -1.0);
    assert_eq!(depth_error(&found, &coverage, &no_truth), Err(MetricError::NoPixels));
}

#[test]
fn spread_is_that_of_the_population() {
    let (mean, std) = mean_std(&[2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]);
    assert_eq!((mean, std), (5.0, 2.0));
    assert!(mean_std(&[]).0.is_nan());
}

// ---------------------------------------------------------------------------------------------
// Golden files

fn golden_json(name: &str) -> Option<Value> {
    let path = common::shared(&format!("golden/{name}"))?;
    Some(serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap())
}

fn array(value: &Value) -> &Vec<Value> {
    value.as_array().unwrap()
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let values: Vec<f64> = array(value).iter().map(|v| v.as_f64().unwrap()).collect();
    values.try_into().unwrap()
}
