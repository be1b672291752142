//! Panel of edits: selection, crop box, hidden and deleted splats, earlier frames.

use super::controls::{SLIDER, command_button, named, section, weak};
use super::signal_color::SignalColor;
use crate::app::command::UiCommand;
use crate::app::edit::editor::{EditCounts, Editor};
use crate::app::state::{Opened, Snapshot};
use crate::app::viewer::SceneView;
use crate::app::viewer::settings::MAX_PAST_MB;
use crate::app::wording;
use eframe::egui::{Button, DragValue, Grid, Label, Response, ScrollArea, Slider, Ui};

pub fn ui(
    view: &mut SceneView,
    snapshot: &Snapshot,
    opened: &Opened,
    ui: &mut Ui,
) -> Option<UiCommand> {
    let mut asked = None;
    ScrollArea::both().auto_shrink(false).show(ui, |ui| {
        let (editor, palette) = (&mut view.editor, &view.palette);
        editor.shows_crop = true;
        let counts = editor.counts(palette);
        commands(editor, &[UiCommand::BoxSelect, UiCommand::Undo, UiCommand::Redo], &mut asked, ui);
        weak(ui, "Drag a box in the viewport to select splats, including occluded ones. Shift adds, Ctrl removes; the right button still pans.");
        section("Selected", ui);
        let [selected, all] = [counts.selected, counts.all].map(wording::grouped);
        ui.label(format!("{selected} of {all} splats"));
        let of_selection = [UiCommand::HideSelected, UiCommand::DeleteSelected, UiCommand::Deselect];
        ui.horizontal_wrapped(|ui| {
            of_selection.into_iter().for_each(|command| button(editor, command, &mut asked, ui));
            let invert = ui.button("Invert");
            if invert.on_hover_text("Select the visible splats that are not selected").clicked() {
                editor.invert(palette);
            }
        });
        section("Crop box", ui);
        crop(editor, opened, &mut asked, ui);
        section("Hidden and deleted", ui);
        hidden_and_deleted(editor, &counts, &mut asked, ui);
        section("History", ui);
        walk_back(view, snapshot, ui);
    });
    asked
}

fn commands(editor: &Editor, commands: &[UiCommand], asked: &mut Option<UiCommand>, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        commands.iter().for_each(|&command| button(editor, command, asked, ui));
    });
}

fn button(editor: &Editor, command: UiCommand, asked: &mut Option<UiCommand>, ui: &mut Ui) {
    let is_on = command == UiCommand::BoxSelect && editor.is_box_selecting;
    let why_not = editor.unavailable_reason(match command {
        UiCommand::Deselect => UiCommand::HideSelected,
        other => other,
    });
    if command_button(command, is_on, why_not, ui) {
        *asked = Some(command);
    }
}

/// Ends the undo step when a control is released, so that a whole drag is one step.
fn end_step(editor: &mut Editor, control: &Response) {
    if control.drag_stopped() || control.changed() && !control.dragged() {
        editor.log.end_drag();
    }
}

fn crop(editor: &mut Editor, opened: &Opened, asked: &mut Option<UiCommand>, ui: &mut Ui) {
    let Some(now) = editor.edits().crop() else {
        return button(editor, UiCommand::CropBox, asked, ui);
    };
    let remove = ui.button("Remove crop box").on_hover_text(UiCommand::CropBox.tooltip());
    if remove.clicked() {
        *asked = Some(UiCommand::CropBox);
    }
    let origin = opened.local_origin;
    let [mut low, mut high] = now.map(|corner| corner + origin);
    let speed = 2e-3 * opened.home.radius;
    Grid::new("crop").num_columns(3).show(ui, |ui| {
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            let label = ui.label(name).id;
            let (least, most) = (low[axis], high[axis]);
            let from = DragValue::new(&mut low[axis]).speed(speed).range(f64::MIN..=most);
            let from = ui.add(from.max_decimals(4)).labelled_by(label).on_hover_text("From");
            let to = DragValue::new(&mut high[axis]).speed(speed).range(least..=f64::MAX);
            let to = ui.add(to.max_decimals(4)).labelled_by(label).on_hover_text("To");
            for control in [from, to] {
                if control.changed() {
                    let crop = Some([low, high].map(|corner| corner - origin));
                    let next = editor.edits().with_crop(crop);
                    editor.log.drag(next);
                }
                end_step(editor, &control);
            }
            ui.end_row();
        }
    });
    weak(
        ui,
        "World units, as in `export --crop`. Drag the handles in the viewport to move the faces.",
    );
}

