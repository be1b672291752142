//! Uses the engine as a library, as a robot would: frames come from memory, the scene and its certainty
//! are read back, and splats are saved. A synthetic camera moves along a wall.
//!
//! `cargo run --release --no-default-features --example robot`
#![allow(clippy::print_stdout, reason = "a command-line program")]

use glam::{DMat4, DVec3};
use std::error::Error;
use vbgs_studio::dataset::error::FrameError;
use vbgs_studio::dataset::frame::{ColorBuffer, DepthBuffer, DepthKind, Frame};
use vbgs_studio::dataset::surface::{Preparer, Sensor, SurfaceSettings};
use vbgs_studio::export::{ModelFormat, WriteOptions, write};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::observation::surface::Observation;
use vbgs_studio::train::learner::{Learner, Learns};
use vbgs_studio::train::scene::{config::SceneConfig, trainer::SceneTrainer};

const SIZE: [usize; 2] = [320, 240];

/// Simulates the driver of a depth camera: intrinsics, pose, RGB bytes, depth in metres.
fn capture(step: usize) -> Result<Frame, FrameError> {
    let [width, height] = SIZE;
    let pixels = (0..width * height).map(|i| [(i % width / 2) as u8, (i / width) as u8, 90]);
    let color: Vec<u8> = pixels.flatten().collect();
    let depth = vec![1.5; width * height];
    Frame::from_memory(
        &format!("step {step}"),
        Intrinsics::from_horizontal_fov(width as u32, height as u32, 1.0),
        DMat4::from_translation(DVec3::X * 0.05 * step as f64),
        ColorBuffer::Rgb8(&color),
        Some(DepthBuffer { lengths: &depth, kind: DepthKind::Z, trusted: [0.3, 4.0] }),
    )
}

fn main() -> Result<(), Box<dyn Error>> {
    // Lengths are metres: components of about 2 cm, noise and thresholds of a structured-light camera.
    let config = SceneConfig::coarse(0.02).check()?;
    let surface = SurfaceSettings::of_sensor(Sensor::Kinect, DVec3::ZERO);
    let mut scene = SceneTrainer::new(&config, surface.origin);
    let (mut preparer, mut seen) = (Preparer::new(), Observation::empty());
    for step in 0..10 {
        // A refused frame leaves the scene unchanged; a robot could skip it instead of returning the error.
        preparer.prepare(&capture(step)?, &surface, &mut seen)?;
        let outcome = scene.learn(&seen)?;
        println!("frame {step}: {} points, {} components", outcome.points, scene.status().used);
    }
    let surest =
        (0..scene.status().components).max_by_key(|&k| scene.component(k).posterior.count as u64);
    let posterior = scene.component(surest.ok_or("no points in any frame")?).posterior;
    println!("most points: a component at {:.3} m, from {}", posterior.mean_space, posterior.count);
    let path = std::env::temp_dir().join("robot.ply");
    let written = write(&path, &scene.splats(), &WriteOptions::new(ModelFormat::Ply))?;
    println!("{} splats, {} bytes: {}", written.n_written, written.bytes, path.display());
    Ok(())
}
