//! Scanning apps and sets of Apple's lidar: recordings of a known room, small recordings with one statement
//! changed, damaged ones and long ones; and recordings of other programs, which are named.

use crate::common::layouts::TestLayout::{self, *};
use crate::common::layouts::{png, put, write};
use crate::common::scratch::{Files, edit_json, open_plain, tiny};
use crate::common::shared;
use glam::{DMat4, DQuat, DVec3};
use image::ExtendedColorType::{L8, L16};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tempfile::TempDir;
use vbgs_studio::dataset::pose_check::check;
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::{Dataset, FrameEntry, Layout, LoadOptions, PoseConvention, open};
use vbgs_studio::math::image::Image;

const APPS: [TestLayout; 4] = [Polycam, Scanner3d, ArkitScenes, ScannetPp];
/// Photographs of 128×96 and depth of a quarter of it.
const ROOM: SyntheticParams = SyntheticParams {
    width: 128,
    height: 96,
    n_train: 23,
    n_eval: 1,
    seed: 7,
    depth_noise: 0.0,
    ..SyntheticParams::demo()
};
const SCANNET_PP: &str = "iphone/pose_intrinsic_imu.json";

fn all(dataset: &Dataset) -> &[FrameEntry] {
    &dataset.splits[dataset.split_named("all").unwrap()].frames
}

fn focal(frame: &FrameEntry) -> f64 {
    frame.photo_camera(None).intrinsics.fx
}

/// Share of pixels that have depth in all frames.
fn share_of_depth(dataset: &Dataset) -> f64 {
    let frames = (0..all(dataset).len()).map(|i| dataset.load(0, i).unwrap().depth_z().unwrap());
    let pixels: Vec<f32> = frames.flat_map(|depth| depth.data).collect();
    pixels.iter().filter(|z| **z > 0.0).count() as f64 / pixels.len() as f64
}

#[track_caller]
fn refused(path: &Path, options: &LoadOptions, parts: &[&str]) {
    let said = open(path, options).map_or_else(|e| e.to_string(), |d| panic!("{:?}", d.notes));
    assert!(parts.iter().all(|part| said.contains(part)), "{parts:?}: {said}");
    let shown = said.replace(&path.display().to_string(), "");
    assert!(shown.chars().count() < 300, "{said}");
}

/// Asserts that one frame of four is skipped, with a warning that contains all parts.
#[track_caller]
fn skips_one(path: &Path, parts: &[&str]) {
    let dataset = open_plain(path).unwrap();
    let said: Vec<String> = dataset.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(all(&dataset).len(), 3, "{said:?}");
    assert!(said.len() == 1 && parts.iter().all(|part| said[0].contains(part)), "{said:?}");
    assert!((0..3).all(|i| dataset.load(0, i).is_ok()));
}

#[track_caller]
fn notes(dataset: &Dataset, part: &str) {
    assert!(dataset.notes.iter().any(|note| note.contains(part)), "{part}: {:?}", dataset.notes);
}

/// Files of a folder, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// JSON files of the used cameras of Polycam.
fn cameras(folder: &TempDir) -> Vec<PathBuf> {
    files(&folder.path().join("keyframes/corrected_cameras"))
}

fn edit(file: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(file).unwrap();
    assert!(text.contains(from), "{text}");
    fs::write(file, text.replacen(from, to, 1)).unwrap();
}

/// Opens a shared case of eight frames with a focal length of 132.8 for 160×120.
fn opens(path: &Path, layout: Layout) -> Dataset {
    let dataset = open_plain(path).unwrap();
    assert_eq!((dataset.layout, all(&dataset).len()), (layout, 8), "{:?}", dataset.warnings);
    assert!(dataset.warnings.is_empty() && dataset.unused.is_empty(), "{:?}", dataset.unused);
    for frame in all(&dataset) {
        let k = frame.camera.intrinsics;
        assert!((k.fx - 132.8).abs() < 1e-9 && (k.width, k.height) == (160, 120), "{k:?}");
        assert!((focal(frame) - 132.8).abs() < 1e-9 && frame.time.is_some());
    }
    let found = check(&dataset, 0).unwrap();
    assert!(found.opened.agreement > 0.95 && found.warnings().is_empty(), "{found:?}");
    assert!(share_of_depth(&dataset) > 0.8);
    dataset
}

