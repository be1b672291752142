//! Status of pixels in frames with few or no valid points.

use super::drawn::{HEIGHT, WIDTH, frame, prepare, settings};
use super::oracle;
use crate::common::layouts::TestLayout;
use crate::common::scratch::{open_plain, tiny};
use glam::DVec3;
use std::sync::Arc;
use vbgs_studio::dataset::calibration::Calibration;
use vbgs_studio::dataset::frame::{Depth, DepthCodes, DepthKind, Frame};
use vbgs_studio::dataset::surface::{
    PixelSampling, PixelStatus, Preparer, Sensor, SurfaceCounts, SurfaceSettings,
};
use vbgs_studio::dataset::synthetic::write::DepthBits;
use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
use vbgs_studio::math::image::Image;
use vbgs_studio::observation::surface::Observation;

const N: usize = WIDTH * HEIGHT;

fn wall() -> Frame {
    frame(DepthKind::Z, |_, _| 1.0)
}

/// Counts of the fast path, checked against the oracle pixel by pixel.
fn counts(frame: &Frame, settings: &SurfaceSettings) -> SurfaceCounts {
    let (preparer, out, counts) = prepare(frame, settings);
    let (expected, fates) = oracle::prepare(frame, settings);
    assert_eq!(preparer.statuses(), &fates);
    assert_eq!(out.points.len(), expected.points.len());
    assert_eq!(counts.kept, out.points.len());
    assert_eq!(counts.kept + counts.holes + counts.dropped(), fates.data.len());
    counts
}

#[test]
fn frames_that_give_no_points_say_why() {
    let kinect = settings(Sensor::Kinect);
    let of = |field: fn(&mut SurfaceCounts) -> &mut usize| {
        let mut counts = SurfaceCounts::default();
        *field(&mut counts) = N;
        counts
    };
    let holes = frame(DepthKind::Z, |_, _| 0.0);
    assert_eq!(counts(&holes, &kinect), of(|c| &mut c.holes));

    let mut glass = wall();
    Arc::make_mut(&mut glass.color).data.iter_mut().for_each(|p| p[3] = 254);
    assert_eq!(counts(&glass, &kinect), of(|c| &mut c.dropped_alpha));

    let mut far = wall();
    far.depth.as_mut().unwrap().trusted = [1.5, 4.0];
    assert_eq!(counts(&far, &kinect), of(|c| &mut c.dropped_range));

    let calibration = Calibration { depth_offset: -1.0, ..Calibration::NONE };
    let behind = SurfaceSettings { calibration: Some(calibration), ..kinect.clone() };
    assert_eq!(counts(&wall(), &behind), of(|c| &mut c.dropped_range));

    let noise =
        frame(DepthKind::Z, |column, row| 1.0 + ((column * 31 + row * 17) % 41) as f64 / 10.0);
    assert_eq!(counts(&noise, &kinect), of(|c| &mut c.dropped_flying));

    for origin in [DVec3::splat(1e6), DVec3::splat(f64::NAN)] {
        let elsewhere = SurfaceSettings { origin, ..kinect.clone() };
        assert_eq!(counts(&wall(), &elsewhere), of(|c| &mut c.dropped_far));
    }
    let calibration = Calibration { depth_scale: 1e12, ..Calibration::NONE };
    let huge = SurfaceSettings { calibration: Some(calibration), ..kinect };
    assert_eq!(counts(&wall(), &huge), of(|c| &mut c.dropped_far));
}

#[test]
fn pixels_that_are_left_out_change_no_other() {
    // A wall with steps, so that some pixels are dropped for another reason.
    let frame = frame(DepthKind::Z, |column, row| 1.0 + ((column + row) / 30) as f64);
    let every = settings(Sensor::Kinect);
    let (whole, all, before) = prepare(&frame, &every);
    assert!(before.dropped_flying > 0 && before.left_out == 0, "{before:?}");
    let (sampling, weight) = (PixelSampling::Quarter, 4);
    let (preparer, mut some, counts) =
        prepare(&frame, &SurfaceSettings { sampling, ..every.clone() });
    let is_used = |pixel: usize| {
        let (column, row) = (pixel % WIDTH, pixel / WIDTH);
        row % 2 == 0 && column % 2 == 0
    };
    let mut expected = all.points.clone();
    expected.retain(|point| is_used(point.pixel as usize));
    // Tiles are wider, so the order differs.
    expected.sort_by_key(|point| point.pixel);
    some.points.sort_by_key(|point| point.pixel);
    assert_eq!((some.points, some.point_weight), (expected, weight));
    assert_eq!(some.ranges, all.ranges);
    for (pixel, status) in preparer.statuses().data.iter().enumerate() {
        let known = whole.statuses().data[pixel];
        let is_hidden = !is_used(pixel) && *status == PixelStatus::LeftOut;
        assert!(is_hidden || *status == known, "{pixel}: {status:?} for {known:?}");
    }
    assert_eq!(counts.kept + counts.left_out + counts.holes + counts.dropped(), N);
    assert!(counts.left_out * 10 > N * 9 * 3 / 4);
}

