//! Colour cameras, depth corrections, exposures, and the calibration file.

use super::drawn::{HEIGHT, WIDTH, frame, prepare, settings};
use crate::common::shared;
use glam::DVec3;
use vbgs_studio::dataset::calibration::{Calibration, ColorCamera, FrameGain};
use vbgs_studio::dataset::frame::DepthKind;
use vbgs_studio::dataset::surface::{PixelStatus, Sensor, SurfaceSettings};
use vbgs_studio::dataset::{LoadOptions, open};
use vbgs_studio::math::measured_pixel::MeasuredPixel;

fn full() -> Calibration {
    Calibration {
        color_camera: Some(ColorCamera { rotation: [0.01, -0.02, 0.03], ..ColorCamera::KINECT }),
        depth_offset: -0.0125,
        depth_scale: 1.01,
        exposure: vec![FrameGain { frame: "train/frame-000010".to_owned(), gain: [1.1, 1.0, 0.9] }],
    }
}

fn with(calibration: Calibration) -> SurfaceSettings {
    SurfaceSettings { calibration: Some(calibration), ..settings(Sensor::Kinect) }
}

#[test]
fn files_round_trip_and_may_leave_fields_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("calibration.ron");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        Calibration::read(&path)
    };
    for calibration in [full(), Calibration::NONE] {
        assert_eq!(read(&calibration.to_text().unwrap()).unwrap(), calibration);
    }
    assert_eq!(read("()").unwrap(), Calibration::NONE);
    let text =
        "(color_camera: (focal: (522, 522), principal: (320, 238.5), offset: (0.023, 0.0015, 0)))";
    assert_eq!(read(text).unwrap().color_camera, Some(ColorCamera::KINECT));
}

#[test]
fn files_that_make_no_sense_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("calibration.ron");
    let missing = Calibration::read(&path).unwrap_err().to_string();
    assert!(missing.contains("calibration.ron: expected a calibration file"), "{missing}");
    for (text, parts) in [
        ("(depth_scale: 0)", ["`depth_scale`", "found 0;"]),
        ("(depth_offset: NaN)", ["`depth_offset`", "found NaN;"]),
        ("(depth_ofset: 1)", ["calibration.ron", "depth_ofset"]),
        (
            "(color_camera: (focal: (0, 1), principal: (0, 0), offset: (0, 0, 0)))",
            ["`focal`", "0;"],
        ),
        (
            "(color_camera: (focal: (1, 1), principal: (0, 0), offset: (0, 0, 0), size: (640, 0)))",
            ["`size`", "0;"],
        ),
        ("(exposure: [(frame: \"a\", gain: (1, -1, 1))])", ["`gain of a`", "-1;"]),
        ("depth", ["calibration.ron", "correct this place"]),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = Calibration::read(&path).unwrap_err().to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{text}: {error}");
    }
    let unsound = Calibration { depth_scale: f64::INFINITY, ..Calibration::NONE };
    assert!(unsound.to_text().is_err());
}

#[test]
fn depth_is_scaled_then_shifted() {
    let wall = frame(DepthKind::Z, |_, _| 1.0);
    let calibration = Calibration { depth_scale: 1.1, depth_offset: -0.05, ..Calibration::NONE };
    let (_, out, _) = prepare(&wall, &with(calibration));
    for point in &out.points {
        let (_, z) = wall.camera.project(DVec3::from_array(point.position.map(f64::from)));
        assert!((z - 1.05).abs() < 1e-5, "{z}");
        assert!((point.range / out.ranges.data[point.pixel as usize] - 1.0).abs() < 1e-5);
    }
}

