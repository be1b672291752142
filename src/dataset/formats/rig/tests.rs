//! Recordings of a painted room with wrong timestamps and a wrong mount.

use super::{Clock, ImagePair, Mount, Rig, find};
use crate::dataset::decode::{CodeKind, DepthEncoding};
use crate::dataset::depth::DepthKind;
use crate::dataset::entry::DepthSource;
use crate::dataset::options::ByteSource;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::{DQuat, DVec3, EulerRot};
use std::path::Path;

const READING: f64 = 0.03;
/// Half side lengths of a box-shaped room, metres.
const ROOM: DVec3 = DVec3::new(2.0, 1.4, 3.1);

fn pose(turn: DQuat) -> Pose {
    let matrix = glam::DMat4::from_rotation_translation(turn, DVec3::new(0.3, -0.2, 0.4));
    Pose::from_opencv(matrix).unwrap()
}

/// Returns a pose that rotates back and forth about two axes, at up to about half a radian per second.
fn shaken(time: f64) -> Option<Pose> {
    let (yaw, pitch) = (0.15 * (4.1 * time).sin(), 0.12 * (5.3 * time).cos());
    Some(pose(DQuat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0)))
}

fn waved(time: f64) -> Option<Pose> {
    let angles = [0.5 * (1.3 * time).sin(), 0.4 * (2.1 * time).cos(), 0.6 * (1.7 * time).sin()];
    let [yaw, pitch, roll] = angles;
    Some(pose(DQuat::from_euler(EulerRot::YXZ, yaw, pitch, roll)))
}

fn even(time: f64) -> Option<Pose> {
    Some(pose(DQuat::from_rotation_y(0.5 * time)))
}

fn camera() -> Intrinsics {
    Intrinsics::from_horizontal_fov(160, 128, 1.0)
}

/// Returns depth along the optical axis and world position for each pixel. Rows are read one after the
/// other within `reading` seconds.
fn seen(time: f64, reading: f64, at: impl Fn(f64) -> Option<Pose>) -> Vec<(f64, DVec3)> {
    let k = camera();
    let rows = k.height as usize;
    let mut seen = Vec::new();
    for row in 0..rows {
        let read = reading * ((row as f64 + 0.5) / rows as f64 - 0.5);
        let pose = at(time + read).unwrap();
        for column in 0..k.width as usize {
            let (from, along) = (pose.centre(), pose.rotation() * k.ray(column, row));
            let wall = ((ROOM * along.signum() - from) / along).min_element();
            seen.push((wall, from + wall * along));
        }
    }
    seen
}

fn recorded(folder: &Path, rig: Rig, at: impl Fn(f64) -> Option<Pose> + Copy) -> Vec<ImagePair> {
    let encoding = DepthEncoding {
        codes: CodeKind::BareFloats,
        kind: DepthKind::Z,
        trusted: [0.1, 10.0],
        units_per_metre: 1.0,
        sensor: Sensor::Kinect,
    };
    let at = |time| at(time).map(|followed| rig.mount.camera_pose(&followed));
    let shot = |i: usize| {
        let (time, photographed) = (0.13 * i as f64, 0.13 * i as f64 + 0.01);
        let [depth, color] = ["depth", "png"].map(|kind| folder.join(format!("{i}.{kind}")));
        let reading = if rig.reads_rows { READING } else { 0.0 };
        let seen = |time| seen(time, reading, at);
        let lengths = seen(time + rig.depth_delay).into_iter().map(|(z, _)| z as f32);
        std::fs::write(&depth, lengths.flat_map(f32::to_le_bytes).collect::<Vec<u8>>()).unwrap();
        // Auto-exposure: the same paint is darker in every other photograph.
        let exposure = if i.is_multiple_of(2) { 1.0 } else { 0.7 };
        let paint = |place: DVec3| {
            100.0 + 50.0 * (5.0 * place).to_array().map(f64::sin).iter().sum::<f64>() / 3.0
        };
        let greys = seen(photographed + rig.color_delay).into_iter();
        let bytes = greys.map(|(_, place)| (exposure * paint(place)) as u8).collect();
        let k = camera();
        image::GrayImage::from_raw(k.width, k.height, bytes).unwrap().save(&color).unwrap();
        let file = ByteSource::File(depth);
        ImagePair {
            name: i.to_string(),
            depth: (time, DepthSource { file, encoding, confidence: None }),
            color: (photographed, ByteSource::File(color)),
        }
    };
    (0..24).map(shot).collect()
}

