//! glTF files of other programs, valid and invalid.

use super::allocations::largest_during;
use super::glb_file::Glb;
use super::round_trip::assert_same;
use super::{assert_fails, distance, random_splats, read_bytes, written_as};
use glam::{DMat3, DMat4, DQuat, DVec3};
use serde_json::{Value, json};
use vbgs_studio::export::{ModelFormat, ModelKind, Note, read};
use vbgs_studio::model::splat::splats::Splat;

const ROTATION: &str = "KHR_gaussian_splatting:ROTATION";
const SCALE: &str = "KHR_gaussian_splatting:SCALE";
const OPACITY: &str = "KHR_gaussian_splatting:OPACITY";
const SH_0: &str = "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0";

fn sample(n: usize) -> (Vec<Splat>, Glb) {
    let splats = random_splats(n, 31);
    let glb = Glb::parse(&written_as(ModelFormat::Glb, &splats));
    (splats, glb)
}

fn changed(change: impl FnOnce(&mut Glb)) -> Vec<u8> {
    let (_, mut glb) = sample(3);
    change(&mut glb);
    glb.to_bytes()
}

#[test]
fn wrong_lengths_of_the_container() {
    let good = sample(3).1.to_bytes();
    assert!(read_bytes(&good).is_ok());
    let n_json = u32::from_le_bytes(good[12..16].try_into().unwrap());
    let bin = 20 + n_json as usize;
    let n_bin = (good.len() - bin - 8) as u32;
    let cases = [
        (4, 1, "expected version 2, found version 1"),
        (8, good.len() as u32 + 4, "expected a file of"),
        (8, good.len() as u32 - 4, "expected a file of"),
        (12, u32::MAX, "JSON chunk: expected 4294967295 bytes"),
        (12, n_json + 1, "JSON chunk: expected a multiple of 4"),
        (16, 0, "JSON chunk: expected chunk type"),
        (bin, n_bin + 4, "BIN chunk: expected"),
        (bin, n_bin - 4, "buffer 0: expected 192 bytes, found 188 bytes"),
        (bin + 4, 7, "BIN chunk: expected chunk type"),
    ];
    for (at, value, part) in cases {
        let mut bytes = good.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        assert_fails(&format!("{at} = {value}"), &bytes, &[part]);
    }
    let mut no_bin = good[..bin].to_vec();
    no_bin[8..12].copy_from_slice(&(bin as u32).to_le_bytes());
    assert_fails("no BIN", &no_bin, &["buffer 0: expected a uri or a BIN chunk"]);
}

