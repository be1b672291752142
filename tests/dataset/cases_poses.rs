//! Poses that lie elsewhere or are missing, pairs of files of which some are lost, and times in any unit.

use crate::common::layouts::{TestLayout, write};
use crate::common::mutation::mutate;
use crate::common::scratch::{TINY, assert_says, edit_json, open_plain, tiny};
use crate::common::shared;
use glam::{DMat4, DQuat, DVec3};
use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::sync::LazyLock;
use tempfile::TempDir;
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::{Dataset, FrameEntry, Layout, LoadOptions, open, pose_check};
use vbgs_studio::math::rng::{Purpose, Rng};

static TRACK: LazyLock<LoadOptions> =
    LazyLock::new(|| LoadOptions { track: true, ..LoadOptions::default() });

fn all(dataset: &Dataset) -> &[FrameEntry] {
    &dataset.splits[dataset.split_named("all").unwrap()].frames
}

fn agreement(dataset: &Dataset) -> f64 {
    pose_check::check(dataset, 0).unwrap().opened.agreement
}

/// Names of colour and depth files of each frame.
fn pairs(dataset: &Dataset) -> Vec<[String; 2]> {
    let stem = |path: &Path| path.file_stem().unwrap().to_str().unwrap().to_owned();
    let pair = |f: &FrameEntry| [f.color_path(), f.depth_path()].map(|path| stem(path.unwrap()));
    all(dataset).iter().map(pair).collect()
}

#[track_caller]
fn refuses(path: &Path, options: &LoadOptions, parts: &[&str]) {
    match open(path, options) {
        Ok(dataset) => panic!("opened with {:?}, {:?}", dataset.notes, dataset.warnings),
        Err(error) => assert_says(&error.to_string(), parts),
    }
}

fn depth_span(entry: &FrameEntry) -> [f64; 2] {
    let depth = entry.load().unwrap().depth_z().unwrap();
    let found = depth.data.iter().map(|z| f64::from(*z)).filter(|z| z.is_finite() && *z > 0.0);
    found.fold([f64::INFINITY, 0.0], |[a, b], z| [a.min(z), b.max(z)])
}

// The recordings from the field.

#[test]
fn lists_of_pairs_open_with_poses_of_any_name() {
    for (case, from, is_counted) in [
        ("cases/08-icl-nuim-associations", "livingRoom1n.gt.freiburg", true),
        ("cases/09-orb-slam-associations-and-poses", "groundtruth.txt", false),
    ] {
        let Some(path) = shared(case) else { continue };
        for options in [LoadOptions::default(), *TRACK] {
            let dataset = open(&path, &options).unwrap();
            assert_eq!(dataset.layout, Layout::Tum);
            assert!(dataset.warnings.is_empty(), "{:?}", dataset.warnings);
            let frames = all(&dataset);
            assert_eq!(frames.len(), 8, "{case}");
            let k = frames[0].camera.intrinsics;
            assert_eq!((k.width, k.height), (160, 120));
            assert!((k.fx - 132.8).abs() < 1e-9);
            assert!(pairs(&dataset).iter().all(|[color, depth]| color == depth));
            let [near, far] = depth_span(&frames[0]);
            assert!(near > 0.5 && far > 2.0 && far < 7.0, "{case}: depth {near} to {far}");
            assert_eq!(frames[1].time.is_none(), is_counted, "{:?}", frames[1].time);
        }
        let dataset = open_plain(&path).unwrap();
        let is_named = dataset.notes.iter().any(|note| note.contains(from));
        assert_eq!(is_named, is_counted, "{:?}", dataset.notes);
        let least = if is_counted { 0.8 } else { 0.95 };
        assert!(agreement(&dataset) > least, "{case}: {}", agreement(&dataset));
    }
}

#[test]
fn a_trajectory_is_found_one_folder_below() {
    let Some(path) = shared("cases/10-open3d-trajectory-in-scene-folder") else { return };
    let dataset = open_plain(&path).unwrap();
    assert_eq!((dataset.layout, all(&dataset).len()), (Layout::Open3d, 12));
    assert!(dataset.recognised_by.contains("scene/trajectory.log"), "{}", dataset.recognised_by);
    assert!(dataset.warnings.is_empty() && agreement(&dataset) > 0.95, "{}", agreement(&dataset));
}

