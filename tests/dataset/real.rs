//! The real recordings open with the expected content, and two views agree on the world.

use crate::common::scratch::open_plain;
use crate::common::{shared, skip};
use glam::DVec3;
use vbgs_studio::dataset::frame::Frame;
use vbgs_studio::dataset::unproject::{
    CameraConvention, EdgeFilter, UnprojectSettings, Unprojector, camera_point,
};
use vbgs_studio::dataset::{Layout, range};
use vbgs_studio::observation::points::Points;

#[test]
fn lego_opens_as_blender() {
    let Some(path) = shared("data/lego400") else { return };
    let dataset = open_plain(&path).unwrap();
    assert_eq!(dataset.layout, Layout::Blender);
    assert_eq!(dataset.name, "lego400");
    assert!(dataset.warnings.is_empty(), "{:?}", dataset.warnings);
    let splits: Vec<_> =
        dataset.splits.iter().map(|s| (s.name.as_str(), s.frames.len(), s.has_depth)).collect();
    assert_eq!(splits, [("test", 200, true), ("val", 50, false)]);
    let train = dataset.training_split().unwrap();
    assert_eq!(train, 0, "the split with depth is the training split");
    let evaluation = dataset.evaluation(train);
    assert_eq!((evaluation.new_views.split, evaluation.training), (1, None));
    let k = dataset.splits[0].frames[0].camera.intrinsics;
    assert_eq!((k.width, k.height, k.cx), (400, 400, 200.0));
    assert!((k.fov_x() - 0.6911112070083618).abs() < 1e-12);
    let range = range::estimate(&dataset, train).unwrap();
    assert_eq!((range.lo(), range.hi()), (DVec3::NEG_ONE, DVec3::ONE));
    let view = dataset.load(1, 49).unwrap();
    assert!(view.depth.is_none() && view.color.width == 400);
}

#[test]
fn kinect_opens_as_seven_scenes() {
    let Some(path) = shared("data/kinect_office") else { return };
    let dataset = open_plain(&path).unwrap();
    assert_eq!(dataset.layout, Layout::SevenScenes);
    assert!(dataset.warnings.is_empty(), "{:?}", dataset.warnings);
    let splits: Vec<_> =
        dataset.splits.iter().map(|s| (s.name.as_str(), s.frames.len(), s.has_depth)).collect();
    assert_eq!(splits, [("eval", 10, true), ("train", 100, true)]);
    let train = dataset.training_split().unwrap();
    assert_eq!(dataset.splits[train].name, "train");
    assert_eq!(dataset.splits[dataset.evaluation(train).new_views.split].name, "eval");
    let k = dataset.splits[train].frames[0].camera.intrinsics;
    assert_eq!((k.width, k.height, k.fx, k.fy, k.cx, k.cy), (640, 480, 585.0, 585.0, 320.0, 240.0));

    let range = range::estimate(&dataset, train).unwrap();
    let size = range.hi() - range.lo();
    assert!((size.max_element() - size.min_element()).abs() < 1e-9, "a cube: {size}");
    assert!(size.x > 1.0 && size.x < 8.0, "an office is metres wide: {size}");
}

#[test]
fn two_views_agree_on_the_world() {
    for (name, split, a, b, tolerance) in [
        // half an 8-bit level
        ("data/lego400", "test", 0, 1, 0.016),
        // the sensor's noise half-width at 2.5 m
        ("data/kinect_office", "train", 0, 1, 0.02),
    ] {
        let Some(path) = shared(name) else { return };
        let dataset = open_plain(&path).unwrap();
        let split = dataset.split_named(split).unwrap();
        let (a, b) = (dataset.load(split, a).unwrap(), dataset.load(split, b).unwrap());
        let (n, median) = disagreement(&a, &b);
        assert!(n > 1000 && median < tolerance, "{name}: {n} points, median {median}");
    }
}

/// Number of A's points seen from B, and the median difference between their depth and B's.
pub fn disagreement(a: &Frame, b: &Frame) -> (usize, f64) {
    let depth = a.depth.as_ref().unwrap();
    let measured = b.depth_z().unwrap();
    let mut errors = Vec::new();
    for row in (0..a.color.height).step_by(3) {
        for column in (0..a.color.width).step_by(3) {
            let Some(value) = depth.value_at(column, row).filter(|v| depth.is_trusted(*v)) else {
                continue;
            };
            let k = &a.camera.intrinsics;
            let local = camera_point(k, CameraConvention::Exact, depth.kind, [column, row], value);
            let (pixel, z) = b.camera.project(a.camera.pose.transform_point(local));
            let inside = pixel.x >= 0.0
                && pixel.y >= 0.0
                && pixel.x < b.color.width as f64
                && pixel.y < b.color.height as f64;
            if z > 0.0 && inside {
                let other = f64::from(*measured.at(pixel.x as usize, pixel.y as usize));
                if other > 0.0 {
                    errors.push((other - z).abs());
                }
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    (errors.len(), errors.get(errors.len() / 2).copied().unwrap_or(f64::INFINITY))
}

#[test]
fn every_pixel_is_accounted_for() {
    for (name, split) in [("data/lego400", "test"), ("data/kinect_office", "train")] {
        let Some(path) = shared(name) else { return };
        let dataset = open_plain(&path).unwrap();
        let split = dataset.split_named(split).unwrap();
        let normalization = range::estimate(&dataset, split).unwrap().normalization();
        let frame = dataset.load(split, 0).unwrap();
        let mut unprojector = Unprojector::new();
        let mut points = Points::new();
        for filter in [EdgeFilter::Off, EdgeFilter::DropMixed] {
            let settings =
                UnprojectSettings { convention: CameraConvention::Exact, filter, normalization };
            let counts = unprojector.unproject(&frame, &settings, &mut points).unwrap();
            let pixels = frame.color.width * frame.color.height;
            assert_eq!(counts.kept + counts.holes + counts.dropped(), pixels);
            assert_eq!(counts.kept, points.len());
            assert_eq!(*points.tiles.last().unwrap() as usize, points.len());
            assert!((0..points.n_tiles()).all(|t| (1..=64).contains(&points.tile(t).len())));
            assert_eq!(counts.dropped_edge > 0, filter == EdgeFilter::DropMixed);
            assert!(counts.dropped_edge * 5 < counts.kept, "mixed pixels are few");
        }
    }
}

#[test]
fn a_missing_recording_is_skipped_with_a_count_and_a_failure_in_strict_mode() {
    let outcome =
        |is_strict| skip::outcome("../shared/x not found", "put the data there", is_strict, || 7);
    let failure = outcome(true).unwrap_err();
    for part in ["../shared/x not found", "put the data there", "unset VBGS_STRICT"] {
        assert!(failure.contains(part), "`{part}` is missing from: {failure}");
    }
    assert_eq!(outcome(false).unwrap(), "skipped: ../shared/x not found (7 skipped so far)");
}