#[test]
fn broken_and_unsupported_files_say_what_is_wrong() {
    type Change = fn(&mut Glb);
    let cases: [(&str, Change); 32] = [
        ("accessor 0 (POSITION): expected 4 rows inside bufferView 0", |g| {
            g.accessor("POSITION")["count"] = 4.into()
        }),
        ("(POSITION): expected 18446744073709551615 rows", |g| {
            g.accessor("POSITION")["count"] = u64::MAX.into()
        }),
        ("an accessor of that number", |g| g.primitive()["attributes"]["POSITION"] = 99.into()),
        ("a bufferView of that number", |g| g.accessor("POSITION")["bufferView"] = 99.into()),
        ("bufferView 0 inside buffer 0", |g| g.view("POSITION")["byteLength"] = 1_000_000.into()),
        ("bufferView 0 inside buffer 0", |g| g.view("POSITION")["byteOffset"] = u64::MAX.into()),
        ("bufferView 0 inside buffer 9", |g| g.view("POSITION")["buffer"] = 9.into()),
        ("rows inside bufferView 0", |g| g.accessor("POSITION")["byteOffset"] = 4.into()),
        ("a byteStride of 12 or more, found 4", |g| g.view("POSITION")["byteStride"] = 4.into()),
        ("(KHR_gaussian_splatting:OPACITY): expected 3 rows, as many as POSITION, found 2", |g| {
            g.accessor(OPACITY)["count"] = 2.into()
        }),
        ("expected VEC3 of 5126, found VEC3 of 5123", |g| {
            g.accessor("POSITION")["componentType"] = 5123.into()
        }),
        ("expected VEC4 of 5126/normalized 5120/normalized 5122, found VEC4 of 5122", |g| {
            g.accessor(ROTATION)["componentType"] = 5122.into()
        }),
        ("expected SCALAR of", |g| g.accessor(OPACITY)["type"] = "VEC3".into()),
        (
            "accessor 3 (KHR_gaussian_splatting:SCALE), row 1: expected scales of 0 or more, found -0.5",
            |g| {
                let at = g.view(SCALE)["byteOffset"].as_u64().unwrap() as usize + 12;
                g.bin[at..at + 4].copy_from_slice(&(-0.5f32).to_le_bytes());
            },
        ),
        ("unsupported: accessor 0 (POSITION) is sparse", |g| {
            g.accessor("POSITION")["sparse"] = json!({"count": 1})
        }),
        ("unsupported: accessor 0 (POSITION) is compressed (EXT_meshopt_compression)", |g| {
            g.view("POSITION")["extensions"] = json!({"EXT_meshopt_compression": {}})
        }),
        ("is compressed (KHR_gaussian_splatting_compression_spz_2)", |g| {
            g.primitive()["extensions"]["KHR_gaussian_splatting"]["extensions"] =
                json!({"KHR_gaussian_splatting_compression_spz_2": {}});
        }),
        ("is compressed (KHR_draco_mesh_compression)", |g| {
            g.primitive()["extensions"]["KHR_draco_mesh_compression"] = json!({})
        }),
        ("requires the extension KHR_mesh_quantization", |g| {
            g.json["extensionsRequired"] =
                json!(["KHR_gaussian_splatting", "KHR_mesh_quantization"])
        }),
        ("attribute KHR_gaussian_splatting:SH_DEGREE_0_COEF_0, found none", |g| {
            let attributes = g.primitive()["attributes"].as_object_mut().unwrap();
            attributes.retain(|name, _| name != SH_0 && name != "COLOR_0");
        }),
        ("attribute POSITION, found none", |g| {
            g.primitive()["attributes"].as_object_mut().unwrap().remove("POSITION");
        }),
        ("unsupported draft", |g| g.primitive()["attributes"]["_ROTATION"] = 2.into()),
        ("expected mode 0 (POINTS), found mode 4", |g| {
            g.primitive().as_object_mut().unwrap().remove("mode");
        }),
        ("found 1 other primitives", |g| *g.primitive() = json!({"attributes": {"POSITION": 0}})),
        ("asset.version: expected 2.0, found \"1.0\"", |g| {
            g.json["asset"]["version"] = "1.0".into()
        }),
        ("JSON: expected glTF 2.0", |g| g.json["accessors"] = "none".into()),
        ("at most 64 nested levels", |g| {
            g.json["extras"] = (0..70).fold(json!(1), |inner, _| json!([inner]));
        }),
        ("scene 7: expected a scene of that number", |g| g.json["scene"] = 7.into()),
        ("node 5: expected a node of that number", |g| g.json["scenes"][0]["nodes"] = json!([5])),
        ("mesh 9: expected a mesh of that number", |g| g.json["nodes"][0]["mesh"] = 9.into()),
        ("node 0: expected a tree of nodes", |g| g.json["nodes"][0]["children"] = json!([0])),
        ("buffer 0: expected 1000000000 bytes", |g| {
            g.json["buffers"][0]["byteLength"] = 1_000_000_000.into()
        }),
    ];
    for (part, change) in cases {
        assert_fails(part, &changed(change), &[part]);
    }
}