#[test]
fn times_in_nanoseconds_are_seconds_when_opened() {
    let Some(path) = shared("cases/19-times-in-nanoseconds") else { return };
    let dataset = open_plain(&path).unwrap();
    let frames = all(&dataset);
    assert!(frames.len() >= 7, "{:?}", dataset.warnings);
    let times: Vec<f64> = frames.iter().map(|frame| frame.time.unwrap()).collect();
    assert!((times[0] - 100.0008).abs() < 1e-9 && (times[6] - times[0] - 0.6).abs() < 1e-9);
    assert!(agreement(&dataset) > 0.95, "{}", agreement(&dataset));
}

#[test]
fn tracking_looks_at_no_pose() {
    if let Some(path) = shared("cases/20-track-scannet-lost-poses") {
        let dataset = open(&path, &TRACK).unwrap();
        assert_eq!(
            (all(&dataset).len(), dataset.warnings.len()),
            (12, 0),
            "{:?}",
            dataset.warnings
        );
        assert_eq!(dataset.layout, Layout::Scannet);
        assert_eq!(all(&open_plain(&path).unwrap()).len(), 8, "four poses are lost");
    }
    if let Some(path) = shared("cases/22-record3d-face-camera") {
        let path = path.join("face.r3d");
        let dataset = open(&path, &TRACK).unwrap();
        assert_eq!(
            (all(&dataset).len(), dataset.warnings.len()),
            (12, 0),
            "{:?}",
            dataset.warnings
        );
        let k = all(&dataset)[0].camera.intrinsics;
        assert_eq!((k.width, k.height), (120, 160));
        let spans: Vec<_> = all(&dataset).iter().map(depth_span).collect();
        let near = spans.iter().map(|[near, _]| *near).fold(f64::INFINITY, f64::min);
        let far = spans.iter().map(|[_, far]| *far).fold(0.0, f64::max);
        assert!((near - 0.87).abs() < 0.01 && (far - 4.16).abs() < 0.01, "{near} {far}");
        refuses(&path, &LoadOptions::default(), &["`poses`", "found none", "--poses track"]);
    }
}

/// Without `ffmpeg` the pairs are those of images extracted by hand.
#[test]
fn a_video_with_lost_frames_is_paired_by_its_times() {
    let Some(path) = shared("cases/05-stray-scanner-video-with-lost-frames") else { return };
    let folder = copied(&path);
    fs::create_dir(folder.path().join("rgb")).unwrap();
    let extract = |n: usize| {
        for i in 0..n {
            image::RgbImage::new(160, 120)
                .save(folder.path().join(format!("rgb/{i:06}.png")))
                .unwrap();
        }
    };
    extract(20);
    let dataset = open_plain(folder.path()).unwrap();
    let lost = [3, 9, 15, 20];
    let kept = (0..24).filter(|n| !lost.contains(n));
    let expected: Vec<_> =
        kept.enumerate().map(|(i, n)| [i, n].map(|number| format!("{number:06}"))).collect();
    assert_eq!(pairs(&dataset), expected);
    assert_eq!(dataset.warnings.len(), 4);
    let note = dataset.notes.iter().find(|note| note.contains("rgb.mp4")).unwrap();
    assert_says(note, &["4 of 24", "3, 9, 15, 20"]);
    // Without the video nothing pairs 20 images with 24 depth images for certain.
    fs::remove_file(folder.path().join("rgb.mp4")).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    let is_told = |note: &String| note.contains("20 images") && note.contains("24 depth images");
    assert!(dataset.notes.iter().any(is_told), "{:?}", dataset.notes);
    // A damaged video states no times.
    let video = fs::read(path.join("rgb.mp4")).unwrap();
    for length in [0, 7, 40, video.len() - 500, video.len() - 3] {
        fs::write(folder.path().join("rgb.mp4"), &video[..length]).unwrap();
        assert!(open_plain(folder.path()).is_ok(), "{length} bytes");
    }
    // Counts of pictures that no video has.
    let mut absurd = video.clone();
    let at = video.windows(4).position(|kind| kind == b"stts").unwrap() + 12;
    absurd[at..at + 4].copy_from_slice(&u32::MAX.to_be_bytes());
    fs::write(folder.path().join("rgb.mp4"), absurd).unwrap();
    assert!(open_plain(folder.path()).is_ok());
}

