//! The GPU renderer on a real Vulkan driver (software ones count) against f64 references.
#![cfg(feature = "gui")]
#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod common;

use common::adapter::{Turn, now, turn, vulkan};
use glam::{DMat3, DMat4, DVec2, DVec3};
use std::path::Path;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::image::Image;
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splats::Splat;
use vbgs_studio::render::gpu::GpuError;
use vbgs_studio::render::gpu::composite::Compositor;
use vbgs_studio::render::gpu::context::{GpuCaps, device_descriptor};
use vbgs_studio::render::gpu::faults::GpuFaults;
use vbgs_studio::render::gpu::projected::{ProjectedRenderer, RenderSettings};
use vbgs_studio::render::gpu::readback;
use vbgs_studio::render::gpu::scene::GpuScene;
use vbgs_studio::render::gpu::sort::{SortScratch, back_to_front};
use vbgs_studio::render::gpu::target::SplatTarget;

/// Of `rendering.md` (g): half-float accumulation.
const GPU_TOLERANCE: f64 = 4e-3;
const ALPHA_CUT: f64 = 1.0 / 255.0;
const NEAR: f32 = 0.2;
const EVERYTHING: RenderSettings = RenderSettings { near: NEAR, extent_cap: f32::INFINITY };

struct Gpu {
    adapter: wgpu::Adapter,
    device: wgpu::Device,
    queue: wgpu::Queue,
    faults: GpuFaults,
    _turn: Turn,
}

impl Gpu {
    /// `None` (with a note) where there is no Vulkan and none is demanded.
    fn new() -> Option<Self> {
        let turn = turn();
        let adapter = vulkan()?;
        let (device, queue) = now(adapter.request_device(&device_descriptor(&adapter))).unwrap();
        let faults = GpuFaults::default();
        faults.watch(&device);
        let caps = GpuCaps::new(&adapter, &device);
        println!("adapter: {caps}");
        caps.check().unwrap();
        Some(Self { adapter, device, queue, faults, _turn: turn })
    }

    fn scene(&self, splats: &[Splat]) -> GpuScene {
        GpuScene::new(&self.device, &self.queue, splats).unwrap()
    }

    fn renderer(&self) -> ProjectedRenderer {
        ProjectedRenderer::new(&self.device, &self.queue).unwrap()
    }

    /// Sorts, uploads the order and draws once.
    fn draw(
        &self,
        renderer: &mut ProjectedRenderer,
        scene: &mut GpuScene,
        splats: &[Splat],
        camera: &Camera,
        settings: RenderSettings,
    ) {
        let mut scratch = SortScratch::default();
        let order = back_to_front(splats, camera, settings.near, &mut scratch);
        scene.set_order(&self.queue, order).unwrap();
        let mut encoder = self.device.create_command_encoder(&Default::default());
        renderer.render(&self.device, &self.queue, &mut encoder, scene, camera, settings).unwrap();
        self.queue.submit([encoder.finish()]);
    }

    /// Premultiplied colour and coverage of `splats`, through a scene that already holds them.
    fn image_of(&self, scene: &mut GpuScene, splats: &[Splat], camera: &Camera) -> Image<[f32; 4]> {
        let mut renderer = self.renderer();
        self.draw(&mut renderer, scene, splats, camera, EVERYTHING);
        readback::premultiplied(&self.device, &self.queue, renderer.target()).unwrap()
    }

    fn image(&self, splats: &[Splat], camera: &Camera) -> Image<[f32; 4]> {
        self.image_of(&mut self.scene(splats), splats, camera)
    }

    fn assert_no_faults(&self) {
        assert_eq!(self.faults.take(), []);
    }
}

