//! Frame lists of several cameras, splits, masks and defects, and codes of depth.

use crate::common::layouts::TestLayout::{self, Nerfstudio};
use crate::common::scratch::{Files, edit_json, open_plain, tiny};
use crate::common::shared;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image as ExrImage, ImageAttributes, Layer,
    LayerAttributes, WritableImage,
};
use glam::DVec3;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use tempfile::TempDir;
use vbgs_studio::dataset::frame::{DepthCodes, Frame};
use vbgs_studio::dataset::pose_check::{PoseCheck, check};
use vbgs_studio::dataset::surface::{Preparer, Sensor, SurfaceSettings};
use vbgs_studio::dataset::{Dataset, LoadOptions, PoseConvention, open};
use vbgs_studio::math::measured_pixel::MASKED;
use vbgs_studio::observation::surface::Observation;

const LIST: &str = "transforms.json";

/// Box in the middle of the room that all cases show, low and high corner.
const BOX: [DVec3; 2] = [DVec3::new(-0.5, 0.3, -0.4), DVec3::new(0.4, 1.2, 0.5)];

fn case(name: &str) -> Option<Dataset> {
    Some(open_plain(&shared(&format!("cases/{name}"))?).unwrap())
}

/// Copy of a case that may be edited.
fn copy(name: &str) -> Option<TempDir> {
    let folder = tempfile::tempdir().unwrap();
    Files::read(&shared(&format!("cases/{name}"))?).write(folder.path());
    Some(folder)
}

fn shape(dataset: &Dataset) -> Vec<(&str, usize)> {
    dataset.splits.iter().map(|s| (s.name.as_str(), s.frames.len())).collect()
}

fn frames(dataset: &Dataset, split: usize) -> Vec<Frame> {
    let all = 0..dataset.splits[split].frames.len();
    all.map(|i| dataset.load(split, i).unwrap_or_else(|e| panic!("{e}"))).collect()
}

fn pose_check(dataset: &Dataset) -> PoseCheck {
    check(dataset, dataset.training_split().unwrap()).unwrap()
}

#[track_caller]
fn agrees(dataset: &Dataset) {
    let check = pose_check(dataset);
    assert!(check.opened.agreement > 0.93 && check.warnings().is_empty(), "{check:?}");
}

/// Least and largest depth of all frames of a split.
fn depth_range(dataset: &Dataset) -> [f32; 2] {
    let all = frames(dataset, 0).into_iter().flat_map(|frame| frame.depth_z().unwrap().data);
    all.filter(|z| *z > 0.0).fold([f32::MAX, 0.0], |[lo, hi], z| [lo.min(z), hi.max(z)])
}

#[track_caller]
fn refuses(folder: &Path, parts: &[&str]) {
    let error = open_plain(folder).map(|d| format!("{d:?}")).unwrap_err().to_string();
    assert!(parts.iter().all(|part| error.contains(part)), "{parts:?}: {error}");
    let length = error.replace(&folder.display().to_string(), "").len();
    assert!(length < 300, "{length}: {error}");
}

/// Asserts that one frame of `n` is skipped with this message.
#[track_caller]
fn skips_one(folder: &Path, n: usize, parts: &[&str]) {
    let dataset = open_plain(folder).unwrap();
    assert_eq!(dataset.splits[0].frames.len(), n - 1, "{:?}", dataset.warnings);
    let said = dataset.warnings[0].to_string();
    assert!(dataset.warnings.len() == 1 && parts.iter().all(|p| said.contains(p)), "{said}");
    frames(&dataset, 0);
}

fn edit(folder: &TempDir, edit: impl FnOnce(&mut Value)) {
    edit_json(&folder.path().join(LIST), edit);
}

#[test]
fn every_list_of_a_folder_is_a_split() {
    let Some(dataset) = case("02-train-and-test-list-with-depth") else { return };
    assert_eq!(shape(&dataset), [("test", 3), ("train", 9)]);
    let training = dataset.training_split().unwrap();
    assert_eq!((training, dataset.evaluation(training).new_views.split), (1, 0));
    assert!(dataset.warnings.is_empty() && dataset.notes.is_empty(), "{:?}", dataset.notes);
    agrees(&dataset);
    assert_eq!(frames(&dataset, 0).len(), 3);
}