fn copied(from: &Path) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    crate::common::scratch::Files::read(from).write(folder.path());
    folder
}

// Poses in every form.

/// Poses of the tiny recording, which is left in Open3D's layout without its log.
fn without_log() -> (TempDir, Vec<DMat4>) {
    let folder = tiny(TestLayout::Open3d);
    let dataset = open_plain(folder.path()).unwrap();
    let poses = all(&dataset).iter().map(|frame| frame.camera.pose.to_opencv()).collect();
    fs::remove_file(folder.path().join("trajectory.log")).unwrap();
    (folder, poses)
}

fn rows(matrix: &DMat4, n: usize) -> Vec<String> {
    let row = |i| matrix.row(i).to_array().map(|v| format!("{v:e}")).join(" ");
    (0..n).map(row).collect()
}

fn position_and_turn(matrix: &DMat4) -> ([f64; 3], [f64; 4]) {
    let (_, turn, position): (DVec3, DQuat, DVec3) = matrix.to_scale_rotation_translation();
    (position.to_array(), turn.to_array())
}

fn lines(poses: &[DMat4], line: impl Fn(usize, &DMat4) -> String) -> String {
    poses.iter().enumerate().map(|(i, pose)| line(i, pose) + "\n").collect()
}

fn tum(time: impl std::fmt::Display, pose: &DMat4) -> String {
    let ([x, y, z], [qx, qy, qz, qw]) = position_and_turn(pose);
    format!("{time} {x} {y} {z} {qx} {qy} {qz} {qw}")
}

fn forms(poses: &[DMat4]) -> Vec<(&'static str, String)> {
    let by_rows = |matrix: &DMat4| serde_json::json!(matrix.transpose().to_cols_array_2d());
    let named: serde_json::Map<_, _> =
        poses.iter().enumerate().map(|(i, pose)| (format!("{i:05}.png"), by_rows(pose))).collect();
    let listed: Vec<_> = poses
        .iter()
        .enumerate()
        .rev()
        .map(|(i, pose)| serde_json::json!({ "image": format!("color/{i:05}.png"), "c2w": by_rows(pose) }))
        .collect();
    let extrinsics: Vec<_> = poses
        .iter()
        .map(|pose| serde_json::json!({ "extrinsic": pose.inverse().to_cols_array() }))
        .collect();
    let csv = lines(poses, |i, pose| {
        let ([x, y, z], [qx, qy, qz, qw]) = position_and_turn(pose);
        format!(
            "{}, {x}, {y}, {z}, {qw}, {qx}, {qy}, {qz}",
            1_403_636_579_763_555_584_u64 + i as u64 * 33_000_000
        )
    });
    let euroc = "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n";
    vec![
        ("poses.txt", lines(poses, |_, pose| rows(pose, 3).join(" "))),
        ("out/kitti_4x4.txt", lines(poses, |_, pose| rows(pose, 4).join(" "))),
        ("blocks.dat", lines(poses, |_, pose| rows(pose, 4).join("\n") + "\n")),
        (
            "trajectory.txt",
            lines(poses, |i, pose| format!("{i} {i} {}\n{}", i + 1, rows(pose, 4).join("\n"))),
        ),
        (
            "CameraTrajectory.txt",
            lines(poses, |i, pose| tum(format!("{:.6}", 100.0 + 0.033 * i as f64), pose)),
        ),
        ("result/traj.freiburg", lines(poses, tum)),
        ("gt/data.csv", euroc.to_owned() + &csv),
        ("poses.json", serde_json::Value::Object(named).to_string()),
        ("frames.json", serde_json::json!({ "all": listed }).to_string()),
        ("camera_trajectory.json", serde_json::json!({ "parameters": extrinsics }).to_string()),
    ]
}

