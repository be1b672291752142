//! Seeded mutations of the text files give a clean dataset or a precise error, never a panic.

use crate::common::layouts::TestLayout;
use crate::common::mutation::mutate;
use crate::common::scratch::{open_plain, tiny, tiny_blender, tiny_seven_scenes};
use std::path::Path;
use vbgs_studio::math::rng::{Purpose, Rng};

const ROUNDS: u64 = 400;

/// Opens the dataset and loads all frames; true if it opened.
fn exercise(root: &Path) -> bool {
    match open_plain(root) {
        Err(error) => {
            assert!(error.to_string().contains("expected"), "{error}");
            false
        }
        Ok(dataset) => {
            for warning in &dataset.warnings {
                assert!(warning.to_string().contains("expected"), "{warning}");
            }
            for (s, split) in dataset.splits.iter().enumerate() {
                for (i, entry) in split.frames.iter().enumerate() {
                    let pose = entry.camera.pose.to_opencv();
                    assert!(pose.is_finite());
                    if let Err(error) = dataset.load(s, i) {
                        assert!(error.to_string().contains("expected"), "{error}");
                    }
                }
            }
            true
        }
    }
}

fn fuzz(root: &Path, files: &[&str], stream: u64) {
    let originals: Vec<_> = files.iter().map(|f| std::fs::read(root.join(f)).unwrap()).collect();
    let mut n_opened = 0;
    for round in 0..ROUNDS {
        let mut rng = Rng::new(99, Purpose::Synthetic, stream + round);
        let pick = rng.below(files.len());
        let path = root.join(files[pick]);
        std::fs::write(&path, mutate(&originals[pick], &mut rng)).unwrap();
        n_opened += usize::from(exercise(root));
        std::fs::write(&path, &originals[pick]).unwrap();
    }
    assert!(exercise(root), "the unmodified datasets open");
    assert!(n_opened > 0, "some mutations are harmless");
    eprintln!("{n_opened} of {ROUNDS} mutations still open");
}

#[test]
fn mutated_frame_lists() {
    let folder = tiny_blender();
    fuzz(folder.path(), &["transforms_train.json", "transforms_eval.json"], 0);
}

#[test]
fn mutated_poses_and_intrinsics() {
    let folder = tiny_seven_scenes();
    let files =
        ["train/frame-000001.pose.txt", "eval/frame-000000.pose.txt", "camera-intrinsics.txt"];
    fuzz(folder.path(), &files, 10_000);
}

#[test]
fn mutated_images() {
    let folder = tiny_blender();
    fuzz(folder.path(), &["train/r_0.png", "train/r_1_depth_0001.png"], 20_000);
}

#[test]
fn mutated_recordings() {
    use TestLayout::*;
    let recordings: [(TestLayout, &[&str]); 15] = [
        (Tum, &["groundtruth.txt", "rgb.txt", "depth.txt", "camera-intrinsics.txt"]),
        (Open3d, &["trajectory.log", "camera.json"]),
        (Replica, &["traj.txt", "cam_params.json"]),
        (Scannet, &["pose/1.txt", "intrinsic/intrinsic_color.txt"]),
        (Nerfstudio, &["transforms.json"]),
        (Record3d, &["metadata.json", "depth/1.exr"]),
        (Record3dArchive, &["recording.r3d"]),
        (StrayScanner, &["odometry.csv", "camera_matrix.csv", "confidence/000001.png"]),
        (Arkit, &["frames.jsonl", "depth/000001.bin"]),
        (RtabMap, &["poses.txt", "calib/1.yaml"]),
        (Colmap, &["sparse/0/images.bin", "sparse/0/cameras.bin"]),
        (Ros2Bag, &["room_0.mcap"]),
        (Scanner3d, &["frame_00001.json", "conf_00001.png"]),
        (ArkitScenes, &["lowres_wide.traj", "lowres_wide_intrinsics/41048190_6845.100.pincam"]),
        (ScannetPp, &["iphone/pose_intrinsic_imu.json"]),
    ];
    for (i, (layout, files)) in recordings.into_iter().enumerate() {
        let folder = tiny(layout);
        fuzz(folder.path(), files, 30_000 + 1_000 * i as u64);
    }
}