fn clock(tracked: &(dyn Fn(f64) -> Option<Pose> + Sync)) -> Clock<'_> {
    let [depth_reading, color_reading] = [READING; 2];
    Clock { tracked, mount: None, intrinsics: camera(), depth_reading, color_reading }
}

fn found(rig: Rig, at: impl Fn(f64) -> Option<Pose> + Copy + Sync) -> Rig {
    let folder = tempfile::tempdir().unwrap();
    find(&recorded(folder.path(), rig, at), &clock(&at))
}

fn late(depth_delay: f64, color_delay: f64) -> Rig {
    Rig { depth_delay, color_delay, ..Rig::EXPECTED }
}

#[test]
fn late_clocks_show_where_the_camera_is_shaken() {
    for real in [late(-0.026, -0.006), late(0.012, 0.017)] {
        let found = found(real, shaken);
        assert!((found.depth_delay - real.depth_delay).abs() < 2e-3, "{found:?} for {real:?}");
        assert!((found.color_delay - real.color_delay).abs() < 2e-3, "{found:?} for {real:?}");
        assert_eq!(found.mount, Mount::default(), "for {real:?}");
    }
}

#[test]
fn rows_read_at_once_show_where_the_camera_is_shaken() {
    for depth_delay in [0.0, 0.012] {
        let found = found(Rig { reads_rows: false, ..late(depth_delay, 0.0) }, shaken);
        assert!(!found.reads_rows && found.mount == Mount::default(), "{found:?}");
        assert!((found.depth_delay - depth_delay).abs() < 2e-3, "{found:?}");
    }
}

#[test]
fn a_camera_beside_what_is_followed_shows_where_it_is_turned() {
    let mount =
        Mount { shift: DVec3::new(0.03, -0.02, 0.01), turn: DVec3::new(0.012, -0.02, 0.016) };
    for real in [Rig { mount, ..late(0.0, 0.0) }, Rig { mount, ..late(-0.026, 0.012) }] {
        let found = found(real, waved);
        // A shift partly compensates for a rotation if all walls are about equally far away.
        for x in [-0.8, 0.8] {
            let seen = DVec3::new(x, 0.5 * x, 2.2);
            let place = |mount: &Mount| mount.camera_pose(&Pose::IDENTITY).transform_point(seen);
            let off = place(&found.mount).distance(place(&mount));
            let before = seen.distance(place(&mount));
            assert!(off < 0.25 * before, "{off} of {before}: {found:?} for {real:?}");
        }
        assert!((found.depth_delay - real.depth_delay).abs() < 2e-3, "{found:?} for {real:?}");
        assert!((found.color_delay - real.color_delay).abs() < 2e-3, "{found:?} for {real:?}");
    }
}

#[test]
fn nothing_is_told_where_nothing_is_wrong_nothing_to_tell_it_by_or_too_much() {
    assert_eq!(found(late(0.0, 0.0), shaken), Rig::EXPECTED);
    let evenly = found(late(-0.026, -0.026), even);
    let delays = [evenly.depth_delay, evenly.color_delay];
    assert_eq!(delays, [0.0; 2], "both of every pair move alike");
    let beyond = found(late(-0.06, -0.06), shaken);
    assert_eq!(beyond.depth_delay, 0.0, "the least lies beyond what is tried");
    assert_eq!(find(&[], &clock(&shaken)), Rig::EXPECTED);
}