#[test]
fn lists_decide_together_and_none_is_lost() {
    let folder = tiny(Nerfstudio);
    let at = |name: &str| folder.path().join(name);
    fs::copy(at(LIST), at("transforms_val.json")).unwrap();
    fs::rename(at(LIST), at("transforms_train.json")).unwrap();
    // Without depth alone, this list would be of another layout.
    edit_json(&at("transforms_val.json"), |json| {
        json["frames"].as_array_mut().unwrap().truncate(2);
        for frame in json["frames"].as_array_mut().unwrap() {
            frame.as_object_mut().unwrap().remove("depth_file_path").unwrap();
        }
    });
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(shape(&dataset), [("train", 4), ("val", 2)]);
    assert!(!dataset.splits[1].has_depth && dataset.training_split().unwrap() == 0);
    fs::write(at("transforms_val.json"), "{\"frames\": [").unwrap();
    refuses(folder.path(), &["transforms_val.json", "expected JSON", "export the file again"]);
    fs::remove_file(at("transforms_val.json")).unwrap();
    fs::rename(at("transforms_train.json"), at("transforms_test.json")).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(shape(&dataset), [("test", 4)]);
    assert!(dataset.notes.iter().any(|note| note.contains("`test`")), "{:?}", dataset.notes);
}

#[test]
fn file_names_divide_a_list() {
    let folder = tiny(Nerfstudio);
    edit(&folder, |json| {
        let names: Vec<Value> = (0..4).map(|i| json["frames"][i]["file_path"].clone()).collect();
        json["train_filenames"] = json!([names[0], names[2]]);
        json["test_filenames"] = json!([names[3], "images/none.png"]);
    });
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(shape(&dataset), [("train", 2), ("test", 1)]);
    assert!(dataset.notes.iter().any(|n| n.contains("1 frames are in no list")));
}

#[test]
fn the_scale_of_poses_is_that_of_depth() {
    let Some(folder) = copy("27-applied-scale") else { return };
    let dataset = open_plain(folder.path()).unwrap();
    let DepthCodes::Linear16 { unit, .. } = dataset.load(0, 0).unwrap().depth.unwrap().codes else {
        panic!("codes of 16 bits");
    };
    assert!((unit - 0.37e-3).abs() < 1e-12 && dataset.units_per_metre() == 0.37, "{unit}");
    agrees(&dataset);
    for bad in [json!(0), json!(-0.37), json!("much"), json!(null)] {
        edit(&folder, |json| json["applied_scale"] = bad.clone());
        refuses(folder.path(), &["transforms.json", "`applied_scale`", "correct the value"]);
    }
}

#[test]
fn an_entry_of_nan_costs_one_frame() {
    let Some(folder) = copy("30-one-pose-of-nan") else { return };
    skips_one(folder.path(), 12, &[LIST, "found the text \"NaN\" at row", "export the pose again"]);
    agrees(&open_plain(folder.path()).unwrap());
    let raw = |key: &str, word: &str| {
        let folder = tiny(Nerfstudio);
        edit(&folder, |json| json["frames"][1][key] = json!("@"));
        let path = folder.path().join(LIST);
        fs::write(&path, fs::read_to_string(&path).unwrap().replace("\"@\"", word)).unwrap();
        folder
    };
    for word in ["NaN", "Infinity", "-Infinity"] {
        let parts = ["camera: expected a number as `cx`", word];
        skips_one(raw("cx", word).path(), 4, &parts);
    }
    let folder = raw("camera_model", "\"EQUIRECTANGULAR\"");
    skips_one(folder.path(), 4, &["EQUIRECTANGULAR", "undistort"]);
}

