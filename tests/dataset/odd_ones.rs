//! A single damaged frame among good ones is skipped, at any position. Camera data in the files are
//! used or refused, never ignored.

use crate::common::layouts::TestLayout::{self, *};
use crate::common::scratch::{edit_json, open_plain, tiny};
use image::GenericImageView;
use serde_json::json;
use std::path::Path;
use vbgs_studio::dataset::synthetic::write::DepthBits;
use vbgs_studio::dataset::{Dataset, LoadOptions, capture_check, open};

/// Layouts and the photograph of their first frame.
const FIRST: [(TestLayout, &str); 12] = [
    (Blender(DepthBits::Sixteen), "train/r_0.png"),
    (SevenScenes, "train/frame-000000.color.png"),
    (Tum, "rgb/1000.000000.png"),
    (Open3d, "color/00000.png"),
    (Replica, "results/frame000000.jpg"),
    (Scannet, "color/0.jpg"),
    (Nerfstudio, "images/frame_00001.png"),
    (Record3d, "rgb/0.jpg"),
    (RtabMap, "rgb/1.png"),
    (Scanner3d, "frame_00000.jpg"),
    (ArkitScenes, "lowres_wide/41048190_6845.000.png"),
    (ScannetPp, "iphone/rgb/frame_000000.jpg"),
];

/// Number of training frames that load, and the messages about the others.
fn loaded(dataset: &Dataset) -> (usize, Vec<String>) {
    let split = dataset.training_split().unwrap();
    let frames = 0..dataset.splits[split].frames.len();
    let (good, bad): (Vec<_>, Vec<_>) =
        frames.map(|i| dataset.load(split, i)).partition(Result::is_ok);
    let refused = dataset.warnings.iter().map(ToString::to_string);
    let bad = bad.into_iter().filter_map(Result::err).map(|error| error.to_string());
    (good.len(), refused.chain(bad).collect())
}

fn halve(path: &Path) {
    let image = image::open(path).unwrap();
    let (width, height) = image.dimensions();
    let half = image.resize_exact(width / 2, height / 2, image::imageops::FilterType::Nearest);
    half.into_rgb8().save(path).unwrap();
}

#[test]
fn a_first_photograph_of_half_the_size_costs_one_frame() {
    for (layout, file) in FIRST {
        let folder = tiny(layout);
        let (n, said) = loaded(&open_plain(folder.path()).unwrap());
        assert!(said.is_empty(), "{layout:?}: {said:?}");
        halve(&folder.path().join(file));
        let dataset = open_plain(folder.path()).unwrap_or_else(|e| panic!("{layout:?}: {e}"));
        let (left, said) = loaded(&dataset);
        assert_eq!(left, n - 1, "{layout:?}: {said:?}");
        let number = file.rsplit('/').next().unwrap().split('.').next().unwrap();
        assert!(
            said.len() == 1 && said[0].contains("16x12") && said[0].contains(number),
            "{layout:?}: {said:?}"
        );
    }
}

#[test]
fn a_first_depth_of_eight_bits_costs_one_frame() {
    let folder = tiny(Blender(DepthBits::Sixteen));
    let depth = folder.path().join("train/r_0_depth_0001.png");
    assert!(depth.exists());
    image::GrayImage::from_pixel(32, 24, image::Luma([90])).save(&depth).unwrap();
    let (left, said) = loaded(&open_plain(folder.path()).unwrap());
    assert_eq!(left, 2, "{said:?}");
    assert!(said[0].contains("r_0_depth") && said[0].contains("16-bit"), "{said:?}");
}

#[track_caller]
fn refuses(
    layout: TestLayout,
    list: &str,
    edit: impl FnOnce(&mut serde_json::Value),
    parts: &[&str],
) {
    let folder = tiny(layout);
    edit_json(&folder.path().join(list), edit);
    let said = match open_plain(folder.path()) {
        Err(error) => error.to_string(),
        Ok(dataset) => panic!("opened: {:?}", loaded(&dataset)),
    };
    for part in parts.iter().chain(&[list]) {
        assert!(said.contains(part), "`{part}` is missing from: {said}");
    }
}

