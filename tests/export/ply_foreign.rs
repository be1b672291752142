//! PLY files of other programs, valid and invalid.

use super::allocations::largest_during;
use super::{assert_fails, distance, read_bytes};
use vbgs_studio::export::{ModelKind, Note};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

/// PLY file with a vertex element of the given properties (`type name`) and rows.
fn file(encoding: Encoding, properties: &[&str], rows: &[Vec<f64>]) -> Vec<u8> {
    let mut bytes = header(encoding, "", properties, rows.len(), "\n");
    for row in rows {
        append_row(&mut bytes, encoding, properties, row);
    }
    bytes
}

fn header(encoding: Encoding, before: &str, properties: &[&str], n: usize, end: &str) -> Vec<u8> {
    let format = match encoding {
        Encoding::Ascii => "ascii",
        Encoding::Little => "binary_little_endian",
        Encoding::Big => "binary_big_endian",
    };
    let mut text = format!("ply\nformat {format} 1.0\ncomment made by a test\n{before}");
    text += &format!("element vertex {n}\n");
    for property in properties {
        text += &format!("property {property}\n");
    }
    text += "end_header\n";
    text.replace('\n', end).into_bytes()
}

fn append_row(bytes: &mut Vec<u8>, encoding: Encoding, properties: &[&str], row: &[f64]) {
    for (property, &value) in properties.iter().zip(row) {
        if encoding == Encoding::Ascii {
            bytes.extend(format!("{value} ").bytes());
            continue;
        }
        let mut raw = match property.split(' ').next().unwrap() {
            "char" | "int8" => (value as i8).to_le_bytes().to_vec(),
            "uchar" | "uint8" => (value as u8).to_le_bytes().to_vec(),
            "short" | "int16" => (value as i16).to_le_bytes().to_vec(),
            "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
            "int" | "int32" => (value as i32).to_le_bytes().to_vec(),
            "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
            "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
            "double" | "float64" => value.to_le_bytes().to_vec(),
            other => panic!("{other}"),
        };
        if encoding == Encoding::Big {
            raw.reverse();
        }
        bytes.extend(raw);
    }
    if encoding == Encoding::Ascii {
        bytes.push(b'\n');
    }
}

/// Properties of a splat and one row: mean 1 2 3, gray, opacity ½, scales 1, no rotation.
const SPLAT: [&str; 14] = [
    "float x",
    "float y",
    "float z",
    "float f_dc_0",
    "float f_dc_1",
    "float f_dc_2",
    "float opacity",
    "float scale_0",
    "float scale_1",
    "float scale_2",
    "float rot_0",
    "float rot_1",
    "float rot_2",
    "float rot_3",
];