#[test]
fn a_background_is_no_surface() {
    let Some(dataset) = case("43-background-as-a-number") else { return };
    let [least, most] = depth_range(&dataset);
    assert!((0.86..0.88).contains(&least) && (2.5..2.61).contains(&most), "{least} to {most}");
    agrees(&dataset);

    let folder = tiny(Nerfstudio);
    edit(&folder, |json| {
        json["depth_unit_scale_factor"] = json!(1.0);
        json["frames"][0]["depth_file_path"] = json!("a.npy");
    });
    let holes = |background: &[f32], scene: f32| {
        let value = |i: usize| *background.get(i % 7).unwrap_or(&(scene + i as f32 * 1e-3));
        let values = (0..32 * 24).flat_map(|i| value(i).to_le_bytes());
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (24, 32), }\n";
        let mut npy = b"\x93NUMPY\x01\x00".to_vec();
        npy.extend((header.len() as u16).to_le_bytes());
        npy.extend(header.bytes().chain(values));
        fs::write(folder.path().join("a.npy"), npy).unwrap();
        let depth = open_plain(folder.path()).unwrap().load(0, 0).unwrap().depth_z().unwrap();
        depth.data.iter().filter(|z| **z <= 0.0).count()
    };
    let n = (32 * 24usize).div_ceil(7);
    for background in [1e10, 65504.0, 1e6, 1000.0, 50.0, f32::MAX, f32::INFINITY, f32::NAN] {
        assert_eq!(holes(&[background], 1.0), n, "{background}");
    }
    assert_eq!(holes(&[1e10, 65504.0, 100.0], 1.0), 3 * n, "several of them");
    assert_eq!(holes(&[6.0], 1.0), 0, "a wall behind a door");
}

/// Channels of an EXR with their values.
type Part<'a> = (&'a str, &'a [(&'a str, f32)]);

fn write_exr(path: &Path, parts: &[Part]) {
    let layer = |(name, channels): &Part| {
        let channels = channels
            .iter()
            .map(|(name, value)| AnyChannel::new(*name, FlatSamples::F32(vec![*value; 32 * 24])));
        let channels = AnyChannels::sort(channels.collect());
        Layer::new((32, 24), LayerAttributes::named(*name), Encoding::UNCOMPRESSED, channels)
    };
    let attributes = ImageAttributes::with_size((32, 24));
    let layers = parts.iter().map(layer).collect::<Vec<_>>();
    ExrImage::from_layers(attributes, layers).write().to_file(path).unwrap();
}

#[test]
fn the_depth_of_an_exr_is_found_by_its_name() {
    let Some(dataset) = case("42-blender-multilayer-exr") else { return };
    let [least, most] = depth_range(&dataset);
    assert!((0.86..1.0).contains(&least) && (4.1..4.2).contains(&most), "{least} to {most}");
    agrees(&dataset);

    let folder = tiny(Nerfstudio);
    edit(&folder, |json| {
        json["depth_unit_scale_factor"] = json!(1.0);
        json["frames"][0]["depth_file_path"] = json!("a.exr");
    });
    let color = [("V.Combined.A", 1.0), ("V.Combined.B", 0.1), ("V.Combined.R", 0.3)];
    let cases: [&[Part]; 7] = [
        &[("", &[color[0], color[1], color[2], ("V.Depth.Z", 2.0)])],
        &[("", &[color[0], color[1], color[2], ("View Layer.Depth.V", 2.0)])],
        &[("", &[("Normal.X", 0.1), ("Normal.Y", 0.2), ("Normal.Z", 0.3), ("Pass.Z", 2.0)])],
        &[("", &[("Mist.Z", 0.5), ("R.depth.Z", 2.0)])],
        &[("", &[("left.R", 0.5), ("left.Z", 2.0)])],
        &[("V.Combined", &[("A", 1.0), ("R", 0.3)]), ("V.Depth", &[("V", 2.0)])],
        &[("", &[("unnamed", 2.0)])],
    ];
    for parts in cases {
        write_exr(&folder.path().join("a.exr"), parts);
        let depth = open_plain(folder.path()).unwrap().load(0, 0).unwrap().depth_z().unwrap();
        assert_eq!((depth.width, depth.data[5]), (32, 2.0), "{parts:?}");
    }
}

