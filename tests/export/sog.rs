//! SOG: written files come back, and are what the format prescribes; files that lie are refused.

use super::{assert_fails, distance, random_splats, read_bytes, set, written, written_as};
use crate::common::scenes::random_appearance;
use glam::{DMat3, DQuat, DVec3};
use image_webp::{ColorType, WebPDecoder, WebPEncoder};
use serde_json::{Value, json};
use std::io::{Cursor, Read, Write};
use vbgs_studio::export::{ModelFormat, Note, WriteOptions};
use vbgs_studio::math::foreign::open_zip;
use vbgs_studio::math::sym3::Sym3;
use vbgs_studio::model::splat::appearance::{Appearance, SplatSet};
use vbgs_studio::model::splat::observed_cone::ObservedCone;
use vbgs_studio::model::splat::splats::Splat;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Members of an archive by their names.
type Members = Vec<(String, Vec<u8>)>;

fn unpacked(bytes: &[u8]) -> Members {
    let mut zip = ZipArchive::new(Cursor::new(bytes)).unwrap();
    let n = zip.len();
    let member = |i| {
        let mut member = zip.by_index(i).unwrap();
        let mut bytes = Vec::new();
        member.read_to_end(&mut bytes).unwrap();
        (member.name().unwrap().to_string(), bytes)
    };
    (0..n).map(member).collect()
}

fn packed(members: &Members) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
    for (name, bytes) in members {
        zip.start_file(name.as_str(), options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn member<'a>(members: &'a mut Members, name: &str) -> &'a mut Vec<u8> {
    &mut members.iter_mut().find(|(found, _)| found == name).unwrap().1
}

fn pixels(bytes: &[u8]) -> (u32, Vec<u8>) {
    let mut decoder = WebPDecoder::new(Cursor::new(bytes)).unwrap();
    let mut pixels = vec![0; decoder.output_buffer_size().unwrap()];
    decoder.read_image(&mut pixels).unwrap();
    (decoder.dimensions().0, pixels)
}

fn webp(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let pixels = vec![255; 3 * width as usize * height as usize];
    WebPEncoder::new(&mut bytes).encode(&pixels, width, height, ColorType::Rgb8).unwrap();
    bytes
}

fn splats(n: usize, seed: u64) -> Vec<Splat> {
    let all = random_splats(n, seed).into_iter();
    all.map(|splat| Splat { scale: splat.scale.map(|s| s.clamp(0.01, 1.0)), ..splat }).collect()
}

/// Pairs each splat with the nearest one of a file, which orders them differently.
fn paired(splats: &[Splat], back: &[Splat]) -> Vec<(Splat, Splat)> {
    let nearest = |a: &Splat| {
        let apart = |b: &&Splat| distance(a.mean, b.mean);
        *back.iter().min_by(|b, c| apart(b).total_cmp(&apart(c))).unwrap()
    };
    splats.iter().map(|a| (*a, nearest(a))).collect()
}

#[test]
fn splats_come_back_as_near_as_their_bytes_allow() {
    let splats = splats(3000, 171);
    let model = read_bytes(&written_as(ModelFormat::Sog, &splats)).unwrap();
    assert_eq!((model.splats.len(), model.skipped, model.up()), (3000, 0, Some(DVec3::Z)));
    for (a, b) in paired(&splats, &model.splats) {
        // A quarter of a small splat of 0.02.
        assert!(distance(a.mean, b.mean) < 0.01, "{a:?} {b:?}");
        assert!(distance(a.scale.map(f32::ln), b.scale.map(f32::ln)) < 0.12, "{a:?} {b:?}");
        assert!((a.opacity - b.opacity).abs() <= 0.5 / 255.0 + 1e-6);
        assert!(distance(a.color, b.color) < 0.02, "{a:?} {b:?}");
        // Half a turn about an axis of the splat may be added, which does not change it.
        let axes = |splat: &Splat| {
            let [w, x, y, z] = splat.rotation.map(f64::from);
            DMat3::from_quat(DQuat::from_xyzw(x, y, z, w))
        };
        for k in 0..3 {
            let turn = axes(&a).col(k).dot(axes(&b).col(k)).abs();
            // Of splats ten times as long as wide, 3° of rotation do not show.
            assert!(turn > 1.0 - 1.4e-3, "{:?} {:?}", a.rotation, b.rotation);
        }
    }
}

#[test]
fn few_splats_and_equal_ones_are_written() {
    let one = splats(1, 172);
    for splats in [one.clone(), vec![one[0]; 5], splats(2, 173)] {
        let back = read_bytes(&written_as(ModelFormat::Sog, &splats)).unwrap().splats;
        assert_eq!(back.len(), splats.len());
        for (a, b) in paired(&splats, &back) {
            assert!(distance(a.mean, b.mean) < 0.01 && distance(a.color, b.color) < 1e-3);
        }
    }
}

