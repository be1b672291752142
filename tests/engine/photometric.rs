//! Learning from photographs, through a session: what it gains, and what it must not harm.

use std::sync::Arc;
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
use vbgs_studio::eval::choices::GroundTruth;
use vbgs_studio::eval::views::{EvalOptions, evaluate};
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::render::{RenderMethod, RenderOptions};
use vbgs_studio::train::scene::photometric::rule::PhotometricMode;

fn room() -> Arc<Dataset> {
    let params = SyntheticParams {
        width: 96,
        height: 72,
        n_train: 40,
        n_eval: 6,
        seed: 9,
        depth_noise: 0.0,
    };
    Arc::new(dataset(&params).unwrap())
}

fn trained(mode: PhotometricMode) -> SplatSet {
    let asked = SceneOverrides { photometric: Some(mode), ..SceneOverrides::default() };
    let mut session = Session::new(room(), asked, Selection::everything()).unwrap();
    while !matches!(session.step().unwrap(), Step::Finished) {}
    session.stored_splats()
}

/// Mean PSNR over the views that no frame was, dB.
fn psnr(splats: &SplatSet) -> f64 {
    let room = room();
    let render = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let options = EvalOptions::plain(GroundTruth::Composited, render);
    let views: Vec<usize> = (0..room.splits[1].frames.len()).collect();
    evaluate(splats, &room, 1, &views, &options, |_| ()).unwrap().0.psnr_mean
}

#[test]
fn photographs_improve_views_that_were_never_seen() {
    let [off, full] = [PhotometricMode::Off, PhotometricMode::Full].map(|m| psnr(&trained(m)));
    println!("points alone {off:.2} dB, with photographs {full:.2} dB");
    assert!(full > off + 0.5, "points alone {off:.2} dB, with photographs {full:.2} dB");
}
