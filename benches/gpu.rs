//! Time per image on the GPU, by stage and path.
//!
//! `cargo bench --bench gpu` draws synthetic scenes of 10⁵ and 10⁶ splats on wgpu's
//! default adapter; `cargo bench --bench gpu -- 4000000 scene.ply` draws those instead. `WGPU_ADAPTER_NAME`
//! names another adapter.

#![allow(clippy::print_stdout)]

use glam::{DQuat, DVec3};
use std::error::Error;
use std::task::{Context, Poll, Waker};
use std::time::Instant;
use vbgs_studio::export;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splats::{Splat, framing};
use vbgs_studio::render::gpu::context::{GpuCaps, device_descriptor};
use vbgs_studio::render::gpu::faults::GpuFaults;
use vbgs_studio::render::gpu::renderer::{GpuTimes, Path, SplatRenderer};
use vbgs_studio::render::gpu::scene::{GpuScene, OrderOf};
use vbgs_studio::render::gpu::sort::{SortScratch, back_to_front};
use vbgs_studio::render::{Method, RenderOptions};

const RESOLUTIONS: [(u32, u32); 2] = [(1280, 720), (1920, 1080)];
const WARM_UPS: usize = 10;
const REPETITIONS: usize = 50;
/// Horizontal field of view of the NeRF-synthetic cameras, radians.
const FOV_X: f64 = 0.6911;

struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    faults: GpuFaults,
}

fn main() -> Result<(), Box<dyn Error>> {
    let gpu = open()?;
    println!("median of {REPETITIONS} images after {WARM_UPS}, ms; wall: submitted until done");
    println!("scene, splats, resolution, renderer, path: preprocess sort draw total, wall");
    // Cargo adds `--bench`.
    let asked: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    if asked.is_empty() {
        measure(&gpu, "surfaces", &surfaces(100_000))?;
        return measure(&gpu, "surfaces", &surfaces(1_000_000));
    }
    for scene in &asked {
        match scene.parse() {
            Ok(n_splats) => measure(&gpu, "surfaces", &surfaces(n_splats))?,
            Err(_) => measure(&gpu, scene, &export::read(scene.as_ref())?.splats)?,
        }
    }
    Ok(())
}

fn open() -> Result<Gpu, Box<dyn Error>> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::PRIMARY,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapter = now(wgpu::util::initialize_adapter_from_env_or_default(&instance, None))?;
    let (device, queue) = now(adapter.request_device(&device_descriptor(&adapter)))?;
    println!("{}", GpuCaps::new(&adapter, &device));
    let faults = GpuFaults::default();
    faults.watch(&device);
    Ok(Gpu { device, queue, faults })
}

/// Futures of native wgpu are ready when they are made.
fn now<T>(future: impl Future<Output = T>) -> T {
    match std::pin::pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("a native wgpu future was not ready"),
    }
}

fn measure(gpu: &Gpu, name: &str, splats: &[Splat]) -> Result<(), Box<dyn Error>> {
    let view_of = orbit(splats);
    for (width, height) in RESOLUTIONS {
        let camera = view_of(width, height);
        for method in [Method::PROJECTED, Method::EXACT] {
            let options = RenderOptions::evaluation(method, [1.0; 3]);
            let mut scene = GpuScene::new(&gpu.device, &gpu.queue, splats)?;
            let mut scratch = SortScratch::default();
            scene.set_order(
                &gpu.queue,
                OrderOf::First,
                back_to_front(splats, &camera, &options, &mut scratch),
            )?;
            for path in [Path::Quads, Path::Tiles] {
                let (times, wall) = frames(gpu, path, &scene, &camera, &options)?;
                let stage = |of: fn(&GpuTimes) -> f64| {
                    median(times.iter().map(of).collect())
                        .map_or("-".into(), |ms| format!("{ms:.3}"))
                };
                println!(
                    "{name}, {}, {width}x{height}, {}, {path}: {} {} {} {}, {wall:.3}",
                    splats.len(),
                    method.renderer(),
                    stage(|t| t.preprocess.unwrap_or(0.0)),
                    stage(|t| t.sort.unwrap_or(0.0)),
                    stage(|t| t.draw),
                    stage(GpuTimes::total),
                );
            }
        }
    }
    Ok(())
}

