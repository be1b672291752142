//! The walk back: the scene as it was after earlier frames, as far as it is kept, or what was born by then.

use super::explained::{SLIDER, named, weak};
use crate::app::edit::editor::{Editor, WalkBack};
use crate::app::state::Snapshot;
use crate::app::viewer::SceneView;
use crate::app::viewer::settings::MAX_PAST_MB;
use eframe::egui::{DragValue, Slider, Ui};

/// Draws the controls; so many splats are of an unknown birth.
pub fn ui(view: &mut SceneView, n_unborn: usize, snapshot: &Snapshot, ui: &mut Ui) {
    let last = snapshot.n_seen();
    let (editor, palette) = view.editing();
    let knows_births = palette.known().iter().any(|known| known.birth.is_some());
    let is_kept = !editor.past.moments().is_empty();
    if last == 0 || !knows_births && !is_kept {
        editor.walked_to = None;
        weak(ui, "What was before is known of scenes that were trained since they were opened.");
        return;
    }
    ui.horizontal_wrapped(|ui| {
        for (walk, label, hint) in WALKS {
            ui.selectable_value(&mut editor.walk, walk, label).on_hover_text(hint);
        }
    });
    slider(editor, last, ui);
    weak(ui, &described(editor));
    if editor.born_until().is_some() && n_unborn > 0 {
        weak(ui, &format!("{n_unborn} splats of an unknown birth are always shown."));
    }
    weak(ui, "Nothing is left out of files by it.");
    budget(view, ui);
}

const WALKS: [(WalkBack, &str, &str); 2] = [
    (
        WalkBack::AsItWas,
        "As it was",
        "The scene as it was after that frame, from copies that are kept of it",
    ),
    (
        WalkBack::Births,
        "By birth, as it is now",
        "Where splats are that a later frame bore is left empty; those that are left are as they are now, not as they were then",
    ),
];

fn slider(editor: &mut Editor, last: usize, ui: &mut Ui) {
    ui.spacing_mut().slider_width = SLIDER;
    let mut frames = editor.walked_to.map_or(last, |frames| frames.min(last));
    ui.horizontal_wrapped(|ui| {
        ui.label("After frame");
        if named(ui.add(Slider::new(&mut frames, 1..=last)), "After frame").changed() {
            editor.walked_to = (frames < last).then_some(frames);
        }
        let is_away = editor.walked_to.is_some();
        if ui.add_enabled(is_away, eframe::egui::Button::new("Back to now")).clicked() {
            editor.walked_to = None;
        }
    });
}

/// What is shown.
fn described(editor: &Editor) -> String {
    let Some(asked) = editor.walked_to else { return "Shown is the scene of now.".to_owned() };
    match (editor.walk, editor.past_shown()) {
        (_, Some(past)) if past.n_frames == asked => format!(
            "Shown is the scene as it was after frame {asked}, in its own colours. Figures are of the scene of now."
        ),
        (_, Some(past)) => format!(
            "Shown is the scene as it was after frame {}, the last that is kept until {asked}, in its own colours. Figures are of the scene of now.",
            past.n_frames
        ),
        (WalkBack::AsItWas, None) => format!(
            "Nothing is kept from until frame {asked}: shown are the splats that were born by then, as they are now."
        ),
        (WalkBack::Births, None) => {
            format!("Shown are the splats that were born until frame {asked}, as they are now.")
        }
    }
}

/// What the copies may take.
fn budget(view: &mut SceneView, ui: &mut Ui) {
    let mut budget = view.settings.past_mb;
    let past = &view.editor().past;
    let (n, taken) = (past.moments().len(), past.bytes() as f64 / 1e6);
    ui.horizontal_wrapped(|ui| {
        ui.label(format!("Kept: {n} moments, {taken:.1} of at most"));
        let value = DragValue::new(&mut budget).range(0..=MAX_PAST_MB).suffix(" MB");
        let value = named(ui.add(value), "Memory of earlier moments");
        value.on_hover_text("Where they would take more, every other one is dropped");
    });
    if budget != view.settings.past_mb {
        view.settings.past_mb = budget;
        let bytes = view.settings.past_bytes();
        view.editing().0.past.keep_to(bytes);
    }
}
