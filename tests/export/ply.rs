//! Written PLY files, read by a parser that shares no code with ours.

use super::{random_splats, read_bytes, written, written_as};
use glam::DVec3;
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Ply, Property};
use vbgs_studio::export::{Axes, ModelFormat, ModelKind, WriteOptions, WriteSelection};
use vbgs_studio::math::image::unit_to_byte;
use vbgs_studio::model::splat::splats::Splat;

fn parse(bytes: &[u8]) -> Ply<DefaultElement> {
    Parser::<DefaultElement>::new().read_ply(&mut &bytes[..]).unwrap()
}

fn float(vertex: &DefaultElement, name: &str) -> f32 {
    match vertex.get(name) {
        Some(Property::Float(value)) => *value,
        other => panic!("{name}: {other:?}"),
    }
}

fn byte(vertex: &DefaultElement, name: &str) -> u8 {
    match vertex.get(name) {
        Some(Property::UChar(value)) => *value,
        other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn an_independent_reader_finds_every_splat() {
    let splats = random_splats(50, 11);
    for (sh3_padding, n_properties) in [(false, 17), (true, 62)] {
        let options = WriteOptions { sh3_padding, ..WriteOptions::new(ModelFormat::Ply) };
        let ply = parse(&written(&splats, &options));
        assert_eq!(ply.header.elements["vertex"].properties.len(), n_properties);
        let vertices = &ply.payload["vertex"];
        assert_eq!(vertices.len(), 50);
        for (vertex, splat) in vertices.iter().zip(&splats) {
            assert_eq!(["x", "y", "z"].map(|n| float(vertex, n)), splat.mean);
            assert_eq!(["nx", "ny", "nz"].map(|n| float(vertex, n)), [0.0; 3]);
            let opacity = 1.0 / (1.0 + (-float(vertex, "opacity")).exp());
            assert!((opacity - splat.opacity).abs() < 1e-6);
            for i in 0..3 {
                let color = 0.5 + 0.282_094_8 * float(vertex, &format!("f_dc_{i}"));
                assert!((color - splat.color[i]).abs() < 1e-6);
                let scale = float(vertex, &format!("scale_{i}")).exp();
                assert!((scale / splat.scale[i] - 1.0).abs() < 2e-6);
            }
            // Files hold the quaternion with positive w.
            let sign = splat.rotation[0].signum();
            for i in 0..4 {
                let found = float(vertex, &format!("rot_{i}"));
                assert!((found - sign * splat.rotation[i]).abs() < 1e-6);
            }
            if sh3_padding {
                assert!((0..45).all(|i| float(vertex, &format!("f_rest_{i}")) == 0.0));
            }
        }
    }
}

#[test]
fn headers_keep_what_the_pickiest_readers_ask_for() {
    let splats = random_splats(3, 12);
    for axes in [Axes::AsIs, Axes::Viewer] {
        let options =
            WriteOptions { axes, sh3_padding: true, ..WriteOptions::new(ModelFormat::Ply) };
        let bytes = written(&splats, &options);
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n") && end < 4096);
        assert!(header.is_ascii() && !header.contains('\r') && !header.contains("  "));
        for absent in ["list", "obj_info", "red"] {
            assert!(!header.contains(absent));
        }
        let up = if axes == Axes::AsIs { "0 0 1" } else { "0 -1 0" };
        assert!(header.contains(&format!("\ncomment Vertical axis: {up}\n")));
        assert_eq!(bytes.len(), end + 3 * 248);
    }
}

#[test]
fn point_clouds_hold_colour_normals_and_what_is_known_of_each() {
    let flat = |mean: [f32; 3], thinnest: usize| {
        let mut scale = [0.2, 0.3, 0.25];
        scale[thinnest] = 0.01;
        Splat { mean, opacity: 0.9, color: [1.0, 0.5, 0.0], scale, rotation: [1.0, 0.0, 0.0, 0.0] }
    };
    let unused = Splat::default();
    let splats = [flat([0.0; 3], 2), unused, flat([10.0, 0.0, 0.0], 0), flat([10.0, 9.0, 0.0], 1)];
    let centres = [DVec3::new(1.0, 1.0, -4.0), DVec3::new(8.0, 5.0, 1.0)];
    let options = WriteOptions {
        camera_centres: &centres,
        confidence: Some(&[1.5, 99.0, 2.5, 1e6]),
        selection: WriteSelection {
            uncertainty: Some(&[0.25, 9.0, 0.5, 1.0]),
            ..Default::default()
        },
        ..WriteOptions::new(ModelFormat::PointCloudPly)
    };
    let bytes = written(&splats, &options);
    let ply = parse(&bytes);
    let expected = [
        ([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [1.5, 0.25]),
        ([10.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [2.5, 0.5]),
        ([10.0, 9.0, 0.0], [0.0, -1.0, 0.0], [1e6, 1.0]),
    ];
    assert_eq!(ply.payload["vertex"].len(), expected.len());
    for (vertex, (mean, normal, known)) in ply.payload["vertex"].iter().zip(expected) {
        assert_eq!(["x", "y", "z"].map(|n| float(vertex, n)), mean);
        assert_eq!(["nx", "ny", "nz"].map(|n| float(vertex, n)), normal);
        assert_eq!(["red", "green", "blue"].map(|n| byte(vertex, n)), [255, 128, 0]);
        assert_eq!(["confidence", "uncertainty"].map(|n| float(vertex, n)), known);
    }
    let model = read_bytes(&bytes).unwrap();
    assert_eq!((model.kind, model.splats.len()), (ModelKind::PointCloud, 3));
    assert!(model.splats.iter().all(|s| s.is_drawable() && s.scale[0] > 0.1));
}

#[test]
fn plain_point_clouds_come_back_with_position_and_colour() {
    let splats = random_splats(200, 13);
    let bytes = written_as(ModelFormat::PointCloudPly, &splats);
    let vertex = &parse(&bytes).payload["vertex"][0];
    assert_eq!(vertex.len(), 6);
    let model = read_bytes(&bytes).unwrap();
    for (point, splat) in model.splats.iter().zip(&splats) {
        assert_eq!(point.mean, splat.mean);
        assert_eq!(point.color.map(unit_to_byte), splat.color.map(unit_to_byte));
    }
}

#[test]
fn viewer_axes_turn_normals_along() {
    let splat = Splat {
        mean: [1.0, 2.0, 3.0],
        opacity: 0.9,
        scale: [0.2, 0.3, 0.01],
        rotation: [1.0, 0.0, 0.0, 0.0],
        ..Splat::default()
    };
    let options = WriteOptions {
        axes: Axes::Viewer,
        camera_centres: &[DVec3::new(1.0, 2.0, 9.0)],
        ..WriteOptions::new(ModelFormat::PointCloudPly)
    };
    let vertex = &parse(&written(&[splat], &options)).payload["vertex"][0];
    assert_eq!(["x", "y", "z"].map(|n| float(vertex, n)), [-1.0, -3.0, -2.0]);
    assert_eq!(["nx", "ny", "nz"].map(|n| float(vertex, n)), [0.0, -1.0, 0.0]);
}
