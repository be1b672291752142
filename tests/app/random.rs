//! Random input in any state of the window: keys, clicks, drags, text, files and sizes from a seed. A
//! watchdog aborts the process if a step never returns.
//!
//! `VBGS_WINDOW_MINUTES=120 cargo test --release --test app -- --nocapture random` is the long run, or
//! `VBGS_WINDOW_INPUTS=100000` in place of minutes. After every [`INPUTS`] inputs it reopens the same dataset
//! and measures memory there, since only equal states of the window show a leak. Memory means the program's
//! own allocations; resident memory also depends on drivers and the system's allocator.

use super::harness::{PATIENCE, Window, dataset, drop_on, is, paper_window, try_menu, wait};
use crate::common::adapter::turn;
use crate::common::live::bytes;
use eframe::egui::accesskit::Role;
use eframe::egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::kittest::{NodeT, Queryable};
use std::path::PathBuf;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};
use vbgs_studio::app::Painting;
use vbgs_studio::app::command::UiCommand;
use vbgs_studio::app::state::RunState;
use vbgs_studio::eval::report::rss_bytes;
use vbgs_studio::math::rng::{Purpose, Rng};

/// Inputs between two measurements of memory, and total number of inputs in CI.
const INPUTS: usize = 400;
/// Inputs between two pictures. Until one is rendered, harness and device retain every uploaded texture; a
/// real window renders every frame.
const DRAWN: usize = 20;
/// Measurements needed to check that memory is flat. Idle windows differ by 5 %, so with fewer measurements
/// the medians scatter by more than [`MAX_RISE`].
const MIN_MEASURED: usize = 100;
const LARGEST: Vec2 = Vec2::new(1600.0, 1000.0);
/// Maximum number of rounds until the window is idle.
const MAX_ROUNDS: usize = 100;
/// Largest relative rise of memory after warm-up.
const MAX_RISE: f64 = 0.03;

/// True if a button may be pressed. Excludes desktop dialogs, which no test can close, and the demo, whose
/// files would go to the current folder.
fn is_pressed(label: &str) -> bool {
    !(label.starts_with("Browse") || label.contains("emo"))
}

/// Starts a thread that aborts the process if no message arrives for [`PATIENCE`].
fn watchdog() -> Sender<String> {
    let (alive, signs) = channel::<String>();
    std::thread::spawn(move || {
        let mut last = String::new();
        loop {
            match signs.recv_timeout(PATIENCE) {
                Ok(input) => last = input,
                Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => {
                    eprintln!("the window never came back from: {last}");
                    std::process::abort();
                }
            }
        }
    });
    alive
}

/// Presses a random control of a role; returns its description.
fn press_any(window: &Window, role: Role, rng: &mut Rng) -> String {
    let of_role: Vec<_> = window.query_all_by_role(role).collect();
    let label = |node: &egui_kittest::Node<'_>| {
        node.accesskit_node().label().unwrap_or_default().to_string()
    };
    let pressed: Vec<_> = of_role.iter().filter(|node| is_pressed(&label(node))).collect();
    if pressed.is_empty() {
        return format!("no {role:?}");
    }
    let node = pressed[rng.below(pressed.len())];
    node.click();
    format!("{role:?} {}", label(node))
}

fn pointer(window: &Window, rng: &mut Rng) -> String {
    let mut place = || Pos2::new(rng.range(0.0, 1000.0) as f32, rng.range(0.0, 640.0) as f32);
    let (from, to) = (place(), place());
    let buttons = [PointerButton::Primary, PointerButton::Secondary, PointerButton::Middle];
    let button = buttons[rng.below(3)];
    let press =
        |pos, pressed| Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE };
    let is_drag = rng.below(2) == 0;
    let to = if is_drag { to } else { from };
    for event in
        [Event::PointerMoved(from), press(from, true), Event::PointerMoved(to), press(to, false)]
    {
        window.event(event);
    }
    format!("{button:?} from {from:?} to {to:?}")
}

fn key(window: &Window, rng: &mut Rng) -> String {
    const OTHERS: [Key; 9] = [
        Key::Enter,
        Key::Escape,
        Key::Tab,
        Key::ArrowUp,
        Key::ArrowDown,
        Key::Delete,
        Key::W,
        Key::Num1,
        Key::Backspace,
    ];
    let shortcuts: Vec<_> = UiCommand::ALL.iter().flat_map(|command| command.shortcuts()).collect();
    match rng.below(4) {
        0 => {
            let key = OTHERS[rng.below(OTHERS.len())];
            window.key_press(key);
            format!("{key:?}")
        }
        _ => {
            let shortcut = shortcuts[rng.below(shortcuts.len())];
            window.key_press_modifiers(shortcut.modifiers, shortcut.logical_key);
            format!("{shortcut:?}")
        }
    }
}

