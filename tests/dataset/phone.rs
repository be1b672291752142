//! Synthetic phone recordings: the stored files, and the ground-truth views beside them.

use crate::common::layouts::{TestLayout, write};
use crate::common::scratch::{TINY, open_plain, tiny};
use std::path::Path;
use tempfile::TempDir;
use vbgs_studio::dataset::synthetic::write::{DepthBits, FREE_FOLDER, WriteError};
use vbgs_studio::dataset::synthetic::{
    PhoneScene, SyntheticCamera, SyntheticParams, SyntheticScene, dataset,
};
use vbgs_studio::dataset::{Dataset, FrameEntry, Layout, LoadOptions, open, pose_check};
use vbgs_studio::math::image::Image;

const DOOR: SyntheticParams = SyntheticParams {
    width: 96,
    height: 128,
    n_train: 24,
    n_eval: 2,
    n_free: 3,
    seed: 6,
    depth_noise: 0.0,
    camera: SyntheticCamera::Phone(PhoneScene::Door),
};

const ROOM: SyntheticParams =
    SyntheticParams { n_free: 0, camera: SyntheticCamera::Phone(PhoneScene::Room), ..DOOR };

fn written(params: &SyntheticParams, layout: TestLayout) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(params, folder.path(), layout, &mut |_, _| ()).unwrap();
    folder
}

fn all(dataset: &Dataset) -> &[FrameEntry] {
    &dataset.splits[dataset.split_named("all").unwrap()].frames
}

fn mean(image: &Image<[u8; 4]>) -> f64 {
    let sum: f64 = image.data.as_flattened().iter().map(|byte| f64::from(*byte)).sum();
    sum / image.data.len() as f64
}

#[test]
fn recordings_open_beside_their_true_views() {
    for (layout, recognised) in [
        (TestLayout::Record3d, Layout::Record3d),
        (TestLayout::Record3dArchive, Layout::Record3dArchive),
        (TestLayout::StrayScanner, Layout::StrayScanner),
        (TestLayout::Arkit, Layout::Arkit),
    ] {
        let folder = written(&DOOR, layout);
        let recording = open_plain(folder.path()).unwrap();
        assert_eq!(recording.layout, recognised);
        assert!(recording.warnings.is_empty(), "{:?}", recording.warnings);
        let frames = all(&recording);
        assert_eq!(frames.len(), DOOR.n_train, "{layout:?}: no ground truth among them");
        let frame = frames[7].load().unwrap();
        assert_eq!((frame.color.width, frame.color.height), (96, 128));
        assert_eq!(frame.depth.as_ref().unwrap().size(), (48, 64));
        assert!((frame.photo_camera(None).intrinsics.fov_x() - 0.873).abs() < 1e-9);

        let beside = open_plain(&folder.path().join(FREE_FOLDER)).unwrap();
        assert!(beside.warnings.is_empty(), "{:?}", beside.warnings);
        let scene = SyntheticScene::new(&DOOR).unwrap();
        for (name, n) in [("eval", DOOR.n_eval), ("free", DOOR.n_free)] {
            let split = beside.split_named(name).unwrap();
            assert_eq!(beside.splits[split].frames.len(), n);
            let frame = beside.load(split, 1).unwrap();
            let truth = scene.render_view(&frame.camera);
            let differing =
                frame.color.data.iter().zip(&truth.color.data).filter(|(a, b)| a != b).count();
            assert!(differing < 10, "{layout:?}, {name}: {differing} pixels differ");
            let exact = frame.depth_z().unwrap();
            let errors = exact.data.iter().zip(&truth.depth_z.data);
            let far = errors.filter(|(a, b)| (f64::from(**a) - **b).abs() > 0.001).count();
            assert!(far < 10, "{layout:?}, {name}: {far} depths differ");
        }
    }
}

