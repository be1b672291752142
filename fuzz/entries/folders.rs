//! Recordings: whole folders, and single files of otherwise valid folders.

use crate::common::bag;
use crate::common::layouts::{TestLayout, write};
use crate::common::scratch::Files;
use std::path::{Component, Path};
use std::sync::{Arc, OnceLock};
use vbgs_studio::dataset::fingerprint::Fingerprint;
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::DepthBits;
use vbgs_studio::dataset::wild_poses::outlier_poses;
use vbgs_studio::dataset::{Dataset, LoadOptions, capture_check, open, pose_check, range};
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;

/// Mark before the path of each file, for a folder in one text.
pub const MARK: &[u8] = b"\n=== ";
const MAX_FILES: usize = 24;
const MAX_FRAMES: usize = 3;

/// Text files with poses, lists and intrinsics, with the layout that has them.
pub const POSE_FILES: [(TestLayout, &str); 25] = [
    (TestLayout::Tum, "groundtruth.txt"),
    (TestLayout::Tum, "rgb.txt"),
    (TestLayout::Tum, "camera-intrinsics.txt"),
    (TestLayout::Open3d, "trajectory.log"),
    (TestLayout::Open3d, "camera.json"),
    (TestLayout::Replica, "traj.txt"),
    (TestLayout::Replica, "cam_params.json"),
    (TestLayout::Scannet, "pose/1.txt"),
    (TestLayout::Scannet, "intrinsic/intrinsic_color.txt"),
    (TestLayout::SevenScenes, "train/frame-000001.pose.txt"),
    (TestLayout::Blender(DepthBits::Eight), "transforms_train.json"),
    (TestLayout::Nerfstudio, "transforms.json"),
    (TestLayout::Record3d, "metadata.json"),
    (TestLayout::StrayScanner, "odometry.csv"),
    (TestLayout::StrayScanner, "camera_matrix.csv"),
    (TestLayout::Arkit, "frames.jsonl"),
    (TestLayout::RtabMap, "poses.txt"),
    (TestLayout::RtabMap, "calib/1.yaml"),
    (TestLayout::Colmap, "sparse/0/cameras.bin"),
    (TestLayout::Colmap, "sparse/0/images.bin"),
    (TestLayout::Polycam, "keyframes/corrected_cameras/109085000000.json"),
    (TestLayout::Scanner3d, "frame_00001.json"),
    (TestLayout::ArkitScenes, "lowres_wide.traj"),
    (TestLayout::ArkitScenes, "lowres_wide_intrinsics/41048190_6845.100.pincam"),
    (TestLayout::ScannetPp, "iphone/pose_intrinsic_imu.json"),
];

/// Image files of photographs, depth and confidence, with the layout that has them.
pub const IMAGE_FILES: [(TestLayout, &str); 6] = [
    (TestLayout::Blender(DepthBits::Eight), "train/r_0.png"),
    (TestLayout::Blender(DepthBits::Eight), "train/r_0_depth_0001.png"),
    (TestLayout::Replica, "results/frame000000.jpg"),
    (TestLayout::Replica, "results/depth000000.png"),
    (TestLayout::StrayScanner, "confidence/000000.png"),
    (TestLayout::Arkit, "depth/000000.bin"),
];

/// Reads a folder in one text: for each file [`MARK`], a path, a line break and the content.
pub fn layout(data: &[u8]) {
    let folder = tempfile::tempdir().expect("a folder");
    let mut rest = data;
    for _ in 0..MAX_FILES {
        let Some(start) = position(rest, MARK) else { break };
        rest = &rest[start + MARK.len()..];
        let end = position(rest, MARK).unwrap_or(rest.len());
        let (file, behind) = rest.split_at(end);
        rest = behind;
        let Some(line) = file.iter().position(|b| *b == b'\n') else { continue };
        let Ok(name) = std::str::from_utf8(&file[..line]) else { continue };
        put(folder.path(), Path::new(name), &file[line + 1..]);
    }
    exercise(folder.path(), examine);
}

/// Writes a file below a folder, if its name permits.
fn put(folder: &Path, name: &Path, bytes: &[u8]) {
    if !name.components().all(|part| matches!(part, Component::Normal(_))) {
        return;
    }
    let path = folder.join(name);
    // Fails for a name that is too long or below a file; the file is then missing.
    let _ = path.parent().map(std::fs::create_dir_all);
    let _ = std::fs::write(path, bytes);
}

fn position(data: &[u8], wanted: &[u8]) -> Option<usize> {
    data.windows(wanted.len()).position(|window| window == wanted)
}

