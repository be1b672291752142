//! Quality during and after training, and the card shown at the end.

use super::harness::{click, dataset, is, train, wait, wait_for_label, window, write_to};
use super::viewer::{evaluated_on_black, position, session};
use crate::common::adapter::turn;
use crate::common::shared;
use eframe::egui::Key;
use eframe::egui::accesskit::Role;
use egui_kittest::kittest::Queryable;
use std::fs;
use std::path::Path;
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::app::wording;
use vbgs_studio::app::{Painting, Studio};
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::{SyntheticLayout, write};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::scene::units::StructuralScale;

#[test]
fn held_out_views_are_measured_as_eval_does_and_a_click_flies_there() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    // Views from the side, with the same picture as the held-out one.
    fs::copy(path.join("transforms_eval.json"), path.join("transforms_free.json")).unwrap();
    let subject = Some(Subject::Path(path.clone()));
    let Some(mut window) = window(subject, Painting::Auto) else { return };
    // Panels appear while loading, and a tab that moves between press and release is not clicked.
    wait(&mut window, "ready", is(RunState::Ready));
    click(&mut window, "Quality");
    train(&mut window);
    wait(&mut window, "the result", |s| s.quality().result().is_some());
    let session = session(&path, SceneOverrides::default());
    let held_out = (session.dataset().evaluation(session.plan().split).new_views.split, 0);
    let expected = evaluated_on_black(&session, held_out);
    let result = window.state().quality().result().unwrap();
    assert!((result.psnr - expected.psnr).abs() < 1e-9, "{result:?}");
    assert_eq!(result.frames, 3);
    assert!(result.depth_error.is_some() && result.seconds > 0.0);
    assert_eq!(result.components, window.state().snapshot().model.used);
    for metric in ["Splats", "SSIM", "Depth error", "PSNR"] {
        window.get_by_role_and_label(Role::Button, metric).click_accesskit();
        window.run_steps(2);
    }
    wait_for_label(&mut window, &format!("PSNR {:.2} dB", expected.psnr));
    wait(&mut window, "views from the side", |s| s.quality().side_result().is_some());
    let side = window.state().quality().side_result().unwrap();
    assert!((side.psnr - expected.psnr).abs() < 1e-9, "{side:?}");
    assert_eq!(window.state().quality().side_progress(3), (1, 1));
    for name in ["New views", "From the side"] {
        let (psnr, ssim, detail) = (side.psnr, side.ssim, side.detail.unwrap());
        let line = format!("{name}: {psnr:.2} dB, SSIM {ssim:.3}, detail {detail} (views: 1)");
        wait_for_label(&mut window, &line);
    }
    wait(&mut window, "what is kept", |s| {
        let kept = s.quality().retention.frames.first();
        kept.and_then(|kept| kept.psnr.last()).is_some_and(|[frames, _]| *frames == 3.0)
    });
    let first = (session.plan().split, session.plan().frames[0]);
    let [kept] = &window.state().quality().retention.frames[..] else { panic!("one frame") };
    let expected = evaluated_on_black(&session, first).psnr;
    let [_, psnr] = *kept.psnr.last().unwrap();
    assert!((psnr - expected).abs() < 0.01, "{psnr} dB, not {expected}");
    window.run_steps(2);
    window.get_by_label("Retention");
    wait(&mut window, "the evidence", |s| {
        s.view().palette.attributes().iter().any(|k| k.evidence.is_some())
    });
    window.run_steps(2);
    let drawn =
        window.state().view().palette.attributes().iter().filter(|k| k.evidence.is_some()).count();
    let counted = wording::count(drawn, "splat");
    window.get_by_label_contains(&format!("{counted}. The Edit tab"));
    let name = window.state().quality().views[0].frame.clone();
    // By accessibility action, since the entry may lie below the visible part of the panel.
    window.get_by_label(&name).click_accesskit();
    window.run_steps(2);
    assert_eq!(position(&window), Some(held_out));
    assert!(window.state().view().comparison.mode().has_photo());
}

/// Shifts the poses of a recording by up to 2 cm along x, as an inaccurate tracker does.
fn sway(poses: &Path) {
    let text = fs::read_to_string(poses).unwrap();
    let lines = text.lines().enumerate().map(|(i, line)| {
        let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        if let Some(Ok(x)) = words.get(1).map(|x| x.parse::<f64>()) {
            words[1] = (x + 0.02 * (0.5 * i as f64).sin()).to_string();
        }
        words.join(" ") + "\n"
    });
    fs::write(poses, lines.collect::<String>()).unwrap();
}

