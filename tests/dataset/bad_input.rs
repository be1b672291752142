//! One test per kind of damage to a dataset. The message states the file, what was expected, what
//! was found and what to do; the rest of the dataset stays usable.

use crate::common::layouts::TestLayout;
use crate::common::scratch::{
    assert_says, edit_json, edit_pose, open_plain, refuses, tiny, tiny_blender, tiny_seven_scenes,
};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use vbgs_studio::dataset::synthetic::write::DepthBits;
use vbgs_studio::dataset::unproject::{
    CameraConvention, EdgeFilter, UnprojectSettings, Unprojector,
};
use vbgs_studio::observation::points::Points;

const LIST: &str = "transforms_train.json";
/// Frames of the tiny Blender dataset.
const FRAMES: [&str; 4] = ["train/r_0", "train/r_1", "train/r_2", "eval/r_0"];

/// Asserts that one frame of `train` is skipped with a warning and the other two load.
#[track_caller]
fn skips_one(path: &Path, parts: &[&str]) {
    let dataset = open_plain(path).unwrap();
    assert_eq!(dataset.warnings.len(), 1, "{:?}", dataset.warnings);
    assert_eq!(dataset.warnings[0].split, "train");
    assert_says(&dataset.warnings[0].to_string(), parts);
    let train = dataset.split_named("train").unwrap();
    assert_eq!(dataset.splits[train].frames.len(), 2);
    assert!((0..2).all(|i| dataset.load(train, i).is_ok()));
}

/// Asserts that frame 1 of `train` fails to load and the others load.
#[track_caller]
fn fails_to_load_one(path: &Path, parts: &[&str]) {
    let dataset = open_plain(path).unwrap();
    let train = dataset.split_named("train").unwrap();
    match dataset.load(train, 1) {
        Ok(_) => panic!("the damaged frame loaded"),
        Err(error) => assert_says(&error.to_string(), parts),
    }
    assert!(dataset.load(train, 0).is_ok() && dataset.load(train, 2).is_ok());
}

fn truncate(path: &Path, keep: f64) {
    let bytes = fs::read(path).unwrap();
    fs::write(path, &bytes[..(bytes.len() as f64 * keep) as usize]).unwrap();
}

fn edit_frame(root: &Path, edit: impl FnOnce(&mut Value)) {
    edit_json(&root.join(LIST), |json| edit(&mut json["frames"][1]));
}

#[test]
fn missing_depth_file() {
    let blender = tiny_blender();
    fs::remove_file(blender.path().join("train/r_1_depth_0001.png")).unwrap();
    let parts = ["r_1.png", "train/r_1", "expected a depth image", "found none", "restore"];
    skips_one(blender.path(), &parts);
    let scenes = tiny_seven_scenes();
    fs::remove_file(scenes.path().join("train/frame-000001.depth.png")).unwrap();
    let parts = ["frame-000001", "expected a depth image", "found none", "restore"];
    skips_one(scenes.path(), &parts);
}

#[test]
fn missing_colour_file() {
    let blender = tiny_blender();
    fs::remove_file(blender.path().join("train/r_1.png")).unwrap();
    skips_one(blender.path(), &[LIST, "r_1.png", "expected a colour image", "found none"]);
    edit_frame(blender.path(), |frame| frame["file_path"] = json!("nowhere/r_1"));
    skips_one(blender.path(), &[LIST, "nowhere/r_1.png", "expected a colour image", "restore"]);
    edit_frame(blender.path(), |frame| frame["file_path"] = json!(7));
    skips_one(blender.path(), &[LIST, "`file_path`", "found an object", "export"]);
}

