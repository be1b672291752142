//! Written SPZ files: read back, and parsed without the library's reader.

use super::{distance, random_splats, read_bytes, set, written, written_as};
use crate::common::scenes::random_appearance;
use glam::{DQuat, DVec3};
use vbgs_studio::export::{ModelFormat, Note, SpzVersion, WriteOptions, write};
use vbgs_studio::model::splat::splats::Splat;

fn splats(n: usize, seed: u64) -> Vec<Splat> {
    let within = |s: f32| s.clamp(1e-4, 100.0);
    let all = random_splats(n, seed).into_iter();
    all.map(|splat| Splat { scale: splat.scale.map(within), ..splat }).collect()
}

/// Sorts the splats by their first coordinate, because the file may order them differently.
fn sorted(mut splats: Vec<Splat>) -> Vec<Splat> {
    splats.sort_by(|a, b| a.mean[0].total_cmp(&b.mean[0]));
    splats
}

#[test]
fn splats_come_back_as_near_as_their_bytes_allow() {
    let splats = splats(3000, 71);
    let model = read_bytes(&written_as(ModelFormat::Spz, &splats)).unwrap();
    assert_eq!((model.splats.len(), model.skipped), (3000, 0));
    assert_eq!(model.up(), Some(DVec3::Z));
    let back = sorted(model.splats.to_vec());
    for (a, b) in sorted(splats).iter().zip(&back) {
        // 17 fraction bits of the 24 leave a range of ±64 units.
        assert!(distance(a.mean, b.mean) <= 0.51 / 131_072.0 + 1e-5, "{a:?} {b:?}");
        assert!(distance(a.scale.map(f32::ln), b.scale.map(f32::ln)) <= 0.5 / 16.0 + 1e-4);
        assert!((a.opacity - b.opacity).abs() <= 0.5 / 255.0 + 1e-6);
        assert!(distance(a.color, b.color) <= 0.5 / 255.0 * 0.2821 / 0.15 + 1e-6);
        let [w, x, y, z] = a.rotation.map(f64::from);
        let [v, i, j, k] = b.rotation.map(f64::from);
        let turn = DQuat::from_xyzw(x, y, z, w).dot(DQuat::from_xyzw(i, j, k, v)).abs();
        assert!(turn > 1.0 - 1e-5, "{:?} {:?}", a.rotation, b.rotation);
    }
    let directions = random_appearance(&back, 72);
    let model = read_bytes(&written_as(ModelFormat::Spz, &set(&back, &directions))).unwrap();
    assert_eq!(model.splats.view().appearance().len(), model.splats.len());
    assert!(model.splats.view().appearance().iter().any(|a| a.directional != [[0.0; 3]; 3]));
    let ignored = |note: &Note| matches!(note, Note::ViewDependentColorIgnored { .. });
    assert!(!model.notes.iter().any(ignored), "{:?}", model.notes);
}

/// The container: header, table, and streams that the reference decompressor unpacks.
#[test]
fn the_container_is_that_of_version_4() {
    let splats = splats(700, 73);
    let v4 = SpzVersion::V4;
    let options = WriteOptions { spz_version: v4, ..WriteOptions::new(ModelFormat::Spz) };
    let bytes = written(&splats, &options);
    assert_eq!(&bytes[..12], b"NGSP\x04\0\0\0\xBC\x02\0\0");
    assert_eq!((bytes[12], bytes[14], bytes[15]), (0, 0, 5));
    assert_eq!(&bytes[16..32], b"\x20\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0");
    let word = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let mut at = 32 + 5 * 16;
    let mut columns = Vec::new();
    for (i, width) in [9, 1, 3, 3, 4].into_iter().enumerate() {
        let (packed, unpacked) = (word(32 + 16 * i), word(40 + 16 * i));
        let column = zstd::decode_all(&bytes[at..at + packed]).unwrap();
        assert_eq!((column.len(), unpacked), (700 * width, 700 * width));
        columns.push(column);
        at += packed;
    }
    assert_eq!(at, bytes.len());
    // Up is y: the highest z of the model is the highest y of the file.
    let fixed = |i: usize, axis: usize| {
        let b = &columns[0][9 * i + 3 * axis..];
        f64::from(i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8) / f64::from(1 << bytes[13])
    };
    let highest = (0..700).map(|i| fixed(i, 1)).fold(f64::NEG_INFINITY, f64::max);
    let expected = splats.iter().map(|s| s.mean[2]).fold(f32::NEG_INFINITY, f32::max);
    assert!((highest - f64::from(expected)).abs() < 1e-3);
}

#[test]
fn coordinates_too_far_out_are_refused_and_small_worlds_are_not_rounded_away() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.spz");
    let far = [Splat { mean: [1e7, 0.0, 0.0], ..random_splats(1, 74)[0] }];
    let options = WriteOptions::new(ModelFormat::Spz);
    let error = write(&path, &far, &options).unwrap_err().to_string();
    assert!(error.contains("a.spz: SPZ: expected coordinates below 8388608, found 1"), "{error}");
    let near = [Splat { mean: [0.01, 0.02, 0.03], scale: [1e-3; 3], ..far[0] }];
    let back = read_bytes(&written(&near, &options)).unwrap().splats[0];
    assert!(distance(back.mean, near[0].mean) < 1e-4, "{back:?}");
}
