//! Every sequence layout: poses, depth and colours written by `synth` are read back.

use crate::common::layouts::{TestLayout, write};
use crate::common::scratch::open_plain;
use crate::common::shared;
use glam::DMat4;
use std::path::Path;
use strum::IntoEnumIterator;
use tempfile::TempDir;
use vbgs_studio::dataset::frame::Frame;
use vbgs_studio::dataset::synthetic::{self, SyntheticParams, SyntheticScene, SyntheticView};
use vbgs_studio::dataset::{
    Dataset, FrameEntry, Layout, LoadOptions, PoseConvention, open, pose_check,
};
use vbgs_studio::math::image::Image;
use vbgs_studio::math::pose::Pose;

const ROOM: SyntheticParams = SyntheticParams {
    width: 64,
    height: 48,
    n_train: 9,
    n_eval: 2,
    seed: 7,
    depth_noise: 0.0,
    ..SyntheticParams::demo()
};

/// Layout, recognised layout, largest depth error (metres, and a share of depth), and whether
/// colours are stored without loss.
const SEQUENCES: [(TestLayout, Layout, [f64; 2], bool); 16] = [
    (TestLayout::Tum, Layout::Tum, [0.5 / 5000.0, 0.0], true),
    (TestLayout::Open3d, Layout::Open3d, [0.5e-3, 0.0], true),
    (TestLayout::Replica, Layout::Replica, [0.5 / 6553.5, 0.0], false),
    (TestLayout::Scannet, Layout::Scannet, [0.5e-3, 0.0], false),
    (TestLayout::Nerfstudio, Layout::Nerfstudio, [0.5e-3, 0.0], true),
    (TestLayout::Record3d, Layout::Record3d, [0.0, 0.5 / 1024.0], false),
    (TestLayout::Record3dArchive, Layout::Record3dArchive, [0.0, 1e-7], false),
    (TestLayout::StrayScanner, Layout::StrayScanner, [0.5e-3, 0.0], true),
    (TestLayout::Arkit, Layout::Arkit, [0.0, 1e-7], true),
    (TestLayout::RtabMap, Layout::RtabMap, [0.5e-3, 0.0], true),
    (TestLayout::Colmap, Layout::Colmap, [0.5e-3, 0.0], true),
    (TestLayout::Ros2Bag, Layout::Ros2Bag, [0.5e-3, 0.0], true),
    (TestLayout::Polycam, Layout::Polycam, [0.5e-3, 0.0], false),
    (TestLayout::Scanner3d, Layout::Scanner3d, [0.5e-3, 0.0], false),
    (TestLayout::ArkitScenes, Layout::ArkitScenes, [0.5e-3, 0.0], true),
    (TestLayout::ScannetPp, Layout::ScannetPp, [0.5e-3, 0.0], false),
];

fn written(layout: TestLayout) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(&ROOM, folder.path(), layout, &mut |_, _| ()).unwrap();
    folder
}

fn all(dataset: &Dataset) -> &[FrameEntry] {
    &dataset.splits[dataset.split_named("all").unwrap()].frames
}

fn truth() -> Vec<Pose> {
    let room = synthetic::dataset(&ROOM).unwrap();
    room.splits.iter().flat_map(|split| &split.frames).map(|frame| frame.camera.pose).collect()
}

fn largest(difference: DMat4) -> f64 {
    difference.to_cols_array().iter().fold(0.0f64, |most, v| most.max(v.abs()))
}

/// Mean difference of bytes.
fn mean_difference(a: &Image<[u8; 4]>, b: &Image<[u8; 4]>) -> f64 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let bytes = a.data.as_flattened().iter().zip(b.data.as_flattened());
    let sum: f64 = bytes.map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
    sum / a.data.as_flattened().len() as f64
}