/// `rendering.md` (b) per splat in f64: centre, conic (xx, xy, yy) and depth.
fn project(splat: &Splat, camera: &Camera) -> Option<(DVec2, [f64; 3], f64)> {
    let k = &camera.intrinsics;
    let (rotation, translation) = camera.pose.inverse();
    let m = rotation * DVec3::from_array(splat.mean.map(f64::from)) + translation;
    if m.z <= f64::from(NEAR) {
        return None;
    }
    let limit = |t: f64, size: u32, f: f64, c: f64| {
        let margin = 0.3 * f64::from(size) / (2.0 * f);
        t.clamp(-c / f - margin, (f64::from(size) - c) / f + margin)
    };
    let a = limit(m.x / m.z, k.width, k.fx, k.cx);
    let b = limit(m.y / m.z, k.height, k.fy, k.cy);
    let sigma = rotation * splat.covariance().to_mat3() * rotation.transpose();
    let u = DVec3::new(k.fx / m.z, 0.0, -k.fx * a / m.z);
    let v = DVec3::new(0.0, k.fy / m.z, -k.fy * b / m.z);
    let (xx, xy, yy) = (u.dot(sigma * u) + 0.3, u.dot(sigma * v), v.dot(sigma * v) + 0.3);
    let det = xx * yy - xy * xy;
    let centre = DVec2::new(k.fx * m.x / m.z + k.cx, k.fy * m.y / m.z + k.cy);
    (det > 0.0).then_some((centre, [yy / det, -xy / det, xx / det], m.z))
}

/// Premultiplied colour and coverage at the centre of a pixel, and whether some alpha is within
/// 1e-4 (relative) of the cut, where f32 may take either branch.
fn reference(splats: &[Splat], camera: &Camera, pixel: [usize; 2]) -> ([f64; 4], bool) {
    let mut drawn: Vec<_> = splats
        .iter()
        .filter(|s| s.is_drawable())
        .filter_map(|s| project(s, camera).map(|p| (s, p)))
        .collect();
    drawn.sort_by(|a, b| a.1.2.total_cmp(&b.1.2));
    let (mut sum, mut transmittance, mut hinges) = ([0.0; 4], 1.0, false);
    for (splat, (centre, [xx, xy, yy], _)) in drawn {
        let d = DVec2::new(pixel[0] as f64 + 0.5, pixel[1] as f64 + 0.5) - centre;
        let power = xx * d.x * d.x + 2.0 * xy * d.x * d.y + yy * d.y * d.y;
        let alpha = (f64::from(splat.opacity) * (-0.5 * power).exp()).min(0.99);
        hinges |= (alpha / ALPHA_CUT - 1.0).abs() < 1e-4;
        if alpha < ALPHA_CUT {
            continue;
        }
        for (channel, out) in sum.iter_mut().enumerate() {
            let value = splat.color.get(channel).map_or(1.0, |&c| f64::from(c).max(0.0));
            *out += value * alpha * transmittance;
        }
        transmittance *= 1.0 - alpha;
    }
    (sum, hinges)
}

fn random_scene(seed: u64, n: usize, largest: f64) -> Vec<Splat> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
    (0..n)
        .map(|_| {
            let mut at = |lo: f64, hi: f64| rng.range(lo, hi) as f32;
            Splat {
                mean: [at(-1.5, 1.5), at(-1.5, 1.5), at(-1.5, 1.5)],
                opacity: at(0.0, 1.0),
                color: [at(0.0, 1.0), at(0.0, 1.0), at(0.0, 1.0)],
                // Axis ratios up to 100.
                scale: std::array::from_fn(|_| {
                    (largest * 10f64.powf(f64::from(at(-2.0, 0.0)))) as f32
                }),
                rotation: {
                    let q = [at(-1.0, 1.0), at(-1.0, 1.0), at(-1.0, 1.0), at(-1.0, 1.0)];
                    let norm = q.iter().map(|v| v * v).sum::<f32>().sqrt();
                    q.map(|v| v / norm)
                },
            }
        })
        .collect()
}

fn camera(width: u32, height: u32, eye: DVec3, fov: f64) -> Camera {
    Camera {
        intrinsics: Intrinsics::from_horizontal_fov(width, height, fov),
        pose: Pose::look_at(eye, DVec3::new(0.1, 0.2, 0.0), DVec3::Z).unwrap(),
    }
}

fn largest_difference(a: &Image<[f32; 4]>, b: &Image<[f32; 4]>) -> f32 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let channels = a.data.iter().flatten().zip(b.data.iter().flatten());
    channels.fold(0.0, |worst, (x, y)| if (x - y).abs() <= worst { worst } else { (x - y).abs() })
}

