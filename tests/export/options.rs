//! Options of the writers: selection of splats, axes and units, and progress.

use super::{distance, random_splats, read_bytes, set, written};
use glam::DVec3;
use std::cell::{Cell, RefCell};
use vbgs_studio::export::{
    Axes, ExportError, Fault, ModelFormat, WriteOptions, WriteProgress, WriteSelection, write,
};
use vbgs_studio::model::splat::appearance::Appearance;
use vbgs_studio::model::splat::splats::Splat;

const SPLAT_FORMATS: [ModelFormat; 6] = [
    ModelFormat::Ply,
    ModelFormat::Glb,
    ModelFormat::Spz,
    ModelFormat::Sog,
    ModelFormat::Html,
    ModelFormat::Usda,
];

fn mean_of(bytes: &[u8]) -> [f32; 3] {
    read_bytes(bytes).unwrap().splats[0].mean
}

/// The model's up direction becomes y in GLB and SPZ, which reading rotates to z, and the selected axis
/// in a PLY.
#[test]
fn up_stays_up() {
    let ups = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    for up in ups.chain([DVec3::new(1.0, -2.0, 2.0)]) {
        let above = (2.0 * up.normalize()).as_vec3().to_array();
        let splats = [Splat { mean: above, scale: [0.1; 3], ..random_splats(1, 81)[0] }];
        for format in [ModelFormat::Glb, ModelFormat::Spz, ModelFormat::Sog] {
            let mean =
                mean_of(&written(&splats, &WriteOptions { up, ..WriteOptions::new(format) }));
            assert!(distance(mean, [0.0, 0.0, 2.0]) < 1e-2, "{format} {up}: {mean:?}");
        }
        for (axes, expected) in [
            (Axes::AsIs, above),
            (Axes::Viewer, [0.0, -2.0, 0.0]),
            (Axes::YUp, [0.0, 2.0, 0.0]),
            (Axes::ZUp, [0.0, 0.0, 2.0]),
        ] {
            for format in [ModelFormat::Ply, ModelFormat::PointCloudPly] {
                let options = WriteOptions { up, axes, ..WriteOptions::new(format) };
                let bytes = written(&splats, &options);
                assert!(distance(mean_of(&bytes), expected) < 1e-6, "{format} {axes:?} {up}");
                let said = read_bytes(&bytes).unwrap().up().unwrap();
                let expected = DVec3::from_array(expected.map(f64::from)) / 2.0;
                assert!((said - expected).length() < 1e-6, "{format} {axes:?} {up}: {said}");
            }
        }
    }
}

/// A y-down camera world is rotated by half a turn about x without changing a bit of a coordinate.
#[test]
fn turns_between_axes_are_exact() {
    let splats = random_splats(50, 82);
    let options = WriteOptions { up: DVec3::NEG_Y, ..WriteOptions::new(ModelFormat::Glb) };
    let model = read_bytes(&written(&splats, &options)).unwrap();
    for (a, b) in splats.iter().zip(model.splats.iter()) {
        let [x, y, z] = a.mean;
        assert_eq!(b.mean, [x, z, -y]);
    }
}

#[test]
fn rotations_are_written_with_a_positive_w() {
    let mut splats = random_splats(200, 83);
    splats.iter_mut().for_each(|s| s.rotation[0] = -s.rotation[0].abs());
    for format in [ModelFormat::Ply, ModelFormat::Glb] {
        let bytes = written(&splats, &WriteOptions::new(format));
        let w: Vec<f32> = match format {
            ModelFormat::Glb => {
                let glb = super::glb_file::Glb::parse(&bytes);
                glb.floats("KHR_gaussian_splatting:ROTATION").iter().map(|q| q[3]).collect()
            }
            _ => read_bytes(&bytes).unwrap().splats.iter().map(|s| s.rotation[0]).collect(),
        };
        assert!(w.len() == 200 && w.iter().all(|w| *w >= 0.0), "{format}");
    }
}

#[test]
fn lengths_are_scaled() {
    let splats =
        [Splat { mean: [1.0, 2.0, 3.0], scale: [0.5, 0.25, 0.125], ..random_splats(1, 84)[0] }];
    for format in [ModelFormat::Ply, ModelFormat::Glb] {
        let options = WriteOptions { unit_scale: 100.0, metric: true, ..WriteOptions::new(format) };
        let bytes = written(&splats, &options);
        let back = read_bytes(&bytes).unwrap().splats[0];
        assert_eq!(back.mean, [100.0, 200.0, 300.0], "{format}");
        assert!(distance(back.scale, [50.0, 25.0, 12.5]) < 1e-4, "{format}: {:?}", back.scale);
        assert!(!bytes.windows(6).any(|w| w == b"metres"), "{format}");
    }
}

