//! The graphics device is lost, or runs out of memory, during each activity of the window: training,
//! orbiting, comparing renderers, previewing a file, rendering a film. The timing is drawn from a seed;
//! `VBGS_WINDOW_LOSSES=200 cargo test --release --test app -- --nocapture moment` tests more cases.

use super::crash::attached;
use super::harness::{
    PATIENCE, Window, click, dataset, drag_between, drop_on, enter_path, is, settled, wait,
    wait_for_picture,
};
use super::inspect::MIDDLE;
use super::random::asked;
use super::viewer::{choose, press};
use crate::common::adapter::{turn, vulkan};
use eframe::egui::accesskit::Role;
use eframe::egui::{Event, Key, Modifiers, PointerButton, Vec2};
use egui_kittest::kittest::Queryable;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use vbgs_studio::app::edit::marks::Mark;
use vbgs_studio::app::state::{Notice, NoticeKind, RunState, Subject};
use vbgs_studio::app::worker::{Worker, WorkerOrder};
use vbgs_studio::app::{Exit, ExitReason, Painting};
use vbgs_studio::math::rng::{Purpose, Rng};

/// Frames of the dataset, enough that some are always untrained.
const FRAMES: usize = 60;
/// Maximum number of passes before the device is lost.
const MAX_PASSES: usize = 25;

/// Activity of the window when the device fails.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Moment {
    Training,
    Orbiting,
    Comparing,
    Previewing,
    Filming,
}

const MOMENTS: [Moment; 5] =
    [Moment::Training, Moment::Orbiting, Moment::Comparing, Moment::Previewing, Moment::Filming];

/// A worker that outlives its windows.
struct Run {
    folder: tempfile::TempDir,
    worker: Arc<Worker>,
    exit: Exit,
}

impl Run {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        dataset(folder.path(), FRAMES);
        let folders = vec![folder.path().join("rescued")];
        let worker = Arc::new(Worker::start_with(Arc::new(|| {}), folders).unwrap());
        worker.send(WorkerOrder::Open(Subject::Path(folder.path().join("room"))));
        Self { folder, worker, exit: Exit::default() }
    }

    /// Opens the next window and waits until it draws the scene.
    fn window(&mut self, painting: Painting) -> (Window, wgpu::Device) {
        self.exit = self.exit.for_next_window();
        let first = vec![WorkerOrder::Deliver];
        let (mut window, device) = attached(&self.worker, &self.exit, first, painting);
        wait(&mut window, "the dataset", |s| s.snapshot().opened.is_some());
        if window.state().snapshot().frames_done == 0 {
            click(&mut window, "Train");
        }
        wait(&mut window, "splats", |s| s.n_drawn() > 100);
        wait_for_picture(&mut window);
        (window, device)
    }
}

/// Starts the activity.
fn begin(window: &mut Window, moment: Moment, folder: &Path) {
    match moment {
        Moment::Training if is(RunState::Finished)(window.state()) => {
            drop_on(window, &folder.join("room"));
            window.run_steps(2);
            click(window, "Discard");
            wait(window, "ready", is(RunState::Ready));
            window.key_press(Key::Space);
            wait(window, "frames", |s| s.snapshot().frames_done > 0);
        }
        Moment::Training => {}
        Moment::Orbiting => {
            window.event(Event::PointerMoved(MIDDLE));
            let (pos, button, modifiers) = (MIDDLE, PointerButton::Primary, Modifiers::NONE);
            window.event(Event::PointerButton { pos, button, pressed: true, modifiers });
            window.step();
            window.event(Event::PointerMoved(MIDDLE + Vec2::new(40.0, 20.0)));
        }
        Moment::Comparing => choose(window, 0, "Wipe renderers"),
        Moment::Previewing => {
            window.key_press_modifiers(Modifiers::COMMAND, Key::E);
            window.run_steps(2);
            enter_path(window, &folder.join("scene.ply"));
        }
        Moment::Filming => draw_film(window, &folder.join("film")),
    }
}

/// Starts rendering a turntable film.
pub fn draw_film(window: &mut Window, output: &Path) {
    click(window, "Path");
    click(window, "Turntable");
    click(window, "Render film…");
    window.run_steps(2);
    // The Path tab has a text field too, but the dialog's field has the focus.
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.event(Event::Text(output.display().to_string()));
    window.run_steps(2);
    window.get_by_role_and_label(Role::Button, "Render film").click();
    window.step();
    // A background thread checks for existing files, so wait for the dialog to close.
    let started = Instant::now();
    while window.query_by_role_and_label(Role::Button, "Render film").is_some() {
        assert!(started.elapsed() < PATIENCE, "the dialog stays");
        if window.query_by_label("Replace").is_some() {
            click(window, "Replace");
        }
        window.step();
    }
}