#[test]
fn random_scenes_agree_with_f64() {
    let Some(gpu) = Gpu::new() else { return };
    let views = [
        // Outside; inside the cloud with splats all around and behind; wide angle, tall image.
        (101, 73, DVec3::new(4.0, -3.0, 1.0), 0.8),
        (64, 64, DVec3::new(0.3, -0.4, 0.1), 1.2),
        (40, 97, DVec3::new(-1.0, 1.2, 0.4), 2.2),
    ];
    for (seed, n, largest) in [(1, 400, 0.05), (2, 150, 0.3), (3, 60, 2.0)] {
        let splats = random_scene(seed, n, largest);
        for (width, height, eye, fov) in views {
            let mut view = camera(width, height, eye, fov);
            view.intrinsics.cx += 5.3;
            view.intrinsics.fy *= 1.1;
            let image = gpu.image(&splats, &view);
            let (mut worst, mut n_hinged) = (0.0f64, 0);
            for row in 0..image.height {
                for column in 0..image.width {
                    let (expected, hinges) = reference(&splats, &view, [column, row]);
                    n_hinged += usize::from(hinges);
                    if hinges {
                        continue;
                    }
                    for (found, expected) in image.at(column, row).iter().zip(expected) {
                        let error = (f64::from(*found) - expected).abs();
                        assert!(
                            error < GPU_TOLERANCE,
                            "scene {seed}, view {width}x{height}, pixel {column},{row}: {found} for {expected}"
                        );
                        worst = worst.max(error);
                    }
                }
            }
            println!("scene {seed}, {width}x{height}: worst {worst:.2e}, {n_hinged} at the cut");
            assert!(n_hinged * 20 < image.data.len(), "{n_hinged} pixels left out");
        }
    }
    gpu.assert_no_faults();
}

fn numbers<const N: usize>(value: &serde_json::Value) -> [f64; N] {
    std::array::from_fn(|i| value[i].as_f64().unwrap())
}

fn golden_camera(value: &serde_json::Value) -> Camera {
    let number = |name: &str| value[name].as_f64().unwrap();
    let rows: [[f64; 4]; 4] = std::array::from_fn(|r| numbers(&value["c2w_opengl"][r]));
    Camera {
        intrinsics: Intrinsics {
            width: number("W") as u32,
            height: number("H") as u32,
            fx: number("fx"),
            fy: number("fy"),
            cx: number("cx"),
            cy: number("cy"),
        },
        pose: Pose::from_opengl(DMat4::from_cols_array_2d(&rows).transpose()).unwrap(),
    }
}

fn golden_splat(value: &serde_json::Value) -> Splat {
    let [r, g, b] = numbers(&value["rgb"]);
    Splat {
        mean: numbers::<3>(&value["mean"]).map(|v| v as f32),
        opacity: value["opacity"].as_f64().unwrap() as f32,
        color: [r as f32, g as f32, b as f32],
        scale: numbers::<3>(&value["scale"]).map(|v| v as f32),
        rotation: numbers::<4>(&value["quat_wxyz"]).map(|v| v as f32),
    }
}

#[test]
fn golden_pixels() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/golden/render_cases.json");
    let Ok(text) = std::fs::read_to_string(&path) else {
        assert!(std::env::var_os("CI").is_none(), "{} not found", path.display());
        println!("skipped: ../shared/golden/render_cases.json not found");
        return;
    };
    let Some(gpu) = Gpu::new() else { return };
    let golden: serde_json::Value = serde_json::from_str(&text).unwrap();
    let (mut n_pixels, mut worst) = (0, 0.0f64);
    for case in golden["cases"].as_array().unwrap() {
        if case["camera"]["model"] != "pinhole" {
            continue;
        }
        let name = case["name"].as_str().unwrap();
        let view = golden_camera(&case["camera"]);
        let splats: Vec<Splat> =
            case["splats"].as_array().unwrap().iter().map(golden_splat).collect();
        let background: [f64; 3] = numbers(&case["background"]);
        let image = gpu.image(&splats, &view);
        for (pixel, expected) in case["pixels"]
            .as_array()
            .unwrap()
            .iter()
            .zip(case["expected"]["projected"].as_array().unwrap())
        {
            let at = numbers::<2>(pixel).map(|v| v as usize);
            if reference(&splats, &view, at).1 {
                continue;
            }
            let found = image.at(at[0], at[1]).map(f64::from);
            let behind = [background[0], background[1], background[2], 0.0];
            for (channel, expected) in numbers::<4>(&expected["rgba"]).iter().enumerate() {
                let found = found[channel] + (1.0 - found[3]) * behind[channel];
                let error = (found - expected).abs();
                assert!(error < GPU_TOLERANCE, "{name} {at:?}: {found} for {expected}");
                worst = worst.max(error);
            }
            n_pixels += 1;
        }
    }
    println!("{n_pixels} golden pixels, worst {worst:.2e}");
    assert!(n_pixels >= 90, "only {n_pixels} golden pixels compared");
    gpu.assert_no_faults();
}