fn hidden_and_deleted(
    editor: &Editor,
    counts: &EditCounts,
    asked: &mut Option<UiCommand>,
    ui: &mut Ui,
) {
    let [written, all] = [counts.all - counts.left_out, counts.all].map(wording::grouped);
    ui.label(format!("An export writes {written} of {all} splats."));
    if counts.left_out > 0 {
        let [deleted, outside] =
            [counts.deleted, counts.left_out - counts.deleted].map(wording::grouped);
        ui.label(format!("Excluded: {deleted} deleted, {outside} others outside the crop box"));
    }
    if counts.hidden > 0 {
        ui.label(format!("{} hidden, but still exported", wording::grouped(counts.hidden)));
    }
    commands(editor, &[UiCommand::ShowHidden, UiCommand::RestoreDeleted], asked, ui);
    weak(ui, "The model, its checkpoints and its quality figures include all splats.");
}

fn walk_back(view: &mut SceneView, snapshot: &Snapshot, ui: &mut Ui) {
    let editor = &mut view.editor;
    if let Some(failure) = editor.stored_scenes.failure() {
        ui.add(Label::new(SignalColor::Yellow.text(failure, ui)).wrap());
    }
    if editor.stored_scenes.moments().is_empty() {
        editor.earlier_frames = None;
        weak(ui, "Available for scenes trained since they were opened.");
    } else {
        // A copy may be newer than the snapshot of this pass.
        slider(editor, snapshot.n_seen().max(1), ui);
        weak(ui, &describe_display(editor));
        weak(ui, "Exports are not affected.");
    }
    // Drawn in either case: with a limit of 0 there are no copies, and the user may raise it again.
    budget(view, ui);
}

fn slider(editor: &mut Editor, last: usize, ui: &mut Ui) {
    ui.spacing_mut().slider_width = SLIDER;
    let mut frames = editor.earlier_frames.map_or(last, |frames| frames.min(last));
    ui.horizontal_wrapped(|ui| {
        ui.label("After frame");
        if named(ui.add(Slider::new(&mut frames, 1..=last)), "After frame").changed() {
            editor.earlier_frames = (frames < last).then_some(frames);
        }
        let is_away = editor.earlier_frames.is_some();
        if ui.add_enabled(is_away, Button::new("Newest")).clicked() {
            editor.earlier_frames = None;
        }
    });
}

fn describe_display(editor: &Editor) -> String {
    let Some(asked) = editor.earlier_frames else { return "Showing the newest scene.".to_owned() };
    match editor.displayed_past() {
        Some(past) if past.after.n_seen == asked => format!(
            "Showing the scene after frame {asked}, in its learned colours. Figures refer to the current scene."
        ),
        Some(past) => format!(
            "Showing the scene after frame {}, the latest copy up to frame {asked}, in its learned colours. Figures refer to the current scene.",
            past.after.n_seen
        ),
        None => format!("No copy exists up to frame {asked}: showing the newest scene."),
    }
}

fn budget(view: &mut SceneView, ui: &mut Ui) {
    let mut budget = view.settings.panels.past_mb;
    let past = &view.editor.stored_scenes;
    let copies = match past.moments().len() {
        1 => "1 scene".to_owned(),
        n => format!("{n} scenes"),
    };
    let taken = past.bytes() as f64 / 1e6;
    ui.horizontal_wrapped(|ui| {
        ui.label(format!("{copies} on disk, {taken:.1} MB of at most"));
        let value = DragValue::new(&mut budget).range(0..=MAX_PAST_MB).suffix(" MB");
        let value = named(ui.add(value), "Disk space for earlier frames");
        value.on_hover_text("Beyond this limit, every other copy is dropped");
    });
    if budget != view.settings.panels.past_mb {
        view.settings.panels.past_mb = budget;
        let bytes = view.settings.panels.past_bytes();
        view.editor.stored_scenes.set_budget(bytes);
    }
}
