//! What files state about their numbers beside them: axes, antialiasing, filters, prefixes. Files for other
//! programs state the same.

use super::glb_file::Glb;
use super::spz::{gzip, legacy, version_4};
use super::{assert_fails, distance, random_splats, read_bytes, set, written, written_as};
use crate::common::shared;
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use std::io::Read;
use vbgs_studio::export::{Fault, Imported, ModelFormat, Note, SpzVersion, WriteOptions, read};
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::appearance::{Appearance, Finishing, SplatSet};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::pick::pick;
use vbgs_studio::render::{Antialias, ExactOptions, Lens, RenderMethod, RenderOptions, Response};

const C1: f64 = 0.488_602_511_902_919_9;
/// Numbers and names of the systems of axes, as the reference library lists them.
const SYSTEMS: [(u32, &str); 16] = [
    (1, "LDB"),
    (2, "RDB"),
    (3, "LUB"),
    (4, "RUB"),
    (5, "LDF"),
    (6, "RDF"),
    (7, "LUF"),
    (8, "RUF"),
    (9, "LFD"),
    (10, "RFD"),
    (11, "LFU"),
    (12, "RFU"),
    (13, "LBD"),
    (14, "RBD"),
    (15, "LBU"),
    (16, "RBU"),
];

/// A vector of right, up, back axes in the axes of a system.
fn in_system(name: &str, v: DVec3) -> DVec3 {
    let component = |letter: char| match letter {
        'R' => v.x,
        'L' => -v.x,
        'U' => v.y,
        'D' => -v.y,
        'B' => v.z,
        'F' => -v.z,
        _ => panic!("{letter}"),
    };
    let mut letters = name.chars().map(component);
    DVec3::from_array(std::array::from_fn(|_| letters.next().unwrap()))
}

fn fixed(v: f64) -> [u8; 3] {
    let [a, b, c, _] = ((v * 4096.0).round() as i32).to_le_bytes();
    [a, b, c]
}

/// Quaternion in 32 bits: two bits for the component left out, then sign and 9 bits of each of the others.
fn smallest_three(q: DQuat) -> [u8; 4] {
    let q = q.to_array();
    let largest = (0..4).max_by(|&a, &b| q[a].abs().total_cmp(&q[b].abs())).unwrap();
    let mut word = largest as u32;
    for i in (0..4).filter(|&i| i != largest) {
        let value = q[i] * q[largest].signum();
        let magnitude = (value.abs() * 2f64.sqrt() * 511.0).round() as u32;
        word = word << 10 | u32::from(value < 0.0) << 9 | magnitude;
    }
    word.to_le_bytes()
}

/// Splat in right, up, back axes: position, rotation, and the change of red with the direction.
struct Original {
    mean: DVec3,
    rotation: DQuat,
    slope: DVec3,
}

fn originals() -> Vec<Original> {
    let mut rng = Rng::new(91, Purpose::Synthetic, 0);
    let mut vector = |step: f64| {
        let mut number = || (rng.range(-60.0, 60.0)).round() * step;
        DVec3::new(number(), number(), number())
    };
    (0..20)
        .map(|_| {
            let turn = vector(0.05);
            Original {
                mean: vector(1.0 / 64.0),
                rotation: DQuat::from_scaled_axis(turn),
                slope: vector(C1 / 128.0),
            }
        })
        .collect()
}

/// Columns of a file whose axes are those of the system.
fn columns(system: &str, degree: usize) -> Vec<Vec<u8>> {
    let mut columns = vec![Vec::new(); if degree == 0 { 5 } else { 6 }];
    for original in originals() {
        let mean = in_system(system, original.mean);
        columns[0].extend(mean.to_array().iter().flat_map(|v| fixed(*v)));
        columns[1].push(200);
        columns[2].extend([100, 128, 150]);
        columns[3].extend([100, 120, 140]);
        let axis = |v: DVec3| in_system(system, original.rotation * v);
        let axes = DMat3::from_cols(axis(DVec3::X), axis(DVec3::Y), axis(DVec3::Z));
        // In a mirrored system the axes of an ellipsoid are left-handed; either sign of one is the same axis.
        let first = axes.x_axis * axes.determinant();
        let axes = DMat3::from_cols(first, axes.y_axis, axes.z_axis);
        columns[4].extend(smallest_three(DQuat::from_mat3(&axes).normalize()));
        if degree > 0 {
            // Real harmonics of degree 1 are −y, z and −x, times a constant.
            let slope = in_system(system, original.slope) / C1;
            for value in [-slope.y, slope.z, -slope.x] {
                columns[5].extend([(128.0 + 128.0 * value).round() as u8, 128, 128]);
            }
            let n_above = (degree + 1).pow(2) - 4;
            columns[5].extend((0..3 * n_above).map(|i| (7 * i) as u8));
        }
    }
    columns
}

