//! Cameras and lenses that files state are used, or refused with the reason: recordings of a room whose
//! surfaces are known, and small recordings with one statement changed.

use crate::common::layouts::TestLayout::{self, *};
use crate::common::scratch::{edit_json, open_plain, tiny};
use crate::common::shared;
use serde_json::json;
use std::fs;
use std::path::Path;
use vbgs_studio::dataset::calibration::ColorCamera;
use vbgs_studio::dataset::{Dataset, FrameEntry, LoadOptions, open};
use vbgs_studio::math::camera::Intrinsics;

/// Boxes of the room of the shared cases, low and high corner, metres; cameras are inside the first.
const ROOM: [[[f64; 3]; 2]; 4] = [
    [[-2.0, -1.2, -2.2], [2.0, 1.2, 2.2]],
    [[-0.5, 0.3, -0.4], [0.4, 1.2, 0.5]],
    [[1.0, 0.6, 0.9], [1.7, 1.2, 1.6]],
    [[-1.8, 0.1, 1.0], [-1.1, 1.2, 1.7]],
];

fn distance_to_room(p: [f64; 3]) -> f64 {
    let one = |[low, high]: [[f64; 3]; 2]| {
        let outside = |i: usize| p[i] - p[i].clamp(low[i], high[i]);
        let out = (0..3).map(|i| outside(i).powi(2)).sum::<f64>().sqrt();
        let inside = (0..3).map(|i| (p[i] - low[i]).min(high[i] - p[i]).abs());
        if out > 0.0 { out } else { inside.fold(f64::INFINITY, f64::min) }
    };
    ROOM.into_iter().map(one).fold(f64::INFINITY, f64::min)
}

/// Distances of all depth pixels from the surfaces, metres: the median, and the limit of 90 %.
fn distances(dataset: &Dataset) -> [f64; 2] {
    let mut all = Vec::new();
    for (i, entry) in dataset.splits[0].frames.iter().enumerate() {
        let depth = dataset.load(0, i).unwrap().depth_z().unwrap();
        let (k, pose) = (entry.camera.intrinsics, entry.camera.pose.to_opencv());
        for (pixel, z) in depth.data.iter().enumerate().filter(|(_, z)| **z > 0.0) {
            let ray = k.ray(pixel % depth.width, pixel / depth.width) * f64::from(*z);
            all.push(distance_to_room(pose.transform_point3(ray).to_array()));
        }
    }
    all.sort_by(f64::total_cmp);
    [all[all.len() / 2], all[all.len() * 9 / 10]]
}

fn photo(entry: &FrameEntry) -> Intrinsics {
    entry.photo_camera(None).intrinsics
}

fn numbers(k: &Intrinsics) -> [f64; 4] {
    [k.fx, k.fy, k.cx, k.cy].map(|v| (v * 1e4).round() / 1e4)
}

#[track_caller]
fn refused(folder: &Path, parts: &[&str]) {
    let said =
        open_plain(folder).map_or_else(|e| e.to_string(), |d| panic!("opened: {:?}", d.notes));
    assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    assert!(said.replace(&folder.display().to_string(), "").chars().count() < 300, "{said}");
}

fn edit(file: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(file).unwrap();
    assert!(text.contains(from), "{text}");
    fs::write(file, text.replacen(from, to, 1)).unwrap();
}

#[test]
fn shifted_camera_matrix_gives_way_to_the_projection() {
    let Some(path) = shared("cases/15-rtabmap-shifted-camera-matrix") else { return };
    let dataset = open_plain(&path).unwrap();
    assert_eq!(dataset.splits[0].frames.len(), 12);
    for frame in &dataset.splits[0].frames {
        assert_eq!(numbers(&frame.camera.intrinsics), [132.8, 132.8, 80.0, 60.0]);
    }
    assert!(dataset.notes.iter().any(|n| n.contains("projection_matrix")), "{:?}", dataset.notes);
    let [median, most] = distances(&dataset);
    assert!(median < 0.004 && most < 0.012, "{median} {most}");
}

#[test]
fn lens_of_a_calibration_is_made_straight() {
    let Some(path) = shared("cases/16-rtabmap-distortion") else { return };
    let [median, most] = distances(&open_plain(&path).unwrap());
    assert!(median < 0.004 && most < 0.012, "{median} {most}");
}