#[test]
fn views_of_a_camera_whose_poses_were_corrected_are_drawn_from_where_it_stood() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room");
    let params = SyntheticParams {
        width: 128,
        height: 96,
        n_train: 52,
        n_eval: 0,
        seed: 1,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    write(&params, &path, SyntheticLayout::Tum, &mut |_, _| {}).unwrap();
    sway(&path.join("groundtruth.txt"));
    let subject = Some(Subject::Path(path.clone()));
    let Some(mut window) = window(subject, Painting::Auto) else { return };
    train(&mut window);
    wait(&mut window, "the result", |s| s.quality().result().is_some());
    let session = session(&path, SceneOverrides::default());
    let evaluation = session.dataset().evaluation(session.plan().split).new_views;
    let held_out = evaluation
        .frames
        .iter()
        .map(|&index| evaluated_on_black(&session, (evaluation.split, index)).psnr);
    let expected = held_out.clone().sum::<f64>() / held_out.len() as f64;
    let (splats, frames) = (session.splats(), &session.dataset().splits[evaluation.split].frames);
    let was_corrected = |&index: &usize| {
        let pose = frames[index].camera.pose;
        splats.finishing().corrected_pose(&pose) != pose
    };
    assert!(evaluation.frames.iter().any(was_corrected));
    let result = window.state().quality().result().unwrap();
    assert!((result.psnr - expected).abs() < 1e-9, "{result:?}, expected {expected}");
    assert!(result.covered.is_some());
}

#[test]
fn the_summary_at_the_end_trains_again_finer_and_the_view_stays() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    window.run_steps(3);
    window.get_by_label_contains("Done: 3 frames in ");
    wait(&mut window, "quality", |s| s.quality().result().is_some());
    let (before, eye) = (window.state().snapshot(), window.state().view().camera.eye());
    click(&mut window, "Retrain finer");
    wait(&mut window, "the end of the finer run", |s| {
        let now = s.snapshot();
        now.state == RunState::Finished && now.model.used > before.model.used
    });
    let now = window.state().snapshot();
    let scale = |opened: &vbgs_studio::app::state::Opened| match opened.scene().unwrap().scale {
        StructuralScale::Pixels(pixels) => pixels,
        StructuralScale::World(_) => panic!("pixels"),
    };
    let [coarse, fine] = [&before, &now].map(|s| scale(s.opened.as_ref().unwrap()));
    assert!((fine / coarse - std::f64::consts::FRAC_1_SQRT_2).abs() < 1e-9);
    // Equal up to rounding, since the camera is converted to angles and back.
    let moved = window.state().view().camera.eye().unwrap().distance(eye.unwrap());
    assert!(moved < 1e-9, "by {moved}");
    wait(&mut window, "still", is(RunState::Finished));
}

/// Curves of a window: quality, and retention of the first frame, each by number of frames.
fn curves(studio: &Studio) -> [Vec<[f64; 2]>; 2] {
    let quality = studio.quality();
    let points = quality.history.iter().map(|point| [point.frames as f64, point.psnr]);
    let first = quality.retention.frames.first();
    [points.collect(), first.map_or_else(Vec::new, |first| first.psnr.clone())]
}

#[test]
fn every_run_has_curves_of_ten_moments_that_a_checkpoint_keeps() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Some(Subject::Path(dataset(folder.path(), 24)));
    let Some(mut first) = window(subject, Painting::Auto) else { return };
    train(&mut first);
    wait(&mut first, "moments", |s| {
        let moments = s.view().editor().stored_scenes.moments();
        assert!(moments.len() >= 10, "{} moments", moments.len());
        let kept = moments.iter().map(|moment| moment.after.n_trained);
        let all = kept.chain([s.snapshot().frames_done]).map(|n| n as f64);
        curves(s).iter().all(|c| all.clone().all(|n| c.iter().any(|point| point[0] == n)))
    });
    let (measured, end) = (curves(first.state()), first.state().snapshot().frames_done as f64);
    for curve in &measured {
        let largest = curve.windows(2).map(|pair| pair[1][0] - pair[0][0]).fold(0.0, f64::max);
        assert!(curve.last().unwrap()[0] == end && largest <= end / 4.0, "{curve:?}");
    }
    let file = folder.path().join("run.vbgs");
    write_to(&mut first, Key::S, "Save", &file);
    wait(&mut first, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    drop(first);

    let Some(mut again) = window(Some(Subject::Path(file)), Painting::Auto) else { return };
    wait(&mut again, "the run", is(RunState::Finished));
    wait(&mut again, "its curves", |s| !s.quality().history.is_empty());
    let known = curves(again.state());
    // The last point may have been measured again meanwhile.
    let agree = |(a, b): (&[f64; 2], &[f64; 2])| a[0] == b[0] && (a[1] - b[1]).abs() < 1e-6;
    for (known, measured) in known.iter().zip(&measured) {
        assert_eq!(known.len(), measured.len());
        assert!(known.iter().zip(measured).all(agree), "{known:?}, not {measured:?}");
    }
}

/// Each of its scenes has several megabytes of textures.
#[test]
fn a_textured_run_keeps_ten_scenes_within_the_budget() {
    let _turn = turn();
    let Some(room) = shared("data/kinect_office") else { return };
    let Some(mut window) = window(Some(Subject::Path(room)), Painting::Auto) else { return };
    train(&mut window);
    window.run_steps(2);
    let stored = &window.state().view().editor().stored_scenes;
    let kept: Vec<usize> = stored.moments().iter().map(|moment| moment.after.n_seen).collect();
    let largest = kept.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
    assert!(kept.len() >= 10 && largest <= 25, "{kept:?}");
    let last = stored.moments().last().unwrap().splats().unwrap();
    let (_, of_textures) = last.finishing().texture_size();
    assert!(of_textures > 10_000_000 && stored.bytes() <= 512_000_000, "{of_textures}");
}