fn any_input(window: &mut Window, files: &[PathBuf], rng: &mut Rng) -> String {
    match rng.below(20) {
        0..=5 => key(window, rng),
        6..=9 => press_any(window, Role::Button, rng),
        10..=11 => press_any(window, Role::CheckBox, rng),
        12 => press_any(window, Role::ComboBox, rng),
        13 => press_any(window, Role::Slider, rng),
        14..=16 => pointer(window, rng),
        17 => {
            let texts = ["", "0", "-1e30", "nan", "0.02", "train", "\u{202e}x", "/dev/null/x"];
            let text = texts[rng.below(texts.len())];
            window.event(Event::Text(text.to_owned()));
            format!("text {text:?}")
        }
        18 => {
            let file = &files[rng.below(files.len())];
            drop_on(window, file);
            format!("dropped {}", file.display())
        }
        _ => {
            let size = Vec2::new(
                rng.range(200.0, LARGEST.x.into()) as f32,
                rng.range(120.0, LARGEST.y.into()) as f32,
            );
            window.set_size(size);
            format!("size {size:?}")
        }
    }
}

/// Brings the window from any state to the dataset, opened and untrained.
fn comes_back(window: &mut Window, path: &std::path::Path, alive: &Sender<String>) {
    window.set_size(Vec2::new(1000.0, 640.0));
    let (started, threads_before) = (Instant::now(), threads());
    loop {
        let snapshot = window.state().snapshot();
        if snapshot.state == RunState::Ready && snapshot.frames_done == 0 {
            break;
        }
        if started.elapsed() > PATIENCE {
            let buttons = window.query_all_by_role(Role::Button);
            let shown: Vec<_> = buttons.filter_map(|node| node.accesskit_node().label()).collect();
            let notices: Vec<_> = snapshot.notices.iter().map(|n| n.text.as_str()).collect();
            // CPU times distinguish a blocked thread from one that gets no core.
            panic!(
                "cannot be brought back from {:?} at frame {} of {}: {shown:?}, {notices:?}, threads \
                 before {threads_before:?}, now {:?}",
                snapshot.state,
                snapshot.frames_done,
                snapshot.n_frames,
                threads()
            );
        }
        alive.send("coming back".to_owned()).unwrap();
        window.key_press(Key::Escape);
        window.run_steps(3);
        // A followed dataset trains as soon as it is open, so it would never be Ready.
        if snapshot.following.is_on {
            // If a menu was open, the next round repeats it.
            try_menu(window, "Open", "Live");
            window.run_steps(3);
        }
        drop_on(window, path);
        for _ in 0..20 {
            if let Some(button) = window.query_by_label("Discard") {
                button.click();
            }
            window.step();
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    }
}

/// Name, state and CPU nanoseconds of every thread, as far as the system reports them.
fn threads() -> Vec<String> {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let told = tasks.map(|task| {
        let read = |file| std::fs::read_to_string(task.path().join(file)).unwrap_or_default();
        let (name, stat, worked) = (read("comm"), read("stat"), read("schedstat"));
        let state = stat.rsplit(") ").next().and_then(|rest| rest.chars().next());
        let worked = worked.split(' ').next().unwrap_or_default();
        format!("{} {} {worked}", name.trim(), state.unwrap_or('?'))
    });
    told.collect()
}

/// Reads a number from an environment variable.
pub fn asked(variable: &str) -> Option<u64> {
    std::env::var(variable).ok().and_then(|n| n.parse().ok())
}

/// True if the requested minutes or inputs are over.
fn is_over(started: Instant, inputs: usize) -> bool {
    match asked("VBGS_WINDOW_MINUTES") {
        Some(minutes) => started.elapsed() >= Duration::from_secs(60 * minutes),
        None => inputs as u64 >= asked("VBGS_WINDOW_INPUTS").unwrap_or(INPUTS as u64),
    }
}

/// Opens the dataset with the panels and settings of a first start. Otherwise features that inputs switched
/// on, such as a renderer with its own buffers, would count as leaks.
fn as_at_first(window: &mut Window, path: &std::path::Path, alive: &Sender<String>) {
    comes_back(window, path, alive);
    let started = Instant::now();
    while window.query_by_label("Reset all").is_none() {
        assert!(started.elapsed() < PATIENCE, "the Settings panel cannot be opened");
        // Dialogs and questions cover the panels.
        window.key_press(Key::Escape);
        window.run_steps(3);
        window.key_press_modifiers(Modifiers::COMMAND, Key::P);
        window.run_steps(3);
        window.event(Event::Text("Reset layout".to_owned()));
        window.run_steps(3);
        window.key_press(Key::Enter);
        window.run_steps(3);
        if let Some(tab) = window.query_all_by_label("Settings").next() {
            tab.click();
        }
        window.run_steps(3);
    }
    window.get_by_label("Reset all").click_accesskit();
    window.run_steps(3);
    remove_second_model(window);
    // Settings apply to datasets opened later. The paper preset allocates its components before any frame, so
    // the model's size shows which preset is active.
    drop_on(window, path);
    wait(window, "ready with the scene preset", |studio| {
        let snapshot = studio.snapshot();
        snapshot.state == RunState::Ready && snapshot.model.bytes < 1_000_000
    });
}

/// Removes the second model. It stays when the same dataset is opened again, and one of the paper preset has ten
/// times the memory of the scene.
fn remove_second_model(window: &mut Window) {
    if window.state().view().comparison.model().is_none() {
        return;
    }
    window.key_press_modifiers(Modifiers::COMMAND, Key::P);
    window.run_steps(3);
    window.event(Event::Text("Remove second model".to_owned()));
    window.run_steps(3);
    window.key_press(Key::Enter);
    window.run_steps(3);
    assert!(window.state().view().comparison.model().is_none(), "the second model stays");
}

/// Opens a window, draws the largest model at the largest size beside a photograph, and resets the window.
/// Buffers then have their final capacity, so later inputs do not grow them.
fn roomy_window(path: &std::path::Path, alive: &Sender<String>) -> Option<Window> {
    let mut window = paper_window(path, Painting::Auto)?;
    window.key_press(Key::Space);
    wait(&mut window, "trained", is(RunState::Finished));
    window.set_size(LARGEST);
    window.key_press(Key::T);
    window.key_press(Key::G);
    wait(&mut window, "compared", |studio| studio.view().camera.frame_ref().is_some());
    held_at_rest(&mut window);
    as_at_first(&mut window, path, alive);
    Some(window)
}

/// Allocated megabytes once background work after opening is done: thumbnails, frame sampling, pose check,
/// picture. Takes the minimum of the last rounds, since a picture in progress allocates more.
fn held_at_rest(window: &mut Window) -> f64 {
    let mut last = [f64::INFINITY; 8];
    for round in 0..=MAX_ROUNDS {
        // Pending textures are released only when a picture is rendered.
        drop(window.render());
        window.run_steps(2);
        std::thread::sleep(Duration::from_millis(20));
        last[round % last.len()] = bytes() as f64 / 1e6;
        let is_flat = last.iter().all(|held| (held - last[0]).abs() < 0.3);
        if is_flat {
            break;
        }
    }
    last.iter().copied().fold(f64::INFINITY, f64::min)
}

/// Prints the course of memory; panics if it rises in a long run.
fn memory_is_flat(measured: &[f64]) {
    let n = measured.len();
    if n < MIN_MEASURED {
        return;
    }
    let median = |part: &[f64]| {
        let mut part = part.to_vec();
        part.sort_by(f64::total_cmp);
        part[part.len() / 2]
    };
    let (warm, end) = (median(&measured[n / 10..n / 2]), median(&measured[n - 2 * n / 5..]));
    let rise = end / warm - 1.0;
    eprintln!("memory {warm:.2} MB after warm-up, {end:.2} MB at the end: {:+.2} %", 100.0 * rise);
    assert!(rise <= MAX_RISE, "memory of the window rises by {rise}, at most {MAX_RISE} allowed");
}

#[test]
fn the_window_survives_any_input_in_any_state() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let room = dataset(folder.path(), 6);
    let nonsense = folder.path().join("nonsense.ply");
    std::fs::write(&nonsense, "ply\nformat nothing\n").unwrap();
    let files =
        [room.clone(), nonsense, folder.path().join("missing"), folder.path().join("room.ply")];
    let alive = watchdog();
    let Some(mut window) = roomy_window(&room, &alive) else { return };
    let mut rng = Rng::new(asked("VBGS_WINDOW_SEED").unwrap_or(1), Purpose::Synthetic, 0);
    let (mut states, mut worst) = (std::collections::BTreeSet::new(), 0.0f64);
    let (started, mut inputs, mut measured) = (Instant::now(), 0, Vec::new());
    while !is_over(started, inputs) {
        let input = any_input(&mut window, &files, &mut rng);
        alive.send(format!("{inputs}: {input}")).unwrap();
        let start = Instant::now();
        window.run_steps(1 + rng.below(3));
        worst = worst.max(start.elapsed().as_secs_f64());
        states.insert(format!("{:?}", window.state().snapshot().state));
        inputs += 1;
        if inputs % DRAWN == 0 {
            // On a busy machine a picture may time out; the next one then releases the textures.
            drop(window.render());
        }
        if inputs % INPUTS == 0 {
            as_at_first(&mut window, &room, &alive);
            let held = held_at_rest(&mut window);
            measured.push(held);
            eprintln!(
                "{inputs} inputs in {:.0} s, {held:.2} MB held, {:.1} resident",
                started.elapsed().as_secs_f64(),
                rss_bytes().map_or(f64::NAN, |bytes| bytes as f64 / 1e6)
            );
        }
    }
    eprintln!("states {states:?}, the longest pause {worst:.2} s");
    assert!(states.len() >= 3, "the inputs reach too few states: {states:?}");
    comes_back(&mut window, &room, &alive);
    memory_is_flat(&measured);
}