#[test]
fn shared_recordings_of_apps_and_sets_open() {
    if let Some(path) = shared("cases/23-polycam-raw") {
        let dataset = opens(&path, Layout::Polycam);
        let inner = opens(&path.join("keyframes"), Layout::Polycam);
        assert_eq!(all(&inner)[3].camera, all(&dataset)[3].camera);
        let times: Vec<f64> = all(&dataset).iter().filter_map(|frame| frame.time).collect();
        assert!((times[7] - times[0] - 7.0 / 60.0).abs() < 1e-6, "{times:?}");
    }
    if let Some(path) = shared("cases/24-arkitscenes") {
        opens(&path, Layout::ArkitScenes);
    }
    if let Some(path) = shared("cases/25-scannetpp-iphone") {
        let dataset = opens(&path, Layout::ScannetPp);
        let inner = opens(&path.join("iphone"), Layout::ScannetPp);
        assert_eq!(all(&inner)[3].camera, all(&dataset)[3].camera);
    }
}

#[test]
fn written_recordings_agree_with_their_poses() {
    for layout in APPS {
        let folder = tempfile::tempdir().unwrap();
        write(&ROOM, folder.path(), layout, &mut |_, _| ()).unwrap();
        let dataset = open_plain(folder.path()).unwrap();
        assert_eq!(all(&dataset).len(), 24, "{layout:?}: {:?}", dataset.warnings);
        let found = check(&dataset, 0).unwrap();
        // Small depth images disagree at edges.
        assert!(found.opened.agreement > 0.75 && found.warnings().is_empty(), "{found:?}");
        assert!(dataset.unused.is_empty() && dataset.is_metric(), "{:?}", dataset.unused);
        let step = all(&dataset)[1].time.unwrap() - all(&dataset)[0].time.unwrap();
        let expected = if layout == ArkitScenes { 0.1 } else { 1.0 / 30.0 };
        assert!((step - expected).abs() < 1e-4, "{layout:?}: {step}");
        let wrong = LoadOptions {
            poses: Some(PoseConvention::OpencvWorldToCamera),
            ..LoadOptions::default()
        };
        let wrong = check(&open(folder.path(), &wrong).unwrap(), 0).unwrap();
        assert!(wrong.opened.agreement < 0.5, "{layout:?}: {wrong:?}");
    }
}

// Polycam.

#[test]
fn corrected_cameras_belong_to_corrected_images() {
    let folder = tiny(Polycam);
    let raw = files(&folder.path().join("keyframes/cameras"));
    raw.iter().for_each(|file| edit_json(file, |json| json["fx"] = json!(77.0)));
    let corrected = open_plain(folder.path()).unwrap();
    assert!(all(&corrected).iter().all(|frame| focal(frame) != 77.0));
    // A frame that the app could not place has neither a corrected image nor a corrected camera.
    fs::remove_file(&cameras(&folder)[2]).unwrap();
    fs::remove_file(&files(&folder.path().join("keyframes/corrected_images"))[2]).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!((all(&dataset).len(), dataset.warnings.len()), (3, 0));
    notes(&dataset, "1 frames without corrected camera are left out");
    // Depth follows the number.
    assert_eq!(all(&dataset)[2].name, all(&corrected)[3].name);
    assert_eq!(all(&dataset)[2].camera, all(&corrected)[3].camera);
    let name = format!("{}.png", all(&corrected)[3].name);
    assert!(all(&dataset)[2].depth_path().unwrap().ends_with(name));
    fs::remove_dir_all(folder.path().join("keyframes/corrected_images")).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(all(&dataset).len(), 4, "{:?}", dataset.warnings);
    assert!(all(&dataset).iter().all(|frame| focal(frame) == 77.0));
}

