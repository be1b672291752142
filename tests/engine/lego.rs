//! The `paper` preset on the real Lego recording against the figures of `model.md`,
//! Comparison with the reference, and the mixed path against f64.
//!
//! `cargo test --release --test engine lego -- --ignored --nocapture` prints the tables.

use crate::common::shared;
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};
use std::fs::File;
use std::io::BufReader;
use std::sync::Arc;
use vbgs_studio::dataset::{self, Dataset, LoadOptions};
use vbgs_studio::eval::choices::GroundTruth;
use vbgs_studio::eval::metrics::psnr;
use vbgs_studio::eval::report::Summary;
use vbgs_studio::eval::views::ground_truth;
use vbgs_studio::export::{self, ModelFormat, WriteOptions};
use vbgs_studio::math::camera::Camera;
use vbgs_studio::math::image::RgbImage;
use vbgs_studio::model::conjugate::posterior::Conversion;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{RenderMethod, RenderOptions};
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides, Precision, ReassignPolicy};

/// Deviation from a published figure that a different initial draw may cause, dB.
const TOLERANCE_DB: f64 = 0.3;
/// Same for the number of used components, relative.
const TOLERANCE_USED: f64 = 0.02;
const SEEDS: [u64; 3] = [0, 1, 2];
/// Conversions, in the order of `Figures::psnr`.
const CONVERSIONS: [&str; 3] = ["legacy x1.41", "eigen x1.41", "eigen x1.0"];

/// One row of the published table.
struct Figures {
    reassign: ReassignPolicy,
    /// PSNR in dB by conversion, against RGB bytes and, where published, against RGB·alpha.
    psnr: [(f64, Option<f64>); 3],
    used: f64,
}

const FIGURES: [Figures; 3] = [
    Figures {
        reassign: ReassignPolicy::Off,
        psnr: [(20.05, Some(19.78)), (20.51, None), (19.62, Some(19.67))],
        used: 13_659.0,
    },
    Figures {
        reassign: ReassignPolicy::Padded,
        psnr: [(20.43, Some(19.94)), (20.71, None), (22.03, Some(21.60))],
        used: 99_982.0,
    },
    Figures {
        reassign: ReassignPolicy::Forwarded,
        psnr: [(20.13, Some(19.65)), (20.44, None), (21.85, Some(21.39))],
        used: 99_881.0,
    },
];

/// Evaluation view, decoded once.
struct View {
    camera: Camera,
    /// Ground truths: RGB bytes, and RGB·alpha.
    truths: [RgbImage; 2],
}

fn open() -> Option<Arc<Dataset>> {
    let path = shared("data/lego400")?;
    Some(Arc::new(dataset::open(&path, &LoadOptions::default()).unwrap()))
}

fn views(dataset: &Dataset) -> Vec<View> {
    let split = dataset.split_named("val").unwrap();
    let load = |i| {
        let frame = dataset.load(split, i).unwrap();
        let truth = |kind| ground_truth(&frame, kind, [0.0; 3]);
        View {
            camera: frame.camera,
            truths: [truth(GroundTruth::Rgb), truth(GroundTruth::Composited)],
        }
    };
    (0..dataset.splits[split].frames.len()).map(load).collect()
}

fn train(dataset: &Arc<Dataset>, overrides: PaperOverrides, max_frames: Option<usize>) -> Session {
    let config = PaperConfig::paper().with(&overrides).unwrap();
    let selection = Selection { max_frames, ..Selection::all_frames() };
    let mut session = Session::new(dataset.clone(), config, selection).unwrap();
    while !matches!(session.step().unwrap(), Step::Finished) {}
    assert!(session.skipped().is_empty(), "{:?}", session.skipped());
    session
}

fn converted(session: &Session, conversion: Conversion) -> Vec<Splat> {
    let learner = session.learner();
    let splat = |k| conversion.splat(&learner.component(k).posterior, session.normalization());
    (0..learner.status().components).map(splat).collect()
}

