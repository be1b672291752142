//! Time per image of the CPU renderer and of SSIM.
//!
//! `cargo bench --bench render` prints the table; `cargo bench --bench render -- WIDTH HEIGHT SPLATS SIGMA`
//! prints one row. `RAYON_NUM_THREADS` sets the number of threads. `cargo bench --bench render -- FILE.vbgs`
//! draws a checkpoint with and without its textures, on the CPU and on a graphics adapter if there is one.

#![allow(clippy::print_stdout)]

mod common;

use common::times_ms;
use glam::DVec3;
use std::time::Instant;
use vbgs_studio::eval::ssim::ssim;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
#[cfg(feature = "gui")]
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::pipeline::checkpoint::SavedRun;
use vbgs_studio::render::cpu::{CpuRenderer, CpuStage};
#[cfg(feature = "gui")]
use vbgs_studio::render::gpu::{
    adapters::AdapterChoice, headless::HeadlessGpu, renderer::SplatRenderer, scene::GpuScene,
};
use vbgs_studio::render::{RenderOptions, Renderer};

/// Repetitions per row of the table, of which the best and the median are printed.
const REPETITIONS: usize = 25;
/// Horizontal field of view (radians) of the NeRF-synthetic cameras.
const FOV_X: f64 = 0.6911;
/// Distance of these cameras from the origin.
const DISTANCE: f64 = 4.0;

fn main() {
    // Parsing skips the `--bench` that cargo adds.
    let numbers: Vec<f64> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    println!(
        "{} threads; milliseconds, best / median of {REPETITIONS}",
        rayon::current_num_threads()
    );
    if let Some(path) = std::env::args().find(|argument| argument.ends_with(".vbgs")) {
        return textured_rows(&path);
    }
    if let [width, height, n_splats, sigma] = numbers[..] {
        return render_row(width as u32, height as u32, n_splats as usize, sigma);
    }
    render_row(400, 400, 50_000, 0.02);
    render_row(400, 400, 50_000, 0.014);
    render_row(800, 600, 100_000, 0.014);
    render_row(1280, 720, 100_000, 0.014);
    ssim_row();
}

fn render_row(width: u32, height: u32, n_splats: usize, sigma: f64) {
    let splats = ball(n_splats, sigma);
    let camera = Camera {
        intrinsics: Intrinsics::from_horizontal_fov(width, height, FOV_X),
        pose: Pose::look_at(DVec3::new(0.0, -DISTANCE, 0.0), DVec3::ZERO, DVec3::Z)
            .expect("the view is not vertical"),
    };
    for renderer in [Renderer::Projected, Renderer::Exact] {
        let options = RenderOptions::evaluation(renderer.into(), [1.0; 3]);
        let mut drawing = CpuRenderer::new();
        let (best, median) = time(|| {
            drawing.render(&splats, &camera, &options);
        });
        let name = format!("{renderer} {width}x{height} {n_splats} splats sigma {sigma}");
        println!("{name}: {best:.2} / {median:.2}");
        print_stages(|observer| {
            drawing.render_observed((&splats).into(), &camera, &options, observer);
        });
    }
}

/// Prints the median time of each stage.
fn print_stages(mut draw: impl FnMut(&mut dyn FnMut(CpuStage))) {
    let mut runs: Vec<[f64; CpuStage::ALL.len()]> = Vec::new();
    for _ in 0..REPETITIONS {
        let (mut ms, mut from) = ([0.0; CpuStage::ALL.len()], Instant::now());
        draw(&mut |stage| {
            ms[stage as usize] = from.elapsed().as_secs_f64() * 1e3;
            from = Instant::now();
        });
        runs.push(ms);
    }
    for stage in CpuStage::ALL {
        let mut ms: Vec<f64> = runs.iter().map(|run| run[stage as usize]).collect();
        ms.sort_by(f64::total_cmp);
        print!("    {stage:?} {:.2}", ms[REPETITIONS / 2]);
    }
    println!();
}

