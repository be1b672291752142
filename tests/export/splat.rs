//! `.splat`: 32 bytes per splat, without a header, so the reader recognises it by plausible values.

use super::{assert_fails, distance, random_splats, read_bytes};
use vbgs_studio::export::read_up_to;
use vbgs_studio::model::splat::splats::Splat;

/// Encodes splats as `.splat`, independently of the library.
pub fn dot_splat(splats: &[Splat]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for splat in splats {
        let floats = splat.mean.iter().chain(&splat.scale);
        bytes.extend(floats.flat_map(|v| v.to_le_bytes()));
        bytes.extend(splat.color.map(|c| (255.0 * c).round() as u8));
        bytes.push((255.0 * splat.opacity).round() as u8);
        bytes.extend(splat.rotation.map(|q| (128.0 * q + 128.0).clamp(0.0, 255.0) as u8));
    }
    bytes
}

#[test]
fn splats_are_read() {
    let splats = random_splats(100, 51);
    let model = read_bytes(&dot_splat(&splats)).unwrap();
    assert_eq!((model.splats.len(), model.skipped), (100, 0));
    for (a, b) in splats.iter().zip(model.splats.iter()) {
        assert_eq!((a.mean, a.scale), (b.mean, b.scale));
        assert!(distance(a.color, b.color) <= 0.5 / 255.0 + 1e-6);
        assert!((a.opacity - b.opacity).abs() <= 0.5 / 255.0 + 1e-6);
        let positive = a.rotation.map(|q| a.rotation[0].signum() * q);
        assert!(distance(positive, b.rotation) < 0.03, "{:?} {:?}", a.rotation, b.rotation);
    }
}

#[test]
fn rows_that_are_no_splats_are_counted() {
    let mut splats = random_splats(10, 52);
    splats[3].mean[1] = f32::NAN;
    splats[4].scale[2] = f32::INFINITY;
    splats[5].scale[0] = -1.0;
    let model = read_bytes(&dot_splat(&splats)).unwrap();
    assert_eq!((model.splats.len(), model.skipped), (7, 3));
}

#[test]
fn what_is_no_splat_file_is_refused() {
    let bytes = dot_splat(&random_splats(3, 53));
    assert_fails("cut", &bytes[..90], &[".splat: expected a multiple of 32 bytes, found 90 bytes"]);
    assert_fails(
        "short",
        &bytes[..31],
        &["expected a model (.ply, .glb, .gltf, .spz, .sog or .splat)"],
    );
    assert_fails("zeros", &[0; 64], &["expected a model"]);
    assert_fails("digits", &b"0123456789".repeat(32), &["expected a model"]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.splat");
    std::fs::write(&path, &bytes).unwrap();
    let error = read_up_to(&path, 2).unwrap_err().to_string();
    assert!(error.contains("a.splat: expected at most 2 splats, found 3"), "{error}");
}