fn record(kind: u32, content: &[u8]) -> Vec<u8> {
    [&kind.to_le_bytes()[..], &(content.len() as u32).to_le_bytes(), content].concat()
}

fn axes_record(number: u32) -> Vec<u8> {
    record(0xADBE_0003, &number.to_le_bytes())
}

/// File of version 4 with extension records before its table.
fn with_records(degree: u8, columns: &[Vec<u8>], records: &[u8]) -> Vec<u8> {
    let plain = version_4(columns[1].len() as u32, degree, columns);
    let mut bytes = [&plain[..32], records, &plain[32..]].concat();
    bytes[14] |= 2;
    bytes[16..20].copy_from_slice(&(32 + records.len() as u32).to_le_bytes());
    bytes
}

fn covariance(splat: &Splat) -> DMat3 {
    let [w, x, y, z] = splat.rotation.map(f64::from);
    let half = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w))
        * DMat3::from_diagonal(DVec3::from_array(splat.scale.map(f64::from)));
    half * half.transpose()
}

fn directional(model: &Imported, i: usize) -> [[f32; 3]; 3] {
    model.splats.appearance_of(i).directional
}

#[test]
fn every_system_of_axes_is_read_as_the_same_scene() {
    for degree in 0..=3u8 {
        let plain = version_4(20, degree, &columns("RUB", degree.into()));
        let expected = read_bytes(&plain).unwrap();
        // Right, up, back becomes x, −z, y.
        for (splat, original) in expected.splats.iter().zip(originals()) {
            let DVec3 { x, y, z } = original.mean;
            assert!(distance(splat.mean, [x as f32, -z as f32, y as f32]) < 1e-6);
        }
        for (number, system) in SYSTEMS {
            let file = with_records(degree, &columns(system, degree.into()), &axes_record(number));
            let found = read_bytes(&file).unwrap();
            assert_eq!(found.notes, expected.notes, "{system}");
            assert_eq!(found.splats.len(), 20);
            for (i, (a, b)) in found.splats.iter().zip(expected.splats.iter()).enumerate() {
                assert_eq!(a.mean, b.mean, "{system} {i}");
                let difference = covariance(a) - covariance(b);
                let size = covariance(b).x_axis.length().max(1e-3);
                let share =
                    difference.to_cols_array().into_iter().fold(0.0f64, |m, v| m.max(v.abs()));
                assert!(share < 0.02 * size.max(0.02), "{system} {i}: {difference:?}");
                let slopes = (directional(&found, i), directional(&expected, i));
                assert!(distance(slopes.0[0], slopes.1[0]) < 1e-6, "{system} {i}: {slopes:?}");
            }
            if degree > 0 {
                let slope = originals()[3].slope;
                let [x, y, z] = directional(&found, 3)[0].map(f64::from);
                assert!((DVec3::new(x, z, -y) - slope).length() < 1e-6, "{system}");
            }
        }
    }
}

#[test]
fn files_of_any_axes_stand_where_the_same_file_without_a_record_stands() {
    let Some(folder) = shared("cases/37-spz-coordinate-system") else { return };
    let plain = read(&folder.join("v4.spz")).unwrap();
    for name in ["rub", "rdf", "luf", "ruf", "rfu"] {
        let model = read(&folder.join(format!("v4_cs_{name}.spz"))).unwrap();
        assert_eq!(
            (model.splats.len(), &model.notes),
            (plain.splats.len(), &plain.notes),
            "{name}"
        );
        for (a, b) in model.splats.iter().zip(plain.splats.iter()) {
            assert!(distance(a.mean, b.mean) < 1e-3, "{name}: {:?} {:?}", a.mean, b.mean);
            let difference = (covariance(a) - covariance(b)).to_cols_array();
            assert!(difference.iter().all(|v| v.abs() < 1e-5), "{name}: {a:?} {b:?}");
        }
        let highest = model.splats.iter().map(|s| s.mean[2]).fold(f32::MIN, f32::max);
        assert!((highest - 0.704).abs() < 0.005, "{name}: {highest}");
    }
}