#[test]
fn no_depth_anywhere() {
    let folder = tiny_blender();
    for frame in FRAMES {
        fs::remove_file(folder.path().join(format!("{frame}_depth_0001.png"))).unwrap();
    }
    let dataset = open_plain(folder.path()).unwrap();
    let error = dataset.training_split().unwrap_err().to_string();
    assert_says(
        &error,
        &["expected a split with depth", "found only colour", "eval, train", "add"],
    );
    let settings = UnprojectSettings {
        convention: CameraConvention::Exact,
        filter: EdgeFilter::DropMixed,
        normalization: dataset.known_range.as_ref().unwrap().normalization(),
    };
    let frame = dataset.load(0, 0).unwrap();
    let error = Unprojector::new().unproject(&frame, &settings, &mut Points::new());
    assert_says(&error.unwrap_err().to_string(), &["expected a frame with depth", "choose"]);
}

#[test]
fn mismatched_sizes() {
    let folder = tiny_blender();
    let depth = folder.path().join("train/r_1_depth_0001.png");
    image::GrayImage::from_pixel(16, 12, image::Luma([9])).save(&depth).unwrap();
    let parts = ["r_1_depth_0001.png", "expected", "32x24", "found 16x12", "export all"];
    fails_to_load_one(folder.path(), &parts);
    let color = folder.path().join("train/r_1.png");
    image::RgbImage::new(16, 12).save(&color).unwrap();
    let parts =
        ["r_1.png", "expected an image of the camera's size 32x24", "found 16x12", "export"];
    fails_to_load_one(folder.path(), &parts);
}

#[test]
fn truncated_image() {
    for (file, keep) in
        [("train/r_1.png", 0.5), ("train/r_1_depth_0001.png", 0.6), ("train/r_1.png", 0.0)]
    {
        let folder = tiny_blender();
        truncate(&folder.path().join(file), keep);
        fails_to_load_one(folder.path(), &[file, "expected a whole PNG or JPEG", "found", "again"]);
    }
    let folder = tiny_seven_scenes();
    let png = folder.path().join("train/frame-000001.color.png");
    let jpg = png.with_extension("jpg");
    image::open(&png).unwrap().into_rgb8().save(&jpg).unwrap();
    fs::remove_file(&png).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert!(dataset.load(dataset.split_named("train").unwrap(), 1).is_ok(), "a whole JPEG loads");
    for keep in [0.9, 0.5, 0.1] {
        truncate(&jpg, keep);
        fails_to_load_one(folder.path(), &["frame-000001.color.jpg", "expected a whole", "again"]);
    }
}

#[test]
fn images_that_are_all_damaged() {
    let folder = tiny_blender();
    for frame in FRAMES {
        fs::write(folder.path().join(format!("{frame}.png")), "no image").unwrap();
    }
    refuses(
        folder.path(),
        &["expected at least one usable frame", "none in 4", "r_0.png", "again"],
    );
}

#[test]
fn depth_of_another_format() {
    let folder = tiny_blender();
    let depth = folder.path().join("train/r_1_depth_0001.png");
    image::ImageBuffer::from_pixel(32, 24, image::Luma([900u16])).save(&depth).unwrap();
    let parts = ["r_1_depth_0001.png", "expected 8-bit depth", "found L16", "export"];
    fails_to_load_one(folder.path(), &parts);
    let folder = tiny_seven_scenes();
    let depth = folder.path().join("train/frame-000001.depth.png");
    image::GrayImage::from_pixel(32, 24, image::Luma([9])).save(&depth).unwrap();
    let parts = ["frame-000001.depth.png", "expected 16-bit gray", "found L8", "export"];
    fails_to_load_one(folder.path(), &parts);
}

#[test]
fn sixteen_bit_depth_with_a_bad_scale() {
    for scale in [json!(0.0), json!(-1.0), json!("1 mm"), json!(null)] {
        let folder = tiny(TestLayout::Blender(DepthBits::Sixteen));
        edit_json(&folder.path().join(LIST), |json| json["integer_depth_scale"] = scale);
        refuses(folder.path(), &[LIST, "`integer_depth_scale`", "expected a"]);
    }
}

