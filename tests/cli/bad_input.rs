//! Damaged datasets through the binary. One message states the file, what was expected, what was
//! found and what to do. A bad frame is skipped; a dataset without a usable frame is an error.

use super::runner::Scratch;
use crate::common::layouts::TestLayout;
use crate::common::scratch::{edit_json, edit_pose, tiny, tiny_blender, tiny_seven_scenes};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use tempfile::TempDir;
use vbgs_studio::dataset::synthetic::write::DepthBits;

const LIST: &str = "transforms_train.json";
const DEPTH: &str = "train/r_1_depth_0001.png";

/// Trains on three frames, the middle one damaged: it is skipped with a warning and counted.
#[track_caller]
fn skips_one(data: &TempDir, parts: &[&str]) {
    let scratch = Scratch::empty();
    let path = data.path().to_str().unwrap();
    let train =
        ["train", path, "--preset", "paper", "--out", "out", "--set", "components=200", "--json"];
    let run = scratch.run_args(&train).succeeds();
    let warnings: Vec<&str> = run.stderr.lines().filter(|l| l.starts_with("warning: ")).collect();
    assert_eq!(warnings.len(), 1, "{}", run.stderr);
    let report = run.json();
    assert_eq!(report["frames"].as_array().unwrap().len(), 2);
    let skipped = report["skipped"].as_array().unwrap();
    assert_eq!(skipped.len(), 1, "{skipped:?}");
    let message = skipped[0]["message"].as_str().unwrap();
    for part in parts {
        assert!(message.contains(part), "`{part}` is missing from: {message}");
        assert!(warnings[0].contains(part), "`{part}` is missing from: {}", warnings[0]);
    }
    assert!(!scratch.model("out/scene.ply").splats.is_empty(), "the other frames are trained");
    let info = scratch.run_args(&["info", path, "--json"]).succeeds().json();
    let defects = info["defects"].as_array().unwrap();
    assert_eq!(defects.len(), 1, "{defects:?}");
    assert!(defects[0].as_str().unwrap().contains(message), "{defects:?}");
}

/// Asserts that training fails and writes no output.
#[track_caller]
fn refuses(data: &TempDir, parts: &[&str]) {
    let scratch = Scratch::empty();
    let path = data.path().to_str().unwrap();
    scratch.run_args(&["train", path, "--preset", "paper", "--out", "out"]).fails(1, parts);
    assert!(!scratch.path("out/scene.ply").exists());
}

fn truncate(path: &Path) {
    let bytes = fs::read(path).unwrap();
    fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
}

fn edit_frame(data: &TempDir, edit: impl FnOnce(&mut Value)) {
    edit_json(&data.path().join(LIST), |json| edit(&mut json["frames"][1]));
}

#[test]
fn missing_depth_file() {
    let data = tiny_blender();
    fs::remove_file(data.path().join(DEPTH)).unwrap();
    skips_one(&data, &["train/r_1", "expected a depth image", "found none", "restore"]);
    let data = tiny_seven_scenes();
    fs::remove_file(data.path().join("train/frame-000001.depth.png")).unwrap();
    skips_one(&data, &["frame-000001", "expected a depth image", "found none", "restore"]);
}

#[test]
fn mismatched_sizes() {
    let data = tiny_blender();
    image::GrayImage::from_pixel(16, 12, image::Luma([9])).save(data.path().join(DEPTH)).unwrap();
    skips_one(&data, &[DEPTH, "expected depth", "32x24", "found 16x12", "export all"]);
    let data = tiny_seven_scenes();
    let color = data.path().join("train/frame-000001.color.png");
    image::RgbImage::new(8, 8).save(color).unwrap();
    skips_one(&data, &["frame-000001", "expected", "32x24", "8x8", "export"]);
}

#[test]
fn truncated_image() {
    for file in ["train/r_1.png", DEPTH] {
        let data = tiny_blender();
        truncate(&data.path().join(file));
        skips_one(&data, &[file, "expected a whole PNG or JPEG", "found", "again"]);
        fs::write(data.path().join(file), "").unwrap();
        skips_one(&data, &[file, "expected a whole PNG or JPEG", "found", "again"]);
    }
}

