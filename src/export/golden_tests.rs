//! Comparison with golden files byte for byte. These were made from f64 values, which a [`Splat`] would
//! round to f32, so the encoders are called directly; `tests/export/golden.rs` compares the public
//! path.

use super::format::{ModelFormat, WriteOptions};
use super::gaussian::{AxisRotation, Gaussian};
use super::stream::{ProgressCounter, SplatRows, WriteProgress};
use super::{glb, ply};
use glam::{DMat3, DQuat, DVec3};
use serde_json::Value;
use std::path::PathBuf;

fn golden(name: &str) -> Vec<u8> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    std::fs::read(folder.join(name)).unwrap()
}

fn gaussians() -> Vec<Gaussian> {
    let cases: Value = serde_json::from_slice(&golden("export_cases.json")).unwrap();
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
    for (name, sh3_padding) in [("two_splats.ply", false), ("two_splats_sh3.ply", true)] {
        let options = WriteOptions { sh3_padding, ..WriteOptions::new(ModelFormat::Ply) };
        let rows = gaussians();
        let layout = ply::write::PlyLayout::new(&rows, &options).unwrap();
        let mut bytes = Vec::new();
        layout.write(&mut bytes, &rows, &mut ProgressCounter::new(WriteProgress::NONE, 2)).unwrap();
        assert!(bytes == golden(name), "{name} differs");
    }
}

#[test]
fn glb_file_is_equal_byte_for_byte_except_the_generator() {
    let rows = gaussians().into_iter().map(|g| g.rotated(&AxisRotation::Z_UP_TO_Y_UP));
    let rows = rows.collect::<Vec<_>>();
    let mut layout =
        glb::write::GlbLayout::new(&rows, &WriteOptions::new(ModelFormat::Glb)).unwrap();
    let mine = concat!(r#""generator":"vbgs-studio "#, env!("CARGO_PKG_VERSION"), '"');
    assert!(layout.json.contains(mine), "{}", layout.json);
    layout.json = layout.json.replace(mine, r#""generator":"vbgs""#);
    let mut bytes = Vec::new();
    layout.write(&mut bytes, &rows, &mut ProgressCounter::new(WriteProgress::NONE, 2)).unwrap();
    assert!(bytes == golden("two_splats.glb"), "GLB differs");
}