#[test]
fn ranges_tell_nothing_from_unknown() {
    let mut half = frame(DepthKind::Z, |column, _| if column < 20 { 1.0 } else { 0.0 });
    for (i, pixel) in Arc::make_mut(&mut half.color).data.iter_mut().enumerate() {
        pixel[3] = match (i % WIDTH, i / WIDTH) {
            (5, _) => 100,
            (20.., 0..10) => 0,
            _ => 255,
        };
    }
    let (_, out, _) = prepare(&half, &settings(Sensor::Kinect));
    for (i, range) in out.ranges.data.iter().enumerate() {
        let (column, row) = (i % WIDTH, i / WIDTH);
        let ray = half.camera.intrinsics.ray(column, row).length() as f32;
        match (column, row) {
            (5, _) => assert!(range.is_nan(), "colour and depth mix two surfaces"),
            (0..20, _) => assert!((range / ray - 1.0).abs() < 1e-6, "{range}"),
            (_, 0..10) => assert_eq!(*range, f32::INFINITY),
            _ => assert!(range.is_nan()),
        }
    }
}

#[test]
fn tiny_frames_are_prepared() {
    for (width, height) in [(0, 0), (1, 1), (3, 1), (2, 9)] {
        let mut frame = wall();
        let n = width * height;
        let k = &mut frame.camera.intrinsics;
        (k.width, k.height) = (width as u32, height as u32);
        frame.color = Image::from_vec(width, height, vec![[9, 9, 9, 255]; n]).into();
        let codes = Image::from_vec(width, height, vec![10_000; n]);
        let codes = DepthCodes::Linear16 { codes, unit: 1e-4 };
        let trusted = [0.0, f64::INFINITY];
        frame.depth = Some(Depth { codes, kind: DepthKind::Z, trusted, units_per_metre: 1.0 });
        let counts = counts(&frame, &settings(Sensor::Kinect));
        // Only the 2×9 frame has windows with enough neighbours that are not collinear.
        assert_eq!((counts.kept > 0, counts.dropped_flying < n), (n == 18, n == 18), "{counts:?}");
    }
}

#[test]
fn a_smaller_frame_after_a_larger_one_is_prepared_as_if_alone() {
    let large = synthetic::dataset(&SyntheticParams {
        width: 120,
        height: 90,
        n_train: 1,
        ..SyntheticParams::demo()
    });
    let large = large.unwrap().load(0, 0).unwrap();
    let small = frame(DepthKind::Z, |column, row| 1.0 + 0.002 * (column + row) as f64);
    let settings = settings(Sensor::Kinect);
    let (mut preparer, mut out) = (Preparer::new(), Observation::empty());
    preparer.prepare(&large, &settings, &mut out).unwrap();
    preparer.prepare(&small, &settings, &mut out).unwrap();
    let (alone, expected, _) = prepare(&small, &settings);
    assert_eq!(out.points, expected.points);
    assert_eq!(out.ranges, expected.ranges);
    assert_eq!(preparer.statuses(), alone.statuses());
}

#[test]
fn a_frame_without_depth_is_an_error() {
    let mut frame = wall();
    frame.depth = None;
    let mut out = Observation::empty();
    let error = Preparer::new().prepare(&frame, &settings(Sensor::Kinect), &mut out).unwrap_err();
    assert!(error.to_string().contains("choose a split with depth"), "{error}");
}

#[test]
fn sensors_follow_from_how_depth_is_stored() {
    for (layout, sensor) in [
        (TestLayout::Blender(DepthBits::Eight), Sensor::Inverse8Ray),
        (TestLayout::Blender(DepthBits::Sixteen), Sensor::Exact { noise: 0.0 }),
        (TestLayout::SevenScenes, Sensor::Kinect),
    ] {
        let folder = tiny(layout);
        let dataset = open_plain(folder.path()).unwrap();
        let settings = SurfaceSettings::new(&dataset, DVec3::ZERO);
        assert_eq!((settings.sensor, settings.calibration), (sensor, None), "{layout:?}");
    }
    let params = SyntheticParams { n_train: 1, depth_noise: 0.3, ..SyntheticParams::demo() };
    let room = synthetic::dataset(&params).unwrap();
    assert_eq!(room.sensor(), Sensor::Exact { noise: 0.3 });
}
