//! Photometric training in a session: gains in PSNR, and robustness to outlier frames.

use glam::{DQuat, DVec3};
use std::sync::Arc;
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::frame::Frame;
use vbgs_studio::dataset::surface::Preparer;
use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
use vbgs_studio::eval::choices::GroundTruth;
use vbgs_studio::eval::views::{EvalOptions, evaluate};
use vbgs_studio::export::mapping::{Mapping, is_plain, to_plain};
use vbgs_studio::model::scene::splat_rule::SplatKind;
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::observation::surface::Observation;
use vbgs_studio::pipeline::checkpoint::{ResumeRequest, SavedRun};
use vbgs_studio::pipeline::plan::{Plan, Selection};
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::scene::{SceneOverrides, SceneRun};
use vbgs_studio::render::{RenderMethod, RenderOptions};
use vbgs_studio::train::learner::{Learner, Learns};
use vbgs_studio::train::outcome::ComparedPhotograph;
use vbgs_studio::train::scene::photometric::rule::PhotometricMode;
use vbgs_studio::train::scene::trainer::SceneTrainer;

fn room() -> Arc<Dataset> {
    let params = SyntheticParams {
        width: 96,
        height: 72,
        n_train: 40,
        n_eval: 6,
        seed: 9,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    Arc::new(dataset(&params).unwrap())
}

fn trained(mode: PhotometricMode) -> SplatSet {
    trained_with(SceneOverrides { photometric: Some(mode), ..SceneOverrides::default() })
}

fn trained_with(asked: SceneOverrides) -> SplatSet {
    let mut session = Session::new(room(), asked, Selection::all_frames()).unwrap();
    while !matches!(session.step().unwrap(), Step::Finished) {}
    session.splats()
}

#[test]
fn plain_splats_learn_what_files_hold() {
    let plain = trained_with(SceneOverrides {
        splats: Some(SplatKind::Plain),
        ..SceneOverrides::default()
    });
    assert!(is_plain(plain.view()), "the training result has gradients");
    let native = trained(PhotometricMode::Full);
    let mapped = to_plain(native.view(), Mapping::default()).expect("native splats");
    let [learnt, mapped] = [psnr(&plain), psnr(&mapped)];
    println!("plain {learnt:.2} dB, native as plain {mapped:.2} dB");
    assert!(learnt > mapped + 0.5, "plain {learnt:.2} dB, native as plain {mapped:.2} dB");
}

#[test]
fn photographs_leave_alone_what_splats_do_not_have() {
    let without_gradient = SceneOverrides { gradient: Some(false), ..SceneOverrides::default() };
    let splats = trained_with(without_gradient);
    let looks = splats.view().appearance();
    assert!(looks.iter().all(|look| look.gradient == [[0.0; 3]; 3]));
    assert!(looks.iter().any(|look| look.directional != [[0.0; 3]; 3]));
    let without_direction =
        SceneOverrides { directional: Some(false), ..SceneOverrides::default() };
    let splats = trained_with(without_direction);
    let looks = splats.view().appearance();
    assert!(looks.iter().all(|look| look.directional == [[0.0; 3]; 3]));
    assert!(looks.iter().any(|look| look.gradient != [[0.0; 3]; 3]));
}

/// Mean PSNR over the evaluation views, dB.
fn psnr(splats: &SplatSet) -> f64 {
    let room = room();
    let render = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
    let options = EvalOptions::plain(GroundTruth::Composited, render);
    let views: Vec<usize> = (0..room.splits[1].frames.len()).collect();
    evaluate(splats, &room, 1, &views, &options, |_| ()).unwrap().0.means.psnr_mean
}

#[test]
fn photographs_improve_views_that_were_never_seen() {
    let modes = [PhotometricMode::Off, PhotometricMode::Light, PhotometricMode::Full];
    let [off, light, full] = modes.map(|mode| psnr(&trained(mode)));
    let said = format!("points alone {off:.2} dB, light {light:.2} dB, full {full:.2} dB");
    println!("{said}");
    assert!(light > off + 0.4 && full > light, "{said}");
}

/// Session planned with `passes` passes over the frames, after its first `steps` steps.
fn repeated(passes: usize, steps: usize) -> Session {
    let selection = Selection { passes, ..Selection::all_frames() };
    // The shuffle buffer is smaller than the number of frames, as in a longer recording.
    let mut session = Session::new(room(), asked(8), selection).unwrap();
    (0..steps).for_each(|_| drop(session.step().unwrap()));
    session
}

#[test]
fn photographs_looked_at_again_teach_more_and_points_count_once() {
    let [mut once, mut twice] = [repeated(1, 40), repeated(2, 80)];
    for session in [&mut once, &mut twice] {
        assert!(matches!(session.step().unwrap(), Step::Finished));
    }
    let [first, second] = [&once, &twice].map(|session| psnr(&session.splats()));
    println!("once {first:.2} dB, twice {second:.2} dB");
    assert!(second > first + 0.2, "once {first:.2} dB, twice {second:.2} dB");
    assert_eq!((once.frames().len(), twice.frames().len()), (40, 80));
    let points = |session: &Session| session.frames().iter().map(|f| f.points).sum::<usize>();
    assert_eq!(points(&once), points(&twice));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.vbgs");
    repeated(2, 55).save(&path).unwrap();
    let saved = SavedRun::read(&path).unwrap();
    let mut resumed = saved.resume(room(), &ResumeRequest::default(), false).unwrap();
    while !matches!(resumed.step().unwrap(), Step::Finished) {}
    assert!(resumed.checkpoint().unwrap().model == twice.checkpoint().unwrap().model);
    // Extending a finished run to two passes equals a run planned with two.
    once.save(&path).unwrap();
    let asked = ResumeRequest { passes: Some(2), ..ResumeRequest::default() };
    let mut resumed = SavedRun::read(&path).unwrap().resume(room(), &asked, false).unwrap();
    while !matches!(resumed.step().unwrap(), Step::Finished) {}
    assert!(resumed.checkpoint().unwrap().model == twice.checkpoint().unwrap().model);
}

fn asked(shuffle_buffer: usize) -> SceneOverrides {
    SceneOverrides { shuffle_buffer: Some(shuffle_buffer), ..SceneOverrides::default() }
}

#[test]
fn photographs_drawn_at_random_teach_more_than_one_after_the_other() {
    let [at_once, shuffled] = [0, 60].map(|n| psnr(&trained_with(asked(n))));
    println!("at once {at_once:.2} dB, out of a buffer {shuffled:.2} dB");
    assert!(shuffled > at_once + 0.1, "at once {at_once:.2} dB, out of a buffer {shuffled:.2} dB");
}

#[test]
fn what_waits_is_drawn_at_rest_and_by_readers_of_a_checkpoint() {
    let mut session = Session::new(room(), asked(8), Selection::all_frames()).unwrap();
    for _ in 0..20 {
        assert!(matches!(session.step().unwrap(), Step::Trained(_)));
    }
    let compared = |session: &Session| {
        session.frames().iter().filter(|frame| frame.photograph.is_some()).count()
    };
    assert_eq!(compared(&session), 12, "eight of twenty are in the shuffle buffer");
    let used =
        |session: &Session| session.learner().device_use().photographs.unwrap().processor_frames;
    assert_eq!(used(&session), 12, "only trained photographs count");
    let before = session.splats();
    let model = session.checkpoint().unwrap().model;
    assert!(session.settle() && !session.settle() && session.is_settled(), "settles once");
    assert_eq!((compared(&session), used(&session)), (20, 20));
    assert!(session.checkpoint().unwrap().model == model, "settling changed the model");
    let settled = session.splats();
    assert!(settled != before);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.vbgs");
    session.save(&path).unwrap();
    assert!(SavedRun::read(&path).unwrap().splats().unwrap() == settled);
    // The next step continues from the trained model, not from the settled copy that was drawn.
    let mut resumed =
        SavedRun::read(&path).unwrap().resume(room(), &ResumeRequest::default(), false).unwrap();
    for session in [&mut session, &mut resumed] {
        assert!(matches!(session.step().unwrap(), Step::Trained(_)));
        assert!(!session.is_settled());
    }
    assert_eq!((used(&session), used(&resumed)), (13, 1));
    assert!(session.splats() == resumed.splats());
    assert!(session.checkpoint().unwrap().model == resumed.checkpoint().unwrap().model);
}

#[test]
fn settings_of_photographs_are_refused_without_training_on_them() {
    let asked = SceneOverrides { photometric: Some(PhotometricMode::Off), ..asked(5) };
    let error = Session::new(room(), asked, Selection::all_frames()).err().unwrap().to_string();
    assert!(error.contains("shuffle_buffer: expected 0") && error.contains("found 5"), "{error}");
    let photometric = Some(PhotometricMode::Off);
    let asked = SceneOverrides { photometric, textures: Some(7), ..SceneOverrides::default() };
    let error = Session::new(room(), asked, Selection::all_frames()).err().unwrap().to_string();
    assert!(error.contains("textures: expected 0") && error.contains("found 7"), "{error}");
}

#[test]
fn points_alone_are_not_gone_through_twice() {
    let asked =
        SceneOverrides { photometric: Some(PhotometricMode::Off), ..SceneOverrides::default() };
    let selection = Selection { passes: 2, ..Selection::all_frames() };
    let error = Session::new(room(), asked, selection).err().unwrap().to_string();
    assert!(error.contains("passes: expected 1") && error.contains("found 2"), "{error}");
}

#[test]
fn textures_are_a_stage_of_their_own() {
    // With a buffer, photographs are learned late, and settling learns those that are buffered.
    for (textures, shuffle_buffer) in [(50, 0), (50, 4), (0, 4)] {
        let asked = SceneOverrides { textures: Some(textures), ..asked(shuffle_buffer) };
        let mut session = Session::new(room(), asked, Selection::all_frames()).unwrap();
        for _ in 0..12 {
            assert!(matches!(session.step().unwrap(), Step::Trained(_)));
            session.settle();
        }
        for frame in session.frames() {
            let ms = frame.ms.stages;
            let of = |key| ms.stages().find(|(stage, _)| stage.key == key).unwrap().1;
            let sum: f64 = ms.values().iter().sum();
            assert!(of("photometric") > 0.0 && sum <= ms.train, "{ms:?}");
            assert_eq!(of("textures") > 0.0, textures > 0, "{ms:?}");
        }
    }
}

/// Damaged frames: a tenth, after the first frames, which establish the usual residual.
const DAMAGED: [usize; 4] = [12, 20, 28, 36];

/// Outlier frames among the compared photographs.
fn contradictions(compared: &[ComparedPhotograph]) -> impl Iterator<Item = usize> {
    let doubted = compared.iter().filter(|compared| compared.outcome.contradiction.is_some());
    doubted.map(|compared| compared.frame as usize)
}

/// Splats trained on all frames with `damage` applied to the `DAMAGED` ones, and the outlier frames found.
fn trained_on(damage: impl Fn(&mut Frame)) -> (SplatSet, Vec<usize>) {
    let room = room();
    let plan = Plan::new(&room, &Selection::all_frames(), 0).unwrap();
    let run = SceneRun::new(&room, &plan, &SceneOverrides::default()).unwrap();
    let surface = run.prepared_surface();
    let mut scene = SceneTrainer::new(&run.engine, surface.origin);
    let (mut preparer, mut seen) = (Preparer::new(), Observation::empty());
    let mut doubted = Vec::new();
    for i in 0..room.splits[0].frames.len() {
        let mut frame = room.load(0, i).unwrap();
        if DAMAGED.contains(&i) {
            damage(&mut frame);
        }
        preparer.prepare(&frame, &surface, &mut seen).unwrap();
        scene.learn(&seen).unwrap();
        doubted.extend(contradictions(scene.last_frame().compared_photographs));
    }
    scene.settle();
    doubted.extend(contradictions(scene.last_frame().compared_photographs));
    doubted.sort_unstable();
    (scene.splats(), doubted)
}

fn pixels_of(frame: &mut Frame) -> &mut Vec<[u8; 4]> {
    &mut Arc::make_mut(&mut frame.color).data
}

/// Name and effect of a kind of damage.
type Damage = (&'static str, fn(&mut Frame));

/// Covered lenses, overexposure, wrong poses and images of other places are detected and skipped. Point
/// colours of another place may resemble the scene's, so there only the photograph is skipped.
#[test]
fn frames_that_contradict_the_scene_are_named_and_left_out() {
    let (clean, none) = trained_on(|_| ());
    assert!(none.is_empty(), "{none:?}");
    let clean = psnr(&clean);
    let damages: [Damage; 4] = [
        ("black", |frame| pixels_of(frame).fill([0, 0, 0, 255])),
        ("saturated", |frame| pixels_of(frame).fill([255; 4])),
        ("turned", |frame| {
            let turn = DQuat::from_rotation_y(0.3);
            frame.camera.pose = frame.camera.pose.attached_camera(DVec3::new(0.1, 0.0, 0.0), turn);
        }),
        ("another image", |frame| pixels_of(frame).reverse()),
    ];
    for (name, damage) in damages {
        let (harmed, doubted) = trained_on(damage);
        let harmed = psnr(&harmed);
        println!("{name}: {harmed:.2} dB, clean {clean:.2} dB, doubted {doubted:?}");
        assert!(doubted == DAMAGED, "{name}: {doubted:?}");
        assert!(harmed > clean - 0.3, "{name}: clean {clean:.2} dB, harmed {harmed:.2} dB");
    }
}