#[test]
fn camera_of_every_scanned_frame_is_used() {
    let Some(path) = shared("cases/04-stray-scanner-intrinsics-per-frame") else { return };
    let dataset = open_plain(&path).unwrap();
    let frames = &dataset.splits[0].frames;
    let found: Vec<_> =
        [0, 11].iter().map(|i| (numbers(&photo(&frames[*i])), photo(&frames[*i]).width)).collect();
    let expected = [276.64, 266.0].map(|f| ([f, f, 160.0, 120.0], 320));
    assert_eq!((frames.len(), found), (12, expected.to_vec()));
    assert_eq!(numbers(&frames[0].camera.intrinsics), [138.32, 138.32, 80.0, 60.0]);
    let [median, most] = distances(&dataset);
    assert!(median < 0.004 && most < 0.012, "{median} {most}");
    assert!(dataset.unused.is_empty(), "empty columns state nothing: {:?}", dataset.unused);
}

#[test]
fn sensor_info_states_both_cameras_and_the_unit() {
    let Some(path) = shared("cases/06-bundlefusion-info-txt") else { return };
    let dataset = open_plain(&path).unwrap();
    let frames = &dataset.splits[0].frames;
    assert_eq!((frames.len(), dataset.known_calibration()), (5, None));
    for k in [photo(&frames[0]), frames[0].camera.intrinsics] {
        assert_eq!((k.width, numbers(&k)), (640, [517.0, 517.0, 318.0, 255.0]));
    }
    let [median, most] = distances(&dataset);
    assert!(median < 0.003 && most < 0.006, "{median} {most}");
}

#[test]
fn images_of_two_lenses_are_refused() {
    let Some(path) = shared("cases/34-colour-16-9-depth-10-9") else { return };
    refused(&path, &["1.78", "1.11", "register depth", "--calibration"]);
    // With both cameras given it opens.
    let intrinsics = Some([76.0, 76.0, 80.0, 72.0]);
    let given = LoadOptions { intrinsics, ..LoadOptions::default() };
    assert!(open(&path, &given).is_err());
    let dataset = open(&path, &LoadOptions { calibrated_photographs: true, ..given }).unwrap();
    assert_eq!(dataset.splits[0].frames[0].camera.intrinsics.fy, 76.0);
}

#[test]
fn calibrations_of_photographs_of_another_size_are_refused() {
    let dataset = open_plain(tiny(Open3d).path()).unwrap();
    let scaling = |principal: [f64; 2], size| {
        let (offset, rotation) = ([0.02, 0.0, 0.0], [0.0; 3]);
        let camera = ColorCamera { focal: [40.0; 2], principal, offset, rotation, size };
        dataset.splits[0].camera_scaling(&camera).map_err(|error| error.to_string())
    };
    assert_eq!(scaling([15.0, 13.0], None), Ok(None));
    assert_eq!(scaling([32.0, 24.0], Some([64, 48])).unwrap().unwrap().found, [32, 24]);
    let said = scaling([32.0, 24.0], None).unwrap_err();
    assert!(said.contains("found 64×48") && said.contains("expected 32×24"), "{said}");
}

/// Calibration files of RTAB-Map with other lens terms.
pub fn with_lens(model: &str, terms: &str) -> tempfile::TempDir {
    let folder = tiny(RtabMap);
    for i in 1..=3 {
        let file = folder.path().join(format!("calib/{i}.yaml"));
        let text = fs::read_to_string(&file).unwrap();
        let lens = format!(
            "distortion_model: {model}\ndistortion_coefficients:\n   rows: 1\n   data: [ {terms} ]\n"
        );
        fs::write(&file, text + &lens).unwrap();
    }
    folder
}

