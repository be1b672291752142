//! Golden values: splats from covariances, and small files written by the public functions.

use super::written;
use crate::common::golden::{golden_file, golden_folder};
use glam::{DMat3, DQuat, DVec3};
use serde_json::Value;
use std::path::Path;
use vbgs_studio::export::{Axes, ModelFormat, WriteOptions, read};
use vbgs_studio::math::sym3::Sym3;
use vbgs_studio::model::splat::splats::{CovarianceForm, Splat, decompose};

/// Factor of the reference exporter on its scales (`model.md`, From posterior to splat).
const LEGACY_SCALE_FACTOR: f64 = 1.41;
/// A [`Splat`] holds f32 but the golden files were made from f64: after `(c − ½)/C0` or a logit the last
/// two bits may differ.
const INPUT_ROUNDING_ULPS: u32 = 3;

/// Eigenvectors have no sign: flipping two of them rotates the frame by half a turn about the third, so
/// the golden quaternion is one of four.
const HALF_TURNS: [DQuat; 4] = [
    DQuat::IDENTITY,
    DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0),
    DQuat::from_xyzw(0.0, 1.0, 0.0, 0.0),
    DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0),
];

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}

fn cases() -> Value {
    let text = std::fs::read_to_string(golden_file("export_cases.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn splats(cases: &Value) -> Vec<Splat> {
    let array = |v: &Value| numbers(v).iter().map(|&x| x as f32).collect::<Vec<f32>>();
    let splat = |s: &Value| Splat {
        mean: array(&s["mean"]).try_into().unwrap(),
        opacity: s["opacity"].as_f64().unwrap() as f32,
        color: array(&s["rgb"]).try_into().unwrap(),
        scale: array(&s["scale"]).try_into().unwrap(),
        rotation: array(&s["quat"]).try_into().unwrap(),
    };
    cases["splats"].as_array().unwrap().iter().map(splat).collect()
}

fn wxyz(q: DQuat) -> [f64; 4] {
    [q.w, q.x, q.y, q.z]
}

fn rotation_distance(a: [f64; 4], b: &[f64]) -> f64 {
    let with = |sign: f64| a.iter().zip(b).map(|(x, y)| (x - sign * y).abs()).fold(0.0, f64::max);
    with(1.0).min(with(-1.0))
}

fn relative(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(x, y)| (x - y).abs() / y.abs()).fold(0.0, f64::max)
}

#[test]
fn covariance_cases_in_both_forms() {
    let cases = cases();
    let (mut n_arrays, mut n_values, mut worst) = (0, 0, [0.0f64; 2]);
    for case in cases["covariance_cases"].as_array().unwrap() {
        let covariance = Sym3::from_mat3(DMat3::from_cols_slice(&numbers(&case["cov"])));
        // The reference exporter takes f32 input, so the golden legacy values do too.
        let narrow = Sym3::from_array(covariance.to_array().map(|v| f64::from(v as f32)));
        let forms = [
            (covariance, CovarianceForm::Eigen, 1.0, "eigen_scale", "eigen_quat_wxyz"),
            (
                narrow,
                CovarianceForm::LegacyCholesky,
                LEGACY_SCALE_FACTOR,
                "legacy_scale",
                "legacy_quat_wxyz",
            ),
        ];
        for (sigma, form, factor, scale_name, rotation_name) in forms {
            let (scale, rotation) = decompose(sigma, form);
            let golden = (numbers(&case[scale_name]), numbers(&case[rotation_name]));
            worst[0] = worst[0].max(relative(&(scale * factor).to_array(), &golden.0));
            let turns = match form {
                CovarianceForm::Eigen => HALF_TURNS.as_slice(),
                CovarianceForm::LegacyCholesky => &HALF_TURNS[..1],
            };
            let distances = turns.iter().map(|t| rotation_distance(wxyz(rotation * *t), &golden.1));
            worst[1] = worst[1].max(distances.fold(f64::INFINITY, f64::min));
            n_arrays += 2;
            n_values += golden.0.len() + golden.1.len();
        }
        let (scale, rotation) = decompose(narrow, CovarianceForm::LegacyCholesky);
        let q = DMat3::from_quat(rotation) * DMat3::from_diagonal(scale);
        let error = q * q.transpose() - covariance.to_mat3();
        let norm = |m: DMat3| m.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt();
        let golden = case["legacy_covariance_error_frobenius_rel"].as_f64().unwrap();
        let ours = norm(error) / norm(covariance.to_mat3());
        assert!((ours - golden).abs() < 1e-9, "legacy error {ours}, golden {golden}");
        n_arrays += 1;
        n_values += 1;
    }
    eprintln!(
        "covariance_cases: {n_arrays} arrays, {n_values} values; \
         worst scale rel {:.1e}, quaternion {:.1e}",
        worst[0], worst[1]
    );
    assert!(n_values == 45 && worst[0] < 1e-9 && worst[1] < 1e-9, "{n_values} {worst:?}");
}

fn f64s(folder: &Path, name: &str) -> Vec<f64> {
    let bytes = std::fs::read(folder.join(format!("{name}.f64.bin"))).unwrap();
    bytes.as_chunks().0.iter().map(|&b| f64::from_le_bytes(b)).collect()
}

fn f32s(folder: &Path, name: &str) -> Vec<f64> {
    let bytes = std::fs::read(folder.join(format!("{name}.f32.bin"))).unwrap();
    bytes.as_chunks().0.iter().map(|&b| f64::from(f32::from_le_bytes(b))).collect()
}

/// Compares within the tolerances of the golden files.
#[test]
fn reference_scales_quaternions_and_eigenvalues() {
    let folder = golden_folder("splat");
    let (sigma, eig) = (f64s(&folder, "sigma"), f64s(&folder, "eig"));
    let (scale_ref, quat_ref) = (f32s(&folder, "scale_ref"), f32s(&folder, "quat_ref"));
    let mut worst = [0.0f64; 3];
    for i in 0..48 {
        let covariance = Sym3::from_array(sigma[6 * i..][..6].try_into().unwrap());
        let (scale, rotation) = decompose(covariance, CovarianceForm::LegacyCholesky);
        worst[0] = worst[0].max(relative(&scale.to_array(), &scale_ref[3 * i..][..3]));
        worst[1] = worst[1].max(rotation_distance(wxyz(rotation), &quat_ref[4 * i..][..4]));
        let golden = &eig[3 * i..][..3];
        // `decompose` clamps eigenvalues that are negative by rounding to zero.
        let values = decompose(covariance, CovarianceForm::Eigen).0.map(|s| s * s).to_array();
        for (value, golden_value) in values.iter().rev().zip(golden) {
            worst[2] = worst[2].max((value - golden_value).abs() / golden[2]);
        }
    }
    let n_values = scale_ref.len() + quat_ref.len() + eig.len();
    eprintln!(
        "splat: 3 arrays, {n_values} values; \
         worst scale rel {:.1e}, quaternion {:.1e}, eigenvalue {:.1e}",
        worst[0], worst[1], worst[2]
    );
    assert_eq!(n_values, 48 * 10);
    assert!(worst[0] < 2e-6 && worst[1] < 2e-6 && worst[2] < 1e-14, "{worst:?}");
}

/// Compares two arrays of f32; returns the number of values that are equal bit for bit.
fn assert_close(name: &str, ours: &[u8], golden: &[u8]) -> usize {
    assert_eq!(ours.len(), golden.len(), "{name}");
    let words = |bytes: &[u8]| -> Vec<u32> {
        bytes.as_chunks().0.iter().map(|&b| u32::from_le_bytes(b)).collect()
    };
    let pairs = words(ours).into_iter().zip(words(golden));
    let mut n_equal = 0;
    for (i, (a, b)) in pairs.enumerate() {
        assert!(a.abs_diff(b) <= INPUT_ROUNDING_ULPS, "{name}, value {i}: {a:#x} against {b:#x}");
        n_equal += usize::from(a == b);
    }
    n_equal
}

#[test]
fn ply_files_of_two_splats() {
    let cases = cases();
    for (name, sh3_padding, row_floats) in
        [("two_splats.ply", false, 17), ("two_splats_sh3.ply", true, 62)]
    {
        let golden = std::fs::read(golden_file(name)).unwrap();
        assert_eq!(golden.len() as u64, cases["files"][name]["bytes"].as_u64().unwrap());
        let options = WriteOptions { sh3_padding, ..WriteOptions::new(ModelFormat::Ply) };
        let ours = written(&splats(&cases), &options);
        let header = golden.len() - 2 * row_floats * 4;
        assert_eq!(ours[..header], golden[..header], "{name}: header");
        let n_equal = assert_close(name, &ours[header..], &golden[header..]);
        eprintln!("{name}: {n_equal} of {} values equal bit for bit", 2 * row_floats);
        assert!(n_equal >= 2 * row_floats - 2);
    }
}

#[test]
fn glb_file_of_two_splats() {
    let cases = cases();
    let golden = std::fs::read(golden_file("two_splats.glb")).unwrap();
    let ours = written(&splats(&cases), &WriteOptions::new(ModelFormat::Glb));
    let (ours, golden) = (super::glb_file::Glb::parse(&ours), super::glb_file::Glb::parse(&golden));
    let mut json = ours.json.clone();
    assert!(json["asset"]["generator"].as_str().unwrap().starts_with("vbgs-studio "));
    json["asset"]["generator"] = "vbgs".into();
    assert_eq!(json, golden.json);
    assert_eq!(json, cases["glb_json"]);
    let n_equal = assert_close("two_splats.glb", &ours.bin, &golden.bin);
    eprintln!("two_splats.glb: {n_equal} of 32 words equal bit for bit");
    assert!(n_equal >= 31);
}

#[test]
fn golden_files_read_back_as_the_golden_splats() {
    let cases = cases();
    for name in ["two_splats.ply", "two_splats_sh3.ply", "two_splats.glb"] {
        let model = read(&golden_file(name)).unwrap();
        for (ours, golden) in model.splats.iter().zip(splats(&cases)) {
            assert_eq!(ours.mean, golden.mean, "{name}");
            super::round_trip::assert_same(ours, &golden, name);
        }
        assert_eq!(model.splats.len(), 2);
    }
}

#[test]
fn axis_changes_move_covariances_as_a_sigma_a_transposed() {
    let cases = cases();
    let splats = super::random_splats(20, 5);
    let options = WriteOptions { axes: Axes::Viewer, ..WriteOptions::new(ModelFormat::Ply) };
    let ply = super::read_bytes(&written(&splats, &options)).unwrap();
    let a = DMat3::from_cols_slice(&numbers(&cases["zup_to_ply_ydown"]["matrix"])).transpose();
    for (before, after) in splats.iter().zip(ply.splats.iter()) {
        let mean = |s: &Splat| DVec3::from_array(s.mean.map(f64::from));
        assert_eq!(a * mean(before), mean(after));
        assert_turned(a, before.covariance(), after.covariance());
    }
    // Import rotates a GLB back, so this reads the raw file.
    let bytes = written(&splats, &WriteOptions::new(ModelFormat::Glb));
    let a = DMat3::from_cols_slice(&numbers(&cases["zup_to_yup"]["matrix"])).transpose();
    let raw = super::glb_file::Glb::parse(&bytes).splats();
    for (before, after) in splats.iter().zip(&raw) {
        assert_eq!(
            a * DVec3::from_array(before.mean.map(f64::from)),
            DVec3::from_array(after.mean.map(f64::from))
        );
        assert_turned(a, before.covariance(), after.covariance());
    }
}

fn assert_turned(a: DMat3, before: Sym3, after: Sym3) {
    let expected = a * before.to_mat3() * a.transpose();
    let difference = expected - after.to_mat3();
    let largest = |m: DMat3| m.to_cols_array().iter().fold(0.0f64, |w, v| w.max(v.abs()));
    // Scales are accurate to 1e-6 (their logarithm is f32), quaternions to 1e-7.
    assert!(largest(difference) < 4e-6 * largest(expected), "{difference} of {expected}");
}