#[test]
fn what_is_written_is_read_back() {
    let scene = SyntheticScene::new(&ROOM).unwrap();
    let poses = truth();
    for (layout, recognised, [step, share], is_lossless) in SEQUENCES {
        let folder = written(layout);
        let dataset = open_plain(folder.path()).unwrap_or_else(|e| panic!("{layout:?}: {e}"));
        assert_eq!(dataset.layout, recognised);
        assert!(dataset.warnings.is_empty(), "{layout:?}: {:?}", dataset.warnings);
        let frames = all(&dataset);
        assert_eq!(frames.len(), poses.len(), "{layout:?}");
        for (i, (entry, pose)) in frames.iter().zip(&poses).enumerate() {
            let error = largest(entry.camera.pose.to_opencv() - pose.to_opencv());
            assert!(error < 1e-6, "{layout:?}, frame {i}: pose is off by {error}");
            if ![0, 5, 10].contains(&i) {
                continue;
            }
            let frame = entry.load().unwrap();
            let seen = scene.render_view(&entry.photo_camera(None)).color;
            let difference = mean_difference(&frame.color, &seen);
            assert!(difference < if is_lossless { 1e-9 } else { 6.0 }, "{layout:?}: {difference}");
            let SyntheticView { depth_z, .. } = scene.render_view(&entry.camera);
            let read = frame.depth_z().unwrap();
            for (read, true_z) in read.data.iter().zip(&depth_z.data) {
                let error = (f64::from(*read) - true_z).abs();
                let most = step + share * true_z + 1e-6;
                assert!(error <= most, "{layout:?}, frame {i}: depth {read} for {true_z}");
            }
        }
    }
    assert_eq!(TestLayout::ALL.len(), SEQUENCES.len() + 3, "every layout is read back somewhere");
}

#[test]
fn photographs_and_depth_have_cameras_of_their_own() {
    for (layout, size) in [
        (TestLayout::StrayScanner, [16, 12]),
        (TestLayout::Record3dArchive, [16, 12]),
        (TestLayout::Scannet, [32, 24]),
    ] {
        let folder = written(layout);
        let dataset = open_plain(folder.path()).unwrap();
        let frame = dataset.load(0, 3).unwrap();
        let k = frame.camera.intrinsics;
        assert_eq!([k.width, k.height], size, "{layout:?}");
        assert_eq!(frame.depth.as_ref().unwrap().size(), (k.width as usize, k.height as usize));
        let photo = frame.photo_camera(None);
        assert_eq!([photo.intrinsics.width, photo.intrinsics.height], [64, 48], "{layout:?}");
        assert_eq!([frame.color.width, frame.color.height], [64, 48]);
        assert!((photo.intrinsics.fov_x() - synthetic::FIELD_OF_VIEW).abs() < 1e-9);
        let registered = frame.with_registered_color();
        assert_eq!(registered.color.width, size[0] as usize);
        let opaque = registered.color.data.iter().filter(|pixel| pixel[3] == 255).count();
        assert!(opaque * 10 > registered.color.data.len() * 8, "{layout:?}: {opaque}");
    }
}

#[test]
fn every_eighth_frame_is_held_out_under_a_name() {
    let folder = written(TestLayout::Tum);
    let dataset = open_plain(folder.path()).unwrap();
    let names: Vec<_> = dataset.splits.iter().map(|s| (s.name.as_str(), s.frames.len())).collect();
    assert_eq!(names, [("all", 11), ("held-out", 2)]);
    let train = dataset.training_split().unwrap();
    let evaluation = dataset.evaluation(train);
    assert_eq!((train, &evaluation.new_views.frames[..]), (0, &[0, 8][..]));
    assert_eq!(evaluation.training, Some(vec![1, 2, 3, 4, 5, 6, 7, 9, 10]));
    let held_out = &dataset.splits[dataset.split_named("held-out").unwrap()].frames;
    assert_eq!(held_out[1].name, dataset.splits[0].frames[8].name);
    assert_eq!(held_out[1].time, Some(1000.0 + (8.0f64 / 30.0 * 1e6).round() / 1e6));
}

