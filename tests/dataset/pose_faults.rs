//! Faults of whole recordings that load without an error: they show where neighbouring frames are compared.

use crate::common::layouts::{TestLayout, write};
use crate::common::scratch::open_plain;
use crate::common::shared;
use glam::{DMat4, DVec4};
use image::{DynamicImage, ImageReader};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use vbgs_studio::dataset::pose_check::{Fault, PoseCheck, check};
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::{Dataset, LoadOptions, open};

/// A walk with the pace of a hand-held camera.
const WALK: SyntheticParams = SyntheticParams {
    width: 160,
    height: 120,
    n_train: 40,
    n_eval: 0,
    seed: 7,
    depth_noise: 0.001,
    ..SyntheticParams::demo()
};

fn recording() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(&WALK, folder.path(), TestLayout::Scannet, &mut |_, _| ()).unwrap();
    folder
}

fn checked(dataset: &Dataset) -> PoseCheck {
    check(dataset, dataset.training_split().unwrap()).unwrap()
}

fn found(folder: &TempDir) -> PoseCheck {
    checked(&open_plain(folder.path()).unwrap())
}

/// Files of a subfolder in the order of their numbers.
fn files(folder: &Path, name: &str) -> Vec<PathBuf> {
    let listed = fs::read_dir(folder.join(name)).unwrap();
    let mut files: Vec<PathBuf> = listed.map(|entry| entry.unwrap().path()).collect();
    files.sort_by_key(|path| {
        path.file_stem().unwrap().to_str().unwrap().parse::<u32>().unwrap_or_default()
    });
    files
}

fn edit_poses(folder: &TempDir, edit: impl Fn(DMat4) -> DMat4) {
    for path in files(folder.path(), "pose") {
        let text = fs::read_to_string(&path).unwrap();
        let numbers: Vec<f64> = text.split_whitespace().map(|v| v.parse().unwrap()).collect();
        let pose = DMat4::from_cols_slice(&numbers).transpose();
        let rows = edit(pose).transpose().to_cols_array();
        fs::write(path, rows.map(|v| v.to_string()).join(" ")).unwrap();
    }
}

fn edit_images(folder: &TempDir, edit: impl Fn(DynamicImage) -> DynamicImage) {
    for path in ["color", "depth"].iter().flat_map(|name| files(folder.path(), name)) {
        let image = ImageReader::open(&path).unwrap().decode().unwrap();
        edit(image).save(path).unwrap();
    }
}

/// Moves the content of every file to the name of the next one; the last one's goes to the first.
fn shift(folder: &TempDir, name: &str) {
    let files = files(folder.path(), name);
    let mut contents: Vec<Vec<u8>> = files.iter().map(|path| fs::read(path).unwrap()).collect();
    contents.rotate_right(1);
    files.iter().zip(contents).for_each(|(path, content)| fs::write(path, content).unwrap());
}

#[track_caller]
fn warns(check: &PoseCheck, part: &str) {
    let text = check.warnings().join("; ");
    assert!(
        text.contains(part) && text.len() < 300,
        "`{part}` is missing from `{text}`: {check:?}"
    );
}

#[test]
fn a_good_recording_has_no_fault() {
    let check = found(&recording());
    assert!(check.warnings().is_empty() && check.opened.agreement > 0.85, "{check:?}");
}

#[test]
fn mirrored_poses_and_rotated_images_are_found() {
    let folder = recording();
    let mirror = DMat4::from_diagonal(DVec4::new(1.0, -1.0, 1.0, 1.0));
    edit_poses(&folder, |pose| mirror * pose * mirror);
    let check = found(&folder);
    assert_eq!(check.best.fault, Some(Fault::MirroredRows), "{check:?}");
    warns(&check, "mirrored top to bottom");
    let folder = recording();
    edit_images(&folder, |image| image.fliph());
    assert_eq!(found(&folder).best.fault, Some(Fault::MirroredColumns));
    let folder = recording();
    edit_images(&folder, |image| image.rotate180());
    let check = found(&folder);
    assert_eq!(check.best.fault, Some(Fault::Rotated(2)), "{check:?}");
    warns(&check, "rotated by 180 degrees clockwise");
    // Rotating a camera clockwise rotates what it should see counterclockwise.
    for (turns, angle) in [(1, 90.0f64), (3, -90.0)] {
        let folder = recording();
        edit_poses(&folder, |pose| pose * DMat4::from_rotation_z(angle.to_radians()));
        assert_eq!(found(&folder).best.fault, Some(Fault::Rotated(turns)));
    }
}

