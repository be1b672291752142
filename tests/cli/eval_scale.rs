//! Evaluation at a fraction of the photographs' size.

use super::runner::Scratch;
use vbgs_studio::dataset::{self, LoadOptions};
use vbgs_studio::math::camera::Camera;
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{RenderMethod, RenderOptions};

/// PSNR of the first evaluation view at half size, computed without the code under test.
fn psnr_at_half(scratch: &Scratch) -> f64 {
    let room = dataset::open(&scratch.path("room"), &LoadOptions::default()).unwrap();
    let split = room.splits.iter().position(|split| split.name == "eval").unwrap();
    let frame = room.load(split, 0).unwrap();
    let camera = Camera { intrinsics: frame.camera.intrinsics.scaled(0.5), ..frame.camera };
    let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let splats = scratch.model("out/scene.ply").splats;
    let drawn = CpuRenderer::new().render(splats.view(), &camera, &options).color;
    assert_eq!((drawn.width, drawn.height), (32, 24));
    let mut sum = 0.0;
    for (i, pixel) in drawn.data.iter().enumerate() {
        let (x, y) = (2 * (i % 32), 2 * (i / 32));
        for (channel, drawn) in pixel.iter().take(3).enumerate() {
            let block = [(0, 0), (1, 0), (0, 1), (1, 1)];
            let bytes = block.map(|(dx, dy)| f64::from(frame.color.at(x + dx, y + dy)[channel]));
            let truth = bytes.iter().sum::<f64>() / 4.0 / 255.0;
            sum += (f64::from(drawn.clamp(0.0, 1.0)) - truth).powi(2);
        }
    }
    -10.0 * (sum / (3 * drawn.data.len()) as f64).log10()
}

#[test]
fn views_are_compared_at_a_fraction_of_their_size_and_say_so() {
    let scratch = Scratch::with_scene();
    let eval = |scale: &str| {
        let run = scratch.run(&format!("eval out/scene.ply room --eval-scale {scale} --json"));
        run.succeeds().json()
    };
    let (full, half) = (eval("1"), eval("0.5"));
    assert_eq!((&full["eval"][0]["scale"], &half["eval"][0]["scale"]), (&1.0.into(), &0.5.into()));
    let found = half["views"][0]["psnr"].as_f64().unwrap();
    let expected = psnr_at_half(&scratch);
    assert!((found - expected).abs() < 1e-3, "{found}, expected {expected}");
    // Depth is resampled to the smaller image, not compared pixel by pixel with the larger one.
    let depth = |report: &serde_json::Value| report["eval"][0]["depth_mae_mean"].as_f64().unwrap();
    assert!((0.5..1.5).contains(&(depth(&half) / depth(&full))), "{full} {half}");

    let said = scratch.run("eval out/scene.ply room --eval-scale 0.5").succeeds().stdout;
    assert!(said.contains("at 0.5 of the photographs' size"), "{said}");
    let said = scratch.run("eval out/scene.ply room").succeeds().stdout;
    assert!(!said.contains("photographs' size"), "{said}");
    let json = scratch.run("eval out/scene.ply room --eval-scale 0.75 --json").succeeds().json();
    assert_eq!(json["eval"][0]["scale"], 0.75);
}

#[test]
fn nonsense_is_refused() {
    let scratch = Scratch::with_scene();
    for scale in ["0", "-1", "1.5", "nan", "half"] {
        let run = scratch.run(&format!("eval out/scene.ply room --eval-scale {scale}"));
        assert_eq!(run.code, 2, "{scale}");
        assert!(run.stderr.contains("above 0 and at most 1"), "{}", run.stderr);
    }
    let tiny = scratch.run("eval out/scene.ply room --eval-scale 0.1");
    tiny.fails(1, &["at least 11x11 pixels, found 6x5"]);
}
