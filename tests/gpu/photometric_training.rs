//! Training with photographs compared on a GPU, and the fallback when the GPU fails.

use super::fixture::Fixture;
use super::photometric::comparer;
use std::sync::Arc;
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
use vbgs_studio::eval::choices::GroundTruth;
use vbgs_studio::eval::views::{EvalOptions, evaluate};
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::render::{RenderMethod, RenderOptions};
use vbgs_studio::train::device_trial::ComparerUse;
use vbgs_studio::train::device_trial::DevicePolicy;
use vbgs_studio::train::learner::TrainingDevice;
use vbgs_studio::train::scene::photometric::rule::PhotometricMode;

const FRAMES: usize = 12;

fn room() -> Arc<Dataset> {
    let params = SyntheticParams {
        width: 80,
        height: 60,
        n_train: FRAMES,
        n_eval: 3,
        seed: 9,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    Arc::new(dataset(&params).unwrap())
}

fn session(room: &Arc<Dataset>) -> Session {
    // No shuffle buffer: devices are lost at frames that are counted, so each frame trains at once.
    let (photometric, shuffle_buffer) = (Some(PhotometricMode::Full), Some(0));
    let asked = SceneOverrides { photometric, shuffle_buffer, ..SceneOverrides::default() };
    Session::new(room.clone(), asked, Selection::all_frames()).unwrap()
}

/// Trains on a device; `before` runs before each frame and may break it.
fn on_device(room: &Arc<Dataset>, gpu: &Fixture, before: impl Fn(usize)) -> Session {
    let mut session = session(room);
    session
        .add_device(TrainingDevice::Photographs(Box::new(comparer(gpu))), DevicePolicy::Device)
        .unwrap();
    for frame in 0.. {
        before(frame);
        if matches!(session.step().unwrap(), Step::Finished) {
            break;
        }
    }
    session
}

fn used(session: &Session) -> ComparerUse {
    session.learner().device_use().photographs.unwrap()
}

fn frames(used: &ComparerUse) -> [u64; 2] {
    [used.device_frames, used.processor_frames]
}

/// Mean PSNR over the evaluation views, dB.
fn psnr(room: &Arc<Dataset>, session: &Session) -> f64 {
    let render = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let options = EvalOptions::plain(GroundTruth::Composited, render);
    let views: Vec<usize> = (0..room.splits[1].frames.len()).collect();
    let splats = session.splats();
    evaluate(&splats, room, 1, &views, &options, |_| ()).unwrap().0.means.psnr_mean
}

#[test]
fn a_scene_learns_the_same_on_a_device() {
    let Some(gpu) = Fixture::shared() else { return };
    let room = room();
    let mut alone = session(&room);
    while !matches!(alone.step().unwrap(), Step::Finished) {}
    let beside = on_device(&room, &gpu, |_| ());
    gpu.assert_no_faults();
    assert_eq!([frames(&used(&alone)), frames(&used(&beside))], [[0, 12], [12, 0]]);
    let [alone, beside] = [&alone, &beside].map(|session| psnr(&room, session));
    println!("processor {alone:.4} dB, device {beside:.4} dB");
    assert!((alone - beside).abs() < 0.02, "{alone} and {beside} dB");
}

#[test]
fn a_lost_device_costs_no_frame() {
    let Some(gpu) = Fixture::own(|_| ()) else { return };
    let room = room();
    let lost = on_device(&room, &gpu, |frame| {
        if frame == 5 {
            gpu.device.destroy();
        }
    });
    let used = used(&lost);
    assert_eq!(frames(&used), [5, 7], "{used:?}");
    assert!(used.given_up.as_ref().is_some_and(|why| !why.is_empty()), "{used:?}");
    assert_eq!((lost.frames().len(), lost.skipped().len()), (FRAMES, 0));
    assert!(lost.frames().iter().all(|frame| frame.photograph.is_some()));
}

#[test]
fn a_view_too_large_for_the_device_is_the_processors() {
    let small = |limits: &mut wgpu::Limits| limits.max_storage_buffer_binding_size = 1 << 16;
    let Some(gpu) = Fixture::own(small) else { return };
    let room = room();
    let refused = used(&on_device(&room, &gpu, |_| ()));
    assert_eq!(frames(&refused), [0, 12], "{refused:?}");
    let why = refused.given_up.unwrap();
    assert!(why.contains("MiB") && why.contains("the CPU is used instead"), "{why}");
}