#[test]
fn lens_models_are_used_or_refused() {
    let straight = open_plain(tiny(RtabMap).path()).unwrap().load(0, 0).unwrap();
    let moved = |model: &str, terms: &str| {
        let bent = open_plain(with_lens(model, terms).path()).unwrap().load(0, 0).unwrap();
        let pairs = bent.color.data.iter().zip(&straight.color.data);
        pairs.filter(|(a, b)| a != b).count()
    };
    assert_eq!(moved("plumb_bob", "0., 0., 0., 0., 0."), 0);
    assert_eq!(moved("equidistant", "0., 0., 0., 0."), 0);
    assert!(moved("plumb_bob", "0.1, -0.02, 0.001, 0.") > 100);
    let rational = moved("rational_polynomial", "0.5, -2.7, 0., 0., 1.5, 0.37, -2.5, 1.4");
    let without_quotient = moved("plumb_bob", "0.1, 0., 0., 0., 0.");
    assert!(rational > 50 && rational != without_quotient, "{rational} {without_quotient}");
    // Equal series above and below the line cancel.
    assert_eq!(moved("rational_polynomial", "0.3, 0.1, 0., 0., 0.2, 0.3, 0.1, 0.2"), 0);
    for (model, terms, reason) in [
        ("equidistant", "0.1, 0.01, 0., 0.", "equidistant"),
        ("plumb_bob", "5., 0., 0., 0., 0.", "fold"),
        ("plumb_bob", "-3., 0., 0., 0., 0.", "fold"),
        ("plumb_bob", "nan, 0., 0., 0., 0.", "distortion_coefficients"),
        ("plumb_bob", "1e300, 0., 0., 0., 0.", "fold"),
        ("plumb_bob", "0.1, x", "distortion_coefficients"),
        ("thin_prism", "0., 0., 0., 0., 0., 0., 0., 0., 0.1", "distortion_coefficients"),
    ] {
        refused(with_lens(model, terms).path(), &["calib/1.yaml", reason, "undistort"]);
    }
    let folder = tiny(Nerfstudio);
    let list = folder.path().join("transforms.json");
    edit_json(&list, |json| json["k1"] = json!(5.0));
    refused(folder.path(), &["transforms.json", "fold", "undistort"]);
    for (terms, reason) in [
        (json!([0.0, 0.0, 0.0, 0.1, 0.0, 0.0]), "distortion_params"),
        (json!([0.1, 0.0]), "distortion_params"),
        (json!([5.0, 0.0, 0.0, 0.0, 0.0, 0.0]), "fold"),
    ] {
        edit_json(&list, |json| json["distortion_params"] = terms);
        refused(folder.path(), &["transforms.json", reason, "undistort"]);
    }
    edit_json(&list, |json| json["distortion_params"] = json!([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]));
    let bent = open_plain(folder.path()).unwrap().load(0, 0).unwrap();
    assert_ne!(bent.color, straight.color);
}

#[test]
fn calibration_of_one_image_is_its_own() {
    let focal = |folder: &Path| -> Vec<f64> {
        let dataset = open_plain(folder).unwrap();
        dataset.splits[0].frames.iter().map(|frame| frame.camera.intrinsics.fx).collect()
    };
    let folder = tiny(RtabMap);
    let common = focal(folder.path());
    let file = folder.path().join("calib/2.yaml");
    edit(&file, &format!("{:e}, 0.,", common[0]), "30., 0.,");
    let own = focal(folder.path());
    assert_eq!(own, [common[0], 30.0, common[0], common[0]]);
    // A damaged one costs its frame, a missing one is replaced by the first.
    fs::write(&file, "%YAML:1.0\ncamera_matrix:\n").unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!((dataset.splits[0].frames.len(), dataset.warnings.len()), (3, 1));
    fs::remove_file(&file).unwrap();
    assert_eq!(focal(folder.path()), common);
}

#[test]
fn unused_matrices_of_a_calibration_are_named() {
    let folder = tiny(RtabMap);
    let file = folder.path().join("calib/1.yaml");
    let text = fs::read_to_string(&file).unwrap();
    let other = "projection_matrix:\n   data: [ 99., 0., 16., 0., 0., 99., 12., 0., 0., 0., 1., 0. ]\n\
                 rectification_matrix:\n   data: [ 0., 1., 0., 1., 0., 0., 0., 0., 1. ]\n";
    fs::write(&file, text + other).unwrap();
    let unused = open_plain(folder.path()).unwrap().unused;
    for part in ["projection_matrix", "99", "rectification_matrix"] {
        assert!(unused.iter().any(|line| line.contains(part)), "{unused:?}");
    }
}

#[test]
fn scanned_frames_without_a_usable_camera() {
    let folder = tiny(StrayScanner);
    let file = folder.path().join("odometry.csv");
    let all = photo(&open_plain(folder.path()).unwrap().splits[0].frames[0]);
    let cells = ["50, 51, 16, 12, ", ", , , , ", "50, 0, 16, 12, 7", "nan, 51, 16, 12, "];
    let text = fs::read_to_string(&file).unwrap();
    let lines: Vec<String> = text
        .lines()
        .enumerate()
        .map(|(i, line)| match i {
            0 => format!("{line}, fx, fy, cx, cy, lens_position"),
            i => format!("{line}, {}", cells[i - 1]),
        })
        .collect();
    fs::write(&file, lines.join("\n") + "\n").unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    let found: Vec<_> =
        dataset.splits[0].frames.iter().map(|frame| numbers(&photo(frame))).collect();
    assert_eq!(found, [[50.0, 51.0, 16.0, 12.0], numbers(&all)]);
    assert_eq!(dataset.warnings.len(), 2, "{:?}", dataset.warnings);
    assert!(dataset.unused.len() == 1 && dataset.unused[0].contains("lens_position"));
}

