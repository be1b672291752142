//! PLY, GLB, SPZ, SOG, `.splat`, pages, USD and checkpoints: golden files, round trips, foreign files, damaged files.
#![allow(clippy::unwrap_used)]

mod allocations;
mod atomic;
mod cases;
mod checkpoint;
#[path = "../common/mod.rs"]
mod common;
mod degree_1;
mod detail;
mod faults;
mod figures;
mod glb;
mod glb_file;
mod glb_foreign;
mod golden;
mod hostile;
mod mapping;
mod mesh;
mod options;
mod ply;
mod ply_compressed;
mod ply_foreign;
mod registration;
mod round_trip;
mod samples;
mod shown;
mod sog;
mod splat;
mod spz;
mod spz_written;
mod stable;

use vbgs_studio::export::{ExportError, Imported, ModelFormat, WriteOptions, read, write};
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::appearance::{Appearance, SplatSet, SplatView};
use vbgs_studio::model::splat::splats::Splat;

/// Reads a model from bytes, in a file without an extension.
fn read_bytes(bytes: &[u8]) -> Result<Imported, ExportError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model");
    std::fs::write(&path, bytes).unwrap();
    read(&path)
}

fn written<'a>(splats: impl Into<SplatView<'a>>, options: &WriteOptions) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model");
    let summary = write(&path, splats, options).unwrap();
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(summary.bytes, bytes.len() as u64);
    bytes
}

fn written_as<'a>(format: ModelFormat, splats: impl Into<SplatView<'a>>) -> Vec<u8> {
    written(splats, &WriteOptions::new(format))
}

/// Panics unless reading fails with a message that contains all `parts`.
fn assert_fails(name: &str, bytes: &[u8], parts: &[&str]) {
    let message = read_bytes(bytes).expect_err(name).to_string();
    for part in parts {
        assert!(message.contains(part), "{name}: {part:?} is missing in: {message}");
    }
}

/// Random splats of all sizes, colours, opacities and orientations.
fn random_splats(n: usize, seed: u64) -> Vec<Splat> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
    (0..n)
        .map(|_| {
            let q: [f64; 4] = std::array::from_fn(|_| rng.normal());
            let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
            Splat {
                mean: std::array::from_fn(|_| rng.range(-50.0, 50.0) as f32),
                opacity: rng.range(1e-5, 1.0 - 1e-5) as f32,
                color: std::array::from_fn(|_| rng.uniform() as f32),
                scale: std::array::from_fn(|_| 10f64.powf(rng.range(-6.0, 2.0)) as f32),
                rotation: q.map(|v| (v / length) as f32),
            }
        })
        .collect()
}

fn set(splats: &[Splat], appearance: &[Appearance]) -> SplatSet {
    let mut set = SplatSet::default();
    splats.iter().zip(appearance).for_each(|(splat, appearance)| set.push(*splat, *appearance));
    set
}

/// Largest absolute difference between two arrays.
fn distance<const N: usize>(a: [f32; N], b: [f32; N]) -> f32 {
    a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
}