fn notes(bytes: &[u8]) -> Vec<String> {
    read_bytes(bytes).unwrap().notes.iter().map(Note::to_string).collect()
}

#[test]
fn records_that_are_not_used_are_named_and_damaged_ones_refused() {
    let columns = columns("LUF", 0);
    let file = |records: &[Vec<u8>]| with_records(0, &columns, &records.concat());
    let mirrored = read_bytes(&file(&[axes_record(4)])).unwrap();
    let right = read_bytes(&file(&[axes_record(7)])).unwrap();
    assert_ne!(mirrored.splats[0].mean, right.splats[0].mean);
    // Records of others, before and after.
    let camera = record(0xADBE_0002, &[0; 12]);
    let foreign = record(0x1234_0001, &[9; 5]);
    let found = file(&[camera.clone(), axes_record(7), foreign.clone()]);
    assert_eq!(read_bytes(&found).unwrap().splats, right.splats);
    let named = "not used: extension record 0xadbe0002 (12 bytes), 0x12340001 (5 bytes)";
    assert_eq!(notes(&found), [named]);
    // The last of two applies.
    let twice = file(&[axes_record(4), axes_record(7)]);
    assert_eq!(read_bytes(&twice).unwrap().splats, right.splats);
    assert_eq!(notes(&twice), ["not used: extension record 0xadbe0003 (4 bytes)"]);
    for number in [0, 17, u32::MAX] {
        let unknown = file(&[axes_record(number)]);
        assert_eq!(read_bytes(&unknown).unwrap().splats, mirrored.splats);
        let said = format!("axis system {number} is not supported: right, up, back is used");
        assert_eq!(notes(&unknown), [said]);
    }
    let short = file(&[record(0xADBE_0003, &[7, 0, 0])]);
    assert_eq!(notes(&short), ["not used: extension record 0xadbe0003 (3 bytes)"]);
    // Zeros fill the space to the table.
    assert_eq!(read_bytes(&file(&[axes_record(7), vec![0; 20]])).unwrap().splats, right.splats);
    let longer = [&foreign[..4], &[6, 0, 0, 0], &foreign[8..]].concat();
    let endless = [&foreign[..4], &[0xFF; 4], &foreign[8..]].concat();
    for damaged in [longer, endless, vec![1, 2, 3]] {
        assert_fails("records", &file(&[damaged]), &["SPZ extensions: expected records inside"]);
    }
    let mut flagged = version_4(20, 0, &columns);
    flagged[14] = 0xF0;
    assert_eq!(notes(&flagged), ["not used: flags 0xf0"]);
}

/// Files in one gzip have their records at the end.
#[test]
fn records_of_older_versions_are_read() {
    let columns = columns("LUF", 1);
    let mut bytes = legacy(3, 20, 1);
    bytes.truncate(16);
    bytes[14] = 2;
    bytes.extend(columns.concat());
    let file = |records: Vec<u8>| gzip(&[bytes.clone(), records].concat());
    let expected = with_records(1, &columns, &axes_record(7));
    let found = read_bytes(&file(axes_record(7))).unwrap();
    assert_eq!(found.splats, read_bytes(&expected).unwrap().splats);
    for records in [vec![], axes_record(7)[..11].to_vec(), vec![5; 30]] {
        assert_fails("records", &file(records), &["unsupported: extensions in SPZ version 3"]);
    }
    // A bomb behind the records is not unpacked.
    assert_fails("bomb", &file(vec![0; 64 << 20]), &["an end after the last column, found more"]);
}

const PROPERTIES: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
    "rot_0", "rot_1", "rot_2", "rot_3",
];
const ROW: [f64; 14] = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.5, -3.0, -2.0, -4.0, 1.0, 0.1, 0.0, 0.0];

/// ASCII PLY of one splat, with header lines, and property names changed by `name`.
fn ply(lines: &str, name: impl Fn(&str) -> String, more: &[(&str, f64)]) -> Vec<u8> {
    let mut text = format!("ply\nformat ascii 1.0\n{lines}element vertex 1\n");
    let more_names = more.iter().map(|(name, _)| (*name).to_owned());
    for name in PROPERTIES.iter().map(|p| name(p)).chain(more_names) {
        text += &format!("property float {name}\n");
    }
    text += "end_header\n";
    for value in ROW.iter().chain(more.iter().map(|(_, value)| value)) {
        text += &format!("{value} ");
    }
    text.into_bytes()
}

