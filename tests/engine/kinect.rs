//! The `paper` preset on the real Kinect recording: trained on the split `train`, measured on `eval`.
//!
//! `cargo test --release --test engine kinect -- --ignored --nocapture` prints the figures.

use crate::common::shared;
use std::sync::Arc;
use vbgs_studio::dataset::{self, LoadOptions};
use vbgs_studio::eval::choices::GroundTruth;
use vbgs_studio::eval::report::{EvalReport, Summary};
use vbgs_studio::eval::views::{EvalOptions, evaluate};
use vbgs_studio::model::conjugate::posterior::Conversion;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::render::{RenderMethod, RenderOptions};
use vbgs_studio::train::paper::config::PaperConfig;

fn quality(session: &Session, scale_factor: f64) -> EvalReport {
    let conversion = Conversion { scale_factor, ..Conversion::right() };
    let learner = session.learner();
    let splat = |k| conversion.splat(&learner.component(k).posterior, session.normalization());
    let splats: Vec<_> = (0..learner.status().components).map(splat).collect();
    let render = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let options = EvalOptions::plain(GroundTruth::Composited, render);
    let dataset = session.dataset();
    let split = dataset.split_named("eval").unwrap();
    let views: Vec<usize> = (0..dataset.splits[split].frames.len()).collect();
    evaluate(&splats, dataset, split, &views, &options, |_| ()).unwrap().0
}

#[test]
#[ignore = "trains on 100 Kinect frames: half a minute"]
fn office() {
    let Some(path) = shared("data/kinect_office") else { return };
    let dataset = Arc::new(dataset::open(&path, &LoadOptions::default()).unwrap());
    let mut session = Session::new(dataset, PaperConfig::paper(), Selection::all_frames()).unwrap();
    while !matches!(session.step().unwrap(), Step::Finished) {}
    assert_eq!((session.frames().len(), session.skipped().len()), (100, 0));
    let summary = Summary::of_frames(session.frames(), 0.0);
    println!(
        "median ms.train {:.1}, {} of {} components used",
        summary.train_ms_median,
        session.learner().status().used,
        session.learner().status().components
    );
    for (scale_factor, least_db) in [(1.0, FLOOR_DB.0), (1.41, FLOOR_DB.1)] {
        let report = quality(&session, scale_factor);
        let covered = report.means.psnr_covered_mean.unwrap();
        println!(
            "scale x{scale_factor}: PSNR {:.2} ± {:.2} dB, {covered:.2} dB over the {:.1} % covered, SSIM {:.4}, depth error {:.3} m",
            report.means.psnr_mean,
            report.means.psnr_std,
            100.0 * report.means.coverage_mean,
            report.means.ssim_mean,
            report.means.depth_mae_mean.unwrap()
        );
        assert_eq!(report.views, 10);
        assert!(
            report.means.psnr_mean > least_db && covered > report.means.psnr_mean,
            "{report:?}"
        );
    }
}

/// PSNR of this version at scale factors 1.0 and 1.41, minus 0.5 dB.
const FLOOR_DB: (f64, f64) = (14.2, 15.3);