/// Mean PSNR over the views against either ground truth, dB.
fn measure(splats: &[Splat], views: &[View]) -> [f64; 2] {
    let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let mut renderer = CpuRenderer::new();
    let mut sums = [0.0; 2];
    for view in views {
        let color = renderer.render(splats, &view.camera, &options).color;
        for (sum, truth) in sums.iter_mut().zip(&view.truths) {
            *sum += psnr(&color, truth).unwrap();
        }
    }
    sums.map(|sum| sum / views.len() as f64)
}

/// Means over the seeds, and each seed's median time per frame.
struct Measured {
    /// PSNR by conversion and ground truth, dB.
    psnr: [[f64; 2]; 3],
    used: f64,
    train_ms: Vec<f64>,
}

fn measure_row(dataset: &Arc<Dataset>, views: &[View], reassign: ReassignPolicy) -> Measured {
    let share = 1.0 / SEEDS.len() as f64;
    let mut row = Measured { psnr: Default::default(), used: 0.0, train_ms: Vec::new() };
    for seed in SEEDS {
        let overrides = PaperOverrides {
            seed: Some(seed),
            reassign: Some(reassign),
            ..PaperOverrides::default()
        };
        let session = train(dataset, overrides, None);
        assert_eq!(session.frames().len(), 200);
        row.used += share * session.learner().status().used as f64;
        row.train_ms.push(Summary::of_frames(session.frames(), 0.0).train_ms_median);
        let wide = Conversion { scale_factor: 1.41, ..Conversion::right() };
        let conversions = [Conversion::legacy(), wide, Conversion::right()];
        for (c, conversion) in conversions.into_iter().enumerate() {
            let splats = converted(&session, conversion);
            for (truth, value) in measure(&splats, views).into_iter().enumerate() {
                row.psnr[c][truth] += share * value;
            }
        }
    }
    row
}

#[test]
#[ignore = "trains nine times on Lego: about two minutes"]
fn section_17() {
    let Some(dataset) = open() else { return };
    let views = views(&dataset);
    assert_eq!(views.len(), 50);
    let mut misses = Vec::new();
    for figures in FIGURES {
        let name = format!("{:?}", figures.reassign);
        let row = measure_row(&dataset, &views, figures.reassign);
        println!(
            "{name}: {:.0} used (published {}), median ms.train of the seeds {:.1?}",
            row.used, figures.used, row.train_ms
        );
        if (row.used / figures.used - 1.0).abs() > TOLERANCE_USED {
            misses.push(format!("{name}: {} used components", row.used));
        }
        for (c, (rgb, composited)) in figures.psnr.into_iter().enumerate() {
            let found = row.psnr[c];
            let published = composited.map_or_else(String::new, |db| format!(" [{db:.2}]"));
            let line = format!(
                "{name}, {}: {:.2} [{:.2}] dB, published {rgb:.2}{published}",
                CONVERSIONS[c], found[0], found[1]
            );
            println!("  {line}");
            let off = |a: f64, b: f64| (a - b).abs() > TOLERANCE_DB;
            if off(found[0], rgb) || composited.is_some_and(|db| off(found[1], db)) {
                misses.push(line);
            }
        }
    }
    assert!(misses.is_empty(), "beyond {TOLERANCE_DB} dB:\n  {}", misses.join("\n  "));
}

/// Sessions in f64 and in mixed precision after five frames.
fn both(dataset: &Arc<Dataset>, reassign: ReassignPolicy) -> [Session; 2] {
    [Precision::F64, Precision::Mixed].map(|precision| {
        let (precision, reassign) = (Some(precision), Some(reassign));
        train(dataset, PaperOverrides { precision, reassign, ..PaperOverrides::default() }, Some(5))
    })
}

/// Mean PSNR of the model over five views, dB.
fn quality(session: &Session) -> f64 {
    let mut views = views(session.dataset());
    views.truncate(5);
    measure(&converted(session, Conversion::right()), &views)[0]
}