#[test]
fn sparse_updates_equal_a_whole_upload() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(80, 60, DVec3::new(4.0, -3.0, 1.0), 0.8);
    let mut splats = random_scene(5, 1000, 0.1);
    let mut scene = gpu.scene(&splats);
    assert_eq!((scene.n_splats(), scene.capacity()), (1000, 1000));

    let others = random_scene(6, 1300, 0.2);
    let changed: Vec<u32> = (0..150).map(|i| (i * 37) % 1000).chain([7, 7]).collect();
    for &id in &changed {
        splats[id as usize] = others[id as usize];
    }
    // Ids past the end come from a dirty list older than the scene and are left out.
    let stale: Vec<u32> = changed[..140].iter().copied().chain([1000, u32::MAX]).collect();
    let bytes = scene.update(&gpu.device, &gpu.queue, &stale, &splats).unwrap();
    assert_eq!(bytes, 140 * 80, "140 of 1000 splats go as sparse records");
    let bytes = scene.update(&gpu.device, &gpu.queue, &changed[140..], &splats).unwrap();
    assert_eq!(bytes, 12 * 80);
    let sparse = gpu.image_of(&mut scene, &splats, &view);
    assert_eq!(largest_difference(&sparse, &gpu.image(&splats, &view)), 0.0);

    assert_eq!(scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap(), 0);
    let many: Vec<u32> = (0..200).collect();
    assert_eq!(scene.update(&gpu.device, &gpu.queue, &many, &splats).unwrap(), 64_000);

    // Growth keeps the picture of what was there and of the order; then 50 more fit as they are.
    splats.extend_from_slice(&others[1000..1001]);
    assert_eq!(scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap(), 64 * 1001);
    assert_eq!(scene.capacity(), 1500);
    assert_eq!(scene.n_drawn(), 1000);
    splats.extend_from_slice(&others[1001..1051]);
    assert_eq!(scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap(), 50 * 80);
    let grown = gpu.image_of(&mut scene, &splats, &view);
    assert_eq!(largest_difference(&grown, &gpu.image(&splats, &view)), 0.0);

    // Shrinking empties the order: it may name splats that are gone.
    splats.truncate(900);
    scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap();
    assert_eq!((scene.n_splats(), scene.n_drawn()), (900, 0));
    let stale = scene.set_order(&gpu.queue, &[3, 900]).unwrap_err();
    assert_eq!(stale, GpuError::StaleOrder { index: 900, n_splats: 900 });
    gpu.assert_no_faults();
}

#[test]
fn growth_draws_the_old_order_until_a_new_one_comes() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(48, 40, DVec3::new(4.0, -3.0, 1.0), 0.8);
    let mut splats = random_scene(8, 50, 0.3);
    let mut scene = gpu.scene(&splats);
    let mut renderer = gpu.renderer();
    gpu.draw(&mut renderer, &mut scene, &splats, &view, EVERYTHING);
    let before = readback::premultiplied(&gpu.device, &gpu.queue, renderer.target()).unwrap();

    splats.extend(random_scene(9, 100, 0.3));
    scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap();
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    renderer.render(&gpu.device, &gpu.queue, &mut encoder, &scene, &view, EVERYTHING).unwrap();
    gpu.queue.submit([encoder.finish()]);
    let after = readback::premultiplied(&gpu.device, &gpu.queue, renderer.target()).unwrap();
    assert_eq!(largest_difference(&before, &after), 0.0);
    assert!(before.data.iter().any(|p| p[3] > 0.5), "something is drawn at all");
    gpu.assert_no_faults();
}

