//! The application window without a display, and helpers that drive it.

use crate::common::adapter::vulkan;
use eframe::CreationContext;
use eframe::egui::accesskit::Role;
use eframe::egui::{
    Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, OutputCommand, PointerButton, Pos2,
    TouchPhase, Vec2,
};
use eframe::egui_wgpu::{RenderState, RendererOptions, WgpuSetup, WgpuSetupExisting};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use egui_kittest::wgpu::{create_render_state, default_wgpu_setup};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::app::worker::{Worker, WorkerOrder};
use vbgs_studio::app::{Exit, Painting, Studio};
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::{DepthBits, SyntheticLayout, write};

pub type Window = Harness<'static, Studio>;

/// Longest wait for any condition, generous for a loaded machine.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// Returns the device shared by all windows, except those whose device a test destroys; the first call
/// creates it. `None` without a Vulkan adapter outside strict mode.
pub fn device() -> Option<WgpuSetup> {
    static DEVICE: OnceLock<WgpuSetupExisting> = OnceLock::new();
    if DEVICE.get().is_none() {
        vulkan()?;
        let options = RendererOptions::PREDICTABLE;
        let state = create_render_state(default_wgpu_setup(), options);
        let RenderState { instance, adapter, device, queue, .. } = state;
        let _ = DEVICE.set(WgpuSetupExisting { instance, adapter, device, queue });
    }
    DEVICE.get().cloned().map(WgpuSetup::Existing)
}

/// Creates the application with a worker of its own, and opens the subject.
pub fn studio(cc: &CreationContext<'_>, subject: Option<Subject>, painting: Painting) -> Studio {
    // Of its own, so that no window offers what another one left. It lives as long as the worker.
    let state = tempfile::tempdir().unwrap();
    let folder = state.path().to_owned();
    studio_in(cc, (folder, state), subject, painting)
}

/// Like [`studio`], with the folder for files that the program writes without a prompt, and what that folder
/// needs to exist.
fn studio_in(
    cc: &CreationContext<'_>,
    (folder, state): (PathBuf, impl Send + Sync + 'static),
    subject: Option<Subject>,
    painting: Painting,
) -> Studio {
    let (window, folders) = (cc.egui_ctx.clone(), vec![folder]);
    let waker = move || {
        let _kept = &state;
        window.request_repaint();
    };
    let worker = Worker::start_with(Arc::new(waker), folders).unwrap();
    let first = subject.map_or(WorkerOrder::Deliver, WorkerOrder::Open);
    let (worker, exit) = (Arc::new(worker), Exit::default());
    Studio::attach(cc, worker, vec![first], exit, painting, Instant::now()).unwrap()
}

/// Opens the window; `None` without a Vulkan adapter outside strict mode.
pub fn window(subject: Option<Subject>, painting: Painting) -> Option<Window> {
    built(move |cc| studio(cc, subject, painting))
}

/// Opens the window with a folder for files that the program writes without a prompt.
pub fn window_in(folder: PathBuf, subject: Subject) -> Option<Window> {
    built(move |cc| studio_in(cc, (folder, ()), Some(subject), Painting::Auto))
}

fn built(studio: impl FnOnce(&CreationContext<'_>) -> Studio) -> Option<Window> {
    let harness = Harness::builder()
        .with_size(Vec2::new(1000.0, 640.0))
        .with_max_steps(8)
        .wgpu_setup(device()?)
        .build_eframe(move |cc| studio(cc));
    Some(harness)
}

#[derive(Debug)]
struct Dropped(PathBuf);

impl eframe::egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|e| e.to_string())
    }
}

pub fn drop_on(window: &mut Window, path: &Path) {
    drop_all_on(window, &[path]);
}

/// Drops several files or folders at once.
pub fn drop_all_on(window: &mut Window, paths: &[&Path]) {
    for path in paths {
        window.input_mut().dropped_files.push(Arc::new(Dropped(path.to_path_buf())));
    }
    window.step();
}

/// Opens the window with the paper preset and loads a dataset.
pub fn paper_window(path: &Path, painting: Painting) -> Option<Window> {
    let mut window = window(None, painting)?;
    click(&mut window, "Settings");
    click(&mut window, "Paper preset");
    drop_on(&mut window, path);
    wait(&mut window, "ready", is(RunState::Ready));
    Some(window)
}

