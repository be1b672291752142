//! Frames passed in memory.

use glam::{DMat3, DMat4, DVec3};
use vbgs_studio::dataset::error::FrameProblem;
use vbgs_studio::dataset::frame::{ColorBuffer, DepthBuffer, DepthKind, Frame};
use vbgs_studio::dataset::surface::{Preparer, Sensor, SurfaceSettings};
use vbgs_studio::dataset::synthetic::demo;
use vbgs_studio::dataset::unproject::{
    CameraConvention, EdgeFilter, UnprojectSettings, Unprojector, camera_point,
};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::observation::points::Points;
use vbgs_studio::observation::surface::Observation;

const TRUST_ALL: [f64; 2] = [0.0, f64::INFINITY];

/// Rebuilds a frame from its bytes and its depth lengths.
fn handed_over(frame: &Frame, kind: DepthKind) -> Frame {
    let lengths = frame.depth_as(kind).unwrap();
    let depth = DepthBuffer { lengths: &lengths.data, kind, trusted: TRUST_ALL };
    let rgba = frame.color.data.as_flattened();
    let rgb: Vec<u8> = frame.color.data.iter().flat_map(|c| [c[0], c[1], c[2]]).collect();
    let pose = frame.camera.pose.to_opencv();
    let again = |color| {
        Frame::from_memory("again", frame.camera.intrinsics, pose, color, Some(depth)).unwrap()
    };
    let opaque = again(ColorBuffer::Rgb8(&rgb));
    assert_eq!(opaque.color, again(ColorBuffer::Rgba8(rgba)).color, "the demo is opaque");
    opaque
}

#[test]
fn a_frame_from_memory_says_what_the_stored_one_says() {
    let stored = demo().unwrap().load(0, 3).unwrap();
    // Noise of the published Kinect, which does not depend on how depth is stored.
    let settings = SurfaceSettings::of_sensor(Sensor::Kinect, DVec3::ZERO);
    let unproject = UnprojectSettings {
        convention: CameraConvention::Exact,
        filter: EdgeFilter::DropMixed,
        normalization: Normalization { offset: [0.0; 3], scale: [1.0; 3] },
    };
    let observe = |frame: &Frame| {
        let mut observation = Observation::empty();
        let counts = Preparer::new().prepare(frame, &settings, &mut observation).unwrap();
        let mut points = Points::new();
        let dropped = Unprojector::new().unproject(frame, &unproject, &mut points).unwrap();
        (counts, observation, dropped, points)
    };
    let (counts, expected, dropped, points) = observe(&stored);
    assert!(counts.kept > 50_000 && points.len() > 50_000, "{counts:?} {dropped:?}");
    for kind in [DepthKind::Z, DepthKind::RayDistance] {
        let (again, found, again_dropped, again_points) = observe(&handed_over(&stored, kind));
        // A length in f32 may fall on the other side of a threshold.
        assert!(again.kept.abs_diff(counts.kept) <= 20, "{again:?} for {counts:?}");
        // The edge filter compares the lengths as measured, so only depth z gives the same result.
        if kind == DepthKind::Z {
            assert!(again_dropped.kept.abs_diff(dropped.kept) <= 20, "{again_dropped:?}");
            assert_eq!(again_points.color(0), points.color(0));
        }
        assert_eq!(again_dropped.holes, 0);
        let by_pixel: std::collections::HashMap<u32, _> =
            expected.points.iter().map(|p| (p.pixel, p)).collect();
        let mut n = 0;
        for point in &found.points {
            let Some(other) = by_pixel.get(&point.pixel) else { continue };
            let apart = point.position_vector().distance(other.position_vector());
            n += usize::from(apart < 1e-5);
        }
        assert!(n * 100 > counts.kept * 99, "{n} points of {} agree", counts.kept);
    }
}

#[test]
fn lengths_that_no_surface_has_are_holes() {
    let intrinsics = Intrinsics::from_horizontal_fov(8, 1, 1.0);
    let color = ColorBuffer::Rgb8(&[9; 24]);
    let lengths = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, -2.0, 1.25, 9.0];
    let depth = DepthBuffer { lengths: &lengths, kind: DepthKind::Z, trusted: [0.3, 4.0] };
    let frame =
        Frame::from_memory("holes", intrinsics, DMat4::IDENTITY, color, Some(depth)).unwrap();
    let z = frame.depth_z().unwrap().data;
    assert_eq!(z, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.25, 9.0]);
    let settings = SurfaceSettings {
        flying_pixels: false,
        ..SurfaceSettings::of_sensor(Sensor::Kinect, DVec3::ZERO)
    };
    let mut observation = Observation::empty();
    let counts = Preparer::new().prepare(&frame, &settings, &mut observation).unwrap();
    assert_eq!((counts.holes, counts.dropped_range, counts.kept), (6, 1, 1));
    assert!(observation.ranges.data[..6].iter().all(|r| r.is_nan()), "no depth at this pixel");
}