#[test]
fn cameras_that_are_not_used_are_refused() {
    let blender = Blender(DepthBits::Eight);
    for (layout, list) in [(blender, "transforms_train.json"), (Nerfstudio, "transforms.json")] {
        for (key, value) in [
            ("camera_model", json!("OPENCV_FISHEYE")),
            ("is_fisheye", json!(true)),
            ("k5", json!(0.1)),
        ] {
            let parts = [key, "perspective", "undistort"];
            refuses(layout, list, |json| json[key] = value.clone(), &parts);
            if layout == Nerfstudio {
                let folder = tiny(layout);
                edit_json(&folder.path().join(list), |json| json["frames"][1][key] = value);
                let (left, said) = loaded(&open_plain(folder.path()).unwrap());
                assert!(left == 3 && parts.iter().all(|part| said[0].contains(part)), "{said:?}");
            }
        }
        refuses(layout, list, |json| json["w"] = json!(33), &["size 33x24", "32x24"]);
    }
}

/// Frames of NeRF-synthetic lists may name depth, have their own camera, or state both angles of view.
#[test]
fn cameras_of_single_frames_and_both_angles_are_used() {
    let folder = tiny(Nerfstudio);
    let list = folder.path().join("transforms.json");
    edit_json(&list, |json| json["frames"][1]["fl_x"] = json!(99.0));
    let dataset = open_plain(folder.path()).unwrap();
    let focal = |i: usize| dataset.splits[0].frames[i].camera.intrinsics.fx;
    assert!(focal(1) == 99.0 && focal(0) != 99.0);

    let folder = tiny(Blender(DepthBits::Eight));
    let list = folder.path().join("transforms_train.json");
    let square = open_plain(folder.path()).unwrap().splits[0].frames[0].camera.intrinsics;
    edit_json(&list, |json| json["camera_angle_y"] = json!(0.9));
    let dataset = open_plain(folder.path()).unwrap();
    let split = dataset.split_named("train").unwrap();
    let k = dataset.splits[split].frames[0].camera.intrinsics;
    assert_eq!(k.fx, square.fx);
    assert!((k.fy - 12.0 / 0.45f64.tan()).abs() < 1e-9, "{k:?}");
}

#[test]
fn intrinsics_that_are_given_are_used_in_every_layout() {
    let given = LoadOptions { intrinsics: Some([40.0, 41.0, 7.0, 5.0]), ..LoadOptions::default() };
    for (layout, _) in FIRST {
        let folder = tiny(layout);
        let dataset = open(folder.path(), &given).unwrap();
        let k = dataset.splits[0].frames[0].camera.intrinsics;
        assert_eq!([k.fx, k.fy, k.cx, k.cy], [40.0, 41.0, 7.0, 5.0], "{layout:?}");
    }
}

#[test]
fn a_sequence_of_two_splits_is_said() {
    let folder = tiny(SevenScenes);
    std::fs::rename(folder.path().join("train"), folder.path().join("seq-01")).unwrap();
    std::fs::write(folder.path().join("TrainSplit.txt"), "sequence1\n").unwrap();
    std::fs::write(folder.path().join("TestSplit.txt"), "sequence1\n").unwrap();
    let notes = open_plain(folder.path()).unwrap().notes.join("; ");
    assert!(notes.contains("`test` and `train` share seq-01"), "{notes}");
}

/// A forged header of a hundred bytes may declare 30 million pixels. It is refused before
/// allocation, also where a grey image would replace the photograph.
#[test]
fn sizes_that_no_file_can_hold_are_refused_before_pictures_are_made() {
    let folder = tiny(StrayScanner);
    std::fs::remove_dir_all(folder.path().join("rgb")).unwrap();
    for file in std::fs::read_dir(folder.path().join("depth")).unwrap() {
        let path = file.unwrap().path();
        let mut bytes = std::fs::read(&path).unwrap();
        // After the signature and the length: `IHDR`, width, height, five bytes, checksum.
        bytes[16..24].copy_from_slice(&[6000u32, 5000].map(u32::to_be_bytes).concat());
        let sum = crc32fast::hash(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&sum.to_be_bytes());
        std::fs::write(path, bytes).unwrap();
    }
    let dataset =
        open(folder.path(), &LoadOptions { geometry_only: true, ..LoadOptions::default() });
    let dataset = dataset.unwrap();
    let frame = &dataset.splits[0].frames[0];
    assert_eq!(frame.camera.intrinsics.width, 6000);
    for refused in [frame.load().map(drop), frame.load_color().map(drop)] {
        let said = refused.unwrap_err().to_string();
        assert!(said.contains("6000x5000 pixels in "), "{said}");
    }
    // Grey placeholder images are not checked for capture problems.
    assert_eq!(capture_check::check(&dataset.splits[0]).looked_at, 0);
}