#[test]
fn nodes_that_mirror_or_shear_are_rejected() {
    let node = |value: Value| changed(|g| g.json["nodes"][0] = value);
    let shear = [1.0, 0.0, 0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let mut projective = DMat4::IDENTITY.to_cols_array();
    projective[3] = 0.1;
    let cases = [
        (json!({"mesh": 0, "scale": [1, -1, 1]}), "a negative or zero scale"),
        (json!({"mesh": 0, "scale": [1, 0, 1]}), "a negative or zero scale"),
        (json!({"mesh": 0, "matrix": shear}), "found shear"),
        (json!({"mesh": 0, "matrix": projective}), "not affine"),
        (json!({"mesh": 0, "rotation": [0, 0, 0, 0]}), "not finite"),
    ];
    for (value, part) in cases {
        assert_fails(part, &node(value), &["node 0: expected a rotation", part, "apply the node"]);
    }
    // A rotated child of a non-uniformly scaled parent is sheared as well.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let bytes = changed(|g| {
        g.json["nodes"] = json!([
            {"children": [1], "scale": [1, 2, 1]},
            {"mesh": 0, "rotation": [0, 0, 0.382_683_432, 0.923_879_532]},
        ]);
    });
    assert_fails("sheared child", &bytes, &["node 1", "found shear"]);
    // A quarter turn maps axes onto axes, so there is no shear.
    let bytes = changed(|g| {
        g.json["nodes"] = json!([
            {"children": [1], "scale": [1, 2, 1]}, {"mesh": 0, "rotation": [0, 0, half, half]},
        ]);
    });
    assert_eq!(read_bytes(&bytes).unwrap().splats.len(), 3);
}

/// Rotates a glTF vector to z-up.
fn z_up(p: DVec3) -> DVec3 {
    DVec3::new(p.x, -p.z, p.y)
}

#[test]
fn node_transforms_move_means_and_covariances() {
    let (_, mut glb) = sample(40);
    let raw = glb.splats();
    let turn = DQuat::from_xyzw(0.1, -0.5, 0.3, 0.8).normalize();
    let parent =
        DMat4::from_scale_rotation_translation(DVec3::splat(2.0), turn, DVec3::new(1.0, 2.0, 3.0));
    let child = DMat4::from_scale(DVec3::new(1.0, 3.0, 0.5));
    glb.json["nodes"] = json!([
        {"children": [1, 2], "scale": [2, 2, 2], "rotation": turn.to_array(), "translation": [1, 2, 3]},
        {"mesh": 0, "matrix": child.to_cols_array()},
        {"mesh": 0},
    ]);
    let model = read_bytes(&glb.to_bytes()).unwrap();
    assert_eq!(model.splats.len(), 80);
    let z_up_matrix = DMat3::from_cols(z_up(DVec3::X), z_up(DVec3::Y), z_up(DVec3::Z));
    for (i, splat) in model.splats.iter().enumerate() {
        let matrix = if i < 40 { parent * child } else { parent };
        let original = &raw[i % 40];
        let mean = z_up(matrix.transform_point3(DVec3::from_array(original.mean.map(f64::from))));
        let found = DVec3::from_array(splat.mean.map(f64::from));
        assert!((mean - found).length() < 1e-5 * mean.length(), "{mean} {found}");
        let m = z_up_matrix * DMat3::from_mat4(matrix);
        let expected = m * original.covariance().to_mat3() * m.transpose();
        let difference = expected - splat.covariance().to_mat3();
        let largest = |m: DMat3| m.to_cols_array().iter().fold(0.0f64, |w, v| w.max(v.abs()));
        assert!(largest(difference) < 2e-6 * largest(expected), "{difference}\n{expected}");
    }
}