#[test]
fn colour_by_direction_follows_a_palette() {
    let splats = splats(640, 174);
    // As many different colours as the palette has entries.
    let some: Vec<Appearance> = random_appearance(&splats[..20], 174);
    let of: Vec<Appearance> = (0..640).map(|i| some[i % 20]).collect();
    let native = set(&splats, &of);
    let plain = read_bytes(&written_as(ModelFormat::Ply, &native)).unwrap().splats;
    let back = read_bytes(&written_as(ModelFormat::Sog, &native)).unwrap();
    assert!(!back.notes.iter().any(|n| matches!(n, Note::ViewDependentColorIgnored { .. })));
    let key = |set: &SplatSet| {
        let mut all: Vec<(f32, [[f32; 3]; 3])> =
            (0..set.len()).map(|i| (set[i].mean[0], set.appearance_of(i).directional)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all
    };
    // A palette of few entries cannot hold all of twenty.
    let (mut errors, mut energy) = (0.0, 0.0);
    for ((_, a), (_, b)) in key(&plain).iter().zip(key(&back.splats)) {
        for (a, b) in a.as_flattened().iter().zip(b.as_flattened()) {
            errors += f64::from((a - b).powi(2));
            energy += f64::from(a.powi(2));
        }
    }
    assert!(errors < 0.6 * energy, "{errors} of {energy}");
}

#[test]
fn colours_of_a_palette_are_exact_from_where_splats_were_seen() {
    let splats = splats(640, 176);
    let mut appearance = random_appearance(&splats, 176);
    let seen = |i: usize| DVec3::new((i as f64).sin(), (i as f64).cos(), 0.7).normalize();
    for (i, appearance) in appearance.iter_mut().enumerate() {
        appearance.observed = ObservedCone::new(seen(i), Sym3::diagonal(0.1));
        appearance.directional = appearance.directional.map(|row| row.map(|v| 0.2 * v));
    }
    let native = set(&splats, &appearance);
    let [plain, back] = [ModelFormat::Ply, ModelFormat::Sog]
        .map(|format| read_bytes(&written_as(format, &native)).unwrap().splats);
    let color = |set: &SplatSet, i: usize, d: DVec3| {
        let slope =
            set.appearance_of(i).directional.map(|row| DVec3::from_array(row.map(f64::from)));
        DVec3::from_array(set[i].color.map(f64::from))
            + DVec3::from_array(slope.map(|row| row.dot(d)))
    };
    let (mut from_there, mut elsewhere) = (0.0_f64, 0.0_f64);
    for i in 0..plain.len() {
        let apart = |j: &usize| distance(plain[i].mean, back[*j].mean);
        let j = (0..back.len()).min_by(|j, k| apart(j).total_cmp(&apart(k))).unwrap();
        let error = |d: DVec3| (color(&plain, i, d) - color(&back, j, d)).abs().max_element();
        from_there = from_there.max(error(seen(i)));
        elsewhere = elsewhere.max(error(-seen(i)));
    }
    // Levels of colours remain.
    assert!(
        from_there < 0.06 && elsewhere > 4.0 * from_there,
        "{from_there}, elsewhere {elsewhere}"
    );
}

#[test]
fn the_archive_is_that_of_version_2() {
    let splats = splats(90, 175);
    let native = set(&splats, &random_appearance(&splats, 175));
    let mut members = unpacked(&written_as(ModelFormat::Sog, &native));
    let meta: Value = serde_json::from_slice(member(&mut members, "meta.json")).unwrap();
    assert_eq!((&meta["version"], &meta["count"]), (&json!(2), &json!(90)));
    assert_eq!(meta["antialias"], json!(false));
    assert_eq!(meta["means"]["files"], json!(["means_l.webp", "means_u.webp"]));
    assert_eq!(meta["shN"]["files"], json!(["shN_centroids.webp", "shN_labels.webp"]));
    for name in ["scales", "sh0", "shN"] {
        assert_eq!(meta[name]["codebook"].as_array().unwrap().len(), 256, "{name}");
    }
    let (width, quats) = pixels(member(&mut members, "quats.webp"));
    assert_eq!((width, quats.len()), (10, 4 * 90));
    assert!(quats.chunks(4).all(|pixel| pixel[3] == 252));
    let (width, _) = pixels(member(&mut members, "shN_centroids.webp"));
    assert_eq!(width, 64 * 3);
    // Down is y: the highest z of the model is the lowest y of the file.
    let lowest = meta["means"]["mins"][1].as_f64().unwrap();
    let highest = splats.iter().map(|s| s.mean[2]).fold(f32::NEG_INFINITY, f32::max);
    assert!((-f64::from(highest).ln_1p() - lowest).abs() < 1e-6, "{lowest} {highest}");
}

#[test]
fn antialiasing_and_bands_of_other_writers_are_read() {
    let splats = splats(70, 176);
    let native = set(&splats, &random_appearance(&splats, 176));
    let mut members = unpacked(&written_as(ModelFormat::Sog, &native));
    let mut meta: Value = serde_json::from_slice(member(&mut members, "meta.json")).unwrap();
    meta["antialias"] = json!(true);
    meta["shN"]["bands"] = json!(3);
    // Some writers leave the first level empty, which no pixel uses.
    meta["shN"]["codebook"][0] = Value::Null;
    *member(&mut members, "meta.json") = meta.to_string().into_bytes();
    *member(&mut members, "shN_centroids.webp") = webp(64 * 15, 1);
    let model = read_bytes(&packed(&members)).unwrap();
    assert!(model.notes.contains(&Note::Antialiased), "{:?}", model.notes);
    let ignored = Note::ViewDependentColorIgnored { n_coefficients: 36 };
    assert!(model.notes.contains(&ignored), "{:?}", model.notes);
}

#[test]
fn files_that_lie_are_refused() {
    let good = unpacked(&written_as(ModelFormat::Sog, &splats(9, 177)));
    let with = |change: &dyn Fn(&mut Value, &mut Members)| {
        let mut members = good.clone();
        let mut meta: Value = serde_json::from_slice(member(&mut members, "meta.json")).unwrap();
        change(&mut meta, &mut members);
        *member(&mut members, "meta.json") = meta.to_string().into_bytes();
        packed(&members)
    };
    let lies: [(&str, Vec<u8>, &[&str]); 9] = [
        ("version", with(&|meta, _| meta["version"] = json!(1)), &["version 2, found 1", "PLY"]),
        ("none", with(&|meta, _| meta["version"] = Value::Null), &["version 2, found none"]),
        ("count", with(&|meta, _| meta["count"] = json!(30_000_000)), &["at most 20000000"]),
        ("many", with(&|meta, _| meta["count"] = json!(19_000_000)), &["at most 16 times"]),
        ("more", with(&|meta, _| meta["count"] = json!(10)), &["WebP of 10 pixels", "3 × 3"]),
        (
            "name",
            with(&|meta, _| meta["sh0"]["files"] = json!([])),
            &["1 names of images, found 0"],
        ),
        (
            "large",
            with(&|_, members| *member(members, "quats.webp") = webp(4000, 4000)),
            &["quats.webp", "4000 × 4000"],
        ),
        (
            "no image",
            with(&|_, members| *member(members, "scales.webp") = vec![0; 90]),
            &["scales.webp: expected a lossless WebP"],
        ),
        ("meta", with(&|meta, _| meta["means"] = json!(7)), &["meta.json", "description of SOG"]),
    ];
    for (name, bytes, parts) in lies {
        assert_fails(name, &bytes, parts);
    }
    let many: Members = (0..65).map(|i| (format!("{i}"), Vec::new())).collect();
    assert_fails("members", &packed(&many), &["at most 64 members", "found more"]);
    // The last record at the end states two members; the directory is that of the one before.
    let other = [&b"PK\x05\x06"[..], &[0; 4], &[1, 0, 2, 0], &[0xFF, 0, 0, 0], &[0; 6]].concat();
    let two_ends = [packed(&many), other].concat();
    assert_fails("two ends", &two_ends, &["at most 64 members", "found more"]);
    assert_fails("other archive", &packed(&vec![("a".into(), vec![1])]), &["meta.json"]);
    let text: Members = vec![("meta.json".into(), vec![b' '; 1 << 20])];
    assert_fails("long text", &packed(&text), &["at most 131072 bytes, found more"]);
}

#[test]
fn members_are_counted_as_they_are_read() {
    let header = *b"PK\x01\x02";
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for name in ["a", "b", "c"] {
        zip.start_file(name, SimpleFileOptions::default()).unwrap();
        // A header within a member is no member.
        zip.write_all(&header.repeat(9)).unwrap();
    }
    let archive = zip.finish().unwrap().into_inner();
    let open = |most| open_zip(Cursor::new(&archive[..]), most);
    assert!(open(2).is_none());
    let mut zip = open(3).unwrap().unwrap();
    let mut bytes = Vec::new();
    zip.by_name("b").unwrap().read_to_end(&mut bytes).unwrap();
    assert_eq!((zip.len(), bytes), (3, header.repeat(9)));
    assert!(open_zip(Cursor::new(&header[..]), 3).unwrap().is_err());
}

/// The file takes a fifth of the bytes of an SPZ of the oldest version, and splats on a curve compress.
#[test]
fn splats_take_few_bytes() {
    let splats: Vec<Splat> = splats(20_000, 178)
        .into_iter()
        .map(|s| Splat { opacity: 0.99, scale: [0.5, 0.4, 0.02], ..s })
        .collect();
    let size = |format| written(&splats, &WriteOptions::new(format)).len() as f64 / 20_000.0;
    let (sog, spz) = (size(ModelFormat::Sog), size(ModelFormat::Spz));
    assert!(sog < 14.0 && sog < spz, "{sog} bytes a splat, SPZ {spz}");
}