/// Mixed precision gives the same scene as f64, component by component.
#[test]
fn mixed_agrees_with_f64() {
    let Some(dataset) = open() else { return };
    let [exact, mixed] = both(&dataset, ReassignPolicy::Off);
    let n_components = exact.learner().status().components;
    let (mut worst, mut n_differ) = (0.0f64, 0);
    for k in 0..n_components {
        let (a, b) =
            (exact.learner().component(k).posterior, mixed.learner().component(k).posterior);
        if a.count == b.count {
            worst = worst.max((a.mean_space - b.mean_space).length());
        } else {
            n_differ += 1;
        }
    }
    // The normalisation scales all axes alike, so normalised lengths are proportional to world lengths.
    let worst = worst / (2.0 * 3f64.sqrt());
    println!(
        "{n_differ} of {n_components} components differ in count, means within {worst:.1e} of the scene"
    );
    // Rounding decides near-ties differently: 1 of 982,910 points when measured.
    assert!(n_differ <= 2, "{n_differ} components differ in count");
    assert!(worst < 1e-6, "{worst:e}");
    let (a, b) = (quality(&exact), quality(&mixed));
    assert!((a - b).abs() < 0.01, "f64 {a} dB, mixed {b} dB");
}

/// Reassignment samples by score, so rounding changes which component moves where: the scenes
/// differ, but not their quality.
#[test]
fn mixed_reassigns_as_well_as_f64() {
    let Some(dataset) = open() else { return };
    for reassign in [ReassignPolicy::Padded, ReassignPolicy::Forwarded] {
        let [exact, mixed] = both(&dataset, reassign);
        let (a, b) = (quality(&exact), quality(&mixed));
        let used = [&exact, &mixed].map(|session| session.learner().status().used);
        println!("{reassign:?}: f64 {a:.4} dB, mixed {b:.4} dB, used {used:?}");
        assert!((a - b).abs() < 0.05, "{reassign:?}: f64 {a} dB, mixed {b} dB");
        let share = used[0] as f64 / used[1] as f64;
        assert!((share - 1.0).abs() < 0.01, "{reassign:?}: used {used:?}");
    }
}

/// The Lego `.ply`, read by a parser that shares no code with ours, renders the same images.
#[test]
fn the_ply_reads_back_with_an_independent_reader() {
    let Some(dataset) = open() else { return };
    let session = train(&dataset, PaperOverrides::default(), Some(10));
    let splats = session.splats();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    let summary = export::write(&path, &splats, &WriteOptions::new(ModelFormat::Ply)).unwrap();
    assert_eq!(summary.n_written, session.learner().status().used);

    let mut file = BufReader::new(File::open(&path).unwrap());
    let ply = Parser::<DefaultElement>::new().read_ply(&mut file).unwrap();
    let back: Vec<Splat> = ply.payload["vertex"].iter().map(splat_of).collect();
    assert_eq!(back.len(), summary.n_written);
    let drawn = splats.iter().filter(|s| s.is_drawable());
    assert!(drawn.zip(&back).all(|(ours, theirs)| ours.mean == theirs.mean));

    let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    for view in &views(&dataset)[..3] {
        let picture =
            |splats: &[Splat]| CpuRenderer::new().render(splats, &view.camera, &options).color;
        let same = psnr(&picture(&back), &picture(&splats)).unwrap();
        assert!(same > 70.0, "the file renders differently: {same} dB");
    }
}

/// Splat from a row of the 3DGS layout, by its definition (`files.md`, PLY of splats).
fn splat_of(row: &DefaultElement) -> Splat {
    let value = |name: &str| match row.get(name) {
        Some(Property::Float(value)) => *value,
        other => panic!("{name}: expected a float, found {other:?}"),
    };
    let color = |i: usize| 0.5 + 0.282_094_8 * value(&format!("f_dc_{i}"));
    Splat {
        mean: ["x", "y", "z"].map(value),
        opacity: 1.0 / (1.0 + (-value("opacity")).exp()),
        color: [0, 1, 2].map(color),
        scale: [0, 1, 2].map(|i| value(&format!("scale_{i}")).exp()),
        rotation: [0, 1, 2, 3].map(|i| value(&format!("rot_{i}"))),
    }
}