fn splat_row() -> Vec<f64> {
    vec![1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
}

#[test]
fn any_order_type_and_encoding() {
    let properties = [
        "double rot_3",
        "float32 rot_0",
        "uchar flags",
        "float64 opacity",
        "int16 x",
        "uint32 y",
        "char z",
        "float f_dc_2",
        "float f_dc_1",
        "float f_dc_0",
        "float scale_2",
        "float scale_0",
        "float scale_1",
        "short rot_1",
        "ushort rot_2",
        "int label",
    ];
    let row = vec![
        -2.0, 2.0, 200.0, 1.5, -300.0, 4e9, -7.0, 0.3, -0.2, 0.1, -3.0, -1.0, -2.0, 0.0, 0.0, -9.0,
    ];
    for encoding in [Encoding::Ascii, Encoding::Little, Encoding::Big] {
        let model = read_bytes(&file(encoding, &properties, &[row.clone(), row.clone()])).unwrap();
        assert_eq!((model.kind, model.splats.len()), (ModelKind::Splats, 2), "{encoding:?}");
        assert_eq!(model.comments, ["made by a test"]);
        let splat = model.splats[1];
        assert_eq!(splat.mean, [-300.0, 4e9, -7.0], "{encoding:?}");
        let c0 = 0.282_094_8;
        assert!(distance(splat.color, [0.5 + 0.1 * c0, 0.5 - 0.2 * c0, 0.5 + 0.3 * c0]) < 1e-6);
        let scale = [-1.0f32, -2.0, -3.0].map(f32::exp);
        assert!(distance(splat.scale, scale) < 1e-6, "{encoding:?}");
        assert!((splat.opacity - 0.817_574_5).abs() < 1e-6, "{encoding:?}");
        let half = std::f32::consts::FRAC_1_SQRT_2;
        assert!(distance(splat.rotation, [half, 0.0, 0.0, -half]) < 1e-6, "{encoding:?}");
    }
}

#[test]
fn crlf_headers_and_texts() {
    for encoding in [Encoding::Ascii, Encoding::Little] {
        let mut bytes = header(encoding, "", &SPLAT, 1, "\r\n");
        append_row(&mut bytes, encoding, &SPLAT, &splat_row());
        let model = read_bytes(&bytes).unwrap();
        assert_eq!(model.splats[0].mean, [1.0, 2.0, 3.0]);
        assert_eq!(model.comments, ["made by a test"]);
    }
}

#[test]
fn elements_before_the_vertices_are_skipped() {
    let before = "element camera 2\nproperty double a\nproperty uchar b\n\
                  element face 3\nproperty list uchar int vertex_indices\nproperty float area\n\
                  element nothing 1000000000\n";
    for encoding in [Encoding::Ascii, Encoding::Little, Encoding::Big] {
        let mut bytes = header(encoding, before, &SPLAT, 1, "\n");
        for camera in 0..2 {
            append_row(&mut bytes, encoding, &["double a", "uchar b"], &[f64::from(camera), 5.0]);
        }
        for n in [3, 0, 4] {
            let mut kinds = vec!["uchar n"];
            kinds.extend(vec!["int i"; n]);
            kinds.push("float area");
            let mut row = vec![1.0; n + 2];
            row[0] = n as f64;
            append_row(&mut bytes, encoding, &kinds, &row);
        }
        append_row(&mut bytes, encoding, &SPLAT, &splat_row());
        assert_eq!(read_bytes(&bytes).unwrap().splats[0].mean, [1.0, 2.0, 3.0], "{encoding:?}");
    }
}

#[test]
fn rows_that_are_not_finite_are_skipped_and_counted() {
    let with = |column: usize, value: f64| {
        let mut row = splat_row();
        row[column] = value;
        row
    };
    let rows = [
        splat_row(),
        with(0, f64::NAN),
        with(2, f64::INFINITY),
        with(4, f64::NAN),
        with(6, f64::NAN),
        with(8, 1000.0), // a scale beyond f32
        with(11, f64::NEG_INFINITY),
        splat_row(),
    ];
    for encoding in [Encoding::Ascii, Encoding::Little] {
        let model = read_bytes(&file(encoding, &SPLAT, &rows)).unwrap();
        assert_eq!((model.splats.len(), model.skipped), (2, 6), "{encoding:?}");
    }
    assert_fails("only NaN", &file(Encoding::Little, &SPLAT, &rows[1..2]), &["1 skipped"]);
    assert_fails("no rows", &file(Encoding::Little, &SPLAT, &[]), &["found none (0 skipped)"]);
}

#[test]
fn zero_quaternions_and_wild_colours_are_repaired_and_counted() {
    let mut rows = vec![splat_row(); 4];
    rows[1][10] = 0.0;
    rows[2][10] = 1e-13;
    rows[3][3] = 5.0;
    let model = read_bytes(&file(Encoding::Little, &SPLAT, &rows)).unwrap();
    let expected = [Note::ZeroRotation { n_splats: 2 }, Note::ColorClamped { n_splats: 1 }];
    assert_eq!(model.notes, expected);
    assert!(model.splats.iter().all(|s| s.rotation == [1.0, 0.0, 0.0, 0.0]));
    assert_eq!(model.splats[3].color, [1.0, 0.5, 0.5]);
    assert!(model.notes[0].to_string().starts_with("2 splats had a rotation of length zero"));
}

#[test]
fn harmonics_above_degree_1_are_ignored_with_a_note() {
    // Degrees 1 to 4, and counts that match no degree.
    for (n_coefficients, n_read) in [(9, 9), (24, 9), (45, 9), (72, 9), (10, 0), (12, 0)] {
        let names: Vec<String> = (0..n_coefficients).map(|i| format!("float f_rest_{i}")).collect();
        let mut properties = SPLAT.to_vec();
        properties.splice(6..6, names.iter().map(String::as_str));
        let mut row = splat_row();
        row.splice(6..6, (0..n_coefficients).map(f64::from));
        let model = read_bytes(&file(Encoding::Little, &properties, &[row])).unwrap();
        assert_eq!(model.splats[0].scale, [1.0; 3]);
        let n_ignored = n_coefficients as usize - n_read;
        if n_ignored == 0 {
            assert_eq!(model.notes, []);
        } else {
            assert_eq!(
                model.notes,
                [Note::ViewDependentColorIgnored { n_coefficients: n_ignored }]
            );
            assert!(model.notes[0].to_string().starts_with("view-dependent colour ignored"));
        }
        let appearance = model.splats.view().appearance();
        assert_eq!(appearance.is_empty(), n_read == 0);
        for (channel, row) in appearance.iter().flat_map(|a| a.directional).enumerate() {
            // Coefficients are stored channel by channel, in the order −y, z, −x.
            let first = (channel * n_coefficients as usize / 3) as f32;
            let expected = [-first - 2.0, -first, first + 1.0].map(|v| 0.488_602_5 * v);
            assert!(distance(row, expected) < 1e-5, "{n_coefficients}: {row:?} {expected:?}");
        }
    }
}

#[test]
fn harmonics_with_a_gap_are_ignored() {
    let names: Vec<String> =
        (0..9).map(|i| format!("float f_rest_{}", if i == 4 { 99 } else { i })).collect();
    let mut properties = SPLAT.to_vec();
    properties.splice(6..6, names.iter().map(String::as_str));
    let mut row = splat_row();
    row.splice(6..6, vec![0.25; 9]);
    let model = read_bytes(&file(Encoding::Little, &properties, &[row])).unwrap();
    assert_eq!(model.notes, [Note::ViewDependentColorIgnored { n_coefficients: 9 }]);
    assert!(model.splats.view().appearance().is_empty());
}

#[test]
fn flat_splats_and_preview_colours() {
    let properties: Vec<&str> = SPLAT.iter().copied().filter(|p| !p.ends_with("scale_2")).collect();
    let mut row = splat_row();
    row.remove(9);
    row[8] = 2f64.ln();
    let model = read_bytes(&file(Encoding::Little, &properties, &[row])).unwrap();
    assert_eq!(model.notes, [Note::FlatSplats]);
    assert!(distance(model.splats[0].scale, [1.0, 2.0, 2e-6]) < 1e-6);

    let mut properties = SPLAT.to_vec();
    properties.splice(3..6, ["uchar red", "uchar green", "uchar blue"]);
    let mut row = splat_row();
    row.splice(3..6, [255.0, 51.0, 0.0]);
    let model = read_bytes(&file(Encoding::Little, &properties, &[row])).unwrap();
    assert!(distance(model.splats[0].color, [1.0, 0.2, 0.0]) < 1e-7);
}

#[test]
fn point_clouds_with_all_kinds_of_colour() {
    let cases = [
        ("uchar", 51.0, 0.2),
        ("ushort", 13107.0, 0.2),
        ("float", 0.2, 0.2),
        ("double", 0.25, 0.25),
    ];
    for (kind, value, color) in cases {
        let colors = ["red", "green", "blue"].map(|name| format!("{kind} {name}"));
        let mut properties = vec!["double x", "double y", "double z", "float nx"];
        properties.extend(colors.iter().map(String::as_str));
        let rows: Vec<Vec<f64>> =
            (0..9).map(|i| vec![f64::from(i), 0.0, 0.0, 9.0, value, value, value]).collect();
        let model = read_bytes(&file(Encoding::Big, &properties, &rows)).unwrap();
        assert_eq!((model.kind, model.notes.len()), (ModelKind::PointCloud, 0), "{kind}");
        assert!(distance(model.splats[8].color, [color; 3]) < 1e-6, "{kind}");
        // The scale is half the assumed spacing of 8/3: 9 points in a box of diagonal 8.
        assert!(
            (model.splats[0].scale[0] - 4.0 / 3.0).abs() < 1e-6 && model.splats[0].opacity == 1.0
        );
    }
    let bare = file(Encoding::Ascii, &["float x", "float y", "float z"], &[vec![1.0, 2.0, 3.0]]);
    let model = read_bytes(&bare).unwrap();
    assert_eq!(model.notes, [Note::NoColor]);
    assert!(model.splats[0].is_drawable());
}

#[test]
fn missing_properties_are_named() {
    for (i, property) in SPLAT.iter().enumerate() {
        let name = property.split(' ').nth(1).unwrap();
        if ["scale_0", "scale_2", "rot_0"].contains(&name) {
            continue; // without these the file is a valid point cloud or flat splats
        }
        let mut properties = SPLAT.to_vec();
        properties.remove(i);
        let mut row = splat_row();
        row.remove(i);
        let expected = format!("expected property {name}, found only");
        assert_fails(name, &file(Encoding::Little, &properties, &[row]), &[&expected]);
    }
}

#[test]
fn a_false_count_fails_before_memory_is_taken() {
    for encoding in [Encoding::Ascii, Encoding::Little, Encoding::Big] {
        for n in [1_000_000_000usize, usize::MAX, usize::MAX / 56] {
            let mut bytes = header(encoding, "", &SPLAT, n, "\n");
            bytes.extend([b'1'; 100]);
            let (result, largest) = largest_during(|| read_bytes(&bytes));
            let message = result.unwrap_err().to_string();
            assert!(message.contains(&format!("element vertex: expected {n} rows")), "{message}");
            assert!(largest < 20_000, "{encoding:?}: {largest} bytes taken");
        }
    }
    // The same for an element before the vertices, with and without lists.
    for before in [
        "element a 1000000000\nproperty int b\n",
        "element a 1000000000\nproperty list uchar int b\n",
    ] {
        let mut bytes = header(Encoding::Little, before, &SPLAT, 1, "\n");
        bytes.extend([1; 100]);
        assert_fails(before, &bytes, &["element a"]);
    }
}

#[test]
fn a_header_line_of_10_mb_fails_early() {
    let mut bytes = b"ply\nformat ascii 1.0\ncomment ".to_vec();
    bytes.extend(vec![b'x'; 10 << 20]);
    bytes.extend(b"\nelement vertex 1\n");
    assert_fails("10 MB line", &bytes, &["end_header", "no end within 131072 bytes"]);
}

#[test]
fn broken_headers_and_rows_say_where() {
    let cases: [(&str, &[&str]); 14] = [
        ("ply\nformat binary_middle_endian 1.0\n", &["header line 2", "binary_middle_endian"]),
        ("ply\nformat ascii 2.0\n", &["header line 2: expected format ascii"]),
        ("ply\nelement vertex 1\nend_header\n", &["header line 3", "format"]),
        ("ply\nformat ascii 1.0\nproperty float x\n", &["header line 3: expected an element"]),
        ("ply\nformat ascii 1.0\nelement vertex -1\n", &["line 3: expected element NAME COUNT"]),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\n", &["line 4", "half x"]),
        ("ply\nformat ascii 1.0\nelement f 1\nproperty list float int x\n", &["integer type"]),
        ("ply\nformat ascii 1.0\nelement f 1\nproperty list x\n", &["a type such as float"]),
        ("ply\nformat ascii 1.0\nvertices 3\n", &["header line 3", "vertices 3"]),
        ("ply\nformat ascii 1.0\nelement vertex 3\n", &["found the end of the file"]),
        ("ply\nformat ascii 1.0\nend_header\n", &["expected an element vertex, found none"]),
        (
            "ply\nformat ascii 1.0\nelement chunk 1\nproperty float min_x\nelement vertex 1\nproperty uint packed_position\nend_header\n",
            &["element chunk: expected property min_y, found none of that name"],
        ),
        (
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar float x\nend_header\n1 2\n",
            &["unsupported: a list"],
        ),
        (
            "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n4 five 6\n",
            &["element vertex, row 1: expected a number, found \"five\""],
        ),
    ];
    for (text, parts) in cases {
        assert_fails(text, text.as_bytes(), parts);
    }
}