#[test]
fn several_primitives_and_foreign_ones() {
    let (splats, mut glb) = sample(4);
    let mut triangles = glb.primitive().clone();
    triangles["mode"] = 4.into();
    triangles.as_object_mut().unwrap().remove("extensions");
    let splat = glb.primitive().clone();
    glb.json["meshes"] = json!([{"primitives": [triangles, splat]}, {"primitives": [splat]}]);
    glb.json["nodes"] = json!([{"mesh": 0}, {"mesh": 1}, {"name": "camera", "camera": 0}]);
    glb.json["scenes"][0]["nodes"] = json!([0, 1, 2]);
    let model = read_bytes(&glb.to_bytes()).unwrap();
    assert_eq!(model.notes, [Note::PrimitivesSkipped { n_primitives: 1 }]);
    for (found, original) in model.splats.iter().zip(splats.iter().chain(&splats)) {
        assert_same(found, original, "primitives");
    }
    assert_eq!(model.splats.len(), 8);
    // Without scenes every root node counts.
    glb.json.as_object_mut().unwrap().remove("scenes");
    glb.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(read_bytes(&glb.to_bytes()).unwrap().splats.len(), 8);
}

#[test]
fn small_component_types() {
    let (_, mut glb) = sample(2);
    let i16s = |v: [i16; 8]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let rotation = i16s([0, 0, 0, 32767, 23170, 0, 0, 23170]);
    glb.replace(
        ROTATION,
        &rotation,
        json!({"componentType": 5122, "normalized": true, "count": 2, "type": "VEC4"}),
    );
    glb.replace(
        SCALE,
        &[1, 2, 3, 40, 50, 255],
        json!({"componentType": 5121, "count": 2, "type": "VEC3"}),
    );
    glb.replace(
        OPACITY,
        &[0, 0x80, 0xFF, 0xFF],
        json!({"componentType": 5123, "normalized": true, "count": 2, "type": "SCALAR"}),
    );
    let model = read_bytes(&glb.to_bytes()).unwrap();
    let [a, b] = [model.splats[0], model.splats[1]];
    assert_eq!((a.scale, b.scale), ([1.0, 2.0, 3.0], [40.0, 50.0, 255.0]));
    assert!((a.opacity - 32768.0 / 65535.0).abs() < 1e-7 && b.opacity == 1.0);
    // Rotating to z-up turns the identity into +90° about x, and +90° into 180°.
    let half = std::f32::consts::FRAC_1_SQRT_2;
    assert!(distance(a.rotation, [half, half, 0.0, 0.0]) < 1e-6, "{:?}", a.rotation);
    assert!(distance(b.rotation, [0.0, 1.0, 0.0, 0.0]) < 1e-6, "{:?}", b.rotation);

    glb.replace(
        SCALE,
        &[0, 51, 255, 255, 0, 0],
        json!({"componentType": 5121, "normalized": true, "count": 2, "type": "VEC3"}),
    );
    glb.replace(
        ROTATION,
        &[0, 0, 0, 127, 0, 0x81, 0, 0],
        json!({"componentType": 5120, "normalized": true, "count": 2, "type": "VEC4"}),
    );
    let model = read_bytes(&glb.to_bytes()).unwrap();
    assert!(distance(model.splats[0].scale, [0.0, 0.2, 1.0]) < 1e-7);
    assert!(
        distance(model.splats[1].rotation, [0.0, 0.0, -half, -half]) < 1e-6,
        "{:?}",
        model.splats[1].rotation
    );
}

#[test]
fn interleaved_attributes_by_byte_stride() {
    let (splats, mut glb) = sample(5);
    let (positions, scales) = (glb.floats("POSITION"), glb.floats(SCALE));
    let start = glb.bin.len();
    for (position, scale) in positions.iter().zip(&scales) {
        for value in position.iter().chain(scale) {
            glb.bin.extend(value.to_le_bytes());
        }
    }
    glb.json["buffers"][0]["byteLength"] = glb.bin.len().into();
    let views = glb.json["bufferViews"].as_array_mut().unwrap();
    let index = views.len();
    views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": 24 * 5, "byteStride": 24}));
    glb.accessor("POSITION")["bufferView"] = index.into();
    glb.accessor(SCALE)["bufferView"] = index.into();
    glb.accessor(SCALE)["byteOffset"] = 12.into();
    let model = read_bytes(&glb.to_bytes()).unwrap();
    for (found, original) in model.splats.iter().zip(&splats) {
        assert_eq!(found.mean, original.mean);
        assert_same(found, original, "interleaved");
    }
}

