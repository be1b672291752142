//! Rolling-shutter correction: rows read one after another are resampled to the pose of the middle row.

use crate::common::scratch::open_plain;
use image::{ImageBuffer, Luma, RgbImage};
use std::fmt::Write;
use std::fs;
use std::path::Path;
use vbgs_studio::dataset::frame::Frame;

/// Radians a second to the right.
const RATE: f64 = 1.0;
/// Column of a white line in every photograph, and of a depth edge.
const LINE: u32 = 320;

/// Writes two frames of a camera that turns to the right about the vertical (world y down, as in images).
fn record(folder: &Path) {
    let mut poses = String::new();
    for i in 0..60 {
        let time = 0.01 * f64::from(i);
        let half = 0.5 * RATE * time;
        writeln!(poses, "{time} 0 0 0 0 {} 0 {}", half.sin(), half.cos()).unwrap();
    }
    fs::write(folder.join("groundtruth.txt"), poses).unwrap();
    for kind in ["rgb", "depth"] {
        fs::create_dir(folder.join(kind)).unwrap();
        fs::write(
            folder.join(format!("{kind}.txt")),
            format!("0.2 {kind}/a.png\n0.4 {kind}/b.png\n"),
        )
        .unwrap();
    }
    let photograph = RgbImage::from_fn(640, 480, |x, _| {
        let value = if x == LINE { 255 } else { 60 };
        image::Rgb([value; 3])
    });
    let depth: ImageBuffer<Luma<u16>, Vec<u16>> =
        ImageBuffer::from_fn(640, 480, |x, _| Luma([if x < LINE { 5000 } else { 10_000 }]));
    for name in ["a.png", "b.png"] {
        photograph.save(folder.join("rgb").join(name)).unwrap();
        depth.save(folder.join("depth").join(name)).unwrap();
    }
}

/// Column of the brightest pixel of a row, and of its first far pixel.
fn columns(frame: &Frame, row: usize) -> (f64, f64) {
    let width = frame.color.width;
    let brightest = (0..width).max_by_key(|&x| frame.color.at(x, row)[0]).unwrap();
    let depth = frame.depth.as_ref().unwrap();
    let far = (0..width).find(|&x| depth.value_at(x, row).is_some_and(|z| z > 1.5)).unwrap();
    (brightest as f64, far as f64)
}

#[test]
fn a_kinects_rows_are_put_where_it_looked() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    let dataset = open_plain(folder.path()).unwrap();
    assert!(dataset.notes.iter().any(|note| note.contains("rows")), "{:?}", dataset.notes);
    let frame = dataset.load(0, 1).unwrap();
    for row in [20, 240, 460] {
        // Angle by which the camera had turned, relative to the middle row, when it read this row.
        let later = RATE * (f64::from(row) + 0.5 - 240.0) / 480.0;
        let [color, depth] = [0.0261, 0.0305].map(|read| 319.5 + 525.0 * (later * read).tan());
        let (line, edge) = columns(&frame, row as usize);
        assert!((line - color).abs() < 1.1, "row {row}: {line}, expected {color}");
        assert!((edge - depth).abs() < 1.6, "row {row}: {edge}, expected {depth}");
    }
    assert!(frame.color.data.iter().all(|rgba| rgba[3] == 255), "no pixel becomes transparent");
}

#[test]
fn a_camera_with_another_focal_length_reads_all_at_once() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    for (focal, reads_at_once) in [(560, true), (530, false)] {
        let k = format!("{focal} 0 319.5\n0 {focal} 239.5\n0 0 1\n");
        fs::write(folder.path().join("camera-intrinsics.txt"), k).unwrap();
        let frame = open_plain(folder.path()).unwrap().load(0, 1).unwrap();
        for row in [20, 460] {
            let is_untouched = columns(&frame, row) == (f64::from(LINE), f64::from(LINE));
            assert_eq!(is_untouched, reads_at_once, "row {row} at {focal} px");
        }
    }
}
