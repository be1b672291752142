//! Written GLB files: valid by the specifications of glTF 2.0 and of the extension.

use super::glb_file::Glb;
use super::{random_splats, written, written_as};
use vbgs_studio::export::{ModelFormat, WriteOptions};

fn sample(n: usize) -> Glb {
    Glb::parse(&written_as(ModelFormat::Glb, &random_splats(n, 21)))
}

#[test]
fn views_are_packed_aligned_and_inside_the_buffer() {
    for n in [1, 2, 33] {
        let glb = sample(n);
        let buffer = glb.json["buffers"][0]["byteLength"].as_u64().unwrap();
        assert!(buffer <= glb.bin.len() as u64 && glb.bin.len() as u64 <= buffer + 3);
        assert_eq!(buffer, 64 * n as u64);
        let mut end = 0;
        let views = glb.json["bufferViews"].as_array().unwrap();
        for (view, accessor) in views.iter().zip(glb.json["accessors"].as_array().unwrap()) {
            let offset = view["byteOffset"].as_u64().unwrap();
            assert_eq!((offset, offset % 4), (end, 0));
            end += view["byteLength"].as_u64().unwrap();
            assert!(view["byteStride"].is_null() && view["target"] == 34962);
            assert_eq!(accessor["count"], n);
            let row = match (accessor["type"].as_str().unwrap(), &accessor["componentType"]) {
                ("VEC4", kind) if kind == 5123 => 8,
                ("SCALAR", _) => 4,
                ("VEC3", _) => 12,
                _ => 16,
            };
            assert_eq!(view["byteLength"], row * n);
        }
        assert_eq!(end, buffer);
    }
}

#[test]
fn values_are_in_their_ranges_and_extremes_exact() {
    let mut glb = sample(500);
    let positions = glb.floats("POSITION");
    for axis in 0..3 {
        let values = || positions.iter().map(|p| p[axis]);
        let (min, max) = (values().fold(f32::MAX, f32::min), values().fold(f32::MIN, f32::max));
        // JSON readers parse decimals to f64, without rounding to f32 in between.
        let accessor = glb.accessor("POSITION");
        assert_eq!(accessor["min"][axis].as_f64().unwrap() as f32, min);
        assert_eq!(accessor["max"][axis].as_f64().unwrap() as f32, max);
    }
    for splat in glb.splats() {
        assert!(splat.is_drawable());
        let length = splat.rotation.iter().map(|v| v * v).sum::<f32>().sqrt();
        assert!((length - 1.0).abs() < 1e-4 && splat.scale.iter().all(|s| *s >= 0.0));
        assert!((0.0..=1.0).contains(&splat.opacity));
    }
}

#[test]
fn the_extension_is_declared_and_optional() {
    let mut glb = sample(2);
    assert_eq!(glb.json["extensionsUsed"], serde_json::json!(["KHR_gaussian_splatting"]));
    assert!(glb.json.get("extensionsRequired").is_none());
    assert!(glb.json["asset"].get("extras").is_none());
    let primitive = glb.primitive();
    assert_eq!(primitive["mode"], 0);
    let extension = &primitive["extensions"]["KHR_gaussian_splatting"];
    assert_eq!(extension["kernel"], "ellipse");
    assert_eq!(extension["colorSpace"], "srgb_rec709_display");
    assert!(glb.json["nodes"][0].get("matrix").is_none(), "axes are baked");
}

#[test]
fn the_fallback_colour_is_linear_and_16_bits_wide() {
    let mut splat = random_splats(1, 22)[0];
    splat.color = [0.5, 0.02, 1.0];
    splat.opacity = 0.5;
    let mut glb = Glb::parse(&written_as(ModelFormat::Glb, &[splat]));
    assert_eq!(glb.accessor("COLOR_0")["normalized"], true);
    let start = glb.view("COLOR_0")["byteOffset"].as_u64().unwrap() as usize;
    let values: Vec<u16> =
        glb.bin[start..start + 8].as_chunks().0.iter().map(|&b| u16::from_le_bytes(b)).collect();
    // sRGB decoding: 0.5 gives 0.214041, 0.02 gives 0.02/12.92.
    assert_eq!(values, [14027, 101, 65535, 32768]);
}

#[test]
fn what_is_up_is_said_with_units_and_comments() {
    let comments = ["vbgs legacy-cov".to_owned()];
    let options =
        WriteOptions { metric: true, comments: &comments, ..WriteOptions::new(ModelFormat::Glb) };
    let glb = Glb::parse(&written(&random_splats(1, 23), &options));
    let expected =
        serde_json::json!({"up": "y", "units": "metres", "comments": ["vbgs legacy-cov"]});
    assert_eq!(glb.json["asset"]["extras"], expected);
    let plain = Glb::parse(&written(&random_splats(1, 23), &WriteOptions::new(ModelFormat::Glb)));
    assert!(plain.json["asset"].get("extras").is_none());
}