#[test]
fn what_is_not_asked_for_is_left_out() {
    let mut splats = random_splats(6, 85);
    for (i, splat) in splats.iter_mut().enumerate() {
        (splat.mean, splat.scale) = ([i as f32, 0.0, 0.0], [0.1; 3]);
    }
    let (evidence, uncertainty) = ([9.0, 1.0, 9.0, 9.0, 9.0, 9.0], [0.1, 0.1, 0.1, 0.5, 0.1, 0.1]);
    let selection = WriteSelection {
        // The corners may come in any order.
        crop: Some([DVec3::new(4.5, -1.0, -1.0), DVec3::new(-0.5, 1.0, 1.0)]),
        min_evidence: Some(2.0),
        max_uncertainty: Some(0.2),
        uncertainty: Some(&uncertainty),
        left_out: Some(&[false, false, false, false, true, false]),
    };
    // All pieces of a native splat are selected together, by the centre of the splat.
    let gradient = [[1.0, 0.0, 0.0], [0.0; 3], [0.0; 3]];
    let native = set(&splats, &[Appearance { gradient, ..Appearance::default() }; 6]);
    for format in ModelFormat::ALL.into_iter().filter(|format| format.is_read()) {
        let options =
            WriteOptions { selection, confidence: Some(&evidence), ..WriteOptions::new(format) };
        for view in [(&splats).into(), native.view()] {
            let model = read_bytes(&written(view, &options)).unwrap();
            let mut found: Vec<f32> = model.splats.iter().map(|s| s.mean[0].round()).collect();
            found.sort_by(f32::total_cmp);
            assert_eq!(found, [0.0, 2.0], "{format}");
        }
    }
}

#[test]
fn options_without_a_meaning_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let splats = random_splats(2, 86);
    let base = WriteOptions::new(ModelFormat::Ply);
    let selected = |selection| WriteOptions { selection, ..base.clone() };
    let plain = WriteSelection::default();
    let nowhere = Some([DVec3::splat(900.0), DVec3::splat(901.0)]);
    let cases = [
        (WriteOptions { unit_scale: 0.0, ..base.clone() }, "unit scale: expected a number above 0"),
        (WriteOptions { up: DVec3::ZERO, ..base.clone() }, "up: expected a direction, found [0, 0"),
        (
            selected(WriteSelection { min_evidence: Some(1.0), ..plain }),
            "least evidence: expected a",
        ),
        (selected(WriteSelection { max_uncertainty: Some(1.0), ..plain }), "largest uncertainty: "),
        (
            selected(WriteSelection { uncertainty: Some(&[1.0]), ..plain }),
            "uncertainty: expected one value for each of 2 splats, found 1 values",
        ),
        (
            selected(WriteSelection { left_out: Some(&[true]), ..plain }),
            "left out: expected one value for each of 2 splats, found 1 values",
        ),
        (
            selected(WriteSelection { crop: Some([DVec3::NAN, DVec3::ONE]), ..plain }),
            "crop box: expected finite corners",
        ),
        (
            selected(WriteSelection { crop: nowhere, ..plain }),
            "nothing to export: expected some of 2 splats inside the crop box",
        ),
    ];
    for (options, part) in cases {
        let error = write(&path, &splats, &options).unwrap_err().to_string();
        assert!(error.contains(part), "{part} is missing in: {error}");
    }
    assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none());
}

#[test]
fn progress_is_told_and_a_no_ends_the_writing() {
    let folder = tempfile::tempdir().unwrap();
    let splats = random_splats(66_000, 87);
    for format in SPLAT_FORMATS {
        let path = folder.path().join("a");
        let shares = RefCell::new(Vec::new());
        let told = |share: f64| {
            shares.borrow_mut().push(share);
            true
        };
        let options =
            WriteOptions { progress: WriteProgress::new(&told), ..WriteOptions::new(format) };
        write(&path, &splats, &options).unwrap();
        let shares = shares.into_inner();
        assert!(shares.len() >= 2 && shares.is_sorted(), "{format}: {shares:?}");
        assert!((shares[shares.len() - 1] - 1.0).abs() < 1e-9, "{format}");

        let before = std::fs::read(&path).unwrap();
        let n_told = Cell::new(0);
        let told = |_| {
            n_told.set(n_told.get() + 1);
            n_told.get() < 2
        };
        let options =
            WriteOptions { progress: WriteProgress::new(&told), ..WriteOptions::new(format) };
        let error = write(&path, &splats, &options).unwrap_err();
        assert!(matches!(error, ExportError { fault: Fault::Cancelled, .. }), "{error}");
        assert!(error.to_string().contains("cancelled: no file was written"), "{error}");
        assert_eq!(n_told.get(), 2);
        assert!(std::fs::read(&path).unwrap() == before, "{format}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "{format}");
    }
}
