//! Points on known planes and at the edges between them.

use super::drawn::{HEIGHT, UNIT, WIDTH, camera, frame, plane, prepare, settings};
use glam::{DVec3, dvec3};
use vbgs_studio::dataset::frame::{DepthCodes, DepthKind, Frame};
use vbgs_studio::dataset::surface::{PixelStatus, Sensor, SurfaceSettings};
use vbgs_studio::math::image::Image;
use vbgs_studio::observation::surface::SurfacePoint;

const EXACT: Sensor = Sensor::Exact { noise: 0.0 };

/// Largest distance of a point to the plane, and of its normal to the plane's.
fn errors(points: &[SurfacePoint], normal: DVec3, distance: f64) -> [f64; 2] {
    let camera = camera();
    let (rotation, translation) = camera.pose.inverse();
    points.iter().fold([0.0f64; 2], |[off, tilt], point| {
        let local = rotation * DVec3::from_array(point.position.map(f64::from)) + translation;
        let turned = rotation * DVec3::from_array(point.normal.map(f64::from));
        [off.max((normal.dot(local) - distance).abs()), tilt.max((turned + normal).length())]
    })
}

#[test]
fn planes_are_recovered() {
    let slants = [dvec3(0.0, 0.0, 1.0), dvec3(0.7, 0.0, 1.0), dvec3(-0.4, 0.8, 1.0)];
    for normal in slants.map(DVec3::normalize) {
        for kind in [DepthKind::Z, DepthKind::RayDistance] {
            let frame = frame(kind, plane(normal, 2.0));
            let (_, out, counts) = prepare(&frame, &settings(EXACT));
            assert_eq!(counts.kept, WIDTH * HEIGHT, "{normal} {kind:?} {counts:?}");
            // A code rounds by half its unit; the fit averages 25 pixels, so the error is smaller.
            let [off, tilt] = errors(&out.points, normal, 2.0);
            assert!(off < 0.5 * UNIT, "{normal} {kind:?}: off by {off}");
            assert!(tilt < 0.003, "{normal} {kind:?}: tilted by {tilt}");
        }
    }
}

#[test]
fn points_say_where_they_are_seen_from() {
    let normal = dvec3(0.2, 0.3, 1.0).normalize();
    let origin = dvec3(10.0, -20.0, 30.0);
    let settings = SurfaceSettings { origin, ..settings(EXACT) };
    let frame = frame(DepthKind::Z, plane(normal, 2.0));
    let (_, out, _) = prepare(&frame, &settings);
    assert_eq!((out.origin, out.camera), (origin, frame.camera));
    let mut pixels: Vec<u32> = Vec::new();
    for point in &out.points {
        let position = DVec3::from_array(point.position.map(f64::from)) + origin;
        let (at, z) = frame.camera.project(position);
        let (column, row) = (point.pixel as usize % WIDTH, point.pixel as usize / WIDTH);
        assert!((at.x - column as f64 - 0.5).abs() < 1e-3, "{at} is pixel {column}, {row}");
        assert!((at.y - row as f64 - 0.5).abs() < 1e-3, "{at} is pixel {column}, {row}");
        let away = position - frame.camera.pose.centre();
        let direction = DVec3::from_array(point.direction.map(f64::from));
        assert!((away.normalize() - direction).length() < 1e-5);
        assert!((f64::from(point.range) - away.length()).abs() < 1e-5);
        assert!((f64::from(point.footprint) - away.length() / 60.0).abs() < 1e-6);
        assert!(z > 0.0 && point.noise > 0.0);
        assert_eq!(point.color, [column as f32 / 255.0, row as f32 / 255.0, 200.0 / 255.0]);
        pixels.push(point.pixel);
    }
    let mut in_tiles = pixels.clone();
    in_tiles.sort_by_key(|pixel| {
        let (column, row) = (*pixel as usize % WIDTH, *pixel as usize / WIDTH);
        (row / 8, column / 8, row, column)
    });
    assert_eq!(pixels, in_tiles);
}

/// Two walls, the nearer on the left, and a column of pixels between them that belongs to neither.
fn step(near: f64, between: f64, far: f64) -> Frame {
    frame(DepthKind::Z, move |column, _| match column {
        0..20 => near,
        20 => between,
        _ => far,
    })
}