#[test]
fn an_arkit_package_may_state_the_camera_for_its_depth() {
    let folder = written(&DOOR, TestLayout::Arkit);
    let cameras = |folder: &Path| {
        let recording = open_plain(folder).unwrap();
        let frames = all(&recording).iter().map(|entry| entry.load().unwrap());
        frames.map(|frame| (frame.camera, frame.photo_camera(None))).collect::<Vec<_>>()
    };
    let expected = cameras(folder.path());
    let path = folder.path().join("frames.jsonl");
    let text = std::fs::read_to_string(&path).unwrap();
    // Depth has half the width and height of the photographs.
    let moved = text.lines().map(|line| {
        let mut json: serde_json::Value = serde_json::from_str(line).unwrap();
        let mut k = json.as_object_mut().unwrap().remove("intrinsics").unwrap();
        for (row, column) in [(0, 0), (0, 2), (1, 1), (1, 2)] {
            k[row][column] = (0.5 * k[row][column].as_f64().unwrap()).into();
        }
        json["intrinsics_depth"] = k;
        format!("{json}\n")
    });
    std::fs::write(&path, moved.collect::<String>()).unwrap();
    assert_eq!(cameras(folder.path()), expected);
}

/// Recording and ground-truth views share one world: depth agrees within drift and noise.
#[test]
fn depth_has_holes_confidence_and_small_errors() {
    let scene = SyntheticScene::new(&DOOR).unwrap();
    let folder = written(&DOOR, TestLayout::StrayScanner);
    let every = LoadOptions { confidence: Some(0), ..LoadOptions::default() };
    let sure = LoadOptions { confidence: Some(2), ..LoadOptions::default() };
    let [every, sure] = [every, sure].map(|options| open(folder.path(), &options).unwrap());
    let (mut n, mut n_holes, mut n_sure, mut errors) = (0, 0, 0, Vec::new());
    for (entry, sure) in all(&every).iter().zip(all(&sure)).step_by(3) {
        let measured = entry.load().unwrap().depth_z().unwrap();
        let sure = sure.load().unwrap().depth_z().unwrap();
        let truth = scene.render_view(&entry.camera).depth_z;
        n += measured.data.len();
        n_holes += measured.data.iter().filter(|z| !z.is_finite() || **z <= 0.0).count();
        let is_sure = |z: &f32| z.is_finite() && *z > 0.0;
        n_sure += sure.data.iter().filter(|z| is_sure(z)).count();
        let pairs = sure.data.iter().zip(&truth.data).filter(|(z, _)| is_sure(z));
        errors.extend(pairs.map(|(z, truth)| (f64::from(*z) - truth).abs()));
    }
    let share = |part: usize| part as f64 / n as f64;
    assert!((0.001..0.2).contains(&share(n_holes)), "{} holes", share(n_holes));
    assert!((0.6..0.995).contains(&share(n_sure)), "{} sure", share(n_sure));
    assert!(n_sure + n_holes < n, "some pixels have medium confidence");
    errors.sort_by(f64::total_cmp);
    let median = errors[errors.len() / 2];
    assert!((0.001..0.006).contains(&median), "{median} m");
    let check = pose_check::check(&every, every.training_split().unwrap());
    assert!(check.is_none_or(|check| check.best == check.opened), "the convention is right");
}

#[test]
fn depth_is_smooth_across_edges() {
    let scene = SyntheticScene::new(&ROOM).unwrap();
    let folder = written(&ROOM, TestLayout::StrayScanner);
    let every = LoadOptions { confidence: Some(0), ..LoadOptions::default() };
    let recording = open(folder.path(), &every).unwrap();
    let (mut n_edges, mut n_mixed) = (0, 0);
    for entry in all(&recording).iter().step_by(4) {
        let measured = entry.load().unwrap().depth_z().unwrap();
        let truth = scene.render_view(&entry.camera).depth_z;
        for row in 0..truth.height {
            for column in 1..truth.width {
                let sides = [*truth.at(column - 1, row), *truth.at(column, row)];
                let (near, far) = (sides[0].min(sides[1]), sides[0].max(sides[1]));
                let z = f64::from(*measured.at(column, row));
                if far - near > 0.5 && far < 4.5 && z > 0.0 {
                    n_edges += 1;
                    n_mixed += usize::from(z > near + 0.1 && z < far - 0.1);
                }
            }
        }
    }
    assert!(n_edges > 300 && n_mixed * 2 > n_edges, "{n_mixed} of {n_edges} are mixed");
}

