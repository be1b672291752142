//! Panel of the camera path: keyframes, preview, film, and the file for `render --path`.

use super::controls::named;
use crate::app::path_editor::PathEditor;
use crate::app::viewer::SceneView;
use crate::export::camera_path::PacedPath;
use eframe::egui::{
    Button, DragValue, Grid, ProgressBar, RichText, ScrollArea, Slider, TextEdit, Ui,
};
use std::path::{Path, PathBuf};

/// Range of the sides of pictures and films, pixels.
const PICTURE_SIDES: std::ops::RangeInclusive<u32> = 16..=8192;

#[derive(Clone, Debug, PartialEq)]
pub enum PathRequest {
    /// Saves the camera path, given as JSON.
    Save(String),
    Open(PathBuf),
    /// Renders the camera path to files.
    Film,
    CancelFilm,
}

/// Draws the panel. `file` is the path under which the camera path is saved. `film` is the rendered
/// fraction of a film in progress.
pub fn ui(
    editor: &mut PathEditor,
    view: &mut SceneView,
    file: &Path,
    film: Option<f32>,
    ui: &mut Ui,
) -> Option<PathRequest> {
    ui.horizontal_wrapped(|ui| {
        let add = ui.button("Add keyframe").on_hover_text("Append the current view");
        if add.clicked()
            && let Some(camera) = view.camera.keyframe()
        {
            editor.add(camera);
        }
        let hint = "Replaces the keyframes by a closed orbit from here: around the place of the last double click while the view turns about it, else around the middle of the scene";
        let turntable = ui.button("Turntable").on_hover_text(hint);
        if turntable.clicked()
            && let Some(path) = view.turntable()
        {
            editor.take(&PacedPath { path, fps: editor.fps });
        }
    });
    if editor.keyframes().is_empty() {
        ui.label("Move the view to the start of the film and add keyframes; the camera moves smoothly between them.");
    }
    ScrollArea::vertical().max_height(260.0).show(ui, |ui| {
        Grid::new("keyframes").num_columns(5).striped(true).show(ui, |ui| {
            keyframes(editor, view, ui);
        });
    });
    ui.add_space(6.0);
    playback(editor, view, ui);
    ui.add_space(6.0);
    let asked = self::film(editor, film, ui);
    files(editor, file, ui).or(asked)
}

fn keyframes(editor: &mut PathEditor, view: &mut SceneView, ui: &mut Ui) {
    let mut removed = None;
    for i in 0..editor.keyframes().len() {
        let keyframe = editor.keyframes()[i];
        let name = ui.label(format!("{}", i + 1)).id;
        if i == 0 {
            ui.label(RichText::new("start").weak());
        } else {
            let mut step = editor.step(i);
            let drag = DragValue::new(&mut step).range(0.05..=600.0).speed(0.05).suffix(" s");
            let hint = "Seconds after the previous keyframe";
            if ui.add(drag).labelled_by(name).on_hover_text(hint).changed() {
                editor.set_step(i, step);
            }
        }
        if ui.button("Go").on_hover_text("Move the view to this keyframe").clicked() {
            editor.moment = keyframe.time;
            view.move_to_keyframe(keyframe);
        }
        let set = ui.button("Set").on_hover_text("Replace this keyframe by the current view");
        if set.clicked()
            && let Some(camera) = view.camera.keyframe()
        {
            editor.replace(i, camera);
        }
        if ui.button("Remove").clicked() {
            removed = Some(i);
        }
        ui.end_row();
    }
    // Removed after the loop, whose indices a removal would shift.
    if let Some(i) = removed {
        editor.remove(i);
    }
}

