//! Damaged files: reading gives an error or a valid model, never a panic, and memory stays in proportion.

use super::allocations::largest_during;
use super::glb_file::Glb;
use super::ply_compressed::compressed;
use super::splat::dot_splat;
use super::spz::{gzip, legacy, version_4, zeros};
use super::{assert_fails, random_splats, set, written, written_as};
use crate::common::scenes::random_appearance;
use std::path::Path;
use vbgs_studio::export::{ExportError, Imported, ModelFormat, SpzVersion, WriteOptions, read};
use vbgs_studio::math::rng::{Purpose, Rng};

/// Small files of every readable format.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let splats = random_splats(2, 41);
    let native = set(&splats, &random_appearance(&splats, 41));
    let padded = WriteOptions { sh3_padding: true, ..WriteOptions::new(ModelFormat::Ply) };
    let spz_version = SpzVersion::V4;
    let spz_4 = WriteOptions { spz_version, ..WriteOptions::new(ModelFormat::Spz) };
    let glb = written_as(ModelFormat::Glb, &splats);
    let mut gltf = Glb::parse(&glb);
    gltf.json["buffers"][0]["uri"] = format!("data:;base64,{}", "AAAA".repeat(43)).into();
    let text = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int i\nelement vertex 2\n\
                property float x\nproperty float y\nproperty float z\nproperty uchar red\n\
                property uchar green\nproperty uchar blue\nend_header\n3 0 1 2\n\
                1 2 3 4 5 6\n-1e-3 2 3 4 5 6\n";
    vec![
        ("ply", written_as(ModelFormat::Ply, &splats)),
        ("ply sh1", written_as(ModelFormat::Ply, &native)),
        ("ply sh3", written(&native, &padded)),
        ("point cloud", written_as(ModelFormat::PointCloudPly, &splats)),
        ("ascii", text.as_bytes().to_vec()),
        ("ascii big", text.replace("ascii", "binary_big_endian").into_bytes()),
        ("glb", glb),
        ("glb sh1", written_as(ModelFormat::Glb, &native)),
        ("gltf", gltf.json.to_string().into_bytes()),
        ("compressed ply", compressed(&splats, 9, true)),
        ("splat", dot_splat(&splats)),
        ("spz 1", gzip(&legacy(1, 2, 0))),
        ("spz 2", gzip(&legacy(2, 2, 1))),
        ("spz raw", legacy(3, 2, 3)),
        ("spz 4", version_4(2, 0, &zeros(2))),
        ("spz 3 sh1", written_as(ModelFormat::Spz, &native)),
        ("spz 4 sh1", written(&native, &spz_4)),
        ("sog", written_as(ModelFormat::Sog, &splats)),
        ("sog sh1", written_as(ModelFormat::Sog, &native)),
    ]
}

fn read_at(path: &Path, bytes: &[u8]) -> Result<Imported, ExportError> {
    std::fs::write(path, bytes).unwrap();
    let (result, largest) = largest_during(|| read(path));
    assert!(largest <= 64 * bytes.len() + 65_536, "{largest} bytes for a file of {}", bytes.len());
    result
}

#[test]
fn truncation_at_every_byte() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model");
    for (name, bytes) in files() {
        for end in 0..bytes.len() {
            let result = read_at(&path, &bytes[..end]);
            // A text cut inside its last number or just behind it is still valid.
            let may_pass = match name {
                "ascii" => end + 3 > bytes.len(),
                // The format has no count, so a cut between splats goes unnoticed.
                "splat" => end == 32,
                _ => false,
            };
            assert!(result.is_err() || may_pass, "{name} cut at {end} of {}", bytes.len());
        }
    }
}

#[test]
fn random_damage() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model");
    let (mut n_errors, mut n_models) = (0, 0);
    for (index, (_, good)) in files().into_iter().enumerate() {
        let mut rng = Rng::new(42, Purpose::Synthetic, index as u64);
        for _ in 0..1500 {
            let mut bytes = good.clone();
            for _ in 0..=rng.below(3) {
                let at = rng.below(bytes.len());
                match rng.below(3) {
                    0 => bytes[at] ^= 1 << rng.below(8),
                    1 => bytes[at] = b"0123456789-.[]{}\", \n"[rng.below(20)],
                    _ => bytes[at] = rng.below(256) as u8,
                }
            }
            match read_at(&path, &bytes) {
                Ok(model) => {
                    n_models += 1;
                    assert!(!model.splats.is_empty());
                    for splat in model.splats.iter() {
                        let fields: [f32; 14] = bytemuck::cast(*splat);
                        assert!(fields.iter().all(|v| v.is_finite()), "{splat:?}");
                    }
                    let appearance = model.splats.view().appearance();
                    assert!(appearance.iter().all(|a| a.is_valid()), "{appearance:?}");
                }
                Err(error) => {
                    n_errors += 1;
                    let message = error.to_string();
                    assert!(message.len() < 700 && !message.contains('\n'), "{message}");
                }
            }
        }
    }
    eprintln!("random damage: {n_errors} errors, {n_models} models");
    assert!(n_errors > 1000 && n_models > 500);
}

#[test]
fn files_that_are_no_models() {
    assert_fails(
        "empty",
        b"",
        &["expected a model (.ply, .glb, .gltf, .spz, .sog or .splat), found an empty file"],
    );
    assert_fails("png", b"\x89PNG\r\n\x1a\n", &["found a file starting"]);
    assert_fails("words", b"plywood is no model", &["plywood is no mo"]);
    assert_fails("json", b"{\"camera_angle_x\": 0.69}", &["JSON: expected glTF 2.0"]);
    let folder = tempfile::tempdir().unwrap();
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("expected a file, found a folder"), "{error}");
    let error = read(&folder.path().join("none.ply")).unwrap_err().to_string();
    assert!(
        error.contains(
            "none.ply: expected a model (.ply, .glb, .gltf, .spz, .sog or .splat), found nothing"
        ),
        "{error}"
    );
}