#[test]
fn an_archive_opens_by_itself() {
    let folder = written(TestLayout::Record3dArchive);
    let path = folder.path().join("recording.r3d");
    let dataset = open_plain(&path).unwrap();
    assert_eq!((dataset.layout, all(&dataset).len()), (Layout::Record3dArchive, 11));
    assert_eq!((dataset.name.as_str(), dataset.path.as_deref()), ("recording.r3d", Some(&*path)));
    assert!(dataset.load(0, 10).is_ok());
}

#[test]
fn options_change_what_a_recording_means() {
    let folder = written(TestLayout::Tum);
    let options = LoadOptions {
        poses: Some(PoseConvention::Opengl),
        intrinsics: Some([50.0, 51.0, 32.0, 24.0]),
        depth_scale: Some(0.001),
        ..LoadOptions::default()
    };
    let dataset = open(folder.path(), &options).unwrap();
    let entry = &all(&dataset)[4];
    let as_written = truth()[4].to_opencv();
    let expected = Pose::from_opengl(as_written).unwrap();
    assert!(largest(entry.camera.pose.to_opencv() - expected.to_opencv()) < 1e-6);
    assert_eq!([entry.camera.intrinsics.fx, entry.camera.intrinsics.fy], [50.0, 51.0]);
    let plain = open_plain(folder.path()).unwrap().load(0, 4).unwrap().depth_z().unwrap();
    let scaled = entry.load().unwrap().depth_z().unwrap();
    assert!((scaled.data[9] - 5.0 * plain.data[9]).abs() < 1e-5);
    for options in [
        LoadOptions { intrinsics: Some([0.0, 1.0, 1.0, 1.0]), ..LoadOptions::default() },
        LoadOptions { confidence: Some(3), ..LoadOptions::default() },
    ] {
        let error = open(folder.path(), &options).unwrap_err().to_string();
        assert!(error.contains("correct it or leave it out"), "{error}");
    }
}

/// Pixels of low confidence are holes, unless the options accept them.
#[test]
fn doubtful_depth_is_left_out() {
    let folder = written(TestLayout::StrayScanner);
    let map = folder.path().join("confidence/000002.png");
    let doubts = image::GrayImage::from_fn(16, 12, |x, _| image::Luma([if x < 4 { 0 } else { 1 }]));
    doubts.save(map).unwrap();
    let at = |confidence, column| {
        let options = LoadOptions { confidence, ..LoadOptions::default() };
        let frame = open(folder.path(), &options).unwrap().load(0, 2).unwrap();
        frame.depth.unwrap().value_at(column, 5).is_some()
    };
    assert_eq!([at(None, 3), at(None, 4), at(Some(0), 3)], [false, true, true]);
    let error = open(folder.path(), &LoadOptions { confidence: Some(2), ..Default::default() });
    let error = error.unwrap().load(0, 2).unwrap_err().to_string();
    assert!(error.contains("000002.png") && error.contains("only holes"), "{error}");
}