#[test]
fn nan_pose() {
    for (bad, found) in [(json!(null), "null"), (json!("NaN"), "the text \"NaN\"")] {
        let folder = tiny_blender();
        edit_frame(folder.path(), |frame| frame["transform_matrix"][2][1] = bad);
        let parts = [LIST, "train/r_1", "expected 4 rows of 4 finite numbers", found];
        skips_one(folder.path(), &parts);
        skips_one(folder.path(), &["row 2, column 1", "export the pose again"]);
    }
    let token = |token| {
        let folder = tiny_blender();
        let path = folder.path().join(LIST);
        edit_frame(folder.path(), |frame| frame["transform_matrix"][3][3] = "@".into());
        let text = fs::read_to_string(&path).unwrap().replace("\"@\"", token);
        fs::write(&path, text).unwrap();
        folder
    };
    // Python writes and reads such words.
    skips_one(token("NaN").path(), &["expected 4 rows of 4 finite numbers", "NaN"]);
    let parts = [LIST, "expected JSON", "found", "line", "export the file again"];
    refuses(token("1e999").path(), &parts);
    let folder = tiny_seven_scenes();
    edit_pose(folder.path(), |values| values[6] = f64::NAN);
    let parts =
        ["frame-000001.pose.txt", "expected 16 finite numbers", "found NaN", "row 1, column 2"];
    skips_one(folder.path(), &parts);
}