#[test]
fn camera_matrices_are_known_by_content() {
    let matrix = |fx: f64| format!("{fx} 0 16\n0 41 12\n0 0 1\n");
    for (layout, usual) in [
        (Tum, "camera-intrinsics.txt"),
        (Open3d, "camera.json"),
        (SevenScenes, "camera-intrinsics.txt"),
    ] {
        let folder = tiny(layout);
        let at = |name: &str| folder.path().join(name);
        fs::remove_file(at(usual)).unwrap();
        // A pose and a list of times are no cameras.
        fs::write(at("a_pose.txt"), "1 0 0 0.5 0 1 0 0.5 0 0 1 0.5 0 0 0 1\n").unwrap();
        fs::write(at("times.txt"), "1 2 3 4 5 6 7 8 9\n").unwrap();
        assert!(open_plain(folder.path()).is_err(), "{layout:?}");
        fs::write(at("depth_K.txt"), matrix(40.0)).unwrap();
        let k = open_plain(folder.path()).unwrap().splits[0].frames[0].camera.intrinsics;
        assert_eq!(numbers(&k), [40.0, 41.0, 16.0, 12.0], "{layout:?}");
        fs::write(at("other.txt"), matrix(44.0)).unwrap();
        refused(folder.path(), &["other.txt", "depth_K.txt", "keep"]);
        fs::write(at("other.txt"), matrix(40.0)).unwrap();
        assert!(open_plain(folder.path()).is_ok(), "{layout:?}: the same camera twice");
    }
}

#[test]
fn one_of_two_different_camera_files_is_not_picked() {
    let folder = tiny(Open3d);
    let at = |name: &str| folder.path().join(name);
    fs::copy(at("camera.json"), at("other.json")).unwrap();
    assert!(open_plain(folder.path()).is_ok());
    edit_json(&at("other.json"), |json| json["intrinsic_matrix"][0] = json!(77.0));
    refused(folder.path(), &["other.json", "camera.json", "keep"]);
}

pub const INFO: &str = "m_sensorName = Phone\nm_colorWidth = 64\nm_colorHeight = 48\nm_depthWidth = 32\n\
    m_depthHeight = 24\nm_depthShift = 500\n\
    m_calibrationColorIntrinsic = 50 0 16.5 0 0 51 12.5 0 0 0 1 0 0 0 0 1\n\
    m_calibrationColorExtrinsic = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n\
    m_calibrationDepthIntrinsic = 40 0 16 0 0 41 12 0 0 0 1 0 0 0 0 1\n\
    m_calibrationDepthExtrinsic = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n";

#[test]
fn sensor_info_of_each_folder() {
    let folder = tiny(SevenScenes);
    let at = |name: &str| folder.path().join(name);
    fs::remove_file(at("camera-intrinsics.txt")).unwrap();
    fs::write(at("train/_info.txt"), INFO.replace(" 16.5", " 33").replace(" 12.5", " 25")).unwrap();
    let other = INFO.replace("= 40", "= 45").replace("Shift = 500", "Shift = 1000");
    fs::write(at("eval/info.txt"), other.replace(" 16.5", " 33").replace(" 12.5", " 25")).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    let split = |name: &str| dataset.split_named(name).unwrap();
    let first = |name: &str| &dataset.splits[split(name)].frames[0];
    assert_eq!(numbers(&first("train").camera.intrinsics), [40.0, 41.0, 16.0, 12.0]);
    assert_eq!(numbers(&first("eval").camera.intrinsics), [45.0, 41.0, 16.0, 12.0]);
    // Photographs have half the stated size.
    assert_eq!(numbers(&photo(first("train"))), [25.0, 25.5, 16.5, 12.5]);
    let middle = |name: &str| dataset.load(split(name), 0).unwrap().depth_z().unwrap().data[400];
    let codes = |name: &str| {
        let file = at(&format!("{name}/frame-000000.depth.png"));
        image::open(file).unwrap().into_luma16().into_raw()[400]
    };
    for (split, unit) in [("train", 0.002), ("eval", 0.001)] {
        let expected = f64::from(codes(split)) * unit;
        assert!((f64::from(middle(split)) - expected).abs() < 1e-6, "{split}: {expected}");
    }
    // A matrix of the user's takes precedence, and the other file is named.
    fs::write(at("train/camera-intrinsics.txt"), "42 0 16 0 42 12 0 0 1").unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert!(dataset.unused.iter().any(|line| line.contains("_info.txt")), "{:?}", dataset.unused);
}

