//! The two real recordings through the binary.

use super::runner::Scratch;
use crate::common::shared;
use serde_json::Value;

#[test]
fn lego_trains_and_evaluates() {
    let Some(data) = shared("data/lego400") else { return };
    let data = data.to_str().unwrap();
    let scratch = Scratch::empty();
    scratch
        .run_args(&["train", data, "--preset", "paper", "--out", "out", "--max-frames", "5"])
        .succeeds();
    let report = scratch.json("out/report.json");
    assert_eq!(report["dataset"]["split"], "test");
    assert_eq!(report["config"]["camera_convention"], "paper");
    let frames = report["frames"].as_array().unwrap();
    assert_eq!((frames.len(), report["dataset"]["width"].as_u64()), (5, Some(400)));
    assert!(frames.iter().all(|f| (30_000..60_000).contains(&f["points"].as_u64().unwrap())));
    assert_eq!(report["skipped"], serde_json::json!([]));
    let eval = scratch.run_args(&["eval", "out/scene.ply", data, "--max-frames", "2", "--json"]);
    let eval = eval.succeeds().json();
    assert_eq!(eval["eval"][0]["split"], "val");
    assert!(eval["eval"][0]["psnr_mean"].as_f64().unwrap() > 14.0, "{}", eval["eval"][0]);
    assert!(eval["eval"][0]["depth_mae_mean"].is_null(), "these views have no depth");
}

#[test]
fn kinect_trains_and_evaluates() {
    let Some(data) = shared("data/kinect_office") else { return };
    let data = data.to_str().unwrap();
    let scratch = Scratch::empty();
    let arguments = ["train", data, "--out", "out", "--max-frames", "5", "--json"];
    let report = scratch.run_args(&arguments).succeeds().json();
    assert_eq!(report["dataset"]["split"], "train");
    assert_eq!(report["dataset"]["layout"], "seven-scenes");
    let frames = report["frames"].as_array().unwrap();
    // In large frames one point covers four pixels.
    assert!(frames.iter().all(|f| f["points"].as_u64().unwrap() > 100_000 / 4));
    let eval = scratch.run_args(&["eval", "out/scene.ply", data, "--max-frames", "1", "--json"]);
    let eval = eval.succeeds().json();
    let eval = &eval["eval"][0];
    assert_eq!(eval["split"], "eval");
    assert!(eval["depth_mae_mean"].as_f64().unwrap() < 1.0, "metres: {eval}");
}

#[test]
fn both_recordings_are_free_of_defects() {
    for (name, frames) in [("data/lego400", 250), ("data/kinect_office", 110)] {
        let Some(data) = shared(name) else { return };
        let scratch = Scratch::empty();
        let info = scratch.run_args(&["info", data.to_str().unwrap(), "--json"]).succeeds().json();
        assert_eq!(info["defects"], serde_json::json!([]));
        let splits = info["splits"].as_array().unwrap();
        let found: u64 = splits.iter().map(|s| s["frames"].as_u64().unwrap()).sum();
        assert_eq!(found, frames, "{name}");
    }
}

#[test]
fn the_kinects_colour_camera_is_found_from_scratch() {
    let Some(data) = shared("data/kinect_office") else { return };
    let data = data.to_str().unwrap();
    let scratch = Scratch::empty();
    let found =
        scratch.run_args(&["calibrate", data, "--from-scratch", "--json"]).succeeds().json();
    let camera = &found["calibration"]["color_camera"];
    let near = |value: &Value, expected: f64, within: f64| {
        let value = value.as_f64().unwrap();
        assert!((value - expected).abs() < within, "{value} is not {expected}: {found}");
    };
    near(&camera["focal"][0], 522.0, 6.0);
    near(&camera["offset"][0], 0.023, 0.004);
    // Offset y and principal point y compensate each other, so this compares the image row of the
    // axis 2 m away.
    let number = |value: &Value| value.as_f64().unwrap();
    let below = 0.5 * number(&camera["focal"][1]) * number(&camera["offset"][1]);
    near(&(number(&camera["principal"][1]) - below).into(), 238.1, 2.0);
    let known = scratch.run_args(&["calibrate", data, "--json"]).succeeds().json();
    assert_eq!(known["changed"], false, "{known}");
    let variance = |found: &Value, when: &str| found[when]["color_variance"].as_f64().unwrap();
    assert!(variance(&found, "after") < 1.02 * variance(&known, "before"));
}

#[test]
fn legos_colours_are_registered() {
    let Some(data) = shared("data/lego400") else { return };
    let scratch = Scratch::empty();
    let run = scratch.run_args(&["calibrate", data.to_str().unwrap()]).succeeds();
    assert!(run.stdout.contains("registered to depth"), "{}", run.stdout);
    assert!(run.stdout.contains("nothing was changed"), "{}", run.stdout);
}