/// Requests a texture larger than any machine's memory, which the driver refuses at once.
fn ask_for_too_much(device: &wgpu::Device) {
    let limits = device.limits();
    let side = limits.max_texture_dimension_2d;
    let _ = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("too much"),
        size: wgpu::Extent3d {
            width: side,
            height: side,
            depth_or_array_layers: limits.max_texture_array_layers,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
}

/// Steps the window until it reports the device loss.
fn leaves(window: &mut Window, exit: &Exit, told: &str) {
    let started = Instant::now();
    while exit.reason.get() != ExitReason::DeviceLost {
        assert!(started.elapsed() < PATIENCE, "{told}: the loss is not detected");
        window.step();
    }
}

/// Returns the notice about a film after its window closed: written, or cut off by the device loss.
fn said_of_film(worker: &Worker) -> Option<Notice> {
    let is_of_film = |notice: &&Notice| {
        notice.text.contains("the window that rendered it") || notice.text.contains("pictures to")
    };
    let asked = Instant::now();
    while asked.elapsed() < PATIENCE {
        let said = worker.snapshot().notices.iter().find(is_of_film).cloned();
        if said.is_some() {
            return said;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    None
}

#[test]
fn at_any_moment_a_lost_device_costs_a_window_and_nothing_else() {
    let _turn = turn();
    if vulkan().is_none() {
        return;
    }
    let mut rng = Rng::new(asked("VBGS_WINDOW_SEED").unwrap_or(1), Purpose::Synthetic, 0);
    let mut run = Run::new();
    for round in 0..asked("VBGS_WINDOW_LOSSES").unwrap_or(MOMENTS.len() as u64) {
        let moment = MOMENTS[round as usize % MOMENTS.len()];
        let painting = [Painting::Auto, Painting::Gpu][rng.below(2)];
        let (mut window, device) = run.window(painting);
        begin(&mut window, moment, run.folder.path());
        let passes = rng.below(MAX_PASSES);
        let told = format!("round {round}, {moment:?} for {passes} passes, {painting:?}");
        window.run_steps(passes);
        let before = run.worker.snapshot();
        device.destroy();
        leaves(&mut window, &run.exit, &told);
        drop(window);
        let after = run.worker.snapshot();
        assert!(run.worker.is_alive() && run.worker.crash().is_none(), "{told}");
        assert!(after.frames_done >= before.frames_done, "{told}: trained frames were lost");
        if moment == Moment::Filming {
            let film = said_of_film(&run.worker)
                .unwrap_or_else(|| panic!("{told}: no notice about the film"));
            let is_cut = film.kind == NoticeKind::Warning && film.text.contains("render it again");
            assert!(is_cut || film.text.contains("Wrote"), "{told}: {}", film.text);
        }
    }
    // Training continued, and the last window draws.
    let (mut window, _device) = run.window(Painting::Auto);
    wait(&mut window, "the end", is(RunState::Finished));
    assert_eq!(window.state().snapshot().frames_done, FRAMES);
}

#[test]
fn at_any_moment_a_device_without_memory_costs_a_notice() {
    let _turn = turn();
    if vulkan().is_none() {
        return;
    }
    let mut rng = Rng::new(asked("VBGS_WINDOW_SEED").unwrap_or(3), Purpose::Synthetic, 0);
    let mut run = Run::new();
    for painting in [Painting::Auto, Painting::Gpu] {
        let (mut window, device) = run.window(painting);
        for moment in MOMENTS {
            begin(&mut window, moment, run.folder.path());
            window.run_steps(rng.below(MAX_PASSES));
            ask_for_too_much(&device);
            let told = |s: &vbgs_studio::app::Studio| {
                s.snapshot()
                    .notices
                    .iter()
                    .any(|notice| notice.kind == NoticeKind::Error && notice.text.contains("emory"))
            };
            wait(&mut window, "the notice", told);
            press(&mut window, Key::Escape);
            press(&mut window, Key::Escape);
            window.event(Event::PointerGone);
            wait_for_picture(&mut window);
            assert_eq!(run.exit.reason.get(), ExitReason::Closed, "{moment:?}, {painting:?}");
            assert!(run.worker.crash().is_none(), "{moment:?}, {painting:?}");
        }
    }
}

/// Deleted splats stay deleted and keyframes are kept in the next window.
#[test]
fn edits_camera_and_path_go_on_in_the_next_window() {
    let _turn = turn();
    if vulkan().is_none() {
        return;
    }
    let mut run = Run::new();
    let (mut window, device) = run.window(Painting::Auto);
    wait(&mut window, "the end", is(RunState::Finished));
    settled(&mut window);
    let all = window.state().n_drawn();
    click(&mut window, "Path");
    click(&mut window, "Add keyframe");
    drag_between(&mut window, PointerButton::Primary, MIDDLE, MIDDLE + Vec2::new(50.0, 10.0));
    press(&mut window, Key::B);
    drag_between(
        &mut window,
        PointerButton::Primary,
        MIDDLE - Vec2::splat(90.0),
        MIDDLE + Vec2::splat(90.0),
    );
    press(&mut window, Key::B);
    press(&mut window, Key::Delete);
    let edits = window.state().view().editor().edits().clone();
    assert!(edits.count(Mark::Deleted) > 0, "the box holds no splat");
    wait(&mut window, "fewer splats", move |s| s.n_drawn() < all);
    let (eye, drawn) = (window.state().view().camera.eye(), window.state().n_drawn());
    device.destroy();
    leaves(&mut window, &run.exit, "edited");
    drop(window);

    let (mut window, _device) = run.window(Painting::Auto);
    wait(&mut window, "as many splats", move |s| s.n_drawn() == drawn);
    let view = window.state().view();
    assert!(*view.editor().edits() == edits, "other edits");
    assert_eq!(view.camera.eye(), eye);
    click(&mut window, "Path");
    assert!(window.query_by_label_contains("and add keyframes").is_none(), "no keyframe");
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    wait(&mut window, "all of them again", move |s| s.n_drawn() == all);
}