fn commented(comments: &[&str]) -> Vec<u8> {
    let lines: String = comments.iter().map(|line| format!("comment {line}\n")).collect();
    ply(&lines, str::to_owned, &[])
}

fn is_antialiased(model: &Imported) -> bool {
    model.splats.finishing().is_antialiased
}

#[test]
fn comments_about_antialiasing_are_read() {
    for (comments, expected) in [
        (&["SplatRenderMode: mip"][..], true),
        (&["Exported from Brush", "SH degree: 3", "  SPLATRENDERMODE:  MIP  "], true),
        (&["antialiased 1"], true),
        (&["antialiased 0"], false),
        (&["SplatRenderMode: default"], false),
        (&["SplatRenderMode: 2dgs"], false),
        (&["antialiased 1", "SplatRenderMode: default"], false),
        (&["SplatRenderMode: default", "antialiased 1"], true),
        (&["made by a test"], false),
    ] {
        let model = read_bytes(&commented(comments)).unwrap();
        assert_eq!(is_antialiased(&model), expected, "{comments:?}");
        let noted = if expected { vec![Note::Antialiased] } else { vec![] };
        assert_eq!(model.notes, noted, "{comments:?}");
    }
    for comments in [["SplatRenderMode: banana"], ["antialiased models look finer"]] {
        let model = read_bytes(&commented(&comments)).unwrap();
        assert!(!is_antialiased(&model));
        assert_eq!(model.notes[0].to_string(), format!("not used: comment {}", comments[0]));
    }
    let mut spz = version_4(20, 0, &columns("RUB", 0));
    spz[14] = 1;
    let model = read_bytes(&spz).unwrap();
    assert_eq!((is_antialiased(&model), model.notes), (true, vec![Note::Antialiased]));
}

#[test]
fn antialiasing_survives_every_format() {
    let finishing = Finishing { is_antialiased: true, ..Finishing::default() };
    let model = SplatSet::from(random_splats(5, 92)).finished(finishing);
    for format in [ModelFormat::Ply, ModelFormat::Glb, ModelFormat::Spz, ModelFormat::Sog] {
        let file = written_as(format, &model);
        let back = read_bytes(&file).unwrap();
        assert!(is_antialiased(&back), "{format}");
        assert!(back.notes.contains(&Note::Antialiased), "{format}");
        let again = read_bytes(&written_as(format, &back.splats)).unwrap();
        assert!(is_antialiased(&again), "{format}");
    }
    let header = String::from_utf8_lossy(&written_as(ModelFormat::Ply, &model)).into_owned();
    assert!(header.contains("\ncomment SplatRenderMode: mip\ncomment antialiased 1\n"));
    let points = read_bytes(&written_as(ModelFormat::PointCloudPly, &model)).unwrap();
    assert_eq!((is_antialiased(&points), points.notes), (false, vec![]));
    let plain = written_as(ModelFormat::Ply, &model.to_vec()[..]);
    assert!(!String::from_utf8_lossy(&plain).contains("SplatRenderMode"));
}

/// Area of the splat's projection without the low-pass of 0.3 px², as a fraction of the area with it.
fn area_share(splat: &Splat, camera: &Camera) -> f64 {
    let mean = DVec3::from_array(splat.mean.map(f64::from));
    let pose = camera.pose.rotation().transpose();
    let (m, k) = (pose * (mean - camera.pose.centre()), camera.intrinsics);
    let s = pose * covariance(splat) * pose.transpose();
    let u = DVec3::new(k.fx / m.z, 0.0, -k.fx * m.x / (m.z * m.z));
    let v = DVec3::new(0.0, k.fy / m.z, -k.fy * m.y / (m.z * m.z));
    let [uu, uv, vv] = [u.dot(s * u), u.dot(s * v), v.dot(s * v)];
    let projected = DMat2::from_cols(DVec2::new(uu, uv), DVec2::new(uv, vv));
    let widened = projected + DMat2::from_diagonal(DVec2::splat(0.3));
    (projected.determinant() / widened.determinant()).sqrt()
}