#[test]
fn empty_scenes_and_viewports() {
    let Some(gpu) = Gpu::new() else { return };
    let eye = DVec3::new(4.0, -3.0, 1.0);
    let empty = gpu.image(&[], &camera(20, 10, eye, 0.8));
    assert_eq!(empty.data, vec![[0.0; 4]; 200]);

    let splats = random_scene(4, 10, 0.3);
    let mut scene = gpu.scene(&splats);
    let mut renderer = gpu.renderer();
    for (width, height) in [(0, 10), (10, 0), (0, 0), (1, 1), (30, 20), (0, 0)] {
        let mut view = camera(32, 32, eye, 0.8);
        (view.intrinsics.width, view.intrinsics.height) = (width, height);
        gpu.draw(&mut renderer, &mut scene, &splats, &view, EVERYTHING);
        let image = readback::premultiplied(&gpu.device, &gpu.queue, renderer.target()).unwrap();
        assert_eq!((image.width, image.height), (width as usize, height as usize));
        assert_eq!(image.data.len(), (width * height) as usize);
    }
    // A scene that began empty takes splats later.
    let view = camera(32, 32, eye, 0.8);
    let mut scene = gpu.scene(&[]);
    scene.update(&gpu.device, &gpu.queue, &[], &splats).unwrap();
    let late = gpu.image_of(&mut scene, &splats, &view);
    assert_eq!(largest_difference(&late, &gpu.image(&splats, &view)), 0.0);
    gpu.assert_no_faults();
}

#[test]
fn hostile_splats_leave_the_rest_of_the_picture_alone() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(64, 48, DVec3::new(4.0, -3.0, 1.0), 0.8);
    let good = random_scene(7, 80, 0.2);
    let template = good[0];
    let mut all = good.clone();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let with = |change: &dyn Fn(&mut Splat)| {
                let mut splat = template;
                change(&mut splat);
                splat
            };
            all.push(with(&|s| s.mean[axis] = bad));
            all.push(with(&|s| s.scale[axis] = bad));
            all.push(with(&|s| s.color[axis] = bad));
            all.push(with(&|s| s.rotation[axis] = bad));
            all.push(with(&|s| s.opacity = bad));
        }
    }
    all.push(Splat { rotation: [0.0; 4], ..template });
    all.push(Splat { opacity: -1.0, ..template });
    all.push(Splat { opacity: 0.0, ..template });
    all.push(Splat { opacity: 1.0 / 256.0, ..template });
    // Finite, but neither their variance nor their place fits in f32.
    all.push(Splat { scale: [3e38; 3], ..template });
    all.push(Splat { mean: [3e38, -3e38, 3e38], ..template });
    let expected = gpu.image(&good, &view);
    let found = gpu.image(&all, &view);
    assert!(found.data.iter().flatten().all(|v| v.is_finite()));
    assert_eq!(largest_difference(&expected, &found), 0.0);

    // Zero scale is a point, drawn as the low-pass; f64 agrees.
    let point = Splat { scale: [0.0; 3], mean: [0.1, 0.2, 0.0], opacity: 0.9, ..template };
    let image = gpu.image(&[point], &view);
    for pixel in [[31, 23], [32, 24], [33, 24], [36, 24]] {
        let (expected, _) = reference(&[point], &view, pixel);
        for (found, expected) in image.at(pixel[0], pixel[1]).iter().zip(expected) {
            assert!((f64::from(*found) - expected).abs() < GPU_TOLERANCE, "{pixel:?}");
        }
    }
    gpu.assert_no_faults();
}