#[test]
fn gains_are_of_their_frame_and_clamp() {
    let wall = frame(DepthKind::Z, |_, _| 1.0);
    let gain = |frame: &str| FrameGain { frame: frame.to_owned(), gain: [2.0, 0.5, 3.0] };
    for (name, factors) in [("drawn", [2.0, 0.5, 3.0]), ("other", [1.0; 3])] {
        let (_, out, _) =
            prepare(&wall, &with(Calibration { exposure: vec![gain(name)], ..Calibration::NONE }));
        for point in &out.points {
            let (column, row) = (point.pixel as usize % WIDTH, point.pixel as usize / WIDTH);
            for ((found, byte), factor) in point.color.iter().zip([column, row, 200]).zip(factors) {
                let expected = (byte as f32 / 255.0 * factor).min(1.0);
                assert!((found - expected).abs() < 1e-6, "{found} {expected}");
            }
        }
    }
}

/// The colour of a drawn frame encodes column and row, so it shows where it was sampled.
#[test]
fn colour_is_looked_up_where_the_colour_camera_sees_the_point() {
    let wall = frame(DepthKind::Z, |_, _| 1.5);
    let k = wall.camera.intrinsics;
    let camera = ColorCamera {
        focal: [50.0, 52.0],
        principal: [20.0, 18.0],
        offset: [0.1, -0.05, 0.02],
        rotation: [0.02, 0.05, -0.1],
        size: None,
    };
    let calibration = Calibration { color_camera: Some(camera), ..Calibration::NONE };
    let (preparer, out, counts) = prepare(&wall, &with(calibration));
    assert_eq!(counts.kept + counts.dropped_no_color, WIDTH * HEIGHT);
    assert!(counts.kept > 1000);
    for point in &out.points {
        let (column, row) = (point.pixel as usize % WIDTH, point.pixel as usize / WIDTH);
        let at = camera.project(k.ray(column, row) * 1.5).unwrap() - 0.5;
        assert!((f64::from(point.color[0]) * 255.0 - at.x).abs() < 1e-3, "{at}");
        assert!((f64::from(point.color[1]) * 255.0 - at.y).abs() < 1e-3, "{at}");
    }
    for (i, fate) in preparer.statuses().data.iter().enumerate() {
        let at = camera.project(k.ray(i % WIDTH, i / WIDTH) * 1.5).unwrap() - 0.5;
        let is_seen = at.x >= 0.0 && at.y >= 0.0 && at.x <= 44.0 && at.y <= 36.0;
        assert_eq!(*fate == PixelStatus::Kept, is_seen, "{at}");
    }
}

/// The intrinsics of a photograph have the size of its image, so loops over pixels stay in bounds.
#[test]
fn a_photograph_has_the_size_of_its_image_whatever_a_calibration_says() {
    let wall = frame(DepthKind::Z, |_, _| 1.5);
    let larger = Some([2 * WIDTH as u32, 4 * HEIGHT as u32]);
    for (size, [sx, sy]) in [(None, [1.0, 1.0]), (larger, [0.5, 0.25])] {
        let camera = ColorCamera { size, ..ColorCamera::KINECT };
        let calibration = Calibration { color_camera: Some(camera), ..Calibration::NONE };
        let (_, out, _) =
            prepare(&wall, &SurfaceSettings { photograph: true, ..with(calibration) });
        let photograph = out.photograph.unwrap();
        let k = photograph.intrinsics;
        assert_eq!([k.width, k.height].map(|n| n as usize), [WIDTH, HEIGHT]);
        assert_eq!((photograph.colors.width, photograph.colors.height), (WIDTH, HEIGHT));
        assert_eq!([k.fx, k.cy], [sx * camera.focal[0], sy * camera.principal[1]]);
    }
}