#[test]
fn opacities_are_lowered_by_the_area_that_antialiasing_adds() {
    let intrinsics =
        Intrinsics { fx: 300.0, fy: 280.0, cx: 60.5, cy: 40.5, width: 121, height: 81 };
    let camera = Camera { intrinsics, pose: Pose::IDENTITY };
    let exact = |antialias| {
        let (response, lens) = (Response::Ray, Lens::Pinhole);
        RenderMethod::Exact(ExactOptions { response, antialias, lens })
    };
    let turned = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 1.1);
    let [x, y, z, w] = turned.to_array().map(|v| v as f32);
    // On the axis, and off it.
    for (mean, scale) in [
        ([0.0, 0.0, 4.0], [0.003; 3]),
        ([0.0, 0.0, 4.0], [0.02, 0.006, 0.001]),
        ([0.4, -0.2, 3.0], [0.006, 0.003, 0.004]),
        ([0.4, -0.2, 3.0], [0.2, 0.1, 0.1]),
    ] {
        let color = [1.0; 3];
        let splat = Splat { mean, scale, color, opacity: 0.95, rotation: [w, x, y, z] };
        let finishing = Finishing { is_antialiased: true, ..Finishing::default() };
        let model = SplatSet::from(vec![splat]).finished(finishing);
        let expected = area_share(&splat, &camera);
        assert!(mean[0] > 0.0 || expected < 0.6, "{expected}");
        let peak = |method, model: &SplatSet| {
            let options = RenderOptions::evaluation(method, [0.0; 3]);
            let image = CpuRenderer::new().render(model, &camera, &options);
            let all = image.coverage.data.iter().copied();
            let most = all.fold(0.0f32, f32::max);
            // A click reports the weight that is drawn.
            let at = (0..image.coverage.data.len()).find(|&i| image.coverage.data[i] == most);
            let at =
                at.map(|i| DVec2::new((i % 121) as f64 + 0.5, (i / 121) as f64 + 0.5)).unwrap();
            let weight = pick(model, &camera, at, &options).map_or(0.0, |found| found.weight);
            assert!((weight - f64::from(most)).abs() < 1e-4, "{weight} {most}");
            f64::from(most)
        };
        let plain = SplatSet::from(vec![splat]);
        for method in [RenderMethod::PROJECTED, RenderMethod::EXACT] {
            let share = peak(method, &model) / peak(method, &plain);
            // The exact renderer's footprint is that of its line of sight.
            let slack = if method == RenderMethod::PROJECTED { 1e-4 } else { 0.03 };
            assert!((share / expected - 1.0).abs() < slack, "{method:?}: {share} {expected}");
        }
        // Where nothing is added, or opacities are lowered anyway, nothing changes.
        for method in [exact(Antialias::None), exact(Antialias::Reference)] {
            let options = RenderOptions::evaluation(method, [0.0; 3]);
            let [a, b] =
                [&model, &plain].map(|m| CpuRenderer::new().render(m, &camera, &options).color);
            assert_eq!(a.data, b.data, "{method:?}");
        }
    }
}

#[test]
fn a_splat_trained_with_antialiasing_is_as_faint_as_its_file_asks() {
    let Some(folder) = shared("cases/39-splats-trained-with-antialiasing") else { return };
    for (name, expected) in [("aa_mip.ply", 9.0), ("aa_flag.spz", 9.0), ("aa_plain.ply", 242.0)] {
        let model = read(&folder.join(name)).unwrap();
        let mean = DVec3::from_array(model.splats[0].mean.map(f64::from));
        // 0.108 px wide, as from the camera of the case's path.
        let f = 0.108 * 2.0 / f64::from(model.splats[0].scale[0]);
        let intrinsics = Intrinsics { fx: f, fy: f, cx: 100.5, cy: 100.5, width: 201, height: 201 };
        let pose = Pose::look_at(mean - 2.0 * DVec3::Z, mean, DVec3::Y).unwrap();
        let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let image =
            CpuRenderer::new().render(&model.splats, &Camera { intrinsics, pose }, &options);
        let middle = 255.0 * image.color.at(100, 100)[0];
        assert!((middle - expected).abs() < 1.2, "{name}: {middle}");
    }
}