#[test]
fn long_needles_keep_their_width_in_f32() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(200, 200, DVec3::new(0.0, -3.0, 0.0), 0.9);
    for angle in [0.0, 0.3, std::f64::consts::FRAC_PI_4, 1.2] {
        let q = glam::DQuat::from_mat3(&DMat3::from_rotation_y(angle));
        let needle = Splat {
            mean: [0.1, 0.2, -0.1],
            opacity: 0.9,
            color: [1.0, 0.5, 0.25],
            // About 7000 px long, well under a pixel thin.
            scale: [100.0, 1e-4, 1e-4],
            rotation: [q.w as f32, q.x as f32, q.y as f32, q.z as f32],
        };
        let image = gpu.image(&[needle], &view);
        for row in 0..200 {
            for column in 0..200 {
                let (expected, hinges) = reference(&[needle], &view, [column, row]);
                let error = f64::from(image.at(column, row)[3]) - expected[3];
                assert!(hinges || error.abs() < GPU_TOLERANCE, "{angle}: {column},{row}: {error}");
            }
        }
        assert!(image.data.iter().any(|p| p[3] > 0.5), "{angle}: nothing drawn");
    }
}

#[test]
fn a_capped_extent_only_loses_tails() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(64, 48, DVec3::new(4.0, -3.0, 1.0), 0.8);
    let splat = Splat {
        mean: [0.1, 0.2, 0.0],
        opacity: 0.9,
        color: [1.0; 3],
        scale: [0.2; 3],
        rotation: [1.0, 0.0, 0.0, 0.0],
    };
    let whole = gpu.image(&[splat], &view);
    let mut renderer = gpu.renderer();
    let capped = RenderSettings { near: NEAR, extent_cap: 3.0 };
    gpu.draw(&mut renderer, &mut gpu.scene(&[splat]), &[splat], &view, capped);
    let cut = readback::premultiplied(&gpu.device, &gpu.queue, renderer.target()).unwrap();
    let lost = largest_difference(&whole, &cut);
    assert!(lost > 0.0 && lost <= 0.9 * (-4.5f32).exp() + 1e-5, "{lost}");
}

#[test]
fn every_target_format_shows_the_same_values() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(70, 50, DVec3::new(4.0, -3.0, 1.0), 0.8);
    let splats = random_scene(10, 200, 0.3);
    let mut scene = gpu.scene(&splats);
    let mut renderer = gpu.renderer();
    gpu.draw(&mut renderer, &mut scene, &splats, &view, EVERYTHING);
    let background = [0.9, 0.1, 0.3];
    let image = readback::premultiplied(&gpu.device, &gpu.queue, renderer.target()).unwrap();
    let shown = |format| {
        readback::composited(&gpu.device, &gpu.queue, renderer.target(), background, format)
            .unwrap()
    };
    let plain = shown(wgpu::TextureFormat::Rgba8Unorm);
    let encoding = shown(wgpu::TextureFormat::Rgba8UnormSrgb);
    for ((texel, plain), encoding) in image.data.iter().zip(&plain.data).zip(&encoding.data) {
        for channel in 0..3 {
            let value = texel[channel] + (1.0 - texel[3]) * background[channel];
            let expected = value.clamp(0.0, 1.0) * 255.0;
            // A GPU blends and rounds by its own rules, but never further off than one level.
            assert!((f32::from(plain[channel]) - expected).abs() <= 1.0, "{plain:?} {expected}");
            assert!(plain[channel].abs_diff(encoding[channel]) <= 1, "{plain:?} {encoding:?}");
        }
        assert_eq!((plain[3], encoding[3]), (255, 255));
    }
    gpu.assert_no_faults();
}