/// The near wall is on the left.
#[test]
fn points_hidden_from_the_colour_camera_are_dropped() {
    let edge = frame(DepthKind::Z, |column, _| if column < 20 { 1.0 } else { 3.0 });
    let k = edge.camera.intrinsics;
    let camera = ColorCamera {
        focal: [k.fx, k.fy],
        principal: [k.cx, k.cy],
        offset: [0.1, 0.0, 0.0],
        rotation: [0.0; 3],
        size: None,
    };
    // Disparities are 6 and 2 pixels. A camera to the left misses four columns of the far wall, one
    // to the right none.
    let hidden = |x: f64| {
        let camera = ColorCamera { offset: [x, 0.0, 0.0], ..camera };
        let calibration = Calibration { color_camera: Some(camera), ..Calibration::NONE };
        let (preparer, _, _) = prepare(&edge, &with(calibration));
        let row = &preparer.statuses().data[18 * WIDTH + 20..18 * WIDTH + 40];
        row.iter().filter(|fate| **fate == PixelStatus::NoColor).count()
    };
    assert_eq!(hidden(0.1), 0);
    let covered = hidden(-0.1);
    assert!((3..=5).contains(&covered), "{covered} columns are hidden");
}

/// Depth of a photograph's pixels, from the same pixels or from a separate depth camera.
#[test]
fn pixels_of_photographs_know_how_far_their_surface_is() {
    let edge = frame(DepthKind::Z, |column, row| match (column, row) {
        (_, 0) => 0.0,
        (0..20, _) => 1.0,
        _ => 3.0,
    });
    let k = edge.camera.intrinsics;
    let depths = |color_camera: Option<ColorCamera>| {
        let calibration = Calibration { color_camera, ..Calibration::NONE };
        let settings = SurfaceSettings { photograph: true, ..with(calibration) };
        let out = prepare(&edge, &settings).1;
        let pixels = out.photograph.unwrap().measured_pixels([1.0; 3], out.tolerance.margin);
        let depth = |pixel: &MeasuredPixel| (pixel.per_tolerance > 0.0).then_some(pixel.depth);
        (pixels.data[18 * WIDTH].per_tolerance, pixels.map(depth))
    };
    let (per_tolerance, own) = depths(None);
    let is_own = |(i, depth): (usize, &Option<f32>)| match (i % WIDTH, i / WIDTH) {
        (_, 0) => depth.is_none(),
        (0..20, _) => *depth == Some(1.0),
        _ => *depth == Some(3.0),
    };
    assert!(own.data.iter().enumerate().all(is_own));
    assert!((per_tolerance - 1.0 / 0.05).abs() < 1e-4, "tolerance: 3 cm, and 2 cm per metre");
    // Seen from the left, the walls move right by six and two pixels: the near wall hides part of
    // the far one.
    let beside = ColorCamera {
        focal: [k.fx, k.fy],
        principal: [k.cx, k.cy],
        offset: [-0.1, 0.0, 0.0],
        rotation: [0.0; 3],
        size: None,
    };
    let (_, seen) = depths(Some(beside));
    let [near, far] = [0.1 * k.fx, 0.1 * k.fx / 3.0].map(|shift| shift.round() as usize);
    assert!(near >= 4 && far >= 1 && near > far);
    for column in (0..WIDTH).filter(|column| column.abs_diff(20 + near) > 1) {
        let expected = match column {
            _ if column + 1 < near => None,
            _ if column < 20 + near => Some(1.0),
            _ => Some(3.0),
        };
        if column.abs_diff(near) > 1 {
            assert_eq!(*seen.at(column, 18), expected, "{column}");
        }
    }
    // A camera of twice the resolution gets no gaps between depth pixels.
    let finer = ColorCamera { focal: [2.0 * k.fx, 2.0 * k.fy], offset: [0.0; 3], ..beside };
    let (_, fine) = depths(Some(finer));
    assert!((0..WIDTH).all(|column| fine.at(column, 18).is_some()));
}

#[test]
fn only_the_published_kinect_has_a_known_colour_camera() {
    let Some(path) = shared("data/kinect_office") else { return };
    let dataset = open(&path, &LoadOptions::default()).unwrap();
    let known = dataset.known_calibration().unwrap();
    assert_eq!(known.color_camera, Some(ColorCamera::KINECT));
    let mut other = dataset.clone();
    other.splits[0].frames[0].camera.intrinsics.fx = 580.0;
    assert_eq!(other.known_calibration(), None);
}