/// Reads a recording with a mutated file of poses. The first byte selects the file.
pub fn poses(data: &[u8]) {
    chosen(&POSE_FILES, data);
}

/// Reads a recording with a mutated image. The first byte selects the file.
pub fn images(data: &[u8]) {
    chosen(&IMAGE_FILES, data);
}

/// Reads a depth file of Record3D.
pub fn exr(data: &[u8]) {
    in_place(TestLayout::Record3d, "depth/0.exr", data, examine);
}

/// Reads a depth file of nerfstudio: NumPy array or TIFF, detected from the content.
pub fn npy(data: &[u8]) {
    in_place(TestLayout::Nerfstudio, "depths/frame_00001.png", data, examine);
}

/// Reads an archive of Record3D.
pub fn r3d(data: &[u8]) {
    in_place(TestLayout::Record3dArchive, "recording.r3d", data, examine);
}

/// Reads a ROS 2 bag. Most mutated bags open, and training on each would leave no time for the others; `layout`
/// trains on bags.
pub fn mcap(data: &[u8]) {
    in_place(TestLayout::Ros2Bag, bag::FILE, data, |dataset| read(&dataset));
}

fn chosen(files: &[(TestLayout, &str)], data: &[u8]) {
    let Some((first, rest)) = data.split_first() else { return };
    let (layout, file) = files[usize::from(*first) % files.len()];
    in_place(layout, file, rest, examine);
}

/// Reads a valid folder in which one file has other content.
fn in_place(layout: TestLayout, file: &str, data: &[u8], examine: fn(Arc<Dataset>)) {
    let folder = tempfile::tempdir().expect("a folder");
    sound(layout).write(folder.path());
    let path = folder.path().join(file);
    assert!(path.exists(), "{layout:?} has no {file}");
    std::fs::write(path, data).expect("a file");
    exercise(folder.path(), examine);
}

/// Views of the smallest recording.
pub const SMALLEST: SyntheticParams = SyntheticParams {
    width: 16,
    height: 12,
    n_train: 2,
    n_eval: 1,
    seed: 4,
    depth_noise: 0.0,
    ..SyntheticParams::demo()
};

/// Returns the smallest recording of a layout.
pub fn sound(layout: TestLayout) -> &'static Files {
    static KEPT: [OnceLock<Files>; TestLayout::ALL.len()] =
        [const { OnceLock::new() }; TestLayout::ALL.len()];
    let slot = TestLayout::ALL.iter().position(|other| *other == layout).expect("a known layout");
    KEPT[slot].get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        write(&SMALLEST, folder.path(), layout, &mut |_, _| ()).expect("a recording");
        Files::read(folder.path())
    })
}

/// Opens a folder with and without its poses.
fn exercise(folder: &Path, examine: fn(Arc<Dataset>)) {
    let blind = LoadOptions { track: true, geometry_only: true, ..LoadOptions::default() };
    for options in [LoadOptions::default(), blind] {
        match open(folder, &options) {
            Ok(dataset) => examine(Arc::new(dataset)),
            Err(error) => short(&error.to_string()),
        }
    }
}

fn read(dataset: &Dataset) {
    for warning in &dataset.warnings {
        short(&warning.to_string());
    }
    for split in &dataset.splits {
        assert!(split.frames.iter().all(|frame| frame.camera.pose.to_opencv().is_finite()));
        for frame in split.frames.iter().take(MAX_FRAMES) {
            if let Err(error) = frame.load() {
                short(&error.to_string());
            }
        }
    }
}

/// Runs all checks before training, and trains on some frames.
fn examine(dataset: Arc<Dataset>) {
    read(&dataset);
    for (s, split) in dataset.splits.iter().enumerate() {
        let _ = outlier_poses(split);
        let _ = capture_check::check(split);
        let _ = pose_check::check(&dataset, s);
        let _ = range::estimate(&dataset, s);
        let _ = Fingerprint::of(&dataset, s);
        assert!(dataset.up(s).is_finite());
    }
    let selection = Selection { max_frames: Some(MAX_FRAMES), ..Selection::all_frames() };
    let Ok(mut session) = Session::new(dataset, SceneOverrides::default(), selection) else {
        return;
    };
    while let Ok(Step::Trained(_) | Step::Skipped(_)) = session.step() {}
    let splats = session.splats();
    let drawn = splats.iter().filter(|splat| splat.opacity > 0.0);
    drawn.for_each(|splat| assert!(splat.is_valid(), "{splat:?}"));
}

/// Checks that a message does not quote too much of a file.
fn short(message: &str) {
    assert!(message.len() < 2000, "a message of {} bytes: {message:.200}", message.len());
}