/// Depth as TIFF, NPY and EXR, lens distortion, and a camera for each frame.
#[test]
fn nerfstudio_takes_every_kind_of_depth() {
    let folder = written(TestLayout::Nerfstudio);
    let list = folder.path().join("transforms.json");
    let lengths = open_plain(folder.path()).unwrap().load(0, 1).unwrap().depth_z().unwrap();
    let raw: Vec<f32> = lengths.data.iter().map(|z| z * 1000.0).collect();
    let mut npy = b"\x93NUMPY\x01\x00".to_vec();
    let header =
        format!("{:<117}\n", "{'descr': '<f4', 'fortran_order': False, 'shape': (48, 64), }");
    npy.extend((header.len() as u16).to_le_bytes());
    npy.extend(header.bytes());
    npy.extend(raw.iter().flat_map(|v| v.to_le_bytes()));
    std::fs::write(folder.path().join("depths/1.npy"), &npy).unwrap();
    let mut file = std::fs::File::create(folder.path().join("depths/1.tiff")).unwrap();
    let mut tiff = tiff::encoder::TiffEncoder::new(&mut file).unwrap();
    tiff.write_image::<tiff::encoder::colortype::Gray32Float>(64, 48, &raw).unwrap();
    exr::prelude::write_rgb_file(folder.path().join("depths/1.exr"), 64, 48, |x, y| {
        (raw[y * 64 + x], 0.0f32, 0.0f32)
    })
    .unwrap();
    for name in ["depths/1.npy", "depths/1.tiff", "depths/1.exr"] {
        crate::common::scratch::edit_json(&list, |json| {
            json["frames"][1]["depth_file_path"] = name.into();
        });
        let read = open_plain(folder.path()).unwrap().load(0, 1).unwrap().depth_z().unwrap();
        let worst = read.data.iter().zip(&lengths.data).map(|(a, b)| (a - b).abs());
        assert!(worst.fold(0.0f32, f32::max) < 1e-5, "{name}");
    }
    for (name, keep) in [("depths/1.npy", 0.5), ("depths/1.tiff", 0.5), ("depths/1.exr", 0.5)] {
        truncate(&folder.path().join(name), keep);
        crate::common::scratch::edit_json(&list, |json| {
            json["frames"][1]["depth_file_path"] = name.into();
        });
        let error = open_plain(folder.path()).unwrap().load(0, 1).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("expected"), "{error}");
    }
}

#[test]
fn a_bent_lens_is_made_straight() {
    let folder = written(TestLayout::Nerfstudio);
    let list = folder.path().join("transforms.json");
    let straight = open_plain(folder.path()).unwrap().load(0, 1).unwrap();
    crate::common::scratch::edit_json(&list, |json| json["k1"] = 0.1.into());
    let bent = open_plain(folder.path()).unwrap().load(0, 1).unwrap();
    let k = straight.camera.intrinsics;
    let (column, row) = (50, 36);
    let slope = k.ray(column, row).truncate()
        * (1.0 + 0.1 * k.ray(column, row).truncate().length_squared());
    let source = [(slope.x * k.fx + k.cx) as usize, (slope.y * k.fy + k.cy) as usize];
    let value = |frame: &vbgs_studio::dataset::frame::Frame, [x, y]: [usize; 2]| {
        frame.depth.as_ref().unwrap().value_at(x, y).unwrap()
    };
    assert_eq!(value(&bent, [column, row]), value(&straight, source));
    crate::common::scratch::edit_json(&list, |json| json["camera_model"] = "OPENCV_FISHEYE".into());
    let error = open_plain(folder.path()).unwrap_err().to_string();
    assert!(error.contains("OPENCV_FISHEYE") && error.contains("undistort"), "{error}");
}

fn truncate(path: &Path, keep: f64) {
    let bytes = std::fs::read(path).unwrap();
    std::fs::write(path, &bytes[..(bytes.len() as f64 * keep) as usize]).unwrap();
}

#[test]
fn recordings_of_others_open_without_an_option() {
    for (name, layout, frames) in [
        ("data/tum_rpy", Layout::Tum, 91),
        ("data/open3d_sample", Layout::Open3d, 5),
        ("data/chair800", Layout::Blender, 200),
    ] {
        let Some(path) = shared(name) else { return };
        let dataset = open_plain(&path).unwrap();
        assert_eq!((dataset.layout, &dataset.warnings[..].len()), (layout, &0), "{name}");
        let train = dataset.training_split().unwrap();
        assert_eq!(dataset.splits[train].frames.len(), frames, "{name}");
        assert!(dataset.load(train, 1).unwrap().depth.is_some());
    }
}