#[test]
fn photographs_are_exposed_in_steps() {
    let scene = SyntheticScene::new(&DOOR).unwrap();
    let folder = written(&SyntheticParams { n_free: 0, ..DOOR }, TestLayout::StrayScanner);
    let recording = open_plain(folder.path()).unwrap();
    let ratio = |entry: &FrameEntry| {
        let frame = entry.load().unwrap();
        mean(&frame.color) / mean(&scene.render_view(&frame.photo_camera(None)).color)
    };
    let ratios: Vec<f64> = all(&recording).iter().map(ratio).collect();
    assert!((0.97..1.0).contains(&ratios[0]), "the corners alone are darker: {}", ratios[0]);
    let n_steps = ratios.array_windows().filter(|[a, b]| (a - b).abs() > 0.012).count();
    assert!((1..=8).contains(&n_steps), "{ratios:?}");
    assert!(ratios.iter().all(|ratio| (0.85..1.12).contains(ratio)), "{ratios:?}");
}

#[test]
fn the_seed_decides_everything() {
    let few = SyntheticParams { n_train: 3, n_free: 1, ..DOOR };
    let bytes = |params: &SyntheticParams| {
        let folder = written(params, TestLayout::Record3d);
        let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
        ["metadata.json", "rgb/1.jpg", "depth/1.exr", "confidence/1.png", "free/free/r_0.png"]
            .map(read)
    };
    let first = bytes(&few);
    assert_eq!(first, bytes(&few));
    let other = bytes(&SyntheticParams { seed: 7, ..few });
    assert!(first.iter().zip(&other).all(|(a, b)| a != b));
}

#[test]
fn the_room_camera_has_free_views_too() {
    let params = SyntheticParams { n_train: 12, n_free: 2, ..TINY };
    let made = dataset(&params).unwrap();
    let names: Vec<&str> = made.splits.iter().map(|split| split.name.as_str()).collect();
    assert_eq!(names, ["train", "eval", "free"]);
    let blender = written(&params, TestLayout::Blender(DepthBits::Sixteen));
    let read = open_plain(blender.path()).unwrap();
    let split = read.split_named("free").unwrap();
    let (a, b) = (made.load(2, 1).unwrap(), read.load(split, 1).unwrap());
    assert_eq!(a.color.data, b.color.data);
    // A layout without splits still holds the evaluation frames, and the free views lie beside it.
    let tum = written(&params, TestLayout::Tum);
    assert_eq!(all(&open_plain(tum.path()).unwrap()).len(), 12 + TINY.n_eval);
    let beside = open_plain(&tum.path().join(FREE_FOLDER)).unwrap();
    assert_eq!(beside.splits.len(), 1);
    assert!(!tiny(TestLayout::Tum).path().join(FREE_FOLDER).exists());
}

#[test]
fn what_the_phone_cannot_do_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let error = write(&DOOR, folder.path(), TestLayout::Tum, &mut |_, _| ()).unwrap_err();
    assert!(matches!(&error, WriteError::Params(error) if error.setting == "layout"), "{error}");
    assert!(error.to_string().contains("record3d"), "{error}");
    assert_eq!(dataset(&DOOR).unwrap_err().setting, "camera");
    let noisy = SyntheticParams { depth_noise: 1.0, ..DOOR };
    assert_eq!(SyntheticScene::new(&noisy).unwrap_err().setting, "depth noise");
}
