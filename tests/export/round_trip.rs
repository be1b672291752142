//! Written splats read back (`files.md`, From splat to file: mean exact, the rest to 1e-6).

use super::{distance, random_splats, read_bytes, written};
use vbgs_studio::export::{Axes, ModelFormat, ModelKind, Note, WriteOptions, read_up_to, write};
use vbgs_studio::model::splat::splats::Splat;

/// Checks a splat within the tolerances of a round trip.
pub fn assert_same(a: &Splat, b: &Splat, name: &str) {
    assert!((a.opacity - b.opacity).abs() <= 1e-6, "{name}: opacity {} {}", a.opacity, b.opacity);
    assert!(distance(a.color, b.color) <= 1e-6, "{name}: colour {:?} {:?}", a.color, b.color);
    let scale: [f32; 3] = std::array::from_fn(|i| a.scale[i] / b.scale[i]);
    assert!(distance(scale, [1.0; 3]) <= 1e-6, "{name}: scale {:?} {:?}", a.scale, b.scale);
    let negative = b.rotation.map(|v| -v);
    let rotation = distance(a.rotation, b.rotation).min(distance(a.rotation, negative));
    assert!(rotation <= 1e-6, "{name}: rotation {:?} {:?}", a.rotation, b.rotation);
}

#[test]
fn splats_come_back_from_every_splat_format() {
    let splats = random_splats(3000, 1);
    for (format, sh3_padding) in
        [(ModelFormat::Ply, false), (ModelFormat::Ply, true), (ModelFormat::Glb, false)]
    {
        let options = WriteOptions { sh3_padding, ..WriteOptions::new(format) };
        let model = read_bytes(&written(&splats, &options)).unwrap();
        assert_eq!((model.kind, model.skipped), (ModelKind::Splats, 0));
        assert_eq!(model.splats.len(), splats.len());
        for (ours, original) in model.splats.iter().zip(&splats) {
            assert_eq!(ours.mean, original.mean, "{format}");
            assert_same(ours, original, format.name());
        }
        assert!(model.splats.view().appearance().is_empty(), "{format}");
        let ignored = Note::ViewDependentColorIgnored { n_coefficients: 36 };
        assert_eq!(model.notes, if sh3_padding { vec![ignored] } else { vec![] }, "{format}");
    }
}

#[test]
fn a_second_round_trip_changes_nothing() {
    let splats = random_splats(500, 2);
    for format in [ModelFormat::Ply, ModelFormat::Glb] {
        let once = read_bytes(&super::written_as(format, &splats)).unwrap();
        let twice = read_bytes(&super::written_as(format, &once.splats)).unwrap();
        for (a, b) in once.splats.iter().zip(twice.splats.iter()) {
            assert_eq!(a.mean, b.mean);
            assert_same(a, b, format.name());
        }
    }
}

#[test]
fn undrawable_splats_are_left_out_and_counted() {
    let mut splats = random_splats(10, 3);
    splats[1].opacity = 0.0;
    splats[4].mean[2] = f32::NAN;
    splats[5].scale[0] = f32::INFINITY;
    splats[6].rotation[3] = f32::NAN;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model");
    for format in ModelFormat::ALL {
        let summary = write(&path, &splats, &WriteOptions::new(format)).unwrap();
        assert_eq!((summary.n_written, summary.n_skipped), (6, 4), "{format}");
        if !format.is_read() {
            continue;
        }
        assert_eq!(read_up_to(&path, 6).unwrap().splats.len(), 6, "{format}");
        let error = read_up_to(&path, 5).unwrap_err().to_string();
        assert!(error.contains("at most 5 splats, found 6"), "{format}: {error}");
    }
}

#[test]
fn an_empty_model_is_refused_and_no_file_appears() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    for splats in [vec![], vec![Splat::default(); 3]] {
        for format in ModelFormat::ALL {
            let error = write(&path, &splats, &WriteOptions::new(format)).unwrap_err().to_string();
            assert!(error.contains("scene.ply: nothing to export"), "{error}");
            assert!(!path.exists());
        }
    }
}

#[test]
fn extremes_are_floored_not_broken() {
    let splat = Splat {
        mean: [-0.0, 1e-30, -1e30],
        opacity: 1.0,
        color: [-0.5, 0.0, 1.5],
        scale: [0.0, 1e-12, 1e6],
        rotation: [0.0; 4],
    };
    for format in [ModelFormat::Ply, ModelFormat::Glb] {
        let model = read_bytes(&super::written_as(format, &[splat])).unwrap();
        let back = model.splats[0];
        assert_eq!(back.mean, splat.mean, "{format}");
        assert!((back.opacity - 1.0).abs() < 1.1e-6, "{format}: {}", back.opacity);
        assert!(distance(back.color, [0.0, 0.0, 1.0]) < 1e-6, "{format}: {:?}", back.color);
        assert!((back.scale[0] / 1e-7 - 1.0).abs() < 2e-6, "{format}: {:?}", back.scale);
        assert!(distance(back.rotation, [1.0, 0.0, 0.0, 0.0]) < 1e-6, "{format}");
        assert!(model.notes.is_empty(), "{format}: {:?}", model.notes);
    }
}

/// SPZ cannot store comments.
#[test]
fn comments_travel_with_the_file() {
    let comments = ["vbgs legacy-cov".to_owned(), "k = 3".to_owned()];
    for format in [ModelFormat::Ply, ModelFormat::PointCloudPly, ModelFormat::Glb] {
        let options = WriteOptions { comments: &comments, ..WriteOptions::new(format) };
        let model = read_bytes(&written(&random_splats(2, 4), &options)).unwrap();
        for comment in &comments {
            assert!(model.comments.contains(comment), "{format}: {:?}", model.comments);
        }
    }
}

#[test]
fn options_that_make_no_sense_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let splats = random_splats(2, 5);
    let (broken, long) = (["a\nend_header".to_owned()], ["x".repeat(5000)]);
    let base = WriteOptions::new(ModelFormat::PointCloudPly);
    let cases = [
        (WriteOptions { comments: &broken, ..base.clone() }, "comment: expected one line"),
        (WriteOptions { comments: &long, ..base.clone() }, "a PLY header below 4096 bytes"),
        (WriteOptions { confidence: Some(&[1.0]), ..base }, "for each of 2 splats, found 1 values"),
    ];
    for (options, part) in cases {
        let error = write(&folder.path().join("a.ply"), &splats, &options).unwrap_err();
        assert!(error.to_string().contains(part), "{error}");
    }
    assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none());
}

#[test]
fn formats_by_name_and_extension() {
    use std::path::Path;
    for format in ModelFormat::ALL {
        assert_eq!(format.name().parse(), Ok(format));
        let json = serde_json::to_string(&format).unwrap();
        assert_eq!(json, format!("\"{format}\""));
    }
    assert_eq!(ModelFormat::from_path(Path::new("a/B.PLY")).unwrap(), ModelFormat::Ply);
    assert_eq!(ModelFormat::from_path(Path::new("x.glb")).unwrap(), ModelFormat::Glb);
    let error = ModelFormat::from_path(Path::new("scene.obj")).unwrap_err().to_string();
    assert!(error.contains(
        "scene.obj: expected a name ending in .ply, .glb, .spz, .sog, .html or .usda, found \"obj\""
    ));
    assert!("gltf".parse::<ModelFormat>().unwrap_err().to_string().contains("point-cloud"));
    assert_eq!(serde_json::to_string(&Axes::AsIs).unwrap(), "\"as-is\"");
}