#[test]
fn the_filter_of_mip_splatting_is_applied() {
    let plain = read_bytes(&ply("", str::to_owned, &[])).unwrap().splats[0];
    for filter in [0.0, 0.03, 0.5] {
        let model = read_bytes(&ply("", str::to_owned, &[("filter_3D", filter)])).unwrap();
        let splat = model.splats[0];
        let own = plain.scale.map(|s| f64::from(s).powi(2));
        let wide = own.map(|s| s + filter * filter);
        let scale = wide.map(|s| s.sqrt() as f32);
        assert!(distance(splat.scale, scale) < 1e-6, "{:?} {scale:?}", splat.scale);
        let determinants = own.iter().product::<f64>() / wide.iter().product::<f64>();
        let opacity = f64::from(plain.opacity) * determinants.sqrt();
        assert!((f64::from(splat.opacity) - opacity).abs() < 1e-7, "{} {opacity}", splat.opacity);
        assert_eq!(model.notes, [Note::FilterApplied]);
    }
    let broken = ply("", str::to_owned, &[("filter_3D", f64::NAN)]);
    assert_fails("NaN", &broken, &["1 skipped"]);
}

#[test]
fn prefixes_of_cloudcompare_are_removed() {
    let rest = (0..9).map(|i| (format!("f_rest_{i}"), 0.01 * f64::from(i))).collect::<Vec<_>>();
    let more = |prefix: &str| rest.iter().map(|(n, v)| (format!("{prefix}{n}"), *v)).collect();
    let file = |prefix: &str| {
        let more: Vec<(String, f64)> = more(prefix);
        let more: Vec<(&str, f64)> = more.iter().map(|(n, v)| (n.as_str(), *v)).collect();
        let prefixed = |name: &str| match name {
            "x" | "y" | "z" => name.to_owned(),
            _ => format!("{prefix}{name}"),
        };
        read_bytes(&ply("", prefixed, &more)).unwrap()
    };
    let expected = file("");
    assert!(expected.splats.view().appearance()[0].directional[2][0] != 0.0);
    for prefix in ["scal_", "scalar_", "scalar_scal_"] {
        let Imported { splats, notes, .. } = file(prefix);
        assert_eq!((splats, notes), (expected.splats.clone(), vec![]), "{prefix}");
    }
    // A property without the prefix has precedence.
    let both = read_bytes(&ply("", str::to_owned, &[("scalar_opacity", 9.0)])).unwrap();
    assert_eq!(both.splats[0].opacity, expected.splats[0].opacity);
    assert_eq!(both.notes[0].to_string(), "not used: property scalar_opacity");
}

#[test]
fn content_that_is_not_used_is_named() {
    let lines = "comment made by a test\ncomment Units: feet\ncomment Y is up\n\
                 element color_space 1\nproperty uchar color_space\nelement nothing 0\n";
    let mut bytes = ply(lines, str::to_owned, &[("nx", 0.0), ("label", 3.0), ("time", 0.5)]);
    let body = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    bytes.splice(body..body, *b"1\n");
    assert_eq!(
        notes(&bytes),
        [
            "not used: element color_space",
            "not used: property label, time",
            "not used: comment Units: feet, Y is up"
        ]
    );
    let many: String = (0..500).map(|i| format!("comment unit {i}\x1b[2J\n")).collect();
    let [note] = &notes(&ply(&many, str::to_owned, &[]))[..] else { panic!() };
    assert!(note.len() < 300 && !note.contains('\x1b'), "{note}");
    // What this program writes has a meaning.
    let splats = random_splats(3, 93);
    let comments = ["vbgs made by a scale test".to_owned()];
    let options = |format| WriteOptions { comments: &comments, ..WriteOptions::new(format) };
    for format in [ModelFormat::Ply, ModelFormat::PointCloudPly, ModelFormat::Glb] {
        let confidence = Some(&[1.0, 2.0, 3.0][..]);
        let options = WriteOptions { confidence, ..options(format) };
        assert_eq!(read_bytes(&written(&splats, &options)).unwrap().notes, [], "{format}");
    }
}

#[test]
fn up_is_read_as_the_programs_that_state_it_mean_it() {
    for (comments, up, noted) in [
        (&["Vertical axis: 0 0 1"][..], Some(DVec3::Z), false),
        (&["vertical AXIS: [0, -2, 0]"], Some(DVec3::NEG_Y), false),
        (&["Vertical Axis: z"], Some(DVec3::Z), true),
        (&["Vertical axis: -y"], Some(DVec3::NEG_Y), true),
        (&["Vertical axis: x", "Exported from Brush"], Some(DVec3::X), true),
        // Brush reads its own letters as the opposite directions.
        (&["Exported from Brush", "Vertical axis: y"], Some(DVec3::NEG_Y), true),
        (&["Exported from Brush", "Vertical axis: 0 1 0"], Some(DVec3::Y), false),
        (&["Vertical axis: 1 0 0", "Vertical axis: 0 1 0"], Some(DVec3::Y), false),
        (&["Vertical axis: sideways"], None, true),
        (&["Vertical axis: 0 0 0"], None, true),
        (&["Vertical axis: NaN 0 1"], None, true),
        (&["Vertical axis:"], None, true),
    ] {
        let model = read_bytes(&commented(comments)).unwrap();
        assert_eq!(model.up(), up, "{comments:?}");
        assert_eq!(model.notes.len(), usize::from(noted), "{comments:?} {:?}", model.notes);
    }
    let note = &notes(&commented(&["Exported from Brush", "Vertical axis: y"]))[0];
    assert_eq!(note, "\"Vertical axis: y\" is read as up = [0, -1, 0]");
}

