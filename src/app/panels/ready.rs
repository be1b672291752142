//! Card shown before training: what was recognised, the first photograph, and the Train button.

use super::card::{self, CardPlace};
use super::signal_color::SignalColor;
use crate::app::command::UiCommand;
use crate::app::state::{Opened, Snapshot};
use crate::app::wording;
use eframe::egui::{Button, Id, Image, Label, RichText, TextureHandle, Ui, Vec2};

/// Width of the card, points.
const WIDTH: f32 = 250.0;
/// Largest height of the photograph, points.
const PHOTO_HEIGHT: f32 = 190.0;
/// Height assumed for the text before its first layout, points.
const TEXT_HEIGHT: f32 = 170.0;
/// A smaller photograph is omitted, points.
const MIN_PHOTO_HEIGHT: f32 = 40.0;

/// Draws the card; returns the command if the button is clicked.
pub fn ui(
    snapshot: &Snapshot,
    opened: &Opened,
    photo: Option<&TextureHandle>,
    place: CardPlace,
    ui: &Ui,
) -> Option<UiCommand> {
    let mut asked = None;
    let contents = |ui: &mut Ui| {
        ui.set_width(WIDTH);
        // The photograph gets the height left by the text.
        let measured = Id::unique("ready's text");
        let text = ui.data(|data| data.get_temp(measured)).unwrap_or(TEXT_HEIGHT);
        let height = PHOTO_HEIGHT.min(place.max_height - text);
        if let Some(photo) = photo.filter(|_| height >= MIN_PHOTO_HEIGHT) {
            let size = photo.size_vec2();
            let scale = (WIDTH / size.x).min(height / size.y);
            ui.add(Image::new(photo).fit_to_exact_size(size * scale))
                .on_hover_text("The first photograph");
        }
        let top = ui.cursor().top();
        dataset_facts(snapshot, opened, ui);
        let text = ui.min_rect().bottom() - top + ui.spacing().item_spacing.y;
        ui.data_mut(|data| data.insert_temp(measured, text));
    };
    card::show("ready", place, ui, contents, |ui| asked = button(snapshot, ui));
    asked
}

fn dataset_facts(snapshot: &Snapshot, opened: &Opened, ui: &mut Ui) {
    ui.label(RichText::new(&opened.name).strong().size(16.0));
    for line in describe_layout(opened) {
        ui.add(Label::new(line).wrap().selectable(false));
    }
    if let Some(check) = &snapshot.poses {
        let text = match wording::pose_warning(check) {
            Some(warning) => {
                RichText::new(warning).color(SignalColor::Yellow.for_theme(ui.visuals().dark_mode))
            }
            None => RichText::new(wording::pose_agreement(check)).weak(),
        };
        ui.add(Label::new(text).wrap().selectable(false));
    }
}

fn button(snapshot: &Snapshot, ui: &mut Ui) -> Option<UiCommand> {
    let text = RichText::new(format!("Train {} frames", snapshot.n_frames)).size(18.0);
    let button = Button::new(text).fill(ui.visuals().selection.bg_fill);
    let train = ui.add_sized(Vec2::new(WIDTH, 36.0), button);
    let train = train.on_hover_text(UiCommand::Train.hint(ui.ctx()));
    train.clicked().then_some(UiCommand::Train)
}

/// Layout, frames, image size and depth of each split.
fn describe_layout(opened: &Opened) -> Vec<String> {
    let Some(dataset) = &opened.dataset else { return Vec::new() };
    let mut lines = vec![format!("Recognised as {}", dataset.layout.name())];
    for (i, split) in dataset.splits.iter().enumerate() {
        let Some(first) = split.frames.first() else { continue };
        let k = &first.camera.intrinsics;
        let (name, n) = (&split.name, split.frames.len());
        let trained = opened.plan.as_ref().filter(|plan| plan.split == i);
        let what = match (split.has_depth, trained.map(|plan| plan.first_pass().len())) {
            (_, Some(trained)) if trained == n => ", all for training".to_owned(),
            (_, Some(trained)) => format!(", {trained} of them for training"),
            (true, None) => String::new(),
            (false, None) => ", colour only".to_owned(),
        };
        lines.push(format!("{name}: {n} frames of {}×{}{what}", k.width, k.height));
    }
    lines
}
