//! Frames drawn from formulas.

use glam::{DVec3, dvec3};
use vbgs_studio::dataset::frame::{Depth, DepthCodes, DepthKind, Frame};
use vbgs_studio::dataset::surface::{Preparer, Sensor, SurfaceCounts, SurfaceSettings};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::image::Image;
use vbgs_studio::math::pose::Pose;
use vbgs_studio::observation::surface::Observation;

pub const UNIT: f64 = 1e-4;
pub const WIDTH: usize = 45;
pub const HEIGHT: usize = 37;

/// A camera that points obliquely at the origin.
pub fn camera() -> Camera {
    let intrinsics = Intrinsics {
        width: WIDTH as u32,
        height: HEIGHT as u32,
        fx: 60.0,
        fy: 63.0,
        cx: 21.0,
        cy: 19.5,
    };
    let pose = Pose::look_at(dvec3(1.0, -2.0, 0.7), DVec3::ZERO, DVec3::Z).unwrap();
    Camera { intrinsics, pose }
}

/// A frame whose depth along the axis is `z(column, row)`; 0 is a hole.
pub fn frame(kind: DepthKind, z: impl Fn(usize, usize) -> f64) -> Frame {
    let camera = camera();
    let code = |i: usize| {
        let (column, row) = (i % WIDTH, i / WIDTH);
        let per_z = match kind {
            DepthKind::RayDistance => camera.intrinsics.ray(column, row).length(),
            DepthKind::Z => 1.0,
        };
        (z(column, row) * per_z / UNIT).round() as u16
    };
    let codes = Image::from_vec(WIDTH, HEIGHT, (0..WIDTH * HEIGHT).map(code).collect());
    let color = |i: usize| [(i % WIDTH) as u8, (i / WIDTH) as u8, 200, 255];
    let depth = Depth {
        codes: DepthCodes::Linear16 { codes, unit: UNIT },
        kind,
        trusted: [0.0, f64::INFINITY],
        units_per_metre: 1.0,
    };
    Frame {
        color_camera: None,
        name: "drawn".to_owned(),
        camera,
        color: Image::from_vec(WIDTH, HEIGHT, (0..WIDTH * HEIGHT).map(color).collect()).into(),
        depth: Some(depth),
    }
}

/// Depth at a pixel of the plane `normal · p = distance` in the camera frame.
pub fn plane(normal: DVec3, distance: f64) -> impl Fn(usize, usize) -> f64 {
    let k = camera().intrinsics;
    move |column, row| distance / normal.dot(k.ray(column, row))
}

/// Settings with every stage on.
pub fn settings(sensor: Sensor) -> SurfaceSettings {
    SurfaceSettings::of_sensor(sensor, DVec3::ZERO)
}

pub fn prepare(
    frame: &Frame,
    settings: &SurfaceSettings,
) -> (Preparer, Observation, SurfaceCounts) {
    let (mut preparer, mut out) = (Preparer::new(), Observation::empty());
    let counts = preparer.prepare(frame, settings, &mut out).unwrap();
    (preparer, out, counts)
}