#[test]
fn polycam_files_that_are_lost_or_damaged_cost_their_frame() {
    let second = |folder: &TempDir, name: &str| {
        files(&folder.path().join("keyframes").join(name))[1].clone()
    };
    for (name, part) in [
        ("corrected_images", "expected a colour image"),
        ("corrected_cameras", "expected a pose file"),
        ("depth", "expected a depth image"),
        ("confidence", "expected a confidence map"),
    ] {
        let folder = tiny(Polycam);
        fs::remove_file(second(&folder, name)).unwrap();
        skips_one(folder.path(), &[part, "found none"]);
    }
    // Without corrected cameras, depth shows that both other files are lost.
    let folder = tiny(Polycam);
    fs::remove_dir_all(folder.path().join("keyframes/corrected_cameras")).unwrap();
    for name in ["images", "cameras"] {
        fs::remove_file(second(&folder, name)).unwrap();
    }
    skips_one(folder.path(), &["expected a colour image"]);
    type Damage = fn(&mut Value);
    let damages: [(Damage, &str); 8] = [
        (|json| json["t_12"] = json!("NaN"), "`t_00` to `t_23`"),
        (|json| drop(json.as_object_mut().unwrap().remove("t_03")), "`t_00` to `t_23`"),
        (|json| json["t_11"] = json!(1e300), "expected a rotation"),
        (|json| json["fx"] = json!(null), "`fx`, `fy`, `cx` and `cy`"),
        (|json| json["fy"] = json!(-5.0), "field of view"),
        (|json| (json["width"], json["height"]) = (json!(32), json!(12)), "one shape"),
        (|json| (json["width"], json["height"]) = (json!(0), json!(0)), "camera: expected"),
        (|json| (json["width"], json["height"]) = (json!(-1e30), json!(1e30)), "one shape"),
    ];
    for (damage, part) in damages {
        let folder = tiny(Polycam);
        edit_json(&cameras(&folder)[1], damage);
        skips_one(folder.path(), &[part]);
    }
    for text in ["", "{\"fx\": 1", "[]", "\u{0}\u{1}"] {
        let folder = tiny(Polycam);
        fs::write(&cameras(&folder)[1], text).unwrap();
        skips_one(folder.path(), &["corrected_cameras", "expected", "found", "remove the frame"]);
    }
    let folder = tiny(Polycam);
    let json = fs::read_to_string(&cameras(&folder)[1]).unwrap();
    let nan = json.replacen("\"t_00\":", "\"t_00\":NaN,\"old\":", 1);
    fs::write(&cameras(&folder)[1], nan).unwrap();
    skips_one(folder.path(), &["`t_00` to `t_23`"]);
}

#[test]
fn polycam_states_are_used_or_named() {
    let folder = tiny(Polycam);
    let half = |json: &mut Value| {
        for key in ["fx", "fy", "cx", "cy"] {
            json[key] = json!(2.0 * json[key].as_f64().unwrap());
        }
        (json["width"], json["height"]) = (json!(64), json!(48));
    };
    let expected = focal(&all(&open_plain(folder.path()).unwrap())[0]);
    cameras(&folder).iter().for_each(|file| edit_json(file, half));
    let dataset = open_plain(folder.path()).unwrap();
    assert!((focal(&all(&dataset)[0]) - expected).abs() < 1e-9);
    notes(&dataset, "stated for images of 64x48 and scaled to photographs of 32x24");
    edit_json(&cameras(&folder)[0], |json| json["k1"] = json!(-0.1));
    let mesh = json!({ "alignmentTransform": [0.0, 1.0] });
    fs::write(folder.path().join("mesh_info.json"), mesh.to_string()).unwrap();
    let unused = open_plain(folder.path()).unwrap().unused.join(" ");
    assert!(unused.contains("k1") && unused.contains("transform of the mesh"), "{unused}");
    let twice = files(&folder.path().join("keyframes/corrected_images"))[1].clone();
    fs::copy(&twice, twice.with_extension("png")).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!((all(&dataset).len(), dataset.warnings.len()), (4, 1));
    assert!(dataset.warnings[0].to_string().contains("expected one of each frame"));
}