#[test]
fn nan_pose() {
    let data = tiny_blender();
    edit_frame(&data, |frame| frame["transform_matrix"][2][1] = json!("NaN"));
    skips_one(
        &data,
        &[LIST, "train/r_1", "expected 4 rows of 4 finite numbers", "\"NaN\"", "export"],
    );
    let data = tiny_seven_scenes();
    edit_pose(data.path(), |values| values[6] = f64::NAN);
    skips_one(
        &data,
        &["frame-000001.pose.txt", "expected", "finite numbers", "found NaN", "export"],
    );
}

#[test]
fn singular_and_non_rigid_poses() {
    for (factor, found) in [(0.0, "determinant 0.000"), (1.5, "determinant 3.375")] {
        let scale = |values: &mut Vec<f64>| {
            [0, 1, 2, 4, 5, 6, 8, 9, 10].iter().for_each(|&i| values[i] *= factor);
        };
        let data = tiny_seven_scenes();
        edit_pose(data.path(), scale);
        skips_one(&data, &["frame-000001.pose.txt", "expected a rotation", found, "export"]);
        let data = tiny_blender();
        edit_frame(&data, |frame| {
            for row in 0..3 {
                for column in 0..3 {
                    let value = &mut frame["transform_matrix"][row][column];
                    *value = json!(value.as_f64().unwrap() * factor);
                }
            }
        });
        skips_one(&data, &[LIST, "train/r_1", "expected a rotation", found, "export"]);
    }
}

#[test]
fn paths_that_escape_the_folder() {
    for path in ["../r_1", "train/../../r_1", "/etc/hostname"] {
        let data = tiny_blender();
        edit_frame(&data, |frame| frame["file_path"] = json!(path));
        skips_one(
            &data,
            &[LIST, "expected a path inside the dataset folder", path, "relative path"],
        );
    }
}

#[test]
fn depth_all_zero() {
    let data = tiny_blender();
    image::RgbaImage::new(32, 24).save(data.path().join(DEPTH)).unwrap();
    skips_one(&data, &[DEPTH, "expected depth values", "only holes", "export"]);
    let data = tiny_seven_scenes();
    let hole = image::ImageBuffer::from_pixel(32, 24, image::Luma([65535u16]));
    hole.save(data.path().join("train/frame-000001.depth.png")).unwrap();
    skips_one(&data, &["frame-000001.depth.png", "expected depth values", "only holes", "export"]);
}

#[test]
fn empty_and_broken_json() {
    for (text, parts) in [
        ("", &["expected JSON", "found", "export the file again"][..]),
        ("{\"frames\": [", &["expected JSON", "found", "line", "export the file again"]),
        ("{}", &["expected an object with a list `frames`", "found", "export"]),
        ("[]", &["expected an object with a list `frames`", "found", "export"]),
        (
            "{\"camera_angle_x\": 1, \"frames\": []}",
            &["expected at least one", "found none", "export"],
        ),
    ] {
        let data = tiny_blender();
        fs::write(data.path().join(LIST), text).unwrap();
        refuses(&data, &[&[LIST][..], parts].concat());
    }
}

#[test]
fn no_frames() {
    let data = tempfile::tempdir().unwrap();
    refuses(&data, &["expected a known layout", "found an empty folder", "give the folder"]);
    let data = tiny_seven_scenes();
    fs::write(data.path().join("TrainSplit.txt"), "sequence1").unwrap();
    fs::remove_dir_all(data.path().join("train")).unwrap();
    fs::remove_dir_all(data.path().join("eval")).unwrap();
    refuses(&data, &["TrainSplit.txt", "expected at least one usable", "seq-01", "unpack"]);
}

#[test]
fn absurd_field_of_view() {
    for angle in [39.6, 0.0, -1.0, 3.2] {
        let data = tiny_blender();
        edit_json(&data.path().join(LIST), |json| json["camera_angle_x"] = json!(angle));
        let parts = [LIST, "expected `camera_angle_x` in radians", "found", &angle.to_string()];
        refuses(&data, &parts);
    }
    let data = tiny_seven_scenes();
    let text = "0 0 16 0 20 12 0 0 1";
    fs::write(data.path().join("camera-intrinsics.txt"), text).unwrap();
    refuses(&data, &["camera-intrinsics.txt", "expected a horizontal field", "correct"]);
}