#[test]
fn values_of_a_gltf_that_are_not_supported_are_named() {
    let splats = random_splats(2, 94);
    let mut glb = Glb::parse(&written_as(ModelFormat::Glb, &splats));
    let expected = read_bytes(&glb.to_bytes()).unwrap();
    assert_eq!(expected.notes, []);
    let splatting = "/meshes/0/primitives/0/extensions/KHR_gaussian_splatting";
    for (key, value, said) in [
        ("kernel", "cone", "kernel \"cone\" is not supported: an ellipse is used"),
        ("colorSpace", "p3", "color space \"p3\" is not supported: sRGB is used"),
        ("projection", "orthographic", "\"orthographic\" is not supported: perspective is used"),
        ("sortingMethod", "zDepth", "\"zDepth\" is not supported: the renderer's order is used"),
    ] {
        let object = glb.json.pointer_mut(splatting).unwrap();
        let before = object[key].take();
        object[key] = value.into();
        let model = read_bytes(&glb.to_bytes()).unwrap();
        assert_eq!((model.splats, model.notes.len()), (expected.splats.clone(), 1), "{key}");
        assert!(model.notes[0].to_string().contains(said), "{:?}", model.notes);
        glb.json.pointer_mut(splatting).unwrap()[key] = before;
    }
    glb.json.pointer_mut(splatting).unwrap()["extensions"] = serde_json::json!({"EXT_glow": {}});
    assert_eq!(notes(&glb.to_bytes()), ["not used: extension EXT_glow"]);
}

fn exported(splats: &SplatSet, spz_version: SpzVersion) -> Vec<u8> {
    written(splats, &WriteOptions { spz_version, ..WriteOptions::new(ModelFormat::Spz) })
}

/// Degrees between two rotations.
fn angle(a: [f32; 4], b: [f32; 4]) -> f64 {
    let dot: f64 = a.iter().zip(b).map(|(x, y)| f64::from(*x) * f64::from(y)).sum();
    2.0 * dot.abs().min(1.0).acos().to_degrees()
}