#[test]
fn frames_of_two_sizes_are_used() {
    let Some(dataset) = case("01-two-cameras-of-two-sizes") else { return };
    assert_eq!(shape(&dataset)[0], ("all", 12));
    assert!(dataset.warnings.is_empty(), "{:?}", dataset.warnings);
    for (i, frame) in frames(&dataset, 0).iter().enumerate() {
        let k = frame.camera.intrinsics;
        let depth = frame.depth.as_ref().unwrap().size();
        assert_eq!(
            (depth, depth),
            ((k.width as usize, k.height as usize), (frame.color.width, frame.color.height))
        );
        let expected = [(90, 120, 110.0), (160, 120, 132.8)];
        let found = (k.width, k.height, k.fx);
        assert!(
            expected
                .iter()
                .any(|e| (e.0, e.1) == (found.0, found.1) && (e.2 - found.2).abs() < 1e-9),
            "{i}: {k:?}"
        );
    }
    agrees(&dataset);
}

fn observe(frame: &Frame, sensor: Sensor) -> (Observation, f64) {
    let settings =
        SurfaceSettings { photograph: true, ..SurfaceSettings::of_sensor(sensor, DVec3::ZERO) };
    let mut out = Observation::empty();
    let counts = Preparer::new().prepare(frame, &settings, &mut out).unwrap();
    let share = counts.kept as f64 / (counts.kept + counts.dropped()) as f64;
    (out, share)
}

/// Number of points of all frames within 3 cm of the box in the middle, above the floor.
fn n_on_box(dataset: &Dataset) -> usize {
    let place = |p: [f32; 3]| DVec3::from_array(p.map(f64::from));
    let is_near = |p: DVec3| p.y < 1.15 && p.distance(p.clamp(BOX[0], BOX[1])) < 0.03;
    let points = |frame: &Frame| observe(frame, Sensor::Lidar).0.points;
    frames(dataset, 0).iter().flat_map(points).filter(|p| is_near(place(p.position))).count()
}

#[test]
fn masked_pixels_give_neither_points_nor_photographs() {
    let Some(folder) = copy("44-mask-path") else { return };
    let dataset = open_plain(folder.path()).unwrap();
    assert!(dataset.warnings.is_empty(), "{:?}", dataset.warnings);
    assert_eq!(n_on_box(&dataset), 0);
    let frame = dataset.load(0, 3).unwrap();
    let n = frame.color.data.iter().filter(|c| **c == MASKED).count();
    assert!(n > 500 && n < 160 * 60, "{n}");
    let (seen, _) = observe(&frame, Sensor::Lidar);
    let pixels = seen.photograph.unwrap().measured_pixels([1.0; 3], [0.03, 0.02]);
    assert_eq!(pixels.data.iter().filter(|pixel| pixel.coverage < 0.0).count(), n);
    // A masked pixel is unknown, not background: its range is no number.
    let masked = frame.color.data.iter().zip(&seen.ranges.data).filter(|(c, _)| **c == MASKED);
    assert!(masked.into_iter().all(|(_, range)| range.is_nan()));
    agrees(&dataset);
    // The same masks, named by their place.
    edit(&folder, |json| {
        for frame in json["frames"].as_array_mut().unwrap() {
            frame.as_object_mut().unwrap().remove("mask_path").unwrap();
        }
    });
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(n_on_box(&dataset), 0);
    assert!(dataset.notes.iter().any(|n| n.contains("12 frames")), "{:?}", dataset.notes);
    fs::rename(folder.path().join("masks"), folder.path().join("other")).unwrap();
    assert!(n_on_box(&open_plain(folder.path()).unwrap()) > 1000);
}