/// The pose convention gives the same cameras, whether stated in the options or by the layout. The
/// images determine the rig's calibration in both cases.
#[test]
fn the_rig_is_found_whoever_says_what_poses_mean() {
    let Some(path) = shared("data/tum_rpy") else { return };
    let known = open_plain(&path).unwrap();
    let poses = Some(PoseConvention::Opencv);
    let said = open(&path, &LoadOptions { poses, ..LoadOptions::default() }).unwrap();
    let mount = |dataset: &Dataset| {
        dataset.notes.iter().find(|note| note.contains("from the tracked body")).cloned()
    };
    assert!(mount(&known).is_some() && mount(&known) == mount(&said), "{:?}", said.notes);
    let cameras =
        |dataset: &Dataset| dataset.splits[0].frames.iter().map(|f| f.camera.pose).collect();
    let [known, said]: [Vec<Pose>; 2] = [cameras(&known), cameras(&said)];
    for (known, said) in known.iter().zip(&said) {
        let (shift, turn) = known.offset_to(said);
        assert!(
            shift.length() < 1e-9 && turn.to_scaled_axis().length() < 1e-7,
            "{known:?} {said:?}"
        );
    }
}

/// `rectified` of a tracked dataset corrects rows and times as the recorded poses would, and keeps
/// no recorded pose.
#[test]
fn images_of_tracked_frames_are_straightened_by_recorded_poses() {
    let Some(path) = shared("data/tum_rpy") else { return };
    let tracked = open(&path, &LoadOptions { track: true, ..LoadOptions::default() }).unwrap();
    let straightened = tracked.rectified().unwrap();
    let recorded = open_plain(&path).unwrap();
    assert_eq!(recorded.rectified().map(|_| ()), None, "recorded poses are rectified already");
    let [raw, straight, expected] =
        [&tracked, &straightened, &recorded].map(|dataset| dataset.load(0, 3).unwrap());
    assert_ne!(raw.color, straight.color);
    assert_eq!((&straight.color, &straight.depth), (&expected.color, &expected.depth));
    let offset = |frame: &Frame| frame.photographed_by(None).map(|camera| camera.offset);
    assert_eq!(offset(&straight), offset(&expected));
    assert_eq!(straight.camera.pose, Pose::IDENTITY, "tracking alone determines the poses");
    let folder = tempfile::tempdir().unwrap();
    write(&ROOM, folder.path(), TestLayout::Tum, &mut |_, _| ()).unwrap();
    let track = LoadOptions { track: true, ..LoadOptions::default() };
    let exact = open(folder.path(), &track).unwrap();
    assert!(exact.rectified().is_none(), "the images are not from a Kinect");
}

/// Every layout states the right pose convention.
#[test]
fn conventions_are_stated() {
    for (layout, recognised, ..) in SEQUENCES {
        let is_opengl = matches!(
            layout,
            TestLayout::Nerfstudio
                | TestLayout::Record3d
                | TestLayout::Record3dArchive
                | TestLayout::Arkit
                | TestLayout::Polycam
                | TestLayout::Scanner3d
        );
        let expected = if is_opengl { PoseConvention::Opengl } else { PoseConvention::Opencv };
        assert_eq!(recognised.pose_convention(), expected, "{layout:?}");
    }
}