#[test]
fn linear_colours_are_encoded_with_a_note() {
    let (_, mut glb) = sample(1);
    glb.primitive()["extensions"]["KHR_gaussian_splatting"]["colorSpace"] =
        "lin_rec709_display".into();
    let coefficient = |linear: f32| ((linear - 0.5) / 0.282_094_8).to_le_bytes();
    let bytes = [0.214_041_14, 0.001, 1.0].map(coefficient).concat();
    glb.replace(SH_0, &bytes, json!({"componentType": 5126, "count": 1, "type": "VEC3"}));
    let model = read_bytes(&glb.to_bytes()).unwrap();
    assert_eq!(model.notes, [Note::LinearColorEncoded]);
    assert!(distance(model.splats[0].color, [0.5, 0.012_92, 1.0]) < 1e-5, "{:?}", model.splats[0]);
}

#[test]
fn zero_quaternions_and_nan() {
    let (_, mut glb) = sample(3);
    let at = |g: &mut Glb, name: &str| g.view(name)["byteOffset"].as_u64().unwrap() as usize;
    let (rotation, position) = (at(&mut glb, ROTATION), at(&mut glb, "POSITION"));
    glb.bin[rotation..rotation + 16].fill(0);
    glb.bin[position + 12..position + 16].copy_from_slice(&f32::NAN.to_le_bytes());
    let model = read_bytes(&glb.to_bytes()).unwrap();
    assert_eq!((model.splats.len(), model.skipped), (2, 1));
    assert_eq!(model.notes, [Note::ZeroRotation { n_splats: 1 }]);
}

#[test]
fn harmonics_that_cannot_be_read_are_ignored_with_a_note() {
    let ignored = |change: &dyn Fn(&mut Glb), n_coefficients| {
        let model = read_bytes(&changed(change)).unwrap();
        assert!(model.notes.contains(&Note::ViewDependentColorIgnored { n_coefficients }));
        model
    };
    let name = |degree, n| format!("KHR_gaussian_splatting:SH_DEGREE_{degree}_COEF_{n}");
    let add = |g: &mut Glb, degree: u32, n: u32| {
        (0..n).for_each(|n| g.primitive()["attributes"][name(degree, n)] = 5.into());
    };
    // Degree 1 is incomplete.
    let model = ignored(&|g| add(g, 1, 2), 6);
    assert!(model.splats.view().appearance().is_empty());
    // Linear coefficients of degree 1 cannot be converted to sRGB.
    let model = ignored(
        &|g| {
            add(g, 1, 3);
            g.primitive()["extensions"]["KHR_gaussian_splatting"]["colorSpace"] =
                "lin_rec709_display".into();
        },
        9,
    );
    assert!(model.splats.view().appearance().is_empty());
    // Degree 1 is kept, degree 2 not.
    let model = ignored(
        &|g| {
            add(g, 1, 3);
            add(g, 2, 5);
        },
        15,
    );
    assert_eq!(model.splats.view().appearance().len(), 3);
}

#[test]
fn points_without_the_extension_are_a_point_cloud() {
    let (splats, mut glb) = sample(6);
    glb.primitive().as_object_mut().unwrap().remove("extensions");
    let model = read_bytes(&glb.to_bytes()).unwrap();
    assert_eq!((model.kind, model.notes.len()), (ModelKind::PointCloud, 0));
    for (found, original) in model.splats.iter().zip(&splats) {
        assert_eq!(found.mean, original.mean);
        // 16 linear bits are coarsest in sRGB for dark colours: 1/65535 · 12.92.
        assert!(distance(found.color, original.color) < 1e-4);
        assert_eq!(found.opacity, 1.0);
    }
    glb.primitive()["attributes"] = json!({"POSITION": 0});
    assert_eq!(read_bytes(&glb.to_bytes()).unwrap().notes, [Note::NoColor]);
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for group in bytes.chunks(3) {
        let mut padded = [0; 3];
        padded[..group.len()].copy_from_slice(group);
        let bits = u32::from_be_bytes([0, padded[0], padded[1], padded[2]]);
        for i in 0..4 {
            let digit = char::from(DIGITS[(bits >> (18 - 6 * i)) as usize & 63]);
            text.push(if i <= group.len() { digit } else { '=' });
        }
    }
    text
}

