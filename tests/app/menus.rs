//! The menu bar: every command with its name, its keys, and the reason if it is disabled.

use super::harness::{Window, click, dataset, is, train, wait, wait_for_label, window};
use crate::common::adapter::turn;
use eframe::egui::{Event, Key};
use egui_kittest::kittest::{NodeT, Queryable};
use vbgs_studio::app::Painting;
use vbgs_studio::app::command::UiCommand;
use vbgs_studio::app::state::{RunState, Subject};

fn open(window: &mut Window, menu: &str) {
    click(window, menu);
    window.run_steps(2);
}

fn close(window: &mut Window) {
    window.key_press(Key::Escape);
    window.run_steps(2);
}

/// Number of buttons and menu entries that name a command.
fn n_named(window: &Window, command: UiCommand) -> usize {
    let keys = command.keys(&window.ctx);
    let names = [command.full_name(), command.label()];
    // Menus append the keys to the name.
    let is_named =
        |label: &str| names.iter().any(|name| label == *name || label == format!("{name} {keys}"));
    window.query_all_by(|node| node.label().is_some_and(|label| is_named(label.trim_end()))).count()
}

#[test]
fn every_command_is_in_one_menu() {
    let _turn = turn();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    window.run_steps(2);
    let mut n_found = [0; UiCommand::ALL.len()];
    let before = UiCommand::ALL.map(|command| n_named(&window, command));
    for menu in ["Open", "Training menu", "Export", "View", "Selection", "Help"] {
        let mut before = before;
        if menu == "Selection" {
            // A part of this menu, whose own commands are counted already.
            open(&mut window, "View");
            before = UiCommand::ALL.map(|command| n_named(&window, command));
        }
        open(&mut window, menu);
        for (i, command) in UiCommand::ALL.into_iter().enumerate() {
            n_found[i] += usize::from(n_named(&window, command) > before[i]);
        }
        close(&mut window);
        close(&mut window);
    }
    for (command, n) in UiCommand::ALL.into_iter().zip(n_found) {
        assert_eq!(n, 1, "{command:?}");
    }
}

#[test]
fn menus_do_what_they_say_and_tell_why_they_cannot() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Subject::Path(dataset(folder.path(), 2));
    let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
    train(&mut window);
    open(&mut window, "Training menu");
    let step = window.get_by_label_contains("Step");
    assert!(step.accesskit_node().is_disabled());
    let at = step.rect().center();
    window.event(Event::PointerMoved(at));
    wait_for_label(&mut window, "All frames are trained");
    close(&mut window);

    open(&mut window, "View");
    let shows_grid = |window: &Window| window.state().view().settings.shows_grid;
    assert!(!shows_grid(&window));
    window.query_all_by_label_contains("Grid").last().unwrap().click();
    window.run_steps(3);
    assert!(shows_grid(&window));
    assert!(window.query_by_label("Panels").is_none(), "the menu is closed");
    open(&mut window, "View");
    click(&mut window, "Panels");
    window.query_all_by_label("Inspector").last().unwrap().click();
    window.run_steps(3);
    window.get_by_label_contains("Click a splat");
    wait(&mut window, "rest", is(RunState::Finished));
}