/// Prints the time to draw a checkpoint from the pose of its middle frame, with and without textures.
fn textured_rows(path: &str) {
    let run = SavedRun::read(path.as_ref()).expect("a checkpoint");
    let textured = run.splats().expect("splats");
    let poses = textured.finishing().poses.clone().expect("a checkpoint of a real camera");
    let frames = poses.frames();
    let [_, pose] = frames[frames.len() / 2].poses().expect("a valid pose");
    let finishing = textured.finishing().without_textures();
    let plain = textured.clone().finished(finishing);
    let camera = Camera { intrinsics: Intrinsics::from_horizontal_fov(1280, 960, 1.05), pose };
    for renderer in [Renderer::Projected, Renderer::Exact] {
        let options = RenderOptions::evaluation(renderer.into(), [0.0; 3]);
        let cpu = [&plain, &textured].map(|scene| {
            let mut drawing = CpuRenderer::new();
            time(|| drop(drawing.render(scene, &camera, &options))).1
        });
        println!("{renderer} 1280x960, CPU: {:.2}, with textures {:.2}", cpu[0], cpu[1]);
        #[cfg(feature = "gui")]
        if let Ok(gpu) = HeadlessGpu::new(&AdapterChoice::Auto) {
            let ms = [&plain, &textured].map(|scene| gpu_ms(&gpu, scene, &camera, &options));
            println!("{renderer} 1280x960, {}: {:.2}, with textures {:.2}", gpu.caps, ms[0], ms[1]);
        }
    }
}

#[cfg(feature = "gui")]
fn gpu_ms(gpu: &HeadlessGpu, scene: &SplatSet, camera: &Camera, options: &RenderOptions) -> f64 {
    let HeadlessGpu { device, queue, .. } = gpu;
    let scene = GpuScene::new(device, queue, scene).expect("memory for the scene");
    let mut renderer = SplatRenderer::new(device, queue).expect("a renderer");
    time(|| {
        let mut encoder = device.create_command_encoder(&Default::default());
        renderer.render(device, queue, &mut encoder, &scene, camera, options).expect("a frame");
        queue.submit([encoder.finish()]);
        gpu.wait().expect("a device");
    })
    .1
}

fn ssim_row() {
    let mut rng = Rng::new(2, Purpose::Synthetic, 0);
    let mut noise = || {
        let data = (0..400 * 400).map(|_| [0; 3].map(|_: i32| rng.uniform() as f32)).collect();
        vbgs_studio::math::image::Image::from_vec(400, 400, data)
    };
    let (a, b) = (noise(), noise());
    let (best, median) = time(|| {
        ssim(&a, &b).expect("images of one size");
    });
    println!("ssim 400x400: {best:.2} / {median:.2}");
}

/// Splats with random orientation and opacity 0.95, uniform in the unit ball.
fn ball(n_splats: usize, sigma: f64) -> Vec<Splat> {
    let mut rng = Rng::new(1, Purpose::Synthetic, 0);
    let mut splats = Vec::with_capacity(n_splats);
    while splats.len() < n_splats {
        let mean = [0; 3].map(|_| rng.range(-1.0, 1.0) as f32);
        if mean.iter().map(|x| x * x).sum::<f32>() > 1.0 {
            continue;
        }
        let color = [0; 3].map(|_| rng.uniform() as f32);
        let scale = [0; 3].map(|_| (sigma * rng.range(0.5, 1.5)) as f32);
        let rotation = [0; 4].map(|_| rng.normal() as f32);
        let norm = rotation.iter().map(|q| q * q).sum::<f32>().sqrt();
        let rotation = rotation.map(|q| q / norm);
        splats.push(Splat { mean, opacity: 0.95, color, scale, rotation });
    }
    splats
}

fn time(run: impl FnMut()) -> (f64, f64) {
    let ms = times_ms(REPETITIONS, run);
    (ms[0], ms[REPETITIONS / 2])
}
