//! Recordings of a painted room whose clocks are wrong.

use super::{Clock, Delays, Shot, find};
use crate::dataset::decode::{CodeKind, DepthEncoding};
use crate::dataset::depth::DepthKind;
use crate::dataset::entry::DepthSource;
use crate::dataset::source::ByteSource;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::{DQuat, DVec3, EulerRot};
use std::path::Path;

const READING: f64 = 0.03;
/// Half the sides of a room, metres.
const ROOM: DVec3 = DVec3::new(2.0, 1.4, 3.1);

fn pose(turn: DQuat) -> Pose {
    let matrix = glam::DMat4::from_rotation_translation(turn, DVec3::new(0.3, -0.2, 0.4));
    Pose::from_opencv(matrix).unwrap()
}

/// Shaken by half a radian a second about two axes.
fn shaken(time: f64) -> Option<Pose> {
    let (yaw, pitch) = (0.15 * (4.1 * time).sin(), 0.12 * (5.3 * time).cos());
    Some(pose(DQuat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0)))
}

/// Turned as evenly as can be.
fn even(time: f64) -> Option<Pose> {
    Some(pose(DQuat::from_rotation_y(0.5 * time)))
}

fn camera() -> Intrinsics {
    Intrinsics::from_horizontal_fov(160, 128, 1.0)
}

/// What each pixel of an image sees, row by row as it is read: depth along the axis and the place in the room.
fn seen(time: f64, at: impl Fn(f64) -> Option<Pose>) -> Vec<(f64, DVec3)> {
    let k = camera();
    let rows = k.height as usize;
    let mut seen = Vec::new();
    for row in 0..rows {
        let read = READING * ((row as f64 + 0.5) / rows as f64 - 0.5);
        let pose = at(time + read).unwrap();
        for column in 0..k.width as usize {
            let (from, along) = (pose.centre(), pose.rotation() * k.ray(column, row));
            let wall = ((ROOM * along.signum() - from) / along).min_element();
            seen.push((wall, from + wall * along));
        }
    }
    seen
}

/// Frames whose times are before those at which they were taken by these delays.
fn recorded(folder: &Path, delays: Delays, at: impl Fn(f64) -> Option<Pose> + Copy) -> Vec<Shot> {
    let encoding = DepthEncoding {
        codes: CodeKind::BareFloats,
        kind: DepthKind::Z,
        trusted: [0.1, 10.0],
        metre: 1.0,
        sensor: Sensor::Kinect,
    };
    let shot = |i: usize| {
        let (time, photographed) = (0.13 * i as f64, 0.13 * i as f64 + 0.01);
        let [depth, color] = ["depth", "png"].map(|kind| folder.join(format!("{i}.{kind}")));
        let lengths = seen(time + delays.depth, at).into_iter().map(|(z, _)| z as f32);
        std::fs::write(&depth, lengths.flat_map(f32::to_le_bytes).collect::<Vec<u8>>()).unwrap();
        // Exposed by itself: the same paint is darker in every other photograph.
        let exposure = if i.is_multiple_of(2) { 1.0 } else { 0.7 };
        let paint = |place: DVec3| {
            100.0 + 50.0 * (5.0 * place).to_array().map(f64::sin).iter().sum::<f64>() / 3.0
        };
        let greys = seen(photographed + delays.color, at).into_iter();
        let bytes = greys.map(|(_, place)| (exposure * paint(place)) as u8).collect();
        let k = camera();
        image::GrayImage::from_raw(k.width, k.height, bytes).unwrap().save(&color).unwrap();
        let file = ByteSource::File(depth);
        Shot {
            name: i.to_string(),
            depth: (time, DepthSource { file, encoding, confidence: None }),
            color: (photographed, ByteSource::File(color)),
        }
    };
    (0..24).map(shot).collect()
}

fn clock<At>(at: At) -> Clock<At> {
    Clock { at, intrinsics: camera(), depth_reading: READING, color_reading: READING }
}

fn found(depth: f64, color: f64, at: impl Fn(f64) -> Option<Pose> + Copy + Sync) -> [f64; 2] {
    let folder = tempfile::tempdir().unwrap();
    let found = find(&recorded(folder.path(), Delays { depth, color }, at), &clock(at));
    [found.depth, found.color]
}

#[test]
fn late_clocks_show_where_the_camera_is_shaken() {
    for [depth, color] in [[-0.026, -0.006], [0.012, 0.017]] {
        let found = found(depth, color, shaken);
        assert!((found[0] - depth).abs() < 2e-3, "{found:?} for depth {depth}");
        assert!((found[1] - color).abs() < 2e-3, "{found:?} for colour {color}");
    }
}

#[test]
fn nothing_is_told_where_there_is_no_delay_nothing_to_tell_it_by_or_too_much() {
    assert_eq!(found(0.0, 0.0, shaken), [0.0; 2]);
    assert_eq!(found(-0.026, -0.026, even), [0.0; 2], "both of every pair move alike");
    assert_eq!(found(-0.06, -0.06, shaken)[0], 0.0, "the least lies beyond what is tried");
    assert_eq!(find(&[], &clock(shaken)), Delays::default());
}