#[test]
fn shades_of_confidence_have_three_levels() {
    let shares = [(1, [0.25, 0.75]), (128, [0.25, 0.75]), (54, [0.25, 0.75])].map(|(middle, _)| {
        let folder = tiny(Polycam);
        let white = if middle == 1 { 2 } else { 255 };
        for file in files(&folder.path().join("keyframes/confidence")) {
            let size = image::image_dimensions(&file).unwrap();
            let [width, height] = [size.0 as usize, size.1 as usize];
            let levels = [0, middle, white, white];
            let data = (0..width * height).map(|i| levels[i % 4]).collect();
            let map = Image::from_vec(width, height, data);
            fs::write(&file, png(&map.data, &map, L8)).unwrap();
        }
        [0, 1, 2].map(|least| {
            let options = LoadOptions { confidence: Some(least), ..LoadOptions::default() };
            share_of_depth(&open(folder.path(), &options).unwrap())
        })
    });
    let [all, sure, most] = shares[0];
    assert!((sure / all - 0.75).abs() < 0.02 && (most / all - 0.5).abs() < 0.02, "{shares:?}");
    assert!(shares.iter().all(|share| *share == shares[0]), "{shares:?}");
}

// 3D Scanner App.

#[test]
fn scanner_app_frames_are_those_with_photograph_and_depth() {
    let folder = tiny(Scanner3d);
    fs::remove_file(folder.path().join("frame_00001.jpg")).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!((all(&dataset).len(), dataset.warnings.len()), (3, 0));
    notes(&dataset, "1 depth images have no photograph");
    let folder = tiny(Scanner3d);
    fs::remove_file(folder.path().join("depth_00002.png")).unwrap();
    skips_one(folder.path(), &["expected a depth image", "frame_00002"]);
    for (from, part) in [("cameraPoseARFrame", "16 in `cameraPoseARFrame`"), ("intrinsics", "nine")]
    {
        let folder = tiny(Scanner3d);
        edit(&folder.path().join("frame_00001.json"), from, "lost");
        skips_one(folder.path(), &[part, "frame_00001"]);
    }
}

// ARKitScenes.

/// Recording of a camera that moves along x and turns about y, with poses at 10 Hz and `n` frames at `rate`.
fn moving(n: usize, rate: f64) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut poses = String::new();
    for i in 0..=(n as f64 / rate * 10.0) as usize + 1 {
        let time = 100.0 + 0.1 * i as f64;
        let inverse = truth(time).inverse();
        let (turn, at) = (DQuat::from_mat4(&inverse).to_scaled_axis(), inverse.w_axis);
        writeln!(poses, "{time:.4} {} {} {} {} {} {}", turn.x, turn.y, turn.z, at.x, at.y, at.z)
            .unwrap();
    }
    put(folder.path(), "lowres_wide.traj", poses.as_bytes());
    let colors: Image<u8> = Image::filled(32, 24, 90);
    let depth: Vec<u8> = [1500u16; 16 * 12].iter().flat_map(|code| code.to_ne_bytes()).collect();
    for i in 0..n {
        let time = 100.0 + i as f64 / rate;
        put(
            folder.path(),
            &format!("lowres_wide/7_{time:.3}.png"),
            &png(&colors.data, &colors, L8),
        );
        let shape: Image<u8> = Image::filled(16, 12, 0);
        put(folder.path(), &format!("lowres_depth/7_{time:.3}.png"), &png(&depth, &shape, L16));
        let name = format!("lowres_wide_intrinsics/7_{:.3}.pincam", time + 0.001);
        put(folder.path(), &name, format!("32 24 {} 28 16 12", 28.0 + i as f64 / 100.0).as_bytes());
    }
    folder
}

