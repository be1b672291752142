//! Byte-for-byte golden files. They were made from f64 values, which [`Splat`] would round to f32, so the
//! encoders are called directly; `tests/export/golden.rs` compares the public API.

use super::format::{ModelFormat, WriteOptions};
use super::gaussian::{Gaussian, Turn};
use super::progress::{Steps, WriteProgress};
use super::stream::SplatRows;
use super::{glb, ply};
use glam::{DMat3, DQuat, DVec3};
use serde_json::Value;
use std::path::PathBuf;

fn golden_folder() -> Option<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/golden");
    if folder.is_dir() {
        return Some(folder);
    }
    // As in `tests/common/skip.rs`: a test without its data fails unless skipping is permitted.
    let is_allowed = std::env::var_os("VBGS_ALLOW_SKIP").is_some_and(|value| value == "1");
    assert!(
        is_allowed,
        "{} not found: put the data there, or set VBGS_ALLOW_SKIP=1 to skip the tests that need it",
        folder.display()
    );
    eprintln!("skipped: ../shared/golden not found");
    None
}

fn gaussians(folder: &std::path::Path) -> Vec<Gaussian> {
    let text = std::fs::read_to_string(folder.join("export_cases.json")).unwrap();
    let cases: Value = serde_json::from_str(&text).unwrap();
    let numbers = |v: &Value| -> Vec<f64> {
        v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
    };
    let splat = |s: &Value| {
        let q = numbers(&s["quat"]);
        Gaussian {
            mean: DVec3::from_slice(&numbers(&s["mean"])),
            opacity: s["opacity"].as_f64().unwrap(),
            color: DVec3::from_slice(&numbers(&s["rgb"])),
            scale: DVec3::from_slice(&numbers(&s["scale"])),
            rotation: DQuat::from_xyzw(q[1], q[2], q[3], q[0]),
            directional: DMat3::ZERO,
        }
    };
    cases["splats"].as_array().unwrap().iter().map(splat).collect()
}

impl SplatRows for Vec<Gaussian> {
    fn n_rows(&self) -> usize {
        self.len()
    }

    fn row(&self, row: usize) -> Gaussian {
        self[row]
    }

    fn has_directions(&self) -> bool {
        false
    }
}

#[test]
fn ply_files_are_equal_byte_for_byte() {
    let Some(folder) = golden_folder() else { return };
    for (name, sh3_padding) in [("two_splats.ply", false), ("two_splats_sh3.ply", true)] {
        let options = WriteOptions { sh3_padding, ..WriteOptions::new(ModelFormat::Ply) };
        let rows = gaussians(&folder);
        let layout = ply::write::PlyLayout::new(&rows, &options).unwrap();
        let mut bytes = Vec::new();
        layout.write(&mut bytes, &rows, &mut Steps::new(WriteProgress::NONE, 2)).unwrap();
        assert!(bytes == std::fs::read(folder.join(name)).unwrap(), "{name} differs");
    }
}

#[test]
fn glb_file_is_equal_byte_for_byte_except_the_generator() {
    let Some(folder) = golden_folder() else { return };
    let rows = gaussians(&folder).into_iter().map(|g| g.turned(&Turn::Z_UP_TO_Y_UP));
    let rows = rows.collect::<Vec<_>>();
    let mut layout =
        glb::write::GlbLayout::new(&rows, &WriteOptions::new(ModelFormat::Glb)).unwrap();
    let mine = concat!(r#""generator":"vbgs-studio "#, env!("CARGO_PKG_VERSION"), '"');
    assert!(layout.json.contains(mine), "{}", layout.json);
    layout.json = layout.json.replace(mine, r#""generator":"vbgs""#);
    let mut bytes = Vec::new();
    layout.write(&mut bytes, &rows, &mut Steps::new(WriteProgress::NONE, 2)).unwrap();
    assert!(bytes == std::fs::read(folder.join("two_splats.glb")).unwrap(), "GLB differs");
}