#[test]
fn poses_of_every_form_are_found() {
    let (folder, poses) = without_log();
    refuses(folder.path(), &LoadOptions::default(), &["found images only", "--poses track"]);
    let check = |name: &str| {
        let dataset = open_plain(folder.path()).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(dataset.warnings.is_empty(), "{name}: {:?}", dataset.warnings);
        assert!(dataset.notes.iter().any(|n| n.contains(name)), "{name}: {:?}", dataset.notes);
        assert_eq!(all(&dataset).len(), poses.len(), "{name}");
        for (frame, pose) in all(&dataset).iter().zip(&poses) {
            let found = frame.camera.pose.to_opencv();
            assert!(found.abs_diff_eq(*pose, 1e-6), "{name}: {found} for {pose}");
        }
    };
    for (name, text) in forms(&poses) {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
        check(name);
        assert_eq!(all(&open(folder.path(), &TRACK).unwrap()).len(), poses.len(), "{name}");
        fs::remove_file(&path).unwrap();
    }
    // One file for each image.
    fs::create_dir(folder.path().join("extrinsics")).unwrap();
    for (i, pose) in poses.iter().enumerate() {
        fs::write(folder.path().join(format!("extrinsics/{i}.txt")), rows(pose, 4).join("\n"))
            .unwrap();
    }
    check("extrinsics");
}

#[test]
fn lists_that_do_not_fit_are_named() {
    let (folder, poses) = without_log();
    let path = folder.path().join("poses.txt");
    // A line too few: no pose can be told from its neighbour.
    for (name, text) in forms(&poses[..3]) {
        let stated_number = ["traj", "json"].iter().any(|part| name.contains(part));
        if stated_number && name != "camera_trajectory.json" {
            continue;
        }
        fs::write(&path, text).unwrap();
        refuses(
            folder.path(),
            &LoadOptions::default(),
            &["poses.txt", "found 3 poses", "4 images"],
        );
    }
    // Of numbered poses only the lost one is missed.
    fs::write(&path, lines(&poses, |i, pose| if i == 1 { String::new() } else { tum(i, pose) }))
        .unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(pairs(&dataset).concat(), ["00000", "00000", "00002", "00002", "00003", "00003"]);
    assert!(dataset.notes.iter().any(|note| note.contains("1 of 4 photographs have no pose")));
    let third = all(&dataset)[1].camera.pose.to_opencv();
    assert!(third.abs_diff_eq(poses[2], 1e-6), "{third}");
    // A lost pose in its place moves no other.
    fs::write(
        &path,
        lines(
            &poses,
            |i, pose| {
                if i == 1 { ["nan"; 12].join(" ") } else { rows(pose, 3).join(" ") }
            },
        ),
    )
    .unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!((all(&dataset).len(), dataset.warnings.len()), (3, 1));
    assert!(all(&dataset)[1].camera.pose.to_opencv().abs_diff_eq(poses[2], 1e-6));
}

#[test]
fn texts_that_are_no_poses_are_none() {
    let (folder, poses) = without_log();
    let texts: [(&str, String); 8] = [
        ("a.txt", "\n".to_owned()),
        ("b.txt", "1 2 3 4\n".repeat(16)),
        ("c.csv", "time,x,y,z,qx,qy,qz,qw\n1,2,3\n,,,,\n".to_owned()),
        ("d.json", format!("{}1{}", "[".repeat(100), "]".repeat(100))),
        ("e.json", "{\"poses\":[null,1e999,{}]}".to_owned()),
        ("f.log", format!("{} 0 1\n", u64::MAX).repeat(10)),
        ("g.txt", "nan ".repeat(12) + "\n" + &"1e308 ".repeat(12)),
        ("h.txt", rows(&poses[0], 3).join(" ") + "\n"),
    ];
    for (name, text) in texts {
        fs::write(folder.path().join(name), text).unwrap();
    }
    fs::write(folder.path().join("i.dat"), [0u8, 255, 1, 0].repeat(1000)).unwrap();
    refuses(folder.path(), &LoadOptions::default(), &["found images only"]);
}

/// A link to poses outside the folder is not followed.
#[cfg(unix)]
#[test]
fn poses_outside_the_folder_are_not_read() {
    let (folder, poses) = without_log();
    let outside = tempfile::tempdir().unwrap();
    let (name, text) = forms(&poses).swap_remove(0);
    fs::write(outside.path().join(name), text).unwrap();
    fs::create_dir(folder.path().join("out")).unwrap();
    let link = folder.path().join("out").join(name);
    std::os::unix::fs::symlink(outside.path().join(name), link).unwrap();
    refuses(folder.path(), &LoadOptions::default(), &["outside"]);
}

