//! The procedural scene: its geometry, and what the written layouts give back.

use crate::common::layouts::{TestLayout, write};
use crate::common::scratch::{TINY, open_plain, tiny};
use crate::real::disagreement;
use std::time::Instant;
use vbgs_studio::dataset::frame::{DepthCodes, DepthKind};
use vbgs_studio::dataset::synthetic::write::{DepthBits, WriteError};
use vbgs_studio::dataset::synthetic::{SyntheticParams, SyntheticScene, dataset, demo};
use vbgs_studio::dataset::unproject::{
    CameraConvention, EdgeFilter, UnprojectSettings, Unprojector,
};
use vbgs_studio::dataset::{Layout, range};
use vbgs_studio::observation::points::Points;

#[test]
fn the_demo_has_splits_and_streams() {
    let start = Instant::now();
    let demo = demo().unwrap();
    eprintln!("demo opens in {:.0} ms", start.elapsed().as_secs_f64() * 1e3);
    assert_eq!(demo.layout, Layout::Synthetic);
    assert!(demo.splits[0].frames.len() >= 60);
    let train = demo.training_split().unwrap();
    assert_eq!(demo.splits[train].name, "train");
    let evaluation = demo.evaluation(train);
    assert_eq!(demo.splits[evaluation.new_views.split].name, "eval");
    assert_eq!(evaluation.training, None);

    let mut best_ms = f64::INFINITY;
    let normalization = range::estimate(&demo, train).unwrap().normalization();
    let settings = UnprojectSettings {
        convention: CameraConvention::Exact,
        filter: EdgeFilter::DropMixed,
        normalization,
    };
    let mut points = Points::new();
    for i in 0..12 {
        let start = Instant::now();
        let frame = demo.load(train, i * 8).unwrap();
        best_ms = best_ms.min(start.elapsed().as_secs_f64() * 1e3);
        let counts = Unprojector::new().unproject(&frame, &settings, &mut points).unwrap();
        assert_eq!(counts.holes, 0, "the room is closed");
        assert!(counts.kept > 320 * 240 * 97 / 100, "{counts:?}");
        // The room's bounds are the normalization range: the edge of a uniform distribution lies at
        // sqrt(3) deviations.
        let all = points.x.iter().chain(&points.y).chain(&points.z);
        assert!(all.into_iter().all(|v| v.abs() < 1.7330));
    }
    eprintln!("320x240 frame: best {best_ms:.1} ms");
}

#[test]
fn views_of_the_room_agree_exactly() {
    let demo = demo().unwrap();
    for (a, b) in [(0, 1), (20, 23), (50, 48)] {
        let (n, median) = disagreement(&demo.load(0, a).unwrap(), &demo.load(0, b).unwrap());
        // The rest comes from the nearest-pixel lookup on slanted surfaces.
        assert!(n > 3000 && median < 0.006, "{a} and {b}: {n} points, median {median}");
    }
}

#[test]
fn seeds_name_scenes_and_noise_is_off_unless_asked() {
    let load = |params: &SyntheticParams| dataset(params).unwrap().load(0, 1).unwrap();
    let (a, b) = (load(&TINY), load(&TINY));
    assert_eq!((&a.color, &a.depth), (&b.color, &b.depth));
    let other = load(&SyntheticParams { seed: 5, ..TINY });
    assert_ne!(a.color.data, other.color.data);

    let large = SyntheticParams { width: 160, height: 120, ..TINY };
    let (a, noisy) = (load(&large), load(&SyntheticParams { depth_noise: 1.0, ..large }));
    assert_eq!(a.color.data, noisy.color.data);
    let (exact, noisy) = (a.depth_z().unwrap(), noisy.depth_z().unwrap());
    let in_sigmas = |z: &f32, n: &f32| ((n - z) / (0.003 * (z * z).max(1.0))).powi(2);
    let n = exact.data.len() as f32;
    let variance =
        exact.data.iter().zip(&noisy.data).map(|(z, n)| in_sigmas(z, n)).sum::<f32>() / n;
    assert!((variance - 1.0).abs() < 0.05, "within five standard errors: {variance}");
}

