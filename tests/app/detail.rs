//! Level of detail of the next run: the slider in the toolbar, changed settings, and the copied command line.

use super::harness::{Window, click, copied, dataset, drop_on, is, wait, window};
use crate::common::adapter::turn;
use eframe::egui::accesskit::Role;
use eframe::egui::{Event, Key, Modifiers};
use egui_kittest::kittest::Queryable;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::app::viewer::toolbar::ViewMode;
use vbgs_studio::pipeline::settings::method::Method;
use vbgs_studio::train::paper::config::{Candidates, Init, ReassignPolicy};
use vbgs_studio::train::scene::units::StructuralScale;

/// Structural scale requested for the open dataset, pixels.
fn pixels(window: &Window) -> f64 {
    let snapshot = window.state().snapshot();
    match snapshot.opened.as_ref().unwrap().scene().unwrap().scale {
        StructuralScale::Pixels(pixels) => pixels,
        StructuralScale::World(_) => panic!("pixels"),
    }
}

/// Moves the detail slider by `n` steps towards the fine end.
fn refine(window: &mut Window, n: usize) {
    window.get_by_role_and_label(Role::Slider, "Detail").focus();
    window.run_steps(2);
    for _ in 0..n {
        window.key_press(Key::ArrowRight);
        window.run_steps(1);
    }
    window.run_steps(2);
}

#[test]
fn the_slider_holds_for_the_first_run_and_offers_another_with_its_forecast() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Subject::Path(dataset(folder.path(), 3));
    let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    wait(&mut window, "sampling of its frames", |s| s.snapshot().sampling.sample.is_some());
    let before = pixels(&window);
    refine(&mut window, 5);
    window.get_by_label_contains("A forecast appears after the first trained frame");
    click(&mut window, "Train");
    wait(&mut window, "the end", is(RunState::Finished));
    let first = pixels(&window);
    assert!(first < before, "{first} pixels after {before}");
    // The summary offers a finer run too; here another tab is in front.
    click(&mut window, "Quality");
    assert!(window.query_by_label("Retrain finer").is_none(), "nothing else was chosen");

    let used = window.state().snapshot().model.used;
    refine(&mut window, 12);
    window.get_by_label_contains("ms a frame after 3 frames");
    // Not asked before: the scene stays beside the new one.
    click(&mut window, "Retrain finer");
    wait(&mut window, "the end of a finer run", |s| {
        let now = s.snapshot();
        now.state == RunState::Finished && now.model.used > used
    });
    assert!(pixels(&window) < first);
    // The scene before is beside the new one.
    let view = window.state().view();
    assert_eq!(view.comparison.mode(), ViewMode::ModelWipe);
    let before = view.comparison.model().unwrap();
    assert_eq!((before.name.as_str(), before.splats.len()), ("Before", used));
}

#[test]
#[cfg(all(unix, feature = "cli"))]
fn changed_settings_are_marked_and_copied_as_a_command_that_trains_so() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("it's mine");
    std::fs::create_dir(&folder).unwrap();
    let subject = Subject::Path(dataset(&folder, 2));
    let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    let press = |window: &mut Window, label: &str| {
        window.get_by_label(label).click_accesskit();
        window.run_steps(3);
    };
    click(&mut window, "Settings");
    press(&mut window, "Details");
    press(&mut window, "Drop slanted surfaces");
    press(&mut window, "Fit planes");
    window.get_by_label("Details: 2 changed");
    press(&mut window, "Fit planes: reset to true");
    window.get_by_label("Details: 1 changed");
    assert!(window.query_by_label("Fit planes: reset to true").is_none());

    let line = copied(&mut window, "Copy as command line");
    assert!(
        line.starts_with("vbgs-studio train '") && line.contains(" --set cosine=false"),
        "{line}"
    );
    let program = std::path::Path::new(env!("CARGO_BIN_EXE_vbgs-studio"));
    let paths =
        format!("{}:{}", program.parent().unwrap().display(), std::env::var("PATH").unwrap());
    let output =
        std::process::Command::new("sh").args(["-c", &line]).env("PATH", paths).output().unwrap();
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    let report = std::fs::read_to_string(folder.join("room.run/report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["frames"].as_array().unwrap().len(), 2);
    assert!(report.to_string().contains("\"cosine\":false"), "trained by these settings");
}

pub fn type_into(window: &mut Window, label: &str, text: &str) {
    window.get_by_role_and_label(Role::TextInput, label).focus();
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.event(Event::Text(text.to_owned()));
    window.run_steps(2);
}

#[test]
#[cfg(unix)]
fn the_papers_settings_are_typed_in_the_panel_trained_by_and_copied() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(None, Painting::Auto) else { return };
    let press = |window: &mut Window, label: &str| {
        window.get_by_label(label).click_accesskit();
        window.run_steps(3);
    };
    click(&mut window, "Settings");
    press(&mut window, "Paper preset");
    press(&mut window, "Details");
    // Typed digit by digit: every shorter number is valid.
    type_into(&mut window, "Components", "2000000");
    for digit in ["0", "0"] {
        window.event(Event::Text(digit.to_owned()));
        window.run_steps(2);
    }
    window.get_by_label_contains("components: expected 1 to");
    window.get_by_label("Details");
    type_into(&mut window, "Components", "2000");
    type_into(&mut window, "Candidates", "dense");
    press(&mut window, "First frame");
    window.get_by_label("Details: 3 changed");
    press(&mut window, "Initial means: reset to random");
    window.get_by_role_and_label(Role::ComboBox, "Reassignment").click_accesskit();
    window.run_steps(3);
    press(&mut window, "Forwarded");
    window.get_by_label("Details: 3 changed");

    drop_on(&mut window, &path);
    wait(&mut window, "ready", is(RunState::Ready));
    click(&mut window, "Train");
    wait(&mut window, "the end", is(RunState::Finished));
    let snapshot = window.state().snapshot();
    assert_eq!(snapshot.model.components, 2000);
    let Some(Method::Paper(config)) = &snapshot.opened.as_ref().unwrap().method else {
        panic!("trained by the paper's preset")
    };
    assert_eq!(config.candidates, Candidates::Dense);
    assert_eq!((config.init, config.reassign), (Init::Random, ReassignPolicy::Forwarded));
    let line = copied(&mut window, "Copy as command line");
    let given =
        "--preset paper --set components=2000 --set candidates=dense --set reassign=forwarded";
    assert!(line.contains(given), "{line}");
}