#[test]
fn damaged_lists_of_every_form() {
    let (folder, poses) = without_log();
    let mut n_opened = 0;
    for (stream, (name, text)) in (0..).zip(forms(&poses)) {
        let path = folder.path().join(name.rsplit('/').next().unwrap());
        for round in 0..40 {
            let mut rng = Rng::new(99, Purpose::Synthetic, 60_000 + 100 * stream + round);
            fs::write(&path, mutate(text.as_bytes(), &mut rng)).unwrap();
            match open_plain(folder.path()) {
                Ok(dataset) => {
                    n_opened += 1;
                    let is_finite = |f: &FrameEntry| f.camera.pose.to_opencv().is_finite();
                    assert!(all(&dataset).iter().all(is_finite), "{name}, round {round}");
                }
                Err(error) => assert_says(&error.to_string(), &["expected"]),
            }
        }
        fs::remove_file(&path).unwrap();
    }
    assert!(n_opened > 20, "some mutations are harmless");
}

// Lost files.

const LONGER: SyntheticParams = SyntheticParams { n_train: 11, ..TINY };

fn written(layout: TestLayout) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(&LONGER, folder.path(), layout, &mut |_, _| ()).unwrap();
    folder
}

#[test]
fn lost_files_cost_their_own_frames() {
    let folder = written(TestLayout::Open3d);
    let poses: Vec<DMat4> = all(&open_plain(folder.path()).unwrap())
        .iter()
        .map(|f| f.camera.pose.to_opencv())
        .collect();
    fs::remove_file(folder.path().join("color/00003.png")).unwrap();
    fs::remove_file(folder.path().join("depth/00007.png")).unwrap();
    // Block 5 as well: as many blocks are left as images of either kind.
    let log = folder.path().join("trajectory.log");
    let text = fs::read_to_string(&log).unwrap();
    let kept = |(i, line): (usize, &str)| (i / 5 != 5).then(|| format!("{line}\n"));
    fs::write(&log, text.lines().enumerate().filter_map(kept).collect::<String>()).unwrap();
    for (options, n) in [(LoadOptions::default(), 9), (*TRACK, 10)] {
        let dataset = open(folder.path(), &options).unwrap();
        let found = pairs(&dataset);
        assert_eq!(found.len(), n, "{found:?}");
        assert!(found.iter().all(|[color, depth]| color == depth), "{found:?}");
        let said = dataset.warnings.iter().map(|w| w.to_string() + "\n").collect::<String>();
        assert_says(&said, &["expected a colour image", "expected a depth image depth/00007.png"]);
        for (frame, [color, _]) in all(&dataset).iter().zip(&found).filter(|_| !options.track) {
            let number: usize = color.parse().unwrap();
            assert!(frame.camera.pose.to_opencv().abs_diff_eq(poses[number], 1e-9), "{color}");
        }
    }
}

#[test]
fn files_without_common_numbers_are_paired_by_equal_counts_only() {
    let folder = written(TestLayout::Open3d);
    let rename = |new: &dyn Fn(usize) -> usize| {
        for i in (0..12).rev() {
            let path = |n: usize| folder.path().join(format!("depth/{n:05}.png"));
            fs::rename(path(i), path(new(i))).unwrap();
        }
    };
    rename(&|i| 1000 + 10 * i);
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(all(&dataset).len(), 12);
    assert!(dataset.notes.iter().any(|note| note.contains("paired by their order")));
    assert_eq!(pairs(&dataset)[3], ["00003", "01030"]);
    fs::remove_file(folder.path().join("depth/01050.png")).unwrap();
    refuses(folder.path(), &LoadOptions::default(), &["depth", "found 11 for 12 in color/"]);
    refuses(folder.path(), &TRACK, &["depth", "found 11 for 12 in color/"]);
}