fn playback(editor: &mut PathEditor, view: &mut SceneView, ui: &mut Ui) {
    let Some(path) = editor.paced() else { return };
    ui.horizontal(|ui| {
        let text = if editor.is_playing { "Stop" } else { "Play" };
        if ui.button(text).clicked() {
            editor.is_playing = !editor.is_playing;
            // From the end, playing starts over.
            if editor.moment >= path.path.duration() {
                editor.moment = 0.0;
            }
        }
        let end = path.path.duration();
        // A formatter, since `fixed_decimals` rounds the value itself, which would stop playback.
        let slider = Slider::new(&mut editor.moment, 0.0..=end).suffix(" s");
        let slider = slider.custom_formatter(|seconds, _| format!("{seconds:.1}"));
        if named(ui.add(slider), "Moment").on_hover_text("Time along the path").changed() {
            editor.is_playing = false;
            view.move_to_keyframe(path.path.at(editor.moment));
        }
    });
    ui.horizontal(|ui| {
        ui.checkbox(&mut editor.is_loop, "Loop")
            .on_hover_text("Return to the first keyframe at the end");
        if editor.is_loop {
            let back = DragValue::new(&mut editor.way_back).range(0.05..=600.0).speed(0.05);
            named(ui.add(back.suffix(" s")), "Return time")
                .on_hover_text("Seconds for returning to the first keyframe");
        }
        let fps = DragValue::new(&mut editor.fps).range(1.0..=120.0).suffix(" pictures per second");
        named(ui.add(fps), "Pictures per second");
    });
    ui.label(RichText::new(format!("{} pictures", path.keyframe_per_frame().len())).weak());
}

fn film(editor: &PathEditor, drawn: Option<f32>, ui: &mut Ui) -> Option<PathRequest> {
    let mut asked = None;
    ui.horizontal(|ui| match drawn {
        Some(share) => {
            ui.add(ProgressBar::new(share).desired_width(120.0).show_percentage());
            if ui.button("Cancel film").clicked() {
                asked = Some(PathRequest::CancelFilm);
            }
        }
        None => {
            let button = Button::new("Render film…");
            let draw = ui.add_enabled(editor.paced().is_some(), button);
            let hint = "Renders the path to a video or a folder of pictures";
            if draw.on_hover_text(hint).clicked() {
                asked = Some(PathRequest::Film);
            }
        }
    });
    asked
}

fn size_choice(size: &mut [u32; 2], ui: &mut Ui) {
    for (side, (prefix, name)) in size.iter_mut().zip([("Size ", "Width"), ("× ", "Height")]) {
        named(ui.add(DragValue::new(side).range(PICTURE_SIDES).prefix(prefix)), name);
    }
    ui.weak("pixels");
}

/// Draws the size of a picture, and buttons for multiples of the viewport's size `shown`.
pub fn picture_choices(size: &mut [u32; 2], shown: [u32; 2], ui: &mut Ui) {
    ui.horizontal(|ui| {
        size_choice(size, ui);
        for factor in [1, 2, 4] {
            let multiple = shown.map(|side| side * factor);
            let fits = multiple.iter().all(|side| PICTURE_SIDES.contains(side));
            let button = ui.add_enabled(fits, Button::new(format!("{factor}×")).small());
            if button.on_hover_text(format!("{factor} times the size of the view")).clicked() {
                *size = multiple;
            }
        }
    });
    ui.weak("The scene as it is shown, without drawings over it. Other shapes show more of it at two sides.");
}

pub fn film_choices(editor: &mut PathEditor, ui: &mut Ui) {
    ui.horizontal(|ui| size_choice(&mut editor.size, ui));
    if let Some(path) = editor.paced() {
        ui.weak(format!("{} pictures of the current scene", path.keyframe_per_frame().len()));
    }
}

fn files(editor: &mut PathEditor, file: &Path, ui: &mut Ui) -> Option<PathRequest> {
    let mut asked = None;
    ui.horizontal(|ui| {
        let path = editor.paced();
        let hint = format!("Writes {}, which `render --path` can render", file.display());
        let save = ui.add_enabled(path.is_some(), Button::new("Save path"));
        if let (true, Some(path)) = (save.on_hover_text(hint).clicked(), path) {
            asked = Some(PathRequest::Save(path.to_json()));
        }
    });
    ui.horizontal(|ui| {
        let open = Button::new("Open path");
        let is_asked = ui.add_enabled(!editor.file.trim().is_empty(), open).clicked();
        let field = TextEdit::singleline(&mut editor.file).hint_text("way.json");
        named(ui.add(field.desired_width(f32::INFINITY)), "Path file");
        if is_asked {
            asked = Some(PathRequest::Open(PathBuf::from(editor.file.trim())));
        }
    });
    asked
}