#[test]
fn gltf_with_data_uris_and_sibling_files() {
    let (splats, mut glb) = sample(7);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep/scene.txt");
    std::fs::create_dir_all(path.parent().unwrap().join("sub")).unwrap();
    std::fs::write(path.with_file_name("sub/the data.bin"), &glb.bin).unwrap();
    std::fs::write(folder.path().join("outside.bin"), &glb.bin).unwrap();
    #[cfg(unix)]
    {
        let link = path.with_file_name("link.bin");
        std::os::unix::fs::symlink(folder.path().join("outside.bin"), link).unwrap();
    }
    let mut import = |uri: &str| {
        glb.json["buffers"][0]["uri"] = uri.into();
        std::fs::write(&path, format!("\u{feff}\n{}", glb.json)).unwrap();
        read(&path)
    };
    let data = format!("data:application/octet-stream;base64,{}", base64(&sample(7).1.bin));
    for uri in [data.as_str(), "sub/the%20data.bin"] {
        let model = import(uri).unwrap();
        for (found, original) in model.splats.iter().zip(&splats) {
            assert_same(found, original, "gltf");
        }
        assert_eq!(model.splats.len(), 7);
    }
    for uri in [
        "../outside.bin",
        "%2e%2e/outside.bin",
        "/etc/hostname",
        "sub/../../outside.bin",
        "https://example.org/a.bin",
        if cfg!(unix) { "link.bin" } else { "../link.bin" },
    ] {
        let error = import(uri).unwrap_err().to_string();
        assert!(error.contains("scene.txt: buffer 0: expected a file beside the glTF"), "{error}");
    }
    for (uri, part) in [
        ("missing.bin", "missing.bin with at least 448 bytes"),
        ("sub", "no file"),
        ("data:,abc", "base64"),
        ("data:;base64,AAAA", "expected 448 bytes, found 3"),
    ] {
        let error = import(uri).unwrap_err().to_string();
        assert!(error.contains(part), "{uri}: {error}");
    }
}

#[test]
fn false_counts_fail_before_memory_is_taken() {
    let bytes = changed(|g| {
        for accessor in g.json["accessors"].as_array_mut().unwrap() {
            accessor["count"] = 1_000_000_000.into();
        }
    });
    let (result, largest) = largest_during(|| read_bytes(&bytes));
    assert!(result.is_err() && largest < 20_000, "{largest}");
    // The limit applies to nodes times primitives.
    let (_, mut glb) = sample(1);
    let primitive = glb.primitive().clone();
    glb.json["meshes"][0]["primitives"] = vec![primitive; 400].into();
    glb.json["nodes"] = vec![json!({"mesh": 0}); 400].into();
    glb.json["scenes"][0]["nodes"] = (0..400).collect::<Vec<u32>>().into();
    assert_fails("400 times 400", &glb.to_bytes(), &["more than 100000 primitives"]);
    // A mesh used by many nodes counts once per node; the sum of splats is limited too.
    // So many may be in a large file, but not in this one.
    for (n, found) in [(10_001, "at most 20000000 splats, found 20002000"), (4000, "found 8000000")]
    {
        let (_, mut glb) = sample(2000);
        glb.json["nodes"] = vec![json!({"mesh": 0}); n].into();
        glb.json["scenes"][0]["nodes"] = (0..n).collect::<Vec<_>>().into();
        let bytes = glb.to_bytes();
        let (result, largest) = largest_during(|| read_bytes(&bytes));
        let message = result.unwrap_err().to_string();
        assert!(message.contains(found), "{message}");
        assert!(largest < 64 * bytes.len(), "{largest} of {}", bytes.len());
    }
}