#[test]
fn masks_of_other_forms_and_bad_ones() {
    let folder = tiny(Nerfstudio);
    let left = |value: u8, path: &str| {
        let column = |x, _| image::Luma([if x < 8 { 0 } else { value }]);
        let path = folder.path().join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        image::GrayImage::from_fn(32, 24, column).save(path).unwrap();
    };
    let masked = || {
        let frame = open_plain(folder.path()).unwrap().load(0, 0).unwrap();
        let n = frame.color.data.iter().filter(|c| **c == MASKED).count();
        let holes = frame.depth_z().unwrap().data.iter().filter(|z| **z == 0.0).count();
        (n, holes)
    };
    left(255, "images/dynamic_mask_frame_00001.png");
    assert_eq!(masked(), (24 * 24, 24 * 24), "white is left out");
    fs::remove_file(folder.path().join("images/dynamic_mask_frame_00001.png")).unwrap();
    left(1, "mask/frame_00001.png");
    assert_eq!(masked(), (8 * 24, 8 * 24), "black is left out");
    left(0, "mask/frame_00001.png");
    let said = open_plain(folder.path()).unwrap().load(0, 0).unwrap_err().to_string();
    assert!(said.contains("a mask with used pixels") && said.contains("found none"), "{said}");
    image::GrayImage::new(31, 24).save(folder.path().join("mask/frame_00001.png")).unwrap();
    let said = open_plain(folder.path()).unwrap().load(0, 0).unwrap_err().to_string();
    assert!(said.contains("a mask of the camera's size 32x24, found 31x24"), "{said}");
    edit(&folder, |json| json["frames"][0]["mask_path"] = json!("../mask.png"));
    skips_one(folder.path(), 4, &["expected a path inside", "../mask.png"]);
    edit(&folder, |json| json["frames"][0]["mask_path"] = json!("none.png"));
    skips_one(folder.path(), 4, &["expected a mask none.png, found none"]);
}

#[test]
fn photographs_stand_upright_where_the_list_says_so() {
    let Some(folder) = copy("31-upright-by-exif") else { return };
    let upright = |dataset: &Dataset| {
        assert!(shape(dataset)[0] == ("all", 12), "{:?}", dataset.warnings);
        let frame = dataset.load(0, 4).unwrap();
        assert_eq!((frame.color.width, frame.color.height), (120, 160));
        let stored = image::open(folder.path().join("images/frame_00005.jpg")).unwrap();
        // Orientation 6: the stored picture is turned clockwise.
        let turned = stored.rotate90().into_rgb8();
        let same = |(a, b): (&[u8; 4], &image::Rgb<u8>)| a[..3] == b.0;
        assert!(frame.color.data.iter().zip(turned.pixels()).all(same));
        agrees(dataset);
    };
    upright(&open_plain(folder.path()).unwrap());
    // Without a size, depth shows which way is up.
    edit(&folder, |json| {
        ["w", "h"].iter().for_each(|k| drop(json.as_object_mut().unwrap().remove(*k)))
    });
    upright(&open_plain(folder.path()).unwrap());
    edit(&folder, |json| json["w"] = json!(150));
    refuses(folder.path(), &["stated size 150x120", "160x120"]);
}

#[test]
fn any_unit_of_depth_is_found() {
    let Some(path) = shared("cases/28-depth-in-quarter-millimetres") else { return };
    for scale in [1e-3, 2e-4, 1.0, 2e-6, 1.25 * 0.25e-3, 0.25e-3 / 1.25] {
        let options = LoadOptions { depth_scale: Some(scale), ..LoadOptions::default() };
        let check = pose_check(&open(&path, &options).unwrap());
        let unit = check.best.unit * scale;
        assert!((unit / 0.25e-3 - 1.0).abs() < 0.01, "{scale}: {check:?}");
        let best = check.best;
        assert!(best.poses == PoseConvention::Opengl && best.agreement > 0.93, "{check:?}");
    }
    let right = LoadOptions { depth_scale: Some(0.25e-3), ..LoadOptions::default() };
    agrees(&open(&path, &right).unwrap());
}