/// Steps the window until the condition holds.
pub fn wait(window: &mut Window, what: &str, condition: impl Fn(&Studio) -> bool) {
    let started = Instant::now();
    loop {
        window.step();
        if condition(window.state()) {
            // The step may have drawn an older state than the one that meets the condition.
            window.step();
            return;
        }
        let snapshot = window.state().snapshot();
        let notices: Vec<&str> = snapshot.notices.iter().map(|n| n.text.as_str()).collect();
        assert!(
            started.elapsed() < PATIENCE,
            "waited for {what}, still {:?}; {notices:?}",
            snapshot.state
        );
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Waits for a condition of a worker without a window.
pub fn until(what: &str, condition: impl Fn() -> bool) {
    let started = Instant::now();
    while !condition() {
        assert!(started.elapsed() < PATIENCE, "waited for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

pub fn is(state: RunState) -> impl Fn(&Studio) -> bool {
    move |studio| studio.snapshot().state == state
}

/// Trains the open dataset to the end.
pub fn train(window: &mut Window) {
    wait(window, "ready", is(RunState::Ready));
    window.key_press(Key::Space);
    wait(window, "the end", is(RunState::Finished));
}

/// Enlarges the viewport: collapses the frame strip.
pub fn clear_view(window: &mut Window) {
    window.key_press(Key::T);
    window.run_steps(3);
}

/// Clicks the widget with this label. Two passes lay out the worker's latest snapshot first; otherwise the
/// click would land where the button was before.
pub fn click(window: &mut Window, label: &str) {
    window.run_steps(2);
    // A question may follow only after a path was checked on another thread.
    wait_for_label(window, label);
    window.get_by_label(label).click();
    window.run_steps(2);
}

/// Trains one frame.
pub fn step(window: &mut Window) {
    window.key_press(Key::Period);
    window.run_steps(2);
}

/// Asks to start over; unsaved training must be confirmed.
pub fn reset(window: &mut Window) {
    window.key_press_modifiers(Modifiers::COMMAND, Key::R);
    window.run_steps(2);
}

/// Chooses an entry of a menu of the top bar by the beginning of its label, which ends in its keys.
pub fn menu(window: &mut Window, menu: &str, entry: &str) {
    assert!(try_menu(window, menu, entry), "no {entry} in {menu}");
}

/// Like [`menu`], but false if the entry is not there, as when the click closed a menu that was open.
pub fn try_menu(window: &mut Window, menu: &str, entry: &str) -> bool {
    click(window, menu);
    let is_entry =
        |label: String| label.trim_end() == entry || label.starts_with(&format!("{entry} "));
    let found = window.query_by(|node| node.label().is_some_and(&is_entry));
    let is_there = found.inspect(|entry| entry.click()).is_some();
    window.run_steps(2);
    is_there
}

/// Switches following of live recordings on or off.
pub fn live(window: &mut Window) {
    menu(window, "Open", "Live");
}

/// Closes the first notice, which is the newest.
pub fn close_notice(window: &mut Window) {
    window.run_steps(2);
    window.query_all_by_label("×").next().unwrap().click();
    window.run_steps(2);
}

/// Writes a file through the dialog that a shortcut opens.
pub fn write_to(window: &mut Window, key: Key, button: &str, file: &Path) {
    window.key_press_modifiers(Modifiers::COMMAND, key);
    window.run_steps(2);
    enter_path(window, file);
    press_in_dialog(window, button);
}

/// Presses a button of the open dialog. Menus of the bars may have the same name; they come first.
pub fn press_in_dialog(window: &mut Window, button: &str) {
    window.get_all_by_role_and_label(Role::Button, button).last().unwrap().click();
}

/// Replaces the path in the open dialog.
pub fn enter_path(window: &mut Window, path: &Path) {
    window.get_by_role(Role::TextInput).focus();
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.event(Event::Text(path.display().to_string()));
    window.run_steps(2);
}

/// Writes a small synthetic dataset that trains quickly.
pub fn dataset(folder: &Path, n_train: usize) -> PathBuf {
    let path = folder.join("room");
    let params = SyntheticParams {
        width: 64,
        height: 48,
        n_train,
        n_eval: 1,
        seed: 1,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    write(&params, &path, SyntheticLayout::Blender(DepthBits::Sixteen), &mut |_, _| {}).unwrap();
    path
}

/// Waits until the window shows a text.
pub fn wait_for_label(window: &mut Window, text: &str) {
    wait_until_shown(window, text, |window| window.query_all_by_label(text).next().is_some());
}

/// Waits until the window shows a text that contains `part`, such as a tooltip.
pub fn wait_for_text(window: &mut Window, part: &str) {
    wait_until_shown(window, part, |w| w.query_all_by_label_contains(part).next().is_some());
}

fn wait_until_shown(window: &mut Window, text: &str, is_shown: impl Fn(&Window) -> bool) {
    let started = Instant::now();
    while !is_shown(window) {
        assert!(started.elapsed() < PATIENCE, "`{text}` is never shown");
        window.step();
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// True if the middle of the viewport shows more than the background.
fn picture_has_content(window: &mut Window) -> bool {
    let image = window.render().unwrap();
    let (w, h) = (image.width(), image.height());
    let mut colors = std::collections::BTreeSet::new();
    for y in (h / 4..3 * h / 4).step_by(7) {
        for x in (w / 10..w / 2).step_by(7) {
            colors.insert(image.get_pixel(x, y).0);
        }
    }
    // Few frames give few birth colours; the background alone gives one or two.
    colors.len() > 8
}

/// Waits until the scene is drawn. Another thread delivers the picture or the sort order shortly after the
/// splats.
pub fn wait_for_picture(window: &mut Window) {
    let started = Instant::now();
    while !picture_has_content(window) {
        assert!(started.elapsed() < PATIENCE, "the scene is never drawn");
        window.step();
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Drags over the middle of the viewport.
pub fn drag(window: &mut Window, button: PointerButton) {
    let start = Pos2::new(300.0, 300.0);
    drag_between(window, button, start, start + Vec2::new(60.0, 30.0));
}

pub fn drag_between(window: &mut Window, button: PointerButton, start: Pos2, end: Pos2) {
    let press = |pos: Pos2, pressed| Event::PointerButton {
        pos,
        button,
        pressed,
        modifiers: Modifiers::NONE,
    };
    window.event(Event::PointerMoved(start));
    window.step();
    window.event(press(start, true));
    window.step();
    for i in 1..=5 {
        window.event(Event::PointerMoved(start.lerp(end, 0.2 * i as f32)));
        window.step();
    }
    window.event(press(end, false));
    window.event(Event::PointerMoved(Pos2::new(5.0, 635.0)));
    window.step();
}

/// Turns the mouse wheel at a position, by `points` upwards.
pub fn turn_wheel(window: &mut Window, at: Pos2, points: f32) {
    window.event(Event::PointerMoved(at));
    window.step();
    window.event(Event::MouseWheel {
        unit: MouseWheelUnit::Point,
        delta: Vec2::new(0.0, points),
        phase: TouchPhase::Move,
        source: MouseWheelSource::Wheel,
        modifiers: Modifiers::NONE,
    });
    // egui smooths scrolling over several passes.
    window.run_steps(30);
    // Moved off the viewport, since the harness draws the pointer into its pictures.
    window.event(Event::PointerMoved(Pos2::new(5.0, 635.0)));
    window.step();
}

/// Returns the pixels of the viewport's middle once they no longer change.
pub fn settled(window: &mut Window) -> Vec<u8> {
    let started = Instant::now();
    let mut last = Vec::new();
    loop {
        for _ in 0..30 {
            window.step();
            std::thread::sleep(Duration::from_millis(10));
        }
        let image = window.render().unwrap();
        let middle: Vec<u8> = (150..500)
            .flat_map(|y| (50..550).flat_map(move |x| [(x, y)]))
            .flat_map(|(x, y)| image.get_pixel(x, y).0)
            .collect();
        if middle == last {
            return last;
        }
        assert!(started.elapsed() < PATIENCE, "the picture never settles");
        last = middle;
    }
}

/// Presses a button and returns the text it copies.
pub fn copied(window: &mut Window, label: &str) -> String {
    window.run_steps(2);
    window.get_by_label(label).click_accesskit();
    for _ in 0..5 {
        window.step();
        for command in &window.output().platform_output.commands {
            if let OutputCommand::CopyText(text) = command {
                return text.clone();
            }
        }
    }
    panic!("nothing is copied");
}