fn truth(time: f64) -> DMat4 {
    let turn = DQuat::from_rotation_y(0.7 * (time - 100.0));
    DMat4::from_rotation_translation(turn, DVec3::X * 0.4 * (time - 100.0))
}

#[test]
fn poses_are_interpolated_and_cameras_nearest_in_time() {
    let folder = moving(60, 60.0);
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(all(&dataset).len(), 60, "{:?}", dataset.warnings);
    for (i, frame) in all(&dataset).iter().enumerate() {
        let expected = truth(frame.time.unwrap());
        assert!(frame.camera.pose.to_opencv().abs_diff_eq(expected, 1e-6), "{i}");
        assert!((focal(frame) - 28.0 - i as f64 / 100.0).abs() < 1e-9, "{i}");
    }
    let traj = folder.path().join("lowres_wide.traj");
    let text = fs::read_to_string(&traj).unwrap();
    // Three poses are lost: no pose is invented across the gap.
    let damaged: Vec<String> = text
        .lines()
        .enumerate()
        .map(|(i, line)| match i {
            3 => "nan ".repeat(7),
            4 => "lost".to_owned(),
            5 => String::new(),
            _ => line.to_owned(),
        })
        .collect();
    fs::write(&traj, damaged.join("\n")).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    let said: Vec<String> = dataset.warnings.iter().map(ToString::to_string).collect();
    assert!(
        said.iter().filter(|s| s.contains("expected seven finite numbers")).count() == 2,
        "{said:?}"
    );
    assert!(said.iter().any(|s| s.contains("expected a pose within 75 ms of 100.4")), "{said:?}");
    let n = all(&dataset).len();
    assert!((40..50).contains(&n), "{n}");
    fs::remove_file(&traj).unwrap();
    refused(
        folder.path(),
        &LoadOptions::default(),
        &["lowres_wide.traj", "no such file", "--poses track"],
    );
}

#[test]
fn sharper_photographs_and_subfolders_of_arkit_scenes() {
    let folder = moving(60, 60.0);
    // Every other frame has a sharper photograph; no file states its camera.
    let sharp: Image<u8> = Image::filled(64, 48, 90);
    for i in (0..60).step_by(2) {
        let name = format!("vga_wide/7_{:.3}.png", 100.0 + i as f64 / 60.0);
        put(folder.path(), &name, &png(&sharp.data, &sharp, L8));
    }
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!((all(&dataset).len(), dataset.warnings.len()), (30, 0), "{:?}", dataset.warnings);
    assert!((focal(&all(&dataset)[0]) - 56.0).abs() < 1e-9);
    notes(&dataset, "photographs of vga_wide/ are used, not of lowres_wide");
    notes(&dataset, "30 photographs and 60 depth images: those of one time are used");
    let outer = tempfile::tempdir().unwrap();
    Files::read(folder.path()).write(&outer.path().join("7_frames"));
    let inner = open_plain(outer.path()).unwrap();
    assert_eq!((inner.layout, all(&inner).len()), (Layout::ArkitScenes, 30));
    assert_eq!(all(&inner)[7].camera, all(&dataset)[7].camera);
}

#[test]
fn damaged_arkit_scenes_cost_their_frame() {
    let camera = "lowres_wide_intrinsics/41048190_6845.100.pincam";
    for (text, part) in [
        ("32 24 20 20", "4 numbers"),
        ("32 24 nan nan 16 12", "field of view"),
        ("32 12 27 27 16 12", "one shape"),
        ("0 0 27 27 16 12", "camera: expected"),
        ("1e300 -5 27 27 16 12", "one shape"),
    ] {
        let folder = tiny(ArkitScenes);
        fs::write(folder.path().join(camera), text).unwrap();
        skips_one(folder.path(), &[part]);
    }
    let folder = tiny(ArkitScenes);
    fs::remove_file(folder.path().join(camera)).unwrap();
    skips_one(folder.path(), &["`w h fx fy cx cy` at the frame's time", "6845.100"]);
    let folder = tiny(ArkitScenes);
    let depth = folder.path().join("lowres_depth/41048190_6845.100.png");
    fs::copy(&depth, depth.with_file_name("2_6845.100.png")).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!((all(&dataset).len(), dataset.warnings.len()), (4, 1));
    assert!(dataset.warnings[0].to_string().contains("at that time"), "{:?}", dataset.warnings);
}