#[test]
fn pixels_between_surfaces_are_rejected() {
    for sensor in [EXACT, Sensor::Kinect, Sensor::Lidar] {
        let (preparer, out, counts) = prepare(&step(1.0, 1.7, 2.5), &settings(sensor));
        assert_eq!((counts.dropped_flying, counts.kept), (HEIGHT, (WIDTH - 1) * HEIGHT));
        for (i, fate) in preparer.statuses().data.iter().enumerate() {
            let expected = if i % WIDTH == 20 { PixelStatus::Flying } else { PixelStatus::Kept };
            assert_eq!(*fate, expected);
        }
        for point in &out.points {
            let (_, z) = camera().project(DVec3::from_array(point.position.map(f64::from)));
            assert!((z - 1.0).abs() < 1e-4 || (z - 2.5).abs() < 1e-4, "{sensor:?}: {z}");
        }
    }
}

#[test]
fn codes_of_eight_bits_are_smoothed() {
    let normal = dvec3(0.25, -0.3, 1.0).normalize();
    let mut frame = frame(DepthKind::RayDistance, plane(normal, 4.0));
    let depth = frame.depth.as_mut().unwrap();
    let DepthCodes::Linear16 { codes, unit } = &depth.codes else { panic!("16 bits are drawn") };
    let eight = |d: &u16| (255.0 * (1.0 - f64::from(*d) * unit / 8.0)).round() as u8;
    depth.codes = DepthCodes::Inverse8(Image::from_vec(
        WIDTH,
        HEIGHT,
        codes.data.iter().map(eight).collect(),
    ));
    let (_, out, counts) = prepare(&frame, &settings(Sensor::Inverse8Ray));
    assert!(counts.kept * 10 > WIDTH * HEIGHT * 9, "{counts:?}");
    let [off, _] = errors(&out.points, normal, 4.0);
    let mean = out.points.iter().map(|p| errors(&[*p], normal, 4.0)[0]).sum::<f64>();
    let mean = mean / counts.kept as f64;
    // Half a level, and an eighth of one for the mean; a level is 0.031.
    assert!(off < 0.02 && mean < 0.006, "off by {off}, in the mean {mean}");
}

#[test]
fn every_stage_can_be_left_out() {
    let all = settings(Sensor::Kinect);
    let edge = step(1.0, 1.7, 2.5);
    let raw = SurfaceSettings { flying_pixels: false, ..all.clone() };
    let (_, out, counts) = prepare(&edge, &raw);
    assert_eq!(counts.kept, WIDTH * HEIGHT);
    let faces_camera = |p: &&SurfacePoint| p.normal == p.direction.map(|v| -v);
    let near = |p: &SurfacePoint| (p.range / out.ranges.data[p.pixel as usize] - 1.0).abs() < 1e-6;
    let between = out.points.iter().filter(|p| p.pixel as usize % WIDTH == 20);
    assert!(between.clone().count() == HEIGHT && between.clone().all(near));
    assert!(between.filter(faces_camera).count() > 0);

    // On a wavy surface fitted depth differs from measured depth.
    let wavy = frame(DepthKind::Z, |column, row| 1.0 + 0.001 * ((column * 7 + row * 3) % 5) as f64);
    let kept = SurfaceSettings { plane_fit: false, ..all.clone() };
    for (settings, is_raw) in [(&all, false), (&kept, true)] {
        let (_, out, _) = prepare(&wavy, settings);
        let raw = |p: &SurfacePoint| (p.range / out.ranges.data[p.pixel as usize] - 1.0).abs();
        assert!(out.points.len() > 1000);
        assert_eq!(out.points.iter().all(|p| raw(p) < 1e-6), is_raw);
    }

    let slanted = frame(DepthKind::Z, plane(dvec3(2.0, 0.0, 1.0).normalize(), 0.5));
    let open = SurfaceSettings { cosine: false, ..settings(EXACT) };
    let counts = [&settings(EXACT), &open].map(|settings| prepare(&slanted, settings).2);
    assert!(counts[0].dropped_slant > HEIGHT, "{:?}", counts[0]);
    assert_eq!(counts[1].dropped_slant, 0);
    assert_eq!(counts[1].kept, counts[0].kept + counts[0].dropped_slant);
}