#[test]
fn a_lost_photograph_is_not_replaced_by_its_neighbour_at_60_hz() {
    let folder = written(TestLayout::Tum);
    // Half the time between frames.
    for name in ["rgb.txt", "depth.txt", "groundtruth.txt"] {
        let path = folder.path().join(name);
        let text = fs::read_to_string(&path).unwrap();
        let faster = |line: &str| match line.split_once(' ') {
            Some((time, rest)) if !line.starts_with('#') => {
                format!("{:.6} {rest}\n", 1000.0 + 0.5 * (time.parse::<f64>().unwrap() - 1000.0))
            }
            _ => format!("{line}\n"),
        };
        let mut lines: Vec<String> = text.lines().map(faster).collect();
        if name == "rgb.txt" {
            let fifth = lines.iter().position(|line| !line.starts_with('#')).unwrap() + 4;
            lines.remove(fifth);
        }
        fs::write(path, lines.concat()).unwrap();
    }
    let dataset = open_plain(folder.path()).unwrap();
    assert_eq!(all(&dataset).len(), 11, "{:?}", dataset.warnings);
    assert!(pairs(&dataset).iter().all(|[color, depth]| color == depth));
    let said = dataset.warnings[0].to_string();
    assert_says(&said, &["expected a colour image within 12.5 ms", "17 ms away"]);
}

// Times.

#[test]
fn units_of_time_follow_from_the_numbers() {
    let reference = written(TestLayout::Tum);
    let expected = open_plain(reference.path()).unwrap();
    let expected: Vec<_> =
        all(&expected).iter().map(|frame| frame.camera.pose.to_opencv()).collect();
    // Units of photographs, depth and poses; whole numbers but for seconds.
    for units in
        [[1e9, 1e9, 1e9], [1e6, 1e6, 1e6], [1e3, 1e3, 1e3], [1e9, 1e9, 1.0], [1e3, 1e9, 1.0]]
    {
        let folder = copied(reference.path());
        for (name, unit) in ["rgb.txt", "depth.txt", "groundtruth.txt"].iter().zip(units) {
            let path = folder.path().join(name);
            let mut text = String::new();
            for line in fs::read_to_string(&path).unwrap().lines().filter(|l| !l.starts_with('#')) {
                let (time, rest) = line.split_once(' ').unwrap();
                let time: f64 = time.parse::<f64>().unwrap() * unit;
                match unit == 1.0 {
                    true => writeln!(text, "{time:.6} {rest}").unwrap(),
                    false => writeln!(text, "{time:.0} {rest}").unwrap(),
                }
            }
            fs::write(path, text).unwrap();
        }
        let dataset = open_plain(folder.path()).unwrap();
        assert_eq!(all(&dataset).len(), 12, "{units:?}: {:?}", dataset.warnings);
        for (frame, expected) in all(&dataset).iter().zip(&expected) {
            let found = frame.camera.pose.to_opencv();
            // Whole milliseconds are half a millisecond off.
            assert!(found.abs_diff_eq(*expected, 0.02), "{units:?}: {found} for {expected}");
        }
        let step = all(&dataset)[11].time.unwrap() - all(&dataset)[0].time.unwrap();
        assert!((step - 11.0 / 30.0).abs() < 2e-3, "{units:?}: {step}");
    }
}

#[test]
fn names_that_are_times_pair_the_images() {
    let reference = written(TestLayout::Tum);
    let expected = open_plain(reference.path()).unwrap();
    for name in ["rgb.txt", "depth.txt"] {
        fs::remove_file(reference.path().join(name)).unwrap();
    }
    let dataset = open_plain(reference.path()).unwrap();
    assert_eq!(all(&dataset).len(), 12, "{:?}", dataset.warnings);
    assert!(pairs(&dataset).iter().all(|[color, depth]| color == depth));
    for (frame, expected) in all(&dataset).iter().zip(all(&expected)) {
        assert_eq!((frame.camera, frame.time), (expected.camera, expected.time));
        assert_eq!(depth_span(frame), depth_span(expected));
    }
}

// Tracking without poses.