/// Damages every frame in a way that only loading detects.
#[test]
fn no_usable_frame() {
    let data = tiny_seven_scenes();
    for i in 0..3 {
        let hole = image::ImageBuffer::from_pixel(32, 24, image::Luma([0u16]));
        hole.save(data.path().join(format!("train/frame-00000{i}.depth.png"))).unwrap();
    }
    refuses(
        &data,
        &["expected at least one usable frame", "found none", "3 sampled", "only holes"],
    );
    let data = tiny_blender();
    for i in 0..3 {
        truncate(&data.path().join(format!("train/r_{i}.png")));
    }
    refuses(&data, &["expected at least one usable frame", "found none", "3 skipped", "r_0.png"]);
}

#[test]
fn a_depth_scale_that_leaves_nothing() {
    let data = tiny(TestLayout::Blender(DepthBits::Sixteen));
    let scratch = Scratch::empty();
    let path = data.path().to_str().unwrap();
    let train =
        ["train", path, "--preset", "paper", "--out", "out", "--depth-range", "900", "1000"];
    scratch.run_args(&train).fails(1, &["expected", "usable", "out of range", "check"]);
}

#[test]
fn paths_that_are_no_dataset() {
    let scratch = Scratch::empty();
    fs::write(scratch.path("list.txt"), "eggs").unwrap();
    fs::create_dir(scratch.path("holiday")).unwrap();
    fs::write(scratch.path("holiday/beach.txt"), "sun").unwrap();
    for (path, parts) in [
        ("nowhere", &["expected a dataset folder", "found nothing", "check the spelling"][..]),
        ("list.txt", &["expected a dataset folder", "found a file", "give the folder"]),
        ("holiday", &["expected a known layout", "found 1 files", "beach.txt", "give the folder"]),
    ] {
        let parts = [&[path][..], parts].concat();
        scratch.run(&format!("train {path} --out out")).fails(1, &parts);
        if path != "list.txt" {
            scratch.run(&format!("info {path}")).fails(1, &parts);
        }
    }
    scratch
        .run("info list.txt")
        .fails(1, &["list.txt", "expected a model (.ply, .glb, .gltf, .spz, .sog or .splat)"]);
}

#[test]
fn splits_that_do_not_exist() {
    let scratch = Scratch::with_scene();
    let parts = ["room", "expected one of the splits eval, train", "`valid`", "name one"];
    scratch.run("train room --out new --split valid").fails(1, &parts);
    scratch.run("train room --out new --eval valid").fails(1, &parts);
    scratch.run("eval out/scene.ply room --split valid").fails(1, &parts);
    scratch.run("render out/scene.ply -o a.png --dataset room --split valid").fails(1, &parts);
    assert!(!scratch.path("new").exists());
}

/// Views that cannot be evaluated are skipped and counted; the scene is still written.
#[test]
fn damaged_views_do_not_cost_the_scene() {
    let scratch = Scratch::with_room();
    truncate(&scratch.path("room/eval/r_1.png"));
    let train = "train room --out out --preset paper --set components=500 --eval eval";
    let run = scratch.run(&format!("{train} --json")).succeeds();
    assert_eq!(run.stderr.matches("warning: ").count(), 1, "{}", run.stderr);
    let eval = &run.json()["eval"][0];
    assert_eq!(eval["views"], 2);
    assert_eq!(eval["skipped"].as_array().unwrap().len(), 1);
    assert!(eval["skipped"][0]["message"].as_str().unwrap().contains("r_1.png"), "{eval}");

    fs::remove_dir_all(scratch.path("out")).unwrap();
    truncate(&scratch.path("room/eval/r_0.png"));
    truncate(&scratch.path("room/eval/r_2.png"));
    let run = scratch.run(train);
    assert_eq!(run.code, 1, "{}", run.stderr);
    for part in
        ["expected at least one usable view", "`eval`", "found none", "3 skipped", "r_0.png"]
    {
        assert!(run.stderr.contains(part), "`{part}` is missing from: {}", run.stderr);
    }
    assert!(!scratch.model("out/scene.ply").splats.is_empty());
    assert_eq!(scratch.json("out/report.json")["frames"].as_array().unwrap().len(), 8);
}

#[test]
fn a_part_of_a_recording_names_all_of_it() {
    let scratch = Scratch::with_room();
    let parts =
        ["room/train: found a part of a recording, expected all of it", "open the folder above"];
    for command in ["train room/train --out out", "info room/train"] {
        scratch.run(command).fails(1, &parts);
    }
}
