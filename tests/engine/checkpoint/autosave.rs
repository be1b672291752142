//! Autosaves: when they are due, failures, and the time they cost training.

use super::*;
use std::time::{Duration, Instant};
use vbgs_studio::eval::report::quantile;
use vbgs_studio::pipeline::autosave::{Autosave, AutosaveInterval, Autosaved};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::scene::units::StructuralScale;

fn every(frames: usize) -> AutosaveInterval {
    AutosaveInterval { frames: Some(frames), time: None }
}

fn frames_in(path: &Path) -> u64 {
    SavedRun::read(path).unwrap().content.cursor.frames
}

#[test]
fn saves_fall_due_by_frames_or_by_time() {
    let folder = tempfile::tempdir().unwrap();
    let (path, kept) = (folder.path().join("run.vbgs"), folder.path().join("run.vbgs.bak"));
    let mut session = Session::new(room(), off(), first(10)).unwrap();
    let mut autosave = Autosave::new(path.clone(), every(4), &session);
    let mut saved = Vec::new();
    while !matches!(session.step().unwrap(), Step::Finished) {
        assert!(autosave.poll(&session).is_none(), "the save is collected below");
        saved.extend(autosave.wait().map(|outcome| outcome.unwrap().frames));
    }
    assert_eq!(saved, [4, 8], "at multiples of four frames");
    assert_eq!((frames_in(&path), frames_in(&kept)), (8, 4));

    let soon = AutosaveInterval { frames: None, time: Some(Duration::from_millis(1)) };
    autosave.set_interval(soon);
    std::thread::sleep(Duration::from_millis(2));
    assert!(autosave.poll(&session).is_none());
    let Some(Ok(last)) = autosave.wait() else { panic!("the last two frames were not saved") };
    let bytes = std::fs::metadata(&path).unwrap().len();
    assert_eq!(last, Autosaved { frames: 10, bytes });
    std::thread::sleep(Duration::from_millis(2));
    autosave.poll(&session);
    assert!(autosave.wait().is_none(), "nothing new to save");
    assert_eq!((frames_in(&path), frames_in(&kept)), (10, 8));
    let again = SavedRun::read(&path).unwrap().content;
    assert!(timeless(again) == timeless(session.checkpoint().unwrap()));
}

#[test]
fn a_failed_save_is_said_and_tried_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("disk/run.vbgs");
    let mut session = Session::new(room(), off(), first(4)).unwrap();
    let mut autosave = Autosave::new(path.clone(), every(1), &session);
    session.step().unwrap();
    assert!(autosave.poll(&session).is_none());
    let said = autosave.wait().unwrap().unwrap_err().to_string();
    for part in ["run.vbgs", "does not exist", "training continues", "when it is due"] {
        assert!(said.contains(part), "{part:?} is missing in: {said}");
    }
    std::fs::create_dir(folder.path().join("disk")).unwrap();
    session.step().unwrap();
    assert!(autosave.poll(&session).is_none());
    assert_eq!(autosave.wait().unwrap().unwrap().frames, 2);
    session.step().unwrap();
    autosave.poll(&session);
    drop(autosave);
    assert_eq!(frames_in(&path), 3, "dropping waits for the save in flight");
}

/// Time that a save after every frame adds to the frames, and how long it blocks the training thread.
#[test]
#[ignore = "measures; needs an optimised build and some minutes"]
fn figures_of_a_save_beside_training() {
    for components in [25_000, 200_000] {
        let (mut session, frame) = large(components);
        let used = session.learner().status().used;
        let path = tempfile::tempdir().unwrap();
        let (mut stalls, mut saves) = (Vec::new(), 0);
        let mut autosave = Autosave::new(path.path().join("run.vbgs"), every(1), &session);
        let mut during = Vec::new();
        for _ in 0..24 {
            let Step::Trained(report) = session.step().unwrap() else { break };
            during.push(report.ms.stages.train);
            let started = Instant::now();
            let ended = autosave.poll(&session);
            stalls.push(started.elapsed().as_secs_f64() * 1e3);
            saves += usize::from(ended.is_some());
        }
        autosave.wait();
        stalls.retain(|ms| *ms > 0.05);
        let sorted = |mut ms: Vec<f64>| {
            ms.sort_by(f64::total_cmp);
            ms
        };
        let (stalls, during) = (sorted(stalls), sorted(during));
        let (stall, longest) = (quantile(&stalls, 0.5), quantile(&stalls, 1.0));
        println!(
            "{used} components: a frame takes {frame:.1} ms, {:.1} ms with a save always in flight; the copy for a save {stall:.1} ms, at most {longest:.1} ms, {} of them, {saves} ended",
            quantile(&during, 0.5),
            stalls.len()
        );
        assert!(stall <= frame, "{stall} ms against {frame} ms");
    }
}

/// Session with at least `components` components and frames left, and its median time per frame in ms.
fn large(components: usize) -> (Session, f64) {
    let params = SyntheticParams {
        width: 640,
        height: 480,
        n_train: 150,
        n_eval: 1,
        seed: 4,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    let room = Arc::new(dataset(&params).unwrap());
    // The number of components grows with the inverse square of their spacing.
    let h = 0.035 * (25_000.0 / components as f64).sqrt();
    let asked =
        SceneOverrides { scale: Some(StructuralScale::World(h)), ..SceneOverrides::default() };
    let mut session = Session::new(room, asked, Selection::all_frames()).unwrap();
    let mut ms = Vec::new();
    while session.learner().status().used < components || ms.len() < 8 {
        let Step::Trained(frame) = session.step().unwrap() else {
            panic!("only {} components", session.learner().status().used)
        };
        ms.push(frame.ms.stages.train);
    }
    let mut last = ms.split_off(ms.len() - 8);
    last.sort_by(f64::total_cmp);
    (session, quantile(&last, 0.5))
}
