//! Slowdown of training by the window, as ratios of paired runs without a display. On a GPU the ratios should
//! differ from 1 only by noise. Prints the figures for the present adapter:
//! `VBGS_FRAMES=60 VBGS_PAIRS=3 cargo test --release --test app -- --ignored --nocapture beside_training`.

use super::harness::{PATIENCE, Window, click, is, step, wait, window};
use super::waiting::large;
use crate::common::adapter::turn;
use eframe::egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::kittest::Queryable;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::app::worker::{Worker, WorkerOrder};

/// Interval of a 60 Hz display.
const REFRESH: Duration = Duration::from_micros(16_667);
/// Point where the simulated drag begins.
const HOLD: Pos2 = Pos2::new(300.0, 300.0);

/// Load that runs beside the trainer.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Beside {
    NoWindow,
    /// A window that draws on repaint requests.
    Window,
    /// The same without stored copies of earlier frames.
    WindowWithoutPast,
    /// A window whose camera is dragged all the time.
    Orbiting,
}

/// Frames of a run and number of pairs. The defaults only test that the measurement runs; their ratios mean
/// nothing.
fn extent() -> (usize, usize) {
    let number = |name, otherwise| {
        std::env::var(name).ok().and_then(|text: String| text.parse().ok()).unwrap_or(otherwise)
    };
    (number("VBGS_FRAMES", 8), number("VBGS_PAIRS", 1))
}

/// Seconds of training all frames but the first.
fn trained_s(room: &Path, beside: Beside) -> Option<f64> {
    let subject = Subject::Path(room.to_owned());
    if beside == Beside::NoWindow {
        return Some(trained_alone_s(subject));
    }
    let mut window = window(Some(subject), Painting::Auto)?;
    wait(&mut window, "ready", is(RunState::Ready));
    step(&mut window);
    wait(&mut window, "a frame", |s| s.snapshot().frames_done == 1 && s.n_drawn() > 0);
    if beside == Beside::WindowWithoutPast {
        keep_no_past(&mut window);
    }
    let before = window.state().snapshot().pace.trained_s;
    window.key_press(Key::Space);
    window.step();
    if beside == Beside::Orbiting {
        press(&mut window, true);
    }
    let started = Instant::now();
    for pass in 0.. {
        let begun = Instant::now();
        if beside == Beside::Orbiting {
            let swing = (pass % 200_usize).abs_diff(100) as f32;
            window.event(Event::PointerMoved(HOLD + Vec2::new(2.0 * swing, 0.0)));
        }
        if beside == Beside::Orbiting || window.ctx.has_requested_repaint() {
            window.step();
            window.render().unwrap();
        }
        if is(RunState::Finished)(window.state()) {
            break;
        }
        assert!(started.elapsed() < 2 * PATIENCE, "it is never trained");
        std::thread::sleep(REFRESH.saturating_sub(begun.elapsed()));
    }
    let moments = window.state().view().editor().stored_scenes.moments().len();
    assert_eq!(moments == 0, beside == Beside::WindowWithoutPast, "{moments} moments");
    Some(window.state().snapshot().pace.trained_s - before)
}

fn trained_alone_s(subject: Subject) -> f64 {
    let worker = Worker::start(Arc::new(|| {})).unwrap();
    let reached = |state, frames| {
        let started = Instant::now();
        while worker.snapshot().state != state || worker.snapshot().frames_done < frames {
            assert!(started.elapsed() < 2 * PATIENCE, "it is never {state:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
        worker.snapshot().pace.trained_s
    };
    worker.send(WorkerOrder::Open(subject));
    reached(RunState::Ready, 0);
    worker.send(WorkerOrder::Step);
    let before = reached(RunState::Paused, 1);
    worker.send(WorkerOrder::Train);
    reached(RunState::Finished, 2) - before
}

fn press(window: &mut Window, pressed: bool) {
    window.event(Event::PointerMoved(HOLD));
    window.step();
    let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
    window.event(Event::PointerButton { pos: HOLD, button, pressed, modifiers });
    window.step();
}

/// Turns off the stored copies of earlier frames, as the user can.
fn keep_no_past(window: &mut Window) {
    click(window, "Edit");
    window.get_by_label("Disk space for earlier frames").focus();
    window.run_steps(3);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.event(Event::Text("0".to_owned()));
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(2);
    assert_eq!(window.state().view().settings.panels.past_mb, 0);
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Ratios of the training times of paired runs. Runs alternate, so other load on the machine affects both.
fn ratios(room: &Path, one: Beside, other: Beside, n_pairs: usize) -> Option<Vec<f64>> {
    let mut ratios = Vec::new();
    for _ in 0..n_pairs {
        ratios.push(trained_s(room, one)? / trained_s(room, other)?);
    }
    Some(ratios)
}

fn room() -> (tempfile::TempDir, PathBuf, usize) {
    let folder = tempfile::tempdir().unwrap();
    let (n_frames, n_pairs) = extent();
    let room = large(folder.path(), n_frames);
    (folder, room, n_pairs)
}

#[test]
#[ignore = "trains some minutes; ratios are of a quiet machine"]
fn figures_beside_training() {
    let _turn = turn();
    let (_folder, room, n_pairs) = room();
    let cases = [
        (Beside::Window, Beside::NoWindow),
        (Beside::Orbiting, Beside::Window),
        (Beside::Window, Beside::WindowWithoutPast),
    ];
    for (one, other) in cases {
        let Some(ratios) = ratios(&room, one, other, n_pairs) else { return };
        let middle = median(ratios.clone());
        println!("training time {one:?} / {other:?}: {ratios:.3?}, median {middle:.3}");
        // A busy machine can far exceed the targets, and a single short pair can give any ratio.
        let is_told = n_pairs > 1;
        assert!(
            !is_told || middle < 2.0,
            "{one:?} costs training {middle:.2} times the time of {other:?}"
        );
    }
}