// ScanNet++.

#[test]
fn scannet_pp_never_mixes_two_worlds() {
    let folder = tiny(ScannetPp);
    let list = folder.path().join(SCANNET_PP);
    let expected = open_plain(folder.path()).unwrap();
    edit_json(&list, |json| {
        drop(json["frame_000010"].as_object_mut().unwrap().remove("aligned_pose"));
    });
    skips_one(folder.path(), &["found no matrix", "frame_000010"]);
    edit_json(&list, |json| {
        for entry in json.as_object_mut().unwrap().values_mut() {
            entry.as_object_mut().unwrap().remove("aligned_pose");
        }
        json["frame_000015"] = json["frame_000010"].clone();
    });
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!((all(&dataset).len(), dataset.warnings.len()), (4, 0));
    notes(&dataset, "ARKit's own `pose` is used");
    notes(&dataset, "1 of 5 listed frames have no images");
    for (frame, expected) in all(&dataset).iter().zip(all(&expected)) {
        assert!(frame.camera.pose.to_opencv().abs_diff_eq(expected.camera.pose.to_opencv(), 1e-9));
    }
}

#[test]
fn damaged_entries_of_scannet_pp_cost_their_frame() {
    type Damage = fn(&mut Value);
    let damages: [(Damage, &str); 6] = [
        (|e| e["aligned_pose"][0][0] = json!("NaN"), "found an array of 4"),
        (|e| e["aligned_pose"] = json!([1, 2]), "2 numbers"),
        (|e| e["aligned_pose"][1][1] = json!(9.0), "expected a rotation"),
        (|e| e["intrinsic"] = json!(null), "nine numbers"),
        (|e| e["intrinsic"][0][2] = json!(1e6), "principal point"),
        (|e| *e = json!(7), "found no matrix"),
    ];
    for (damage, part) in damages {
        let folder = tiny(ScannetPp);
        edit_json(&folder.path().join(SCANNET_PP), |json| damage(&mut json["frame_000010"]));
        skips_one(folder.path(), &[part, "frame_000010"]);
    }
    let folder = tiny(ScannetPp);
    let list = folder.path().join(SCANNET_PP);
    edit(&list, "frame_000010", "frame_000000");
    let dataset = open_plain(folder.path()).unwrap();
    let said: Vec<String> = dataset.warnings.iter().map(ToString::to_string).collect();
    assert_eq!((all(&dataset).len(), said.len()), (3, 2), "{said:?}");
    assert!(said[0].contains("another entry of `frame_000000`"), "{said:?}");
    assert!(said[1].contains("expected an entry for this frame"), "{said:?}");
    let text = fs::read_to_string(&list).unwrap();
    fs::write(&list, &text[..text.len() / 2]).unwrap();
    refused(folder.path(), &LoadOptions::default(), &[SCANNET_PP, "expected JSON", "export"]);
}

#[test]
fn scannet_pp_photographs_may_be_downscaled_and_packed_ones_are_named() {
    let folder = tiny(ScannetPp);
    edit_json(&folder.path().join(SCANNET_PP), |json| {
        for entry in json.as_object_mut().unwrap().values_mut() {
            entry["intrinsic"] = json!([[1500.0, 0, 960.0], [0, 1500.0, 720.0], [0, 0, 1]]);
        }
    });
    let dataset = open_plain(folder.path()).unwrap();
    assert!((focal(&all(&dataset)[0]) - 25.0).abs() < 1e-9);
    notes(&dataset, "stated for images of 1920x1440 and scaled to photographs of 32x24");
    fs::remove_dir_all(folder.path().join("iphone/rgb")).unwrap();
    fs::write(folder.path().join("iphone/rgb.mkv"), "").unwrap();
    for path in [folder.path().to_owned(), folder.path().join("iphone")] {
        let track = LoadOptions { track: true, ..LoadOptions::default() };
        refused(&path, &track, &["rgb.mkv", "unpack", "iphone.prepare_iphone_data"]);
    }
}