/// Copies of trained frames would be held out as new views.
#[test]
fn a_copy_of_a_frame_is_named() {
    let folder = tiny(TestLayout::Scannet);
    assert!(open_plain(folder.path()).unwrap().unused.is_empty());
    for (name, end) in [("color", "jpg"), ("depth", "png"), ("pose", "txt")] {
        let file = |i: usize| folder.path().join(format!("{name}/{i}.{end}"));
        fs::copy(file(1), file(8)).unwrap();
    }
    let said = open_plain(folder.path()).unwrap().unused.join("; ");
    assert!(said.starts_with("frame 8 is a copy of frame 1, as are 1 of 1"), "{said}");
    // Another depth image: the camera stood still.
    fs::copy(folder.path().join("depth/0.png"), folder.path().join("depth/8.png")).unwrap();
    assert!(open_plain(folder.path()).unwrap().unused.is_empty());
}

#[test]
fn several_lists_of_one_folder_are_splits_or_named() {
    let folder = tiny(TestLayout::Arkit);
    let lines = fs::read_to_string(folder.path().join("frames.jsonl")).unwrap();
    let (first, rest) = lines.split_once('\n').unwrap();
    fs::remove_file(folder.path().join("frames.jsonl")).unwrap();
    fs::write(folder.path().join("train.jsonl"), rest).unwrap();
    fs::write(folder.path().join("eval.jsonl"), format!("{first}\n")).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    let train = dataset.training_split().unwrap();
    assert_eq!(dataset.splits[train].name, "train");
    assert_eq!(dataset.splits[train].frames.len(), rest.lines().count());
    let evaluation = dataset.evaluation(train).new_views;
    assert_eq!((&*dataset.splits[evaluation.split].name, evaluation.frames.len()), ("eval", 1));
    for (layout, list, other) in [
        (TestLayout::Open3d, "trajectory.log", "odometry.log"),
        (TestLayout::RtabMap, "poses.txt", "raw_poses.txt"),
        (TestLayout::RtabMap, "calib.yaml", "other.yaml"),
    ] {
        let folder = tiny(layout);
        let from = match folder.path().join(list) {
            path if path.exists() => path,
            _ => {
                let calibration = fs::read_dir(folder.path().join("calib")).unwrap().next();
                let path = folder.path().join(list);
                fs::copy(calibration.unwrap().unwrap().path(), &path).unwrap();
                fs::remove_dir_all(folder.path().join("calib")).unwrap();
                path
            }
        };
        fs::copy(from, folder.path().join(other)).unwrap();
        let notes = open_plain(folder.path()).unwrap().notes.join("; ");
        assert!(notes.contains(&format!("are not used: {other}")), "{layout:?}: {notes}");
    }
}

#[test]
fn slanted_surfaces_of_small_depth_images_are_kept() {
    let Some(dataset) = case("35-small-depth-of-a-kinect-layout") else { return };
    assert_eq!(dataset.sensor(), Sensor::Kinect);
    let all = frames(&dataset, 0);
    let share = |sensor| all.iter().map(|f| observe(f, sensor).1).sum::<f64>() / all.len() as f64;
    let [kinect, lidar] = [Sensor::Kinect, Sensor::Lidar].map(share);
    assert!(kinect > 0.95 * lidar, "{kinect} {lidar}");
    // Depth of the usual size keeps its gate.
    let folder = tiny(TestLayout::Tum);
    let frame = open_plain(folder.path()).unwrap().load(0, 0).unwrap();
    let depth = frame.depth.as_ref().unwrap();
    let steepness = |fx| {
        let camera = vbgs_studio::math::camera::Intrinsics { fx, ..frame.camera.intrinsics };
        Sensor::Kinect.profile(depth, &camera).steepness
    };
    assert!(steepness(525.0) == 0.0 && steepness(262.5) == 0.0 && steepness(131.0) > 0.005);
}

fn npy(kind: &str, is_by_columns: bool, values: impl Iterator<Item = Vec<u8>>) -> Vec<u8> {
    let order = if is_by_columns { "True" } else { "False" };
    let header = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': (24, 32), }}\n");
    let mut npy = b"\x93NUMPY\x01\x00".to_vec();
    npy.extend((header.len() as u16).to_le_bytes());
    npy.extend(header.bytes().chain(values.flatten()));
    npy
}