#[test]
fn written_layouts_load_back() {
    let truth = dataset(&TINY).unwrap();
    let scene = SyntheticScene::new(&TINY).unwrap();
    for (layout, kind, step) in [
        (TestLayout::Blender(DepthBits::Eight), DepthKind::RayDistance, 8.0 / 255.0),
        (TestLayout::Blender(DepthBits::Sixteen), DepthKind::RayDistance, 0.00025),
        (TestLayout::SevenScenes, DepthKind::Z, 0.001),
    ] {
        let folder = tiny(layout);
        let loaded = open_plain(folder.path()).unwrap();
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let train = loaded.training_split().unwrap();
        assert_eq!(loaded.splits[train].name, "train");
        for original in &truth.splits {
            let split = loaded.split_named(&original.name).unwrap();
            assert_eq!(loaded.splits[split].frames.len(), original.frames.len());
            assert!(loaded.splits[split].has_depth);
            for (i, entry) in original.frames.iter().enumerate() {
                let frame = loaded.load(split, i).unwrap();
                let view = scene.render_view(&entry.camera);
                assert_eq!(frame.color.data, view.color.data, "{layout:?}: PNG keeps colours");
                let (k, l) = (&entry.camera.intrinsics, &frame.camera.intrinsics);
                assert!((k.fx - l.fx).abs() < 1e-9 && (k.fy - l.fy).abs() < 1e-9);
                let pose = frame.camera.pose.to_opencv() - entry.camera.pose.to_opencv();
                assert!(pose.to_cols_array().iter().all(|v| v.abs() < 1e-6), "{layout:?}");
                let depth = frame.depth.unwrap();
                assert_eq!(depth.kind, kind);
                for row in 0..k.height as usize {
                    for column in 0..k.width as usize {
                        let per_z = match kind {
                            DepthKind::RayDistance => k.ray(column, row).length(),
                            DepthKind::Z => 1.0,
                        };
                        let expected = view.depth_z.at(column, row) * per_z;
                        let found = depth.value_at(column, row).unwrap();
                        assert!((found - expected).abs() <= 0.5 * step + 1e-12, "{layout:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn blender_folders_keep_the_range_of_the_room() {
    let folder = tiny(TestLayout::Blender(DepthBits::Eight));
    let range = range::estimate(&open_plain(folder.path()).unwrap(), 0).unwrap();
    assert_eq!(range.lo().to_array(), [-2.6, -2.2, 0.0]);
    assert_eq!(range.hi().to_array(), [2.6, 2.2, 2.6]);
}

#[test]
fn bit_depths_differ_in_codes_only() {
    let load = |bits| {
        let folder = tiny(TestLayout::Blender(bits));
        open_plain(folder.path()).unwrap().load(0, 0).unwrap().depth.unwrap().codes
    };
    assert!(matches!(load(DepthBits::Eight), DepthCodes::Inverse8(_)));
    assert!(matches!(load(DepthBits::Sixteen), DepthCodes::Linear16 { unit: 0.00025, .. }));
}

#[test]
fn nothing_is_overwritten_and_parameters_are_checked() {
    let folder = tiny(TestLayout::SevenScenes);
    let error = write(&TINY, folder.path(), TestLayout::SevenScenes, &mut |_, _| ());
    assert!(matches!(&error, Err(WriteError::NotEmpty(p)) if p == folder.path()), "{error:?}");
    for (params, setting) in [
        (SyntheticParams { width: 0, ..TINY }, "width"),
        (SyntheticParams { height: 100_000, ..TINY }, "height"),
        (SyntheticParams { n_train: 0, ..TINY }, "training frames"),
        (SyntheticParams { n_eval: usize::MAX, ..TINY }, "evaluation frames"),
        (SyntheticParams { depth_noise: f64::NAN, ..TINY }, "depth noise"),
    ] {
        let error = dataset(&params).unwrap_err();
        assert_eq!(error.setting, setting);
        assert!(error.to_string().contains("expected"), "{error}");
    }
}