#[test]
fn composites_into_part_of_a_foreign_pass() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(16, 12, DVec3::new(4.0, -3.0, 1.0), 0.8);
    let splats = random_scene(11, 60, 0.5);
    let mut scene = gpu.scene(&splats);
    let mut renderer = gpu.renderer();
    gpu.draw(&mut renderer, &mut scene, &splats, &view, EVERYTHING);
    let (device, queue) = (&gpu.device, &gpu.queue);
    let alone = readback::premultiplied(device, queue, renderer.target()).unwrap();

    // A window of Rgba16Float, so that the same readback serves: the image at (5, 3).
    let window = SplatTarget::new(device, 40, 30).unwrap();
    let mut compositor = Compositor::new(device, wgpu::TextureFormat::Rgba16Float);
    compositor.prepare(device, queue, renderer.target(), [0.0, 0.0, 1.0]);
    let mut encoder = device.create_command_encoder(&Default::default());
    let mut pass = encoder
        .begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: window.view(),
                depth_slice: None,
                resolve_target: None,
                ops: Default::default(),
            })],
            ..Default::default()
        })
        .forget_lifetime();
    pass.set_viewport(5.0, 3.0, 16.0, 12.0, 0.0, 1.0);
    compositor.draw(&mut pass);
    drop(pass);
    queue.submit([encoder.finish()]);

    let shown = readback::premultiplied(device, queue, &window).unwrap();
    for row in 0..30 {
        for column in 0..40 {
            let inside = (5..21).contains(&column) && (3..15).contains(&row);
            let expected = if inside {
                let [r, g, b, a] = *alone.at(column - 5, row - 3);
                [r, g, b + 1.0 - a, 1.0]
            } else {
                [0.0; 4]
            };
            for (found, expected) in shown.at(column, row).iter().zip(expected) {
                assert!((found - expected).abs() < 1e-3, "{column},{row}: {found} for {expected}");
            }
        }
    }
    gpu.assert_no_faults();
}

#[test]
fn pass_times_come_back_where_the_adapter_has_them() {
    let Some(gpu) = Gpu::new() else { return };
    let caps = GpuCaps::new(&gpu.adapter, &gpu.device);
    let view = camera(64, 48, DVec3::new(4.0, -3.0, 1.0), 0.8);
    let splats = random_scene(12, 300, 0.3);
    let mut scene = gpu.scene(&splats);
    let mut renderer = gpu.renderer();
    for _ in 0..8 {
        gpu.draw(&mut renderer, &mut scene, &splats, &view, EVERYTHING);
        gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    }
    // Encoders that are never submitted must not use the timer up.
    for _ in 0..8 {
        let mut lost = gpu.device.create_command_encoder(&Default::default());
        renderer.render(&gpu.device, &gpu.queue, &mut lost, &scene, &view, EVERYTHING).unwrap();
    }
    println!("splat pass: {:?}", renderer.gpu_time());
    assert_eq!(renderer.gpu_time().is_some(), caps.has_timestamps);
    if let Some(time) = renderer.gpu_time() {
        assert!(time.as_secs_f64() < 10.0, "{time:?}");
    }
    gpu.assert_no_faults();
}

#[test]
fn a_lost_device_is_reported_and_rebuilt_from_the_splats() {
    let Some(gpu) = Gpu::new() else { return };
    let view = camera(64, 48, DVec3::new(4.0, -3.0, 1.0), 0.8);
    let splats = random_scene(13, 100, 0.3);
    let before = gpu.image(&splats, &view);
    assert!(!gpu.faults.is_lost());
    gpu.device.destroy();
    let _ = gpu.device.poll(wgpu::PollType::Poll);
    assert!(gpu.faults.is_lost());
    assert_eq!(gpu.faults.take().len(), 1);
    // A read from a dead device is an error, not a panic and not a hang.
    let mut renderer = gpu.renderer();
    gpu.draw(&mut renderer, &mut gpu.scene(&splats), &splats, &view, EVERYTHING);
    assert!(readback::premultiplied(&gpu.device, &gpu.queue, renderer.target()).is_err());

    drop((renderer, gpu));
    let fresh = Gpu::new().unwrap();
    assert_eq!(largest_difference(&before, &fresh.image(&splats, &view)), 0.0);
}

#[test]
fn uncaptured_errors_reach_the_sink() {
    let Some(gpu) = Gpu::new() else { return };
    for _ in 0..3 {
        // Without MAPPABLE_PRIMARY_BUFFERS, MAP_WRITE goes with COPY_SRC only.
        let _ = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("invalid"),
            size: 4,
            usage: wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::STORAGE,
            mapped_at_creation: false,
        });
    }
    let faults = gpu.faults.take();
    assert_eq!(faults.len(), 1, "{faults:?}");
    assert_eq!(faults[0].n_seen, 3);
}