#[test]
fn frames_of_another_pose_are_found() {
    let folder = recording();
    shift(&folder, "pose");
    let check = found(&folder);
    assert_eq!(check.best.fault, Some(Fault::Shifted(1)), "{check:?}");
    warns(&check, "the poses one frame later");
}

#[test]
fn photographs_of_another_frame_are_found() {
    let folder = recording();
    shift(&folder, "color");
    let check = found(&folder);
    assert_eq!((check.best.fault, check.color_shift), (None, 1), "{check:?}");
    warns(&check, "the depth one frame earlier");
    for _ in 0..WALK.n_train - 2 {
        shift(&folder, "color");
    }
    assert_eq!(found(&folder).color_shift, -1);
}

/// A wrong focal length bends every frame alike; only neighbouring frames show it.
#[test]
fn a_wrong_focal_length_is_found_with_its_value() {
    let with = |path: &Path, factor: f64| {
        let right = open_plain(path).unwrap();
        let k = right.splits[right.training_split().unwrap()].frames[0].camera.intrinsics;
        let intrinsics = Some([factor * k.fx, factor * k.fy, k.cx, k.cy]);
        let options = LoadOptions { intrinsics, ..LoadOptions::default() };
        (k.fx, checked(&open(path, &options).unwrap()))
    };
    let folder = recording();
    let recordings = [
        (Some(folder.path().to_owned()), &[0.9, 0.95, 1.05, 1.1][..], 0.02),
        (shared("data/kinect_office"), &[0.95, 1.05], 0.03),
    ];
    for (path, factors, tolerance) in recordings {
        let Some(path) = path else { continue };
        for &factor in factors {
            let (focal, check) = with(&path, factor);
            let Some(Fault::FocalLength(change)) = check.best.fault else {
                panic!("{}, {factor}: {check:?}", path.display())
            };
            assert!((change * factor - 1.0).abs() < tolerance, "{factor}: {check:?}");
            warns(&check, &format!("{:.0} px", check.focal * change));
            assert!((check.focal / (factor * focal) - 1.0).abs() < 1e-9);
        }
        let (_, check) = with(&path, 1.0);
        assert!(check.warnings().is_empty(), "{}: {check:?}", path.display());
    }
}

#[test]
fn a_unit_that_is_slightly_off_is_found_with_its_value() {
    let Some(path) = shared("data/kinect_office") else { return };
    for factor in [0.8, 0.9, 1.1, 1.25] {
        let options = LoadOptions { depth_scale: Some(1e-3 * factor), ..LoadOptions::default() };
        let check = checked(&open(&path, &options).unwrap());
        assert_eq!(check.best.fault, None, "{factor}: {check:?}");
        assert!((check.best.unit * factor - 1.0).abs() < 0.03, "{factor}: {check:?}");
        warns(&check, "times as long as read");
    }
}

#[test]
fn real_recordings_have_no_fault() {
    for name in ["kinect_office", "tum_rpy", "lego400", "open3d_sample", "arkit_lidar", "chair800"]
    {
        let Some(path) = shared(&format!("data/{name}")) else { continue };
        let dataset = open_plain(&path).unwrap();
        let Ok(split) = dataset.training_split() else { continue };
        let Some(check) = check(&dataset, split) else { continue };
        assert!(check.warnings().is_empty(), "{name}: {:?} {check:?}", check.warnings());
    }
}

#[test]
fn a_world_that_is_mirrored_is_found() {
    let Some(path) = shared("cases/08-icl-nuim-associations") else { return };
    let check = checked(&open_plain(&path).unwrap());
    assert_eq!(check.best.fault, Some(Fault::MirroredRows), "{check:?}");
    assert!(check.best.agreement > 0.95 && check.best.error < 0.003, "{check:?}");
}