#[test]
fn every_version_of_spz_is_written_as_documented() {
    let splats: Vec<Splat> = random_splats(600, 95)
        .into_iter()
        .map(|s| Splat { scale: s.scale.map(|v| v.clamp(1e-4, 100.0)), ..s })
        .collect();
    let slope =
        [[0.25, -0.125, 0.0625], [0.0; 3], [0.5, 0.0, 0.0]].map(|r| r.map(|v| v * C1 as f32));
    let appearance = vec![Appearance { directional: slope, ..Appearance::default() }; 600];
    let model = set(&splats, &appearance);
    assert_eq!(WriteOptions::new(ModelFormat::Spz).spz_version, SpzVersion::V3);
    for (version, number, n_rotation, degrees) in
        [(SpzVersion::V2, 2u8, 3, 7.0), (SpzVersion::V3, 3, 4, 0.3), (SpzVersion::V4, 4, 4, 0.3)]
    {
        let file = exported(&model, version);
        let start = if number < 4 {
            assert_eq!(file[..3], [0x1F, 0x8B, 8]);
            let mut plain = Vec::new();
            flate2::read::GzDecoder::new(&file[..]).read_to_end(&mut plain).unwrap();
            assert_eq!(plain.len(), 16 + 600 * (9 + 1 + 3 + 3 + n_rotation + 9));
            assert_eq!(plain[15], 0);
            plain
        } else {
            assert_eq!(file[15], 6);
            file.clone()
        };
        assert_eq!(start[..12], [b'N', b'G', b'S', b'P', number, 0, 0, 0, 0x58, 2, 0, 0]);
        assert_eq!((start[12], start[14]), (1, 0));
        assert_eq!(file, exported(&model, version), "the same bytes each time");
        let back = read_bytes(&file).unwrap();
        assert_eq!((back.splats.len(), back.notes.len()), (600, 0));
        let step = 0.5f32.powi(i32::from(start[13]));
        let by_x = |splats: &[Splat]| {
            let mut order: Vec<usize> = (0..splats.len()).collect();
            order.sort_by(|&a, &b| splats[a].mean[0].total_cmp(&splats[b].mean[0]));
            order
        };
        for (i, j) in by_x(&splats).into_iter().zip(by_x(&back.splats)) {
            let (a, b) = (&splats[i], &back.splats[j]);
            assert!(distance(a.mean, b.mean) <= 0.5 * step + 1e-5, "{a:?} {b:?}");
            assert!(distance(a.scale.map(f32::ln), b.scale.map(f32::ln)) <= 0.5 / 16.0 + 1e-4);
            assert!((a.opacity - b.opacity).abs() <= 0.5 / 255.0 + 1e-6);
            assert!(distance(a.color, b.color) <= 0.5 / 255.0 * 0.2821 / 0.15 + 1e-6);
            let apart = angle(a.rotation, b.rotation);
            assert!(apart <= degrees, "{version}: {apart} degrees: {a:?} {b:?}");
            let found = directional(&back, j);
            for (found, expected) in found.iter().zip(slope) {
                assert!(distance(*found, expected) <= 0.5 / 16.0 * 0.49 + 1e-5, "{found:?}");
            }
        }
    }
}

/// Three bytes leave the largest error where `w` is near 0, because it follows from the others.
#[test]
fn rotations_of_version_2_err_by_at_most_7_degrees() {
    let mut rng = Rng::new(96, Purpose::Synthetic, 0);
    let splats: Vec<Splat> = random_splats(20_000, 97)
        .into_iter()
        .map(|splat| {
            let mut q = [0.0; 4].map(|_: f64| rng.normal());
            q[0] *= 0.03;
            let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
            Splat { rotation: q.map(|v| (v / length) as f32), ..splat }
        })
        .collect();
    // One file each, because a file has an order of its own.
    let worst = |splats: &[Splat]| {
        let back = read_bytes(&exported(&splats.to_vec().into(), SpzVersion::V2)).unwrap();
        let nearest = |a: &Splat| {
            let near = |b: &&Splat| distance(a.mean, b.mean) < 1e-3;
            back.splats.iter().find(near).map_or(180.0, |b| angle(a.rotation, b.rotation))
        };
        splats.iter().map(nearest).fold(0.0, f64::max)
    };
    let worst = splats.chunks(250).map(worst).fold(0.0, f64::max);
    assert!((2.0..7.0).contains(&worst), "{worst}");
}

#[test]
fn a_model_is_written_for_readers_of_any_version() {
    let Some(path) = shared("cases/38-spz-out-for-older-readers/ref.ply") else { return };
    let model = read(&path).unwrap();
    let sizes = [SpzVersion::V2, SpzVersion::V3, SpzVersion::V4].map(|version| {
        let file = exported(&model.splats, version);
        let back = read_bytes(&file).unwrap();
        assert_eq!(back.splats.len(), model.splats.len());
        let bounds = |splats: &[Splat], axis: usize| {
            let values = || splats.iter().map(move |s| s.mean[axis]);
            (values().fold(f32::MAX, f32::min), values().fold(f32::MIN, f32::max))
        };
        for axis in 0..3 {
            let (a, b) = (bounds(&model.splats, axis), bounds(&back.splats, axis));
            assert!((a.0 - b.0).abs() < 1e-3 && (a.1 - b.1).abs() < 1e-3, "{a:?} {b:?}");
        }
        file.len()
    });
    assert!(sizes.iter().all(|size| *size < 27_613 / 8), "{sizes:?}");
    // A fault names the setting that a version lacks room for.
    let far = SplatSet::from(vec![Splat { mean: [1e8, 0.0, 0.0], ..model.splats[0] }]);
    let options =
        WriteOptions { spz_version: SpzVersion::V2, ..WriteOptions::new(ModelFormat::Spz) };
    let refused = vbgs_studio::export::read_back(&far, &options).unwrap_err();
    assert!(matches!(refused, Fault::Setting { .. }), "{refused}");
}