#[test]
fn what_is_no_frame_is_refused_with_its_reason() {
    let k = Intrinsics::from_horizontal_fov(4, 3, 1.0);
    let (rgb, lengths) = ([7u8; 36], [1.0f32; 12]);
    let depth = DepthBuffer { lengths: &lengths, kind: DepthKind::Z, trusted: TRUST_ALL };
    let refuse = |k, pose, color: &[u8], depth| {
        let refused = Frame::from_memory("7", k, pose, ColorBuffer::Rgb8(color), Some(depth));
        let error = refused.unwrap_err();
        let message = error.to_string();
        assert!(message.starts_with("memory: frame 7: "), "{message}");
        assert!(message.contains("expected") && message.contains("found"), "{message}");
        error.problem
    };
    let pose = DMat4::IDENTITY;
    let mut nan = pose;
    nan.w_axis.y = f64::NAN;
    for wrong in [nan, pose * 2.0, DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0))] {
        assert!(matches!(refuse(k, wrong, &rgb, depth), FrameProblem::Pose(_)), "{wrong}");
    }
    for wrong in [
        Intrinsics { fx: f64::NAN, ..k },
        Intrinsics { fy: -1.0, ..k },
        Intrinsics { cx: 4.5, ..k },
        Intrinsics { width: 0, ..k },
    ] {
        let problem = refuse(wrong, pose, &rgb, depth);
        assert!(matches!(problem, FrameProblem::Intrinsics { .. }), "{wrong:?}: {problem}");
    }
    let problem = refuse(k, pose, &rgb[..35], depth);
    let is_short = matches!(problem, FrameProblem::BufferSize { expected: 36, found: 35, .. });
    assert!(is_short, "{problem}");
    let short = DepthBuffer { lengths: &lengths[1..], ..depth };
    let problem = refuse(k, pose, &rgb, short);
    assert!(matches!(problem, FrameProblem::BufferSize { expected: 12, found: 11, .. }));
    for trusted in [[f64::NAN, 1.0], [2.0, 1.0], [-1.0, 1.0]] {
        let problem = refuse(k, pose, &rgb, DepthBuffer { trusted, ..depth });
        assert!(matches!(problem, FrameProblem::TrustedDepth { .. }), "{trusted:?}: {problem}");
    }
    let empty = DepthBuffer { lengths: &[f32::NAN; 12], ..depth };
    assert!(matches!(refuse(k, pose, &rgb, empty), FrameProblem::NoDepthValues));
}

/// The loop handles four pixels at a time. The points must equal those of a loop over single
/// pixels, in tiles of 8×8 made of quads of 4×4, whatever pixels are missing.
#[test]
fn holes_borders_and_far_points_leave_the_bits_of_their_neighbours() {
    const SIZE: [usize; 2] = [13, 11];
    let k = Intrinsics::from_horizontal_fov(13, 11, 1.1);
    let bytes: Vec<u8> = (0..13 * 11 * 3).map(|i| (i * 37 % 256) as u8).collect();
    let lengths: Vec<f32> = (0..13 * 11)
        .map(|i| match i % 7 {
            0 => 0.0,
            3 if i % 2 == 0 => 1e9, // farther than any point may be
            _ => 1.0 + 0.01 * i as f32,
        })
        .collect();
    let pose = DMat4::from_rotation_translation(
        glam::DQuat::from_scaled_axis(DVec3::new(0.3, -0.2, 0.5)),
        DVec3::new(0.1, 0.2, 0.3),
    );
    for kind in [DepthKind::Z, DepthKind::RayDistance] {
        let depth = DepthBuffer { lengths: &lengths, kind, trusted: TRUST_ALL };
        let color = ColorBuffer::Rgb8(&bytes);
        let frame = Frame::from_memory("odd", k, pose, color, Some(depth)).unwrap();
        let settings = UnprojectSettings {
            convention: CameraConvention::Exact,
            filter: EdgeFilter::Off,
            normalization: Normalization::from_range(DVec3::NEG_ONE, DVec3::ONE),
        };
        let mut found = Points::new();
        let counts = Unprojector::new().unproject(&frame, &settings, &mut found).unwrap();
        let normalization = settings.normalization;
        let per_unit = DMat3::from_diagonal(DVec3::ONE / DVec3::from_array(normalization.scale));
        let rotation = per_unit * frame.camera.pose.rotation();
        let mut expected = Points::new();
        for tile in 0..4 {
            for place in 0..64 {
                let (quad, line, x) = (place / 16, place / 4 % 4, place % 4);
                let column = tile % 2 * 8 + quad % 2 * 4 + x;
                let row = tile / 2 * 8 + quad / 2 * 4 + line;
                let at = row * SIZE[0] + column;
                if column >= SIZE[0] || row >= SIZE[1] || lengths[at] == 0.0 || lengths[at] > 1e8 {
                    continue;
                }
                let convention = settings.convention;
                let local = camera_point(&k, convention, kind, [column, row], lengths[at].into());
                let centre = normalization.normalize(frame.camera.pose.centre());
                let p = (rotation * local + centre).as_vec3();
                let [r, g, b] = [0, 1, 2].map(|channel| {
                    let value = f64::from(bytes[3 * at + channel]) / 255.0;
                    Normalization::normalize_channel(value) as f32
                });
                expected.push([p.x, p.y, p.z, r, g, b]);
            }
            expected.close_tile();
        }
        assert_eq!(found, expected, "{kind:?}");
        assert_eq!((counts.kept, counts.holes), (found.len(), 21));
        assert_eq!(counts.dropped_far, 13 * 11 - 21 - found.len());
    }
}
