//! The camera path: its keyframes, a preview, and the file that `render --path` draws.

use super::explained::named;
use crate::app::path_editor::PathEditor;
use crate::math::camera_path::Keyframe;
use eframe::egui::{
    Button, DragValue, Grid, ProgressBar, RichText, ScrollArea, Slider, TextEdit, Ui,
};
use std::path::{Path, PathBuf};

/// Sides of the pictures of a film, pixels.
const FILM_SIDES: std::ops::RangeInclusive<u32> = 16..=8192;

/// What the user asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum PathRequest {
    /// The view as it is now as a further keyframe.
    Add,
    /// The view as it is now in place of a keyframe.
    Replace(usize),
    /// A turn around what the camera looks at.
    Turntable,
    /// To stand there.
    Show(Keyframe),
    /// To write the path.
    Save(String),
    /// To read another.
    Open(PathBuf),
    /// To draw it into files.
    Film,
    /// To draw it no further.
    CancelFilm,
}

/// Draws the panel; `file` is where the path is saved, `film` the share that is drawn of a film.
pub fn ui(
    editor: &mut PathEditor,
    file: &Path,
    film: Option<f32>,
    ui: &mut Ui,
) -> Option<PathRequest> {
    let mut asked = None;
    ui.horizontal_wrapped(|ui| {
        if ui.button("Add keyframe").on_hover_text("The view as it is now").clicked() {
            asked = Some(PathRequest::Add);
        }
        let hint = "A path around what the camera looks at, in place of these keyframes";
        if ui.button("Turntable").on_hover_text(hint).clicked() {
            asked = Some(PathRequest::Turntable);
        }
    });
    if editor.keyframes().is_empty() {
        ui.label("Stand where the film is to begin, then add keyframes: the camera moves smoothly from one to the next.");
    }
    ScrollArea::vertical().max_height(260.0).show(ui, |ui| {
        Grid::new("keyframes").num_columns(5).striped(true).show(ui, |ui| {
            asked = keyframes(editor, ui).or(asked.take());
        });
    });
    ui.add_space(6.0);
    asked = preview(editor, ui).or(asked);
    ui.add_space(6.0);
    asked = self::film(editor, film, ui).or(asked);
    files(editor, file, ui).or(asked)
}

fn keyframes(editor: &mut PathEditor, ui: &mut Ui) -> Option<PathRequest> {
    let (mut asked, mut removed) = (None, None);
    for i in 0..editor.keyframes().len() {
        let keyframe = editor.keyframes()[i];
        let name = ui.label(format!("{}", i + 1)).id;
        if i == 0 {
            ui.label(RichText::new("start").weak());
        } else {
            let mut step = editor.step(i);
            let drag = DragValue::new(&mut step).range(0.05..=600.0).speed(0.05).suffix(" s");
            let hint = "Seconds after the keyframe before";
            if ui.add(drag).labelled_by(name).on_hover_text(hint).changed() {
                editor.set_step(i, step);
            }
        }
        if ui.button("Go").on_hover_text("Look from there").clicked() {
            editor.moment = keyframe.time;
            asked = Some(PathRequest::Show(keyframe));
        }
        if ui.button("Set").on_hover_text("Take the view as it is now instead").clicked() {
            asked = Some(PathRequest::Replace(i));
        }
        if ui.button("Remove").clicked() {
            removed = Some(i);
        }
        ui.end_row();
    }
    if let Some(i) = removed {
        editor.remove(i);
    }
    asked
}

/// Playing, and any moment by hand.
fn preview(editor: &mut PathEditor, ui: &mut Ui) -> Option<PathRequest> {
    let path = editor.paced()?;
    let mut asked = None;
    ui.horizontal(|ui| {
        let text = if editor.is_playing { "Stop" } else { "Play" };
        if ui.button(text).clicked() {
            editor.is_playing = !editor.is_playing;
            if editor.moment >= path.path.duration() {
                editor.moment = 0.0;
            }
        }
        let end = path.path.duration();
        // Formatted, not `fixed_decimals`: that rounds the moment itself, and playing would stand still.
        let slider = Slider::new(&mut editor.moment, 0.0..=end).suffix(" s");
        let slider = slider.custom_formatter(|seconds, _| format!("{seconds:.1}"));
        if named(ui.add(slider), "Moment").on_hover_text("The moment that is shown").changed() {
            editor.is_playing = false;
            asked = Some(PathRequest::Show(path.path.at(editor.moment)));
        }
    });
    ui.horizontal(|ui| {
        ui.checkbox(&mut editor.is_loop, "Loop").on_hover_text("Back to the first keyframe");
        if editor.is_loop {
            let back = DragValue::new(&mut editor.way_back).range(0.05..=600.0).speed(0.05);
            named(ui.add(back.suffix(" s")), "Way back")
                .on_hover_text("Seconds that the way back takes");
        }
        let fps = DragValue::new(&mut editor.fps).range(1.0..=120.0).suffix(" pictures a second");
        named(ui.add(fps), "Pictures a second");
    });
    ui.label(RichText::new(format!("{} pictures", path.pictures().len())).weak());
    asked
}

/// The film of the path, drawn into files.
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
            let button = Button::new("Draw film…");
            let draw = ui.add_enabled(editor.paced().is_some(), button);
            let hint = "Draws every picture of the path into a folder or a video";
            if draw.on_hover_text(hint).clicked() {
                asked = Some(PathRequest::Film);
            }
        }
    });
    asked
}

/// Choices of the dialog that asks where a film goes.
pub fn film_choices(editor: &mut PathEditor, ui: &mut Ui) {
    ui.horizontal(|ui| {
        for (side, (suffix, name)) in
            editor.size.iter_mut().zip([(" wide", "Width"), (" high", "Height")])
        {
            named(ui.add(DragValue::new(side).range(FILM_SIDES).suffix(suffix)), name);
        }
        ui.weak("pixels");
    });
    if let Some(path) = editor.paced() {
        ui.weak(format!("{} pictures of the scene as it is now", path.pictures().len()));
    }
}

fn files(editor: &mut PathEditor, file: &Path, ui: &mut Ui) -> Option<PathRequest> {
    let mut asked = None;
    ui.horizontal(|ui| {
        let path = editor.paced();
        let hint = format!("Writes {}, which `render --path` draws", file.display());
        let save = ui.add_enabled(path.is_some(), Button::new("Save path"));
        if let (true, Some(path)) = (save.on_hover_text(hint).clicked(), path) {
            asked = Some(PathRequest::Save(path.to_json()));
        }
    });
    ui.horizontal(|ui| {
        let open = Button::new("Open path");
        let is_asked = ui.add_enabled(!editor.file.trim().is_empty(), open).clicked();
        let field = TextEdit::singleline(&mut editor.file).hint_text("way.json");
        named(ui.add(field.desired_width(f32::INFINITY)), "File of a path");
        if is_asked {
            asked = Some(PathRequest::Open(PathBuf::from(editor.file.trim())));
        }
    });
    asked
}