#[test]
fn singular_pose() {
    let zero_rotation = |values: &mut Vec<f64>| values[..12].fill(0.0);
    let scenes = tiny_seven_scenes();
    edit_pose(scenes.path(), zero_rotation);
    let parts = ["frame-000001.pose.txt", "expected a rotation", "determinant 0.000", "export"];
    skips_one(scenes.path(), &parts);
    let blender = tiny_blender();
    edit_frame(blender.path(), |frame| {
        frame["transform_matrix"] = json!([[1, 0, 0, 0], [2, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    });
    skips_one(blender.path(), &[LIST, "train/r_1", "expected a rotation", "determinant 0.000"]);
}

#[test]
fn non_rigid_pose() {
    let scaled = tiny_seven_scenes();
    edit_pose(scaled.path(), |values| {
        for i in [0, 1, 2, 4, 5, 6, 8, 9, 10] {
            values[i] *= 1.5;
        }
    });
    let parts = ["frame-000001.pose.txt", "expected a rotation", "determinant 3.375", "export"];
    skips_one(scaled.path(), &parts);
    let transposed = tiny_seven_scenes();
    edit_pose(transposed.path(), |values| {
        let old = values.clone();
        (0..16).for_each(|i| values[i] = old[i % 4 * 4 + i / 4]);
    });
    skips_one(transposed.path(), &["frame-000001.pose.txt", "last row 0 0 0 1", "transposed"]);
}

#[test]
fn pose_files_that_are_no_matrix() {
    for (text, found) in
        [("", "found 0 numbers"), ("1 2 3", "found 3 numbers"), ("hello 1", "found `hello`")]
    {
        let folder = tiny_seven_scenes();
        fs::write(folder.path().join("train/frame-000001.pose.txt"), text).unwrap();
        let parts = ["frame-000001.pose.txt", "expected 4 rows of 4", found, "export"];
        skips_one(folder.path(), &parts);
    }
    let folder = tiny_seven_scenes();
    fs::remove_file(folder.path().join("train/frame-000001.pose.txt")).unwrap();
    let parts = ["frame-000001.pose.txt", "expected a pose file", "found none", "restore"];
    skips_one(folder.path(), &parts);
}

#[test]
fn empty_json() {
    let folder = tiny_blender();
    fs::write(folder.path().join(LIST), "").unwrap();
    refuses(folder.path(), &[LIST, "expected JSON", "EOF", "export the file again"]);
    fs::write(folder.path().join(LIST), "{}").unwrap();
    refuses(folder.path(), &[LIST, "expected an object with a list `frames`", "0 keys", "export"]);
}

#[test]
fn broken_json() {
    let folder = tiny_blender();
    truncate(&folder.path().join(LIST), 0.7);
    refuses(folder.path(), &[LIST, "expected JSON", "line", "export the file again"]);
    for (text, found) in
        [("[1, 2]", "an array of 2"), ("\"x\"", "the text \"x\""), ("7", "found 7")]
    {
        fs::write(folder.path().join(LIST), text).unwrap();
        refuses(folder.path(), &[LIST, "expected an object with a list `frames`", found, "export"]);
    }
}

#[test]
fn no_frames() {
    let folder = tiny_blender();
    edit_json(&folder.path().join(LIST), |json| json["frames"] = json!([]));
    refuses(folder.path(), &[LIST, "expected at least one entry", "found none", "export"]);
    let folder = tiny_seven_scenes();
    for split in ["train", "eval"] {
        fs::remove_dir_all(folder.path().join(split)).unwrap();
    }
    fs::write(folder.path().join("TrainSplit.txt"), "sequence1").unwrap();
    refuses(folder.path(), &["TrainSplit.txt", "expected at least one usable", "seq-01", "unpack"]);
    fs::write(folder.path().join("TrainSplit.txt"), "").unwrap();
    refuses(folder.path(), &["expected at least one frame", "found none", "export"]);
}

#[test]
fn absurd_field_of_view() {
    for angle in [39.6, 0.0, -1.0, 1e-9, 3.2, 1e300] {
        let folder = tiny_blender();
        edit_json(&folder.path().join(LIST), |json| json["camera_angle_x"] = json!(angle));
        let parts = [LIST, "expected `camera_angle_x` in radians", "between 0.1 and 179", "found"];
        refuses(folder.path(), &parts);
        if angle == 39.6 {
            refuses(folder.path(), &["39.6", "is this in degrees?", "0.691150"]);
        }
    }
    let folder = tiny_blender();
    edit_json(&folder.path().join(LIST), |json| json["camera_angle_x"] = json!(null));
    refuses(
        folder.path(),
        &[LIST, "expected a number as `camera_angle_x`", "found null", "correct"],
    );
    edit_json(&folder.path().join(LIST), |json| {
        json.as_object_mut().unwrap().remove("camera_angle_x");
    });
    refuses(folder.path(), &[LIST, "expected a number `camera_angle_x`", "frames", "add"]);
    edit_json(&folder.path().join(LIST), |json| json["fl_x"] = json!(-20.0));
    refuses(folder.path(), &[LIST, "expected a horizontal field of view", "correct the focal"]);
}

#[test]
fn absurd_intrinsics() {
    let k = "camera-intrinsics.txt";
    for (text, parts) in [
        ("", [k, "expected 4 numbers", "found 0 numbers", "export"]),
        ("a b c", [k, "expected 4 numbers", "found `a`", "export"]),
        ("20 5 16 0 20 12 0 0 1", [k, "expected a camera matrix", "found [20.0, 5.0", "undistort"]),
        ("nan 0 16 0 20 12 0 0 1", [k, "expected a horizontal field", "found NaN", "correct"]),
        ("0 0 16 0 20 12 0 0 1", [k, "expected a horizontal field", "found 180", "correct"]),
        ("20 0 16 0 1e9 12 0 0 1", [k, "expected a vertical field", "found 0.0000", "correct"]),
        ("585 0 320 0 585 240 0 0 1", [k, "inside the 32x24 image", "found (320, 240)", "use the"]),
    ] {
        let folder = tiny_seven_scenes();
        fs::write(folder.path().join(k), text).unwrap();
        refuses(folder.path(), &parts);
    }
}

#[test]
fn paths_that_escape_the_folder() {
    for path in ["../r_1", "train/../../r_1", "/etc/hostname", "C:\\r_1.png"] {
        let folder = tiny_blender();
        edit_frame(folder.path(), |frame| frame["file_path"] = json!(path));
        let parts =
            [LIST, "expected a path inside the dataset folder", path, "use a relative path"];
        skips_one(folder.path(), &parts);
    }
}

#[cfg(unix)]
#[test]
fn links_that_escape_the_folder() {
    use std::os::unix::fs::symlink;
    let outside = tiny_blender();
    let folder = tiny_blender();
    let color = folder.path().join("train/r_1.png");
    fs::remove_file(&color).unwrap();
    symlink(outside.path().join("train/r_1.png"), &color).unwrap();
    skips_one(folder.path(), &["expected a path inside", "train/r_1.png", "copy the file"]);

    fs::remove_file(&color).unwrap();
    symlink(folder.path().join("train/r_2.png"), &color).unwrap();
    assert!(open_plain(folder.path()).unwrap().warnings.is_empty(), "links inside are valid");

    let folder = tiny_blender();
    let images = folder.path().join("train");
    fs::remove_dir_all(&images).unwrap();
    symlink(outside.path().join("train"), &images).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(dataset.warnings.len(), 3);
    let parts = ["expected a path inside the dataset folder", "`train`", "copy the file"];
    assert_says(&dataset.warnings[0].to_string(), &parts);
}

/// Without its list a recording cannot be distinguished from images without poses.
#[cfg(unix)]
#[test]
fn lists_that_a_link_keeps_outside() {
    use std::os::unix::fs::symlink;
    let (outside, folder) = (tiny_blender(), tiny_blender());
    let list = folder.path().join(LIST);
    fs::remove_file(&list).unwrap();
    symlink(outside.path().join(LIST), &list).unwrap();
    let parts = [LIST, "expected a file inside the dataset folder", "a link that leads outside"];
    refuses(folder.path(), &parts);
    refuses(folder.path(), &["copy the file into the folder"]);

    let folder = tempfile::tempdir().unwrap();
    symlink("/etc/hostname", folder.path().join("recording.r3d")).unwrap();
    refuses(folder.path(), &["recording.r3d", "a link that leads outside", "copy the file"]);
    fs::remove_file(folder.path().join("recording.r3d")).unwrap();
    symlink("nowhere", folder.path().join("recording.r3d")).unwrap();
    refuses(folder.path(), &["expected a known layout", "1 files"]);
}

#[test]
fn depth_all_zero() {
    let folder = tiny_blender();
    let depth = folder.path().join("train/r_1_depth_0001.png");
    image::RgbaImage::from_pixel(32, 24, image::Rgba([0, 0, 0, 255])).save(&depth).unwrap();
    let parts = ["r_1_depth_0001.png", "expected depth values", "only holes", "skipped", "export"];
    fails_to_load_one(folder.path(), &parts);
    for hole in [0u16, 65535] {
        let folder = tiny_seven_scenes();
        let depth = folder.path().join("train/frame-000001.depth.png");
        image::ImageBuffer::from_pixel(32, 24, image::Luma([hole])).save(&depth).unwrap();
        fails_to_load_one(folder.path(), &["frame-000001.depth.png", "only holes", "export"]);
    }
}

#[test]
fn a_folder_that_is_no_dataset() {
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().display().to_string();
    let parts =
        [&name, "an empty folder", "expected a known layout", "blender", "seven-scenes", "give"];
    refuses(folder.path(), &parts);
    fs::write(folder.path().join("holiday.txt"), "sun").unwrap();
    fs::create_dir(folder.path().join("beach")).unwrap();
    refuses(folder.path(), &[&name, "found 1 files and 1 folders (beach, holiday.txt)", "give"]);
}

#[test]
fn a_file_instead_of_a_folder() {
    let folder = tiny_blender();
    let parts = [LIST, "expected a dataset folder", "found a file", "give the folder"];
    refuses(&folder.path().join(LIST), &parts);
}

#[test]
fn a_path_that_does_not_exist() {
    let folder = tempfile::tempdir().unwrap();
    let parts = ["no/such", "expected a dataset folder", "found nothing", "check the spelling"];
    refuses(&folder.path().join("no/such"), &parts);
}

#[test]
fn splits_and_frames_that_do_not_exist() {
    let folder = tiny_blender();
    let dataset = open_plain(folder.path()).unwrap();
    let error = dataset.split_named("valid").unwrap_err().to_string();
    assert_says(&error, &["expected one of the splits eval, train", "`valid`", "name one"]);
    let error = dataset.load(1, 9).unwrap_err().to_string();
    assert_says(&error, &["expected a frame number below 3", "found 9", "choose"]);
    assert!(dataset.load(7, 0).is_err());
}
