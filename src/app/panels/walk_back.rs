//! Controls for viewing earlier frames: stored copies of the scene, or current splats by birth frame.

use super::explained::{SLIDER, named, weak};
use crate::app::edit::editor::{EarlierView, Editor};
use crate::app::state::Snapshot;
use crate::app::viewer::SceneView;
use crate::app::viewer::settings::MAX_PAST_MB;
use eframe::egui::{DragValue, Slider, Ui};

/// Draws the controls; `n_unborn` is the number of splats with unknown birth frame.
pub fn ui(view: &mut SceneView, n_unborn: usize, snapshot: &Snapshot, ui: &mut Ui) {
    let last = snapshot.n_seen();
    let (editor, palette) = view.editor_and_palette();
    let knows_births = palette.attributes().iter().any(|known| known.birth.is_some());
    let is_kept = !editor.stored_scenes.moments().is_empty();
    if last == 0 || !knows_births && !is_kept {
        editor.earlier_frames = None;
        weak(ui, "Available for scenes trained since they were opened.");
        return;
    }
    ui.horizontal_wrapped(|ui| {
        for (walk, label, hint) in VIEW_CHOICES {
            ui.selectable_value(&mut editor.earlier_view, walk, label).on_hover_text(hint);
        }
    });
    slider(editor, last, ui);
    weak(ui, &describe_display(editor));
    if editor.born_until().is_some() && n_unborn > 0 {
        weak(ui, &format!("{n_unborn} splats with unknown birth frame are always shown."));
    }
    weak(ui, "This does not affect saving or exporting.");
    budget(view, ui);
}

const VIEW_CHOICES: [(EarlierView, &str, &str); 2] = [
    (EarlierView::StoredCopy, "As it was", "Shows a stored copy of the scene after that frame"),
    (
        EarlierView::BornByThen,
        "By birth, as it is now",
        "Shows the current splats that were created up to that frame, in their current state",
    ),
];

fn slider(editor: &mut Editor, last: usize, ui: &mut Ui) {
    ui.spacing_mut().slider_width = SLIDER;
    let mut frames = editor.earlier_frames.map_or(last, |frames| frames.min(last));
    ui.horizontal_wrapped(|ui| {
        ui.label("After frame");
        if named(ui.add(Slider::new(&mut frames, 1..=last)), "After frame").changed() {
            editor.earlier_frames = (frames < last).then_some(frames);
        }
        let is_away = editor.earlier_frames.is_some();
        if ui.add_enabled(is_away, eframe::egui::Button::new("Back to now")).clicked() {
            editor.earlier_frames = None;
        }
    });
}

/// Describes the displayed scene.
fn describe_display(editor: &Editor) -> String {
    let Some(asked) = editor.earlier_frames else { return "Showing the current scene.".to_owned() };
    match (editor.earlier_view, editor.displayed_past()) {
        (_, Some(past)) if past.n_frames == asked => format!(
            "Showing the scene after frame {asked}, in its learned colours. Figures refer to the current scene."
        ),
        (_, Some(past)) => format!(
            "Showing the scene after frame {}, the latest copy up to frame {asked}, in its learned colours. Figures refer to the current scene.",
            past.n_frames
        ),
        (EarlierView::StoredCopy, None) => format!(
            "No copy exists up to frame {asked}: showing the current splats created by then."
        ),
        (EarlierView::BornByThen, None) => {
            format!("Showing the current splats created up to frame {asked}.")
        }
    }
}

/// Memory budget of the copies.
fn budget(view: &mut SceneView, ui: &mut Ui) {
    let mut budget = view.settings.past_mb;
    let past = &view.editor().stored_scenes;
    let (n, taken) = (past.moments().len(), past.bytes() as f64 / 1e6);
    ui.horizontal_wrapped(|ui| {
        ui.label(format!("{n} copies stored, {taken:.1} MB of at most"));
        let value = DragValue::new(&mut budget).range(0..=MAX_PAST_MB).suffix(" MB");
        let value = named(ui.add(value), "Memory for earlier frames");
        value.on_hover_text("Beyond this limit, every other copy is dropped");
    });
    if budget != view.settings.past_mb {
        view.settings.past_mb = budget;
        let bytes = view.settings.past_bytes();
        view.editor_and_palette().0.stored_scenes.set_budget(bytes);
    }
}