/// Every code of one depth image gives the same lengths.
#[test]
fn codes_of_depth_are_read_or_named() {
    let folder = tiny(Nerfstudio);
    edit(&folder, |json| json["depth_unit_scale_factor"] = json!(0.001));
    let load = |name: &str, bytes: &[u8]| {
        fs::write(folder.path().join(name), bytes).unwrap();
        edit(&folder, |json| json["frames"][0]["depth_file_path"] = json!(name));
        let frame = open_plain(folder.path()).unwrap().load(0, 0);
        frame.map(|frame| frame.depth_z().unwrap().data).map_err(|error| error.to_string())
    };
    let value = |row: usize, column: usize| 1000 + 40 * row + column;
    let rows = || (0..24 * 32).map(|i| value(i / 32, i % 32));
    let columns = || (0..24 * 32).map(|i| value(i % 24, i / 24));
    let right: Vec<f32> = rows().map(|v| (v as f64 * 1e-3) as f32).collect();
    let f4 = |v: usize| (v as f32).to_le_bytes().to_vec();
    let by_rows = npy("<f4", false, rows().map(f4));
    let npz = |names: &[&str]| {
        let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        let options = zip::write::SimpleFileOptions::default();
        for name in names {
            zip.start_file(*name, options).unwrap();
            std::io::Write::write_all(&mut zip, &by_rows).unwrap();
        }
        zip.finish().unwrap().into_inner()
    };
    let mut tiff = std::io::Cursor::new(Vec::new());
    let floats: Vec<f32> = rows().map(|v| v as f32).collect();
    let mut encoder = tiff::encoder::TiffEncoder::new_big(&mut tiff).unwrap();
    encoder.write_image::<tiff::encoder::colortype::Gray32Float>(32, 24, &floats).unwrap();
    for (name, bytes) in [
        ("rows.npy", by_rows.clone()),
        ("columns.npy", npy("<f4", true, columns().map(f4))),
        ("codes.npy", npy("<u2", true, columns().map(|v| (v as u16).to_le_bytes().to_vec()))),
        ("whole.npy", npy("<i8", false, rows().map(|v| (v as i64).to_le_bytes().to_vec()))),
        ("short.npy", npy("<i2", false, rows().map(|v| (v as i16).to_le_bytes().to_vec()))),
        ("one.npz", npz(&["arr_0.npy"])),
        ("named.npz", npz(&["confidence.npy", "depth.npy"])),
        ("big.tif", tiff.into_inner()),
    ] {
        assert_eq!(load(name, &bytes).as_ref(), Ok(&right), "{name}");
    }
    let error = load("two.npz", &npz(&["a.npy", "b.npy"])).unwrap_err();
    assert!(error.contains("array named depth") && error.contains("a.npy, b.npy"), "{error}");
    let error = load("gray.pgm", b"P5\n32 24\n65535\n").unwrap_err();
    assert!(
        error.contains("found Pnm, expected PNG or JPEG") && error.contains("convert"),
        "{error}"
    );
    let whole = npz(&["arr_0.npy"]);
    for length in (0..whole.len()).step_by(97) {
        assert!(load("cut.npz", &whole[..length]).is_err(), "{length}");
    }
}

#[test]
fn depth_folders_hold_any_code_of_depth() {
    let folder = tiny(TestLayout::Open3d);
    let right = open_plain(folder.path()).unwrap().load(0, 0).unwrap().depth_z().unwrap();
    let n = fs::read_dir(folder.path().join("depth")).unwrap().count();
    for i in 0..n {
        let png = folder.path().join(format!("depth/{i:05}.png"));
        let codes = image::ImageReader::open(&png).unwrap().decode().unwrap().into_luma16();
        let metres = codes.iter().map(|v| (f32::from(*v) * 1e-3).to_le_bytes().to_vec());
        fs::write(png.with_extension("npy"), npy("<f4", false, metres)).unwrap();
        fs::remove_file(png).unwrap();
    }
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(dataset.splits[0].frames.len(), n);
    let found = dataset.load(0, 0).unwrap().depth_z().unwrap();
    let far = found.data.iter().zip(&right.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(far < 1e-5, "{far}");
}