// Recordings of other programs.

#[test]
fn recordings_that_are_not_read_are_named() {
    for (name, parts) in [
        ("take.mkv", &["found a Matroska video", "Open3D", "--poses track"][..]),
        ("walk.bag", &["found a bag of ROS", "mcap convert"]),
        ("walk_0.db3", &["found a bag of ROS", "mcap convert"]),
        ("room.svo2", &["found a video of a ZED", "ZED SDK"]),
        ("scene0000_00.sens", &["found a stream of ScanNet", "SensReader"]),
        ("Room.USDZ", &["found a finished model", "raw data"]),
        ("mesh.ply", &["found a finished model", "raw data"]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(name);
        fs::write(&file, "some bytes").unwrap();
        refused(folder.path(), &LoadOptions::default(), &[&[name, "expected"], parts].concat());
        let said = open_plain(&file).unwrap_err().to_string();
        let is_model = parts[0].contains("model");
        assert_eq!(said.contains(parts[0]), !is_model, "{said}");
        fs::write(folder.path().join("notes.txt"), "").unwrap();
        let said = open_plain(folder.path()).unwrap_err().to_string();
        assert_eq!(said.contains(parts[0]), !is_model, "{said}");
    }
}

// Long recordings.

/// Writes `n` frames with the images of the first one of a small recording.
fn long(layout: TestLayout, n: usize) -> TempDir {
    let (small, folder) = (tiny(layout), tempfile::tempdir().unwrap());
    let mut list = serde_json::Map::new();
    let mut poses = String::new();
    for (path, bytes) in Files::read(small.path()).iter() {
        let text = path.to_str().unwrap();
        let first = match layout {
            Polycam => text.contains("109085000000").then_some("109085000000"),
            Scanner3d => text.contains("00000").then_some("00000"),
            ArkitScenes => text.contains("6845.000").then_some("6845.000"),
            _ => text.contains("000000").then_some("000000"),
        };
        let number = |i: usize| match layout {
            Polycam => (109_085_000_000 + 33_333 * i).to_string(),
            Scanner3d => format!("{i:05}"),
            ArkitScenes => format!("{:.3}", 6845.0 + 0.1 * i as f64),
            _ => format!("{i:06}"),
        };
        match first {
            Some(first) => {
                (0..n).for_each(|i| put(folder.path(), &text.replace(first, &number(i)), bytes))
            }
            None if text == SCANNET_PP => {
                let json: Value = serde_json::from_slice(bytes).unwrap();
                list.extend(
                    (0..n).map(|i| (format!("frame_{i:06}"), json["frame_000000"].clone())),
                );
                put(folder.path(), text, json!(list).to_string().as_bytes());
            }
            None if text == "lowres_wide.traj" => {
                let line = String::from_utf8_lossy(bytes);
                let (_, pose) = line.lines().next().unwrap().split_once(' ').unwrap();
                (0..n).for_each(|i| writeln!(poses, "{} {pose}", number(i)).unwrap());
                put(folder.path(), text, poses.as_bytes());
            }
            None => {}
        }
    }
    folder
}

#[test]
fn long_recordings_open_fast() {
    for layout in APPS {
        let folder = long(layout, 2000);
        let start = Instant::now();
        let dataset = open_plain(folder.path()).unwrap();
        let taken = start.elapsed().as_secs_f64();
        assert_eq!(all(&dataset).len(), 2000, "{layout:?}: {:?}", dataset.warnings.first());
        eprintln!("{layout:?}: {taken:.3} s for 2000 frames");
        assert!(taken < 3.0, "{layout:?}: {taken} s");
    }
}