#[test]
fn bad_sensor_info() {
    let open_with = |from: &str, to: &str| {
        let folder = tiny(SevenScenes);
        fs::remove_file(folder.path().join("camera-intrinsics.txt")).unwrap();
        let text = INFO.replace(" 16.5", " 33").replace(" 12.5", " 25");
        assert!(text.contains(from));
        fs::write(folder.path().join("info.txt"), text.replace(from, to)).unwrap();
        folder
    };
    for (from, to, reason) in [
        ("Shift = 500", "Shift = 0", "depth shift"),
        ("Shift = 500", "Shift = nan", "depth shift"),
        ("Intrinsic = 50 0 33", "Intrinsic = nan 0 33", "field of view"),
        ("Intrinsic = 40 0 16 0", "Intrinsic = 40 0", "found 14 numbers"),
        ("colorWidth = 64", "colorWidth = 0", "one shape"),
        ("colorWidth = 64", "colorWidth = 1e30", "one shape"),
        ("depthHeight = 24", "depthHeight = 32", "one shape"),
    ] {
        refused(open_with(from, to).path(), &["info.txt", reason]);
    }
    let moved = open_with("ColorExtrinsic = 1 0 0 0", "ColorExtrinsic = 1 0 0 0.05");
    let unused = open_plain(moved.path()).unwrap().unused;
    assert!(unused.len() == 1 && unused[0].contains("transform"), "{unused:?}");
}

#[test]
fn published_second_camera_only_without_a_stated_one() {
    let Some(path) = shared("data/kinect_office") else { return };
    assert!(open_plain(&path).unwrap().known_calibration().is_some());
    let folder = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(&path).unwrap().map(Result::unwrap) {
        let name = entry.file_name().into_string().unwrap();
        if name != "camera-intrinsics.txt" {
            copy(&entry.path(), &folder.path().join(name));
        }
    }
    let k = "585 0 320 0 0 585 240 0 0 0 1 0 0 0 0 1";
    let info = format!("m_calibrationColorIntrinsic = {k}\nm_calibrationDepthIntrinsic = {k}\n");
    fs::write(folder.path().join("info.txt"), info).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(dataset.known_calibration(), None);
    assert_eq!(photo(&dataset.splits[0].frames[0]).fx, 585.0);
}

/// Copies a file, or the first few files of a folder.
fn copy(from: &Path, to: &Path) {
    if from.is_file() {
        fs::copy(from, to).unwrap();
        return;
    }
    fs::create_dir_all(to).unwrap();
    let mut files: Vec<_> = fs::read_dir(from).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    files.iter().take(9).for_each(|f| copy(f, &to.join(f.file_name().unwrap())));
}

fn stretch(path: &Path, width: u32, height: u32) {
    let image = image::open(path).unwrap();
    image.resize_exact(width, height, image::imageops::FilterType::Nearest).save(path).unwrap();
}

#[test]
fn depth_of_another_shape_is_refused_in_every_layout() {
    let layouts: [(TestLayout, &str); 5] = [
        (Tum, "depth"),
        (Open3d, "depth"),
        (Nerfstudio, "depths"),
        (StrayScanner, "depth"),
        (RtabMap, "depth"),
    ];
    for (layout, depths) in layouts {
        for (height, is_one_lens) in [(160, false), (122, true), (119, true), (125, false)] {
            let folder = tiny(layout);
            for file in fs::read_dir(folder.path().join(depths)).unwrap() {
                let file = file.unwrap().path();
                stretch(&file, 160, height);
            }
            match (open_plain(folder.path()), is_one_lens) {
                (Ok(dataset), true) => {
                    let k = dataset.splits[0].frames[0].camera.intrinsics;
                    assert_eq!((k.width, k.height), (160, height), "{layout:?}");
                }
                (Err(error), false) => {
                    assert!(error.to_string().contains("one shape"), "{layout:?}: {error}");
                }
                (found, _) => panic!("{layout:?} {height}: {:?}", found.map(|d| d.notes)),
            }
        }
    }
}

#[test]
fn intrinsics_of_another_image_size_are_refused() {
    for (layout, file) in [(Tum, "camera-intrinsics.txt"), (SevenScenes, "camera-intrinsics.txt")] {
        for (k, is_plausible) in [
            ("80 80 32 24", false),
            ("20 20 8 6", false),
            ("80 80 32 18", false),
            ("40 40 17.5 13", true),
            ("40 40 24 12", true),
        ] {
            let folder = tiny(layout);
            fs::write(folder.path().join(file), format!("{k}\n")).unwrap();
            match is_plausible {
                true => assert!(open_plain(folder.path()).is_ok(), "{layout:?}: {k}"),
                false => refused(folder.path(), &[file, "the centre of", "of this size"]),
            }
        }
    }
}