/// Times on the GPU and the median wall time of images by one path.
fn frames(
    gpu: &Gpu,
    path: Path,
    scene: &GpuScene,
    camera: &Camera,
    options: &RenderOptions,
) -> Result<(Vec<GpuTimes>, f64), Box<dyn Error>> {
    let (device, queue) = (&gpu.device, &gpu.queue);
    let mut renderer = SplatRenderer::new(device, queue, OrderOf::First)?;
    renderer.set_path(path);
    let (mut times, mut wall) = (Vec::new(), Vec::new());
    for i in 0..WARM_UPS + REPETITIONS {
        let start = Instant::now();
        let mut encoder = device.create_command_encoder(&Default::default());
        renderer.render(device, queue, &mut encoder, scene, camera, options)?;
        queue.submit([encoder.finish()]);
        device.poll(wgpu::PollType::wait_indefinitely())?;
        if i >= WARM_UPS {
            wall.push(start.elapsed().as_secs_f64() * 1e3);
            times.extend(renderer.gpu_times());
        }
    }
    if let Some(shortage) = renderer.shortage() {
        println!("{shortage}");
    }
    if let Some(fault) = gpu.faults.take().into_iter().next() {
        return Err(fault.message.into());
    }
    Ok((times, median(wall).unwrap_or(f64::NAN)))
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// A camera of any size that sees the whole scene from the side and above.
fn orbit(splats: &[Splat]) -> impl Fn(u32, u32) -> Camera {
    let (centre, radius) =
        framing(splats).map_or((DVec3::ZERO, 1.0), |scene| (scene.centre, scene.radius));
    let eye = centre + 2.6 * radius * DVec3::new(0.5, -0.8, 0.35).normalize();
    move |width, height| Camera {
        intrinsics: Intrinsics::from_horizontal_fov(width, height, FOV_X),
        pose: Pose::look_at(eye, centre, DVec3::Z).expect("the view is not vertical"),
    }
}

/// Flat splats on balls and a floor, as training leaves them: closer together the more there are.
fn surfaces(n_splats: usize) -> Vec<Splat> {
    let mut rng = Rng::new(1, Purpose::Synthetic, 0);
    let balls: Vec<(DVec3, f64)> = (0..12)
        .map(|_| {
            let at = DVec3::new(rng.range(-0.7, 0.7), rng.range(-0.7, 0.7), rng.range(0.0, 0.6));
            (at, rng.range(0.1, 0.35))
        })
        .collect();
    // About 12 square units in all; neighbours overlap by two standard deviations.
    let spacing = (12.0 / n_splats.max(1) as f64).sqrt();
    (0..n_splats)
        .map(|i| {
            let (at, normal) = match balls.get(i % (balls.len() + 4)) {
                Some((centre, radius)) => {
                    let normal = direction(&mut rng);
                    (*centre + *radius * normal, normal)
                }
                None => (DVec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), -0.3), DVec3::Z),
            };
            let turn = DQuat::from_rotation_arc(DVec3::Z, normal)
                * DQuat::from_rotation_z(rng.range(0.0, 6.2));
            let mut side = || (spacing * rng.range(-1.2, 0.3).exp()) as f32;
            let scale = [side(), side(), 0.1 * spacing as f32];
            Splat {
                mean: at.as_vec3().to_array(),
                opacity: rng.range(0.5, 0.95) as f32,
                color: [0; 3].map(|_| rng.uniform() as f32),
                scale,
                rotation: [turn.w, turn.x, turn.y, turn.z].map(|q| q as f32),
            }
        })
        .collect()
}

fn direction(rng: &mut Rng) -> DVec3 {
    DVec3::new(rng.normal(), rng.normal(), rng.normal()).try_normalize().unwrap_or(DVec3::Z)
}