/// Depth alone shows a wrong pose convention or unit.
#[test]
fn wrong_poses_and_units_are_told_from_depth() {
    let folder = tempfile::tempdir().unwrap();
    let walk = SyntheticParams { n_train: 48, n_eval: 0, ..ROOM };
    write(&walk, folder.path(), TestLayout::Tum, &mut |_, _| ()).unwrap();
    let check = |options| pose_check::check(&open(folder.path(), &options).unwrap(), 0).unwrap();
    let right = check(LoadOptions::default());
    assert!(right.opened.agreement > 0.8 && right.warnings().is_empty(), "{right:?}");
    assert!(right.pairs == 8 && right.opened.error < 0.05, "{right:?}");
    for poses in PoseConvention::iter().filter(|poses| *poses != PoseConvention::Opencv) {
        let wrong = check(LoadOptions { poses: Some(poses), ..LoadOptions::default() });
        assert_eq!((wrong.opened.poses, wrong.best.poses), (poses, PoseConvention::Opencv));
        assert!(wrong.opened.agreement < 0.5 && wrong.best.agreement > 0.8, "{wrong:?}");
    }
    let millimetres = LoadOptions { depth_scale: Some(0.001), ..LoadOptions::default() };
    let far = LoadOptions { depth_range: Some([0.1, 100.0]), ..millimetres };
    let wrong = check(far);
    assert!((wrong.best.unit / 0.2 - 1.0).abs() < 0.01, "{wrong:?}");
    assert_eq!(wrong.best.poses, PoseConvention::Opencv);
}

/// Poses of a robot, whose camera points along its x axis and is mounted above it, become camera poses.
#[test]
fn rtabmap_poses_of_a_robot() {
    let folder = written(TestLayout::RtabMap);
    let optical = "0., 0., 1., 0.125, -1., 0., 0., 0., 0., -1., 0., 0.5";
    let said = format!("local_transform:\n   rows: 3\n   cols: 4\n   data: [ {optical} ]\n");
    for file in std::fs::read_dir(folder.path().join("calib")).unwrap() {
        let path = file.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(path, text + &said).unwrap();
    }
    let poses = folder.path().join("poses.txt");
    let of_camera = std::fs::read_to_string(&poses).unwrap();
    std::fs::rename(&poses, folder.path().join("map_camera_poses.txt")).unwrap();
    let far = |dataset: &Dataset| {
        let poses = all(dataset).iter().zip(truth());
        let far =
            poses.map(|(frame, truth)| largest(frame.camera.pose.to_opencv() - truth.to_opencv()));
        far.fold(0.0f64, f64::max)
    };
    assert!(far(&open_plain(folder.path()).unwrap()) < 1e-6, "poses of the camera itself");
    std::fs::remove_file(folder.path().join("map_camera_poses.txt")).unwrap();
    let numbers = optical.replace(',', " ");
    let rows: Vec<f64> = numbers.split_whitespace().map(|v| v.parse().unwrap()).collect();
    let rows: [f64; 16] = [&rows[..], &[0.0, 0.0, 0.0, 1.0]].concat().try_into().unwrap();
    let to_camera = DMat4::from_cols_array(&rows).transpose().inverse();
    let robot: String = of_camera
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            let v: Vec<f64> = line.split_whitespace().map(|v| v.parse().unwrap()).collect();
            let turn = glam::DQuat::from_xyzw(v[4], v[5], v[6], v[7]).normalize();
            let camera = DMat4::from_rotation_translation(turn, glam::DVec3::new(v[1], v[2], v[3]));
            let (_, q, p) = (camera * to_camera).to_scale_rotation_translation();
            let [px, py, pz] = p.to_array();
            format!("{:.6} {px} {py} {pz} {} {} {} {} {}\n", v[0], q.x, q.y, q.z, q.w, v[8])
        })
        .collect();
    std::fs::write(&poses, robot).unwrap();
    let dataset = open_plain(folder.path()).unwrap();
    assert!(far(&dataset) < 1e-6, "poses of the robot: {}", far(&dataset));
    assert!(dataset.notes.iter().any(|note| note.contains("poses of the robot")));
    let broken = folder.path().join("calib/1.yaml");
    let text = std::fs::read_to_string(&broken).unwrap();
    std::fs::write(&broken, text.replace("0., 0., 1., 0.125", "0., 0., 7., 0.125")).unwrap();
    let error = open_plain(folder.path()).unwrap_err().to_string();
    assert!(error.contains("1.yaml") && error.contains("local_transform"), "{error}");
}
