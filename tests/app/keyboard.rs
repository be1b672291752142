//! Keyboard control: actions found by name, and controls reached by Tab.

use super::harness::{Window, click, dataset, drop_on, is, train, wait, window};
use crate::common::adapter::turn;
use eframe::egui::accesskit::Role;
use eframe::egui::{Event, Key, Modifiers, Theme, Vec2};
use egui_kittest::kittest::{NodeT, Queryable};
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::render::Renderer;

/// Opens the list of actions and types into it.
fn find(window: &mut Window, typed: &str) {
    window.key_press_modifiers(Modifiers::COMMAND, Key::P);
    window.run_steps(3);
    window.event(Event::Text(typed.to_owned()));
    window.run_steps(2);
}

#[test]
fn actions_are_found_by_letters_of_their_names_and_show_their_keys() {
    let _turn = turn();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    find(&mut window, "");
    assert!(window.query_all_by_label_contains("Ctrl+O").next().is_some(), "the keys of Open");
    window.event(Event::Text("tbset".to_owned()));
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(2);
    window.get_by_label("Scene preset");
    assert!(window.query_by_role(Role::TextInput).is_none(), "the list is closed");

    find(&mut window, "export");
    window.key_press(Key::Enter);
    window.run_steps(2);
    window.get_by_role(Role::TextInput);
    window.key_press(Key::Escape);
    window.run_steps(2);
    assert!(window.query_by_role(Role::TextInput).is_none(), "nothing is open to export");
    // The arrow key selects the second match.
    find(&mut window, "tab:");
    window.key_press(Key::ArrowDown);
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(2);
    window.get_by_label_contains("Quality is measured");
}

#[test]
fn tab_is_the_renderers_until_controls_have_the_keyboard() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Subject::Path(dataset(folder.path(), 2));
    let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    let press = |window: &mut Window, key| {
        window.key_press(key);
        window.run_steps(2);
    };
    let renderer = |window: &Window| window.state().view().settings.renderer;
    let focused = |window: &Window| window.ctx.memory(|memory| memory.focused());
    press(&mut window, Key::Tab);
    assert_eq!((renderer(&window), focused(&window)), (Renderer::Exact, None));

    press(&mut window, Key::F6);
    let first = focused(&window).expect("a control has the keyboard");
    press(&mut window, Key::Tab);
    let second = focused(&window).expect("the next one has it");
    assert_ne!(second, first);
    assert_eq!(renderer(&window), Renderer::Exact, "Tab moves only the focus");
    press(&mut window, Key::M);
    assert!(window.state().view().overlays.is_measuring(), "letter keys still act on the view");

    press(&mut window, Key::F6);
    assert_eq!(focused(&window), None);
    press(&mut window, Key::Tab);
    assert_eq!(renderer(&window), Renderer::Projected);
    window.key_press_modifiers(Modifiers::SHIFT, Key::Tab);
    window.run_steps(2);
    assert!(focused(&window).is_some(), "Shift+Tab goes to the controls");
    assert_eq!(renderer(&window), Renderer::Projected);
}

#[test]
fn the_window_is_light_or_dark_as_is_chosen() {
    let _turn = turn();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    find(&mut window, "tab: settings");
    window.key_press(Key::Enter);
    window.run_steps(2);
    for (label, theme) in [("Light theme", Theme::Light), ("Dark theme", Theme::Dark)] {
        window.get_by_label(label).click_accesskit();
        window.run_steps(2);
        assert_eq!(window.ctx.theme(), theme);
    }
}

#[test]
fn a_text_field_keeps_the_keys() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Subject::Path(dataset(folder.path(), 2));
    let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    find(&mut window, "tab: path");
    window.key_press(Key::Enter);
    window.run_steps(2);
    window.get_by_role(Role::TextInput).focus();
    window.run_steps(2);
    let eye = window.state().view().camera.eye();
    let keys = [Key::Space, Key::Period, Key::M, Key::X, Key::C, Key::P, Key::B, Key::W, Key::V];
    for key in keys {
        window.key_press(key);
        window.run_steps(2);
    }
    let snapshot = window.state().snapshot();
    assert_eq!((snapshot.state, snapshot.frames_done), (RunState::Ready, 0));
    let view = window.state().view();
    let settings = &view.settings;
    assert!(!view.overlays.is_measuring() && !settings.shows_grid && !settings.shows_cameras);
    assert!(!settings.shows_points && view.camera.is_guided());
    assert_eq!(view.camera.eye(), eye, "nothing flew");
    // After the field loses the focus, keys act on the view again.
    window.key_press(Key::Enter);
    window.run_steps(2);
    window.key_press(Key::M);
    window.run_steps(2);
    assert!(window.state().view().overlays.is_measuring());
}

/// Kind and place of controls that screen readers would announce without a name.
fn nameless(window: &Window) -> Vec<String> {
    use Role::{Button, CheckBox, ComboBox, Link, Slider, SpinButton, TextInput};
    let sliders: Vec<f32> =
        window.query_all_by_role(Slider).map(|slider| slider.rect().center().y).collect();
    let controls = [Button, CheckBox, ComboBox, Link, Slider, SpinButton, TextInput];
    let controls = controls
        .into_iter()
        .flat_map(|role| window.query_all_by_role(role).map(move |node| (role, node)));
    let nameless = controls.filter(|(role, node)| {
        // The number field of a slider is named by the slider.
        let y = node.rect().center().y;
        let is_of_slider = *role == SpinButton && sliders.iter().any(|at| (at - y).abs() < 6.0);
        let name = node.accesskit_node().label().unwrap_or_default();
        name.trim().is_empty() && !is_of_slider
    });
    nameless.map(|(role, node)| format!("{role:?} at {:?}", node.rect())).collect()
}

#[test]
fn every_control_has_a_name() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    window.set_size(Vec2::new(1600.0, 1000.0));
    window.run_steps(3);
    assert_eq!(nameless(&window), [""; 0], "at the start");
    drop_on(&mut window, &dataset(folder.path(), 3));
    wait(&mut window, "ready", is(RunState::Ready));
    window.run_steps(3);
    assert_eq!(nameless(&window), [""; 0], "before training");
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    window.run_steps(3);
    assert_eq!(nameless(&window), [""; 0], "after the end");
    for tab in ["Summary", "Quality", "Latency", "Inspector", "Edit", "Path", "Settings"] {
        click(&mut window, tab);
        assert_eq!(nameless(&window), [""; 0], "{tab}");
    }
    window.key_press(Key::G);
    window.run_steps(3);
    assert_eq!(nameless(&window), [""; 0], "beside a photograph");
    for key in [Key::O, Key::S, Key::E, Key::P] {
        window.key_press_modifiers(Modifiers::COMMAND, key);
        window.run_steps(3);
        assert_eq!(nameless(&window), [""; 0], "{key:?}");
        window.key_press(Key::Escape);
        window.run_steps(3);
    }
}
