//! Small files by other programs (`../shared/data/splats`), with the same splats in several formats.

use super::distance;
use crate::common::shared;
use glam::{DMat3, DQuat, DVec3, Vec3};
use vbgs_studio::export::{Imported, ModelKind, Note, read};
use vbgs_studio::model::splat::splats::Splat;

fn sample(name: &str) -> Option<Imported> {
    Some(read(&shared(&format!("data/splats/{name}"))?).unwrap())
}

/// Rotates a splat back to the axes of its y-up file; reading rotated it to z-up.
fn in_file_axes(splat: &Splat) -> Splat {
    let [x, y, z] = splat.mean;
    let [w, i, j, k] = splat.rotation.map(f64::from);
    let back = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    let q = back * DQuat::from_xyzw(i, j, k, w);
    let rotation = [q.w, q.x, q.y, q.z].map(|v| v as f32);
    Splat { mean: [x, z, -y], rotation, ..*splat }
}

fn shape(splat: &Splat) -> DMat3 {
    let [w, x, y, z] = splat.rotation.map(f64::from);
    let half = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w))
        * DMat3::from_diagonal(DVec3::from_array(splat.scale.map(f64::from)));
    half * half.transpose()
}

fn assert_alike(name: &str, a: &Splat, b: &Splat, slack: f32) {
    let scale = distance(a.scale.map(f32::ln), b.scale.map(f32::ln));
    assert!(distance(a.mean, b.mean) <= 1e-3, "{name}: {:?} {:?}", a.mean, b.mean);
    assert!((a.opacity - b.opacity).abs() <= 1.0 / 255.0, "{name}: {a:?} {b:?}");
    assert!(distance(a.color, b.color) <= slack, "{name}: {:?} {:?}", a.color, b.color);
    assert!(scale <= slack.max(0.05), "{name}: {:?} {:?}", a.scale, b.scale);
    // Compares covariances: a ball may have any rotation.
    let difference = shape(a) - shape(b);
    let part = difference.to_cols_array().map(f64::abs).into_iter().fold(0.0, f64::max);
    assert!(
        part <= 0.15 * f64::from(a.scale[0].max(a.scale[1]).max(a.scale[2])).powi(2),
        "{name}: {a:?} {b:?}"
    );
}

/// PlayCanvas wrote the same four splats in each format.
#[test]
fn four_splats_are_the_same_in_every_format() {
    let Some(plain) = sample("minimal.splat") else { return };
    assert_eq!((plain.kind, plain.splats.len()), (ModelKind::Splats, 4));
    assert_eq!(plain.splats[1].mean, [0.0, 0.0, -1.0]);
    assert!(distance(plain.splats[1].color, [2.0 / 3.0, 1.0 / 3.0, 128.0 / 255.0]) < 1e-6);
    assert!((plain.splats[0].opacity - 230.0 / 255.0).abs() < 1e-6);
    for name in ["minimal-raw.spz", "minimal-v2.spz", "minimal-v3.spz", "minimal-v4.spz"] {
        let Some(packed) = sample(name) else { return };
        assert_eq!(packed.splats.len(), 4, "{name}");
        // The older two files hold coordinates and colours unconverted; the newer two follow the
        // format: y up, z backward, colours as coefficients.
        let is_converted = name.contains("v3") || name.contains("v4");
        let (sign, slack) = if is_converted { (-1.0, 0.005) } else { (1.0, 0.15) };
        for (a, b) in plain.splats.iter().zip(packed.splats.iter()) {
            let b = in_file_axes(b);
            let [x, y, z] = b.mean;
            assert_alike(name, a, &Splat { mean: [x, sign * y, sign * z], ..b }, slack);
        }
    }
}

/// Nine splats with harmonics of degree 3; reading uses degree 1 only.
#[test]
fn nine_splats_are_the_same_as_ply_and_spz() {
    let (Some(ply), Some(spz)) = (sample("model.ply"), sample("model.spz")) else { return };
    let ignored = vec![Note::ViewDependentColorIgnored { n_coefficients: 36 }];
    assert_eq!((&ply.notes, &spz.notes), (&ignored, &ignored));
    assert_eq!((ply.splats.len(), spz.splats.len()), (9, 9));
    for (a, b) in ply.splats.iter().zip(spz.splats.iter()) {
        assert_alike("model.spz", a, &in_file_axes(b), 0.01);
    }
}

/// One splat per primitive and component type of `KHR_gaussian_splatting`, in a draft with logarithmic
/// scales.
#[test]
fn every_component_type_of_the_extension_is_read() {
    let scale = |l: [f64; 3]| l.map(|v| v.exp() as f32);
    let (default, one) = (scale([0.0, 0.5, -0.5]), scale([1.0, 0.0, -1.0]));
    let mut scales = [default; 15];
    scales[3] = scale([0.2, -0.1, 0.7]);
    scales[4] = scale([1.0, -2.0, 3.0]);
    scales[5] = one;
    scales[6] = scale([2.0, -3.0, 4.0]);
    scales[7] = one;
    let mut opacities = [0.25; 15];
    opacities[8] = 0.75;
    opacities[9] = 64.0 / 255.0;
    opacities[10] = 16384.0 / 65535.0;
    for name in ["khr_conformance_matrix.gltf", "khr_conformance_matrix.glb"] {
        let Some(model) = sample(name) else { return };
        assert_eq!((model.splats.len(), model.skipped), (15, 0), "{name}");
        for (i, splat) in model.splats.iter().enumerate() {
            let splat = in_file_axes(splat);
            assert_eq!(splat.mean, [1.0, 2.0, 3.0], "{name} {i}");
            assert!((splat.opacity - opacities[i]).abs() < 1e-6, "{name} {i}: {}", splat.opacity);
            let ratio = Vec3::from(splat.scale) / Vec3::from(scales[i]);
            assert!((ratio - 1.0).abs().max_element() < 1e-5, "{name} {i}: {:?}", splat.scale);
            let half_turn = distance(splat.rotation.map(f32::abs), [0.0, 1.0, 0.0, 0.0]);
            assert!(half_turn < 1e-5, "{name} {i}: {:?}", splat.rotation);
        }
        assert!(model.notes.contains(&Note::LogarithmicScales), "{name}: {:?}", model.notes);
        assert!(model.notes.contains(&Note::LinearColorEncoded), "{name}: {:?}", model.notes);
    }
}

/// An unknown kernel extension is read as an ellipse with the fallback colour.
#[test]
fn an_unknown_kernel_is_an_ellipse() {
    let Some(model) = sample("khr_extensible_fallback.gltf") else { return };
    assert!(
        model.notes.iter().any(|note| matches!(note, Note::Unsupported { name: "kernel", .. }))
    );
    for note in [Note::FallbackColor, Note::LogarithmicScales] {
        assert!(model.notes.contains(&note), "{:?}", model.notes);
    }
    let splat = in_file_axes(&model.splats[0]);
    assert_eq!((splat.mean, splat.opacity), ([1.0, 2.0, 3.0], 0.5));
    assert!(distance(splat.scale, [1.0; 3]) < 1e-6, "{:?}", splat.scale);
    // sRGB encodings of linear 0.2821, 0.5642 and 0.8463.
    assert!(distance(splat.color, [0.5679, 0.7770, 0.9285]) < 1e-3, "{:?}", splat.color);
}