#[test]
fn every_layout_opens_without_poses_for_tracking() {
    use TestLayout::*;
    let files: [(TestLayout, &str); 7] = [
        (Tum, "groundtruth.txt"),
        (Open3d, "trajectory.log"),
        (Replica, "traj.txt"),
        (Scannet, "pose"),
        (StrayScanner, "odometry.csv"),
        (RtabMap, "poses.txt"),
        (ArkitScenes, "lowres_wide.traj"),
    ];
    for (layout, file) in files {
        let folder = tiny(layout);
        let path = folder.path().join(file);
        let expected = all(&open(folder.path(), &TRACK).unwrap())[1].clone();
        match path.is_dir() {
            true => fs::remove_dir_all(&path).unwrap(),
            false => fs::remove_file(&path).unwrap(),
        }
        let dataset =
            open(folder.path(), &TRACK).unwrap_or_else(|error| panic!("{layout:?}: {error}"));
        assert_eq!(all(&dataset).len(), 4, "{layout:?}: {:?}", dataset.warnings);
        let frame = &all(&dataset)[1];
        // Camera and depth do not depend on the poses.
        assert_eq!(frame.camera, expected.camera, "{layout:?}");
        assert_eq!(frame.photo_camera(None), expected.photo_camera(None), "{layout:?}");
        assert_eq!(depth_span(frame), depth_span(&expected), "{layout:?}");
        refuses(folder.path(), &LoadOptions::default(), &["--poses track"]);
    }
}

#[test]
fn damaged_poses_do_not_matter_for_tracking() {
    use TestLayout::*;
    let nonsense = |folder: &Path, layout| match layout {
        Tum => fs::write(folder.join("groundtruth.txt"), "lost").unwrap(),
        Open3d => fs::write(folder.join("trajectory.log"), "0 0 1\n-inf -inf -inf -inf\n").unwrap(),
        Replica => fs::write(folder.join("traj.txt"), "nan ".repeat(16)).unwrap(),
        Scannet => fs::write(folder.join("pose/2.txt"), "-inf ".repeat(16)).unwrap(),
        StrayScanner => {
            let head =
                "timestamp, frame, x, y, z, qx, qy, qz, qw\n0.1, 000001, nan, 0, 0, 0, 0, 0, 0\n";
            fs::write(folder.join("odometry.csv"), head).unwrap();
        }
        RtabMap => fs::write(folder.join("poses.txt"), "0 0 0 0 0 0 0 0\n").unwrap(),
        SevenScenes => fs::write(folder.join("train/frame-000001.pose.txt"), "none").unwrap(),
        Record3d => {
            edit_json(&folder.join("metadata.json"), |json| json["poses"] = serde_json::json!([]))
        }
        Nerfstudio => edit_json(&folder.join("transforms.json"), |json| {
            json["frames"][1]["transform_matrix"] = serde_json::Value::Null;
        }),
        Arkit => {
            let path = folder.join("frames.jsonl");
            let text = fs::read_to_string(&path).unwrap();
            fs::write(path, text.replace("\"camera_to_world\"", "\"lost\"")).unwrap();
        }
        Scanner3d => edit_json(&folder.join("frame_00001.json"), |json| {
            json.as_object_mut().unwrap().remove("cameraPoseARFrame").unwrap();
        }),
        ArkitScenes => fs::write(folder.join("lowres_wide.traj"), "nan ".repeat(7)).unwrap(),
        ScannetPp => edit_json(&folder.join("iphone/pose_intrinsic_imu.json"), |json| {
            json["frame_000010"]["aligned_pose"] = serde_json::Value::Null;
            json["frame_000020"].as_object_mut().unwrap().remove("aligned_pose").unwrap();
        }),
        other => panic!("{other:?}"),
    };
    for layout in [
        Tum,
        Open3d,
        Replica,
        Scannet,
        StrayScanner,
        RtabMap,
        SevenScenes,
        Record3d,
        Nerfstudio,
        Arkit,
        Scanner3d,
        ArkitScenes,
        ScannetPp,
    ] {
        let folder = tiny(layout);
        nonsense(folder.path(), layout);
        let dataset =
            open(folder.path(), &TRACK).unwrap_or_else(|error| panic!("{layout:?}: {error}"));
        assert!(dataset.warnings.is_empty(), "{layout:?}: {:?}", dataset.warnings);
        let recorded = dataset.splits.iter().filter(|split| split.name != "held-out");
        assert_eq!(recorded.map(|split| split.frames.len()).sum::<usize>(), 4, "{layout:?}");
    }
}
