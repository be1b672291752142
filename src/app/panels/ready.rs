//! Card shown before training: what was recognised, the first photograph, and the Train button.

use super::card;
use super::card::CardPlace;
use super::signal_color::SignalColor;
use crate::app::command::UiCommand;
use crate::app::quality::QualityMonitor;
use crate::app::state::{Opened, RunState, Snapshot};
use crate::app::wording;
use crate::export::format::{READ_ENDINGS, listed};
use eframe::egui::{
    Button, Color32, Frame, Grid, Id, Image, Label, RichText, Stroke, TextureHandle, Ui, Vec2,
};

const WIDTH: f32 = 250.0;
const PHOTO_HEIGHT: f32 = 190.0;
/// Height assumed for the text before its first layout, points.
// The photograph above the text needs the height of the text below it, known only one pass later.
const TEXT_HEIGHT: f32 = 170.0;
/// Height below which the photograph is omitted, points.
const MIN_PHOTO_HEIGHT: f32 = 40.0;

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
    card::show("ready", place, ui, contents, |ui| asked = train_button(snapshot, ui));
    asked
}

fn dataset_facts(snapshot: &Snapshot, opened: &Opened, ui: &mut Ui) {
    ui.label(RichText::new(&opened.name).strong().size(16.0));
    for line in describe_layout(opened) {
        ui.add(Label::new(line).wrap().selectable(false));
    }
    if let Some(check) = &snapshot.sampling.poses {
        let warnings = check.warnings();
        let text = match warnings.is_empty() {
            false => SignalColor::Yellow.text(warnings.join("\n"), ui),
            true => RichText::new(wording::pose_agreement(check)).weak(),
        };
        ui.add(Label::new(text).wrap().selectable(false));
    }
}

fn train_button(snapshot: &Snapshot, ui: &mut Ui) -> Option<UiCommand> {
    let text = RichText::new(format!("Train {} frames", snapshot.n_frames)).size(18.0);
    let button = Button::new(text).fill(ui.visuals().selection.bg_fill);
    let train = ui.add_sized(Vec2::new(WIDTH, 36.0), button);
    let train = train.on_hover_text(UiCommand::Train.hint(ui.ctx()));
    train.clicked().then_some(UiCommand::Train)
}

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

pub const WHAT_HAPPENS: &str = "Turns photographs with depth into a Gaussian-splat scene while you watch, \
                                using each frame once";

/// Draws the start page below the notices, which cover the top `noticed` points of the viewport. Returns
/// the requested command.
pub fn start(snapshot: &Snapshot, noticed: f32, ui: &mut Ui) -> Option<UiCommand> {
    let mut asked = None;
    ui.vertical_centered(|ui| {
        ui.add_space((ui.available_height() * 0.22).max(noticed + 10.0));
        if let Some(followed) = &snapshot.following.recording {
            let path = followed.path.display();
            ui.label(RichText::new(format!("Waiting for the first frame of {path}")).size(22.0));
            ui.label(followed.problem.as_deref().unwrap_or_default());
            return;
        }
        if snapshot.state == RunState::Loading {
            ui.label(RichText::new("Opening…").size(22.0));
            return;
        }
        ui.label(RichText::new("VBGS Studio").size(28.0).strong());
        ui.label(RichText::new(WHAT_HAPPENS).size(15.0));
        ui.add_space(18.0);
        target(ui);
        ui.add_space(12.0);
        let big = |text: &str| Button::new(RichText::new(text).size(15.0)).min_size(BUTTON);
        let open = ui.add(big(UiCommand::Open.label()));
        if open.on_hover_text(UiCommand::Open.hint(ui.ctx())).clicked() {
            asked = Some(UiCommand::Open);
        }
        let demo = ui.add(big("Try the synthetic scene"));
        if demo.on_hover_text(UiCommand::OpenDemo.hint(ui.ctx())).clicked() {
            asked = Some(UiCommand::OpenDemo);
        }
    });
    asked
}

const BUTTON: Vec2 = Vec2::new(220.0, 32.0);

/// Draws an outlined target area for dropped folders. The whole window accepts drops.
fn target(ui: &mut Ui) {
    let width = (ui.available_width() - 40.0).clamp(100.0, 460.0);
    let line = Stroke::new(1.5, Color32::from_gray(110));
    // A frame, not a painted rectangle: it grows when lines wrap in a narrow window.
    let frame = Frame::new().stroke(line).corner_radius(8.0).inner_margin(14.0);
    ui.allocate_ui(Vec2::new(width, 0.0), |ui| {
        frame.show(ui, |ui| {
            ui.vertical_centered(|ui| {
                ui.label(RichText::new("Your own capture: drop a folder").size(20.0));
                ui.label("from a depth camera, a phone or a renderer; the format is detected");
                let endings = listed(&READ_ENDINGS);
                ui.label(
                    RichText::new(format!(
                        "or a checkpoint to resume, or splats to view ({endings})"
                    ))
                    .weak(),
                );
            });
        });
    });
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SummaryAnswer {
    Command(UiCommand),
    Finer,
    Quality,
    Close,
}

/// Draws the summary card. `finer` describes a run with finer detail, if one is possible.
pub fn summary(
    snapshot: &Snapshot,
    quality: &QualityMonitor,
    finer: Option<&str>,
    place: CardPlace,
    ui: &Ui,
) -> Option<SummaryAnswer> {
    let (mut answer, mut asked) = (None, None);
    let contents = |ui: &mut Ui| {
        ui.horizontal(|ui| {
            // At the left, which stays in place when new figures widen the card.
            if ui.small_button("×").on_hover_text("Close this card").clicked() {
                answer = Some(SummaryAnswer::Close);
            }
            let title = format!("Trained on {} frames", snapshot.frames_done);
            ui.label(RichText::new(title).strong().size(16.0));
        });
        Grid::new("summary").num_columns(2).spacing([14.0, 3.0]).show(ui, |ui| {
            ui.label(RichText::new("Held out").weak());
            let figures = ui
                .link(quality_text(quality))
                .on_hover_text("Shows the figures of every view and their history");
            if figures.clicked() {
                answer = Some(SummaryAnswer::Quality);
            }
            ui.end_row();
            // Present from the start: a row added with the figures would shift the rows above it, since the
            // card is anchored at its bottom.
            ui.label(RichText::new("Where covered").weak());
            ui.label(covered(quality));
            ui.end_row();
            for (label, value) in facts(snapshot) {
                ui.label(RichText::new(label).weak());
                ui.label(value);
                ui.end_row();
            }
        });
    };
    card::show("summary", place, ui, contents, |ui| {
        ui.horizontal(|ui| asked = buttons(finer, ui));
    });
    asked.or(answer)
}

fn buttons(finer: Option<&str>, ui: &mut Ui) -> Option<SummaryAnswer> {
    let mut answer = None;
    let mut offer = |ui: &mut Ui, text: &str, hint: &str, then: SummaryAnswer| {
        if ui.add(Button::new(text)).on_hover_text(hint).clicked() {
            answer = Some(then);
        }
    };
    let (export, compare) = (UiCommand::Export, UiCommand::ComparePhoto);
    offer(ui, "Export scene…", &export.hint(ui.ctx()), SummaryAnswer::Command(export));
    let hint = compare.hint(ui.ctx());
    offer(ui, "Compare with photographs", &hint, SummaryAnswer::Command(compare));
    if let Some(finer) = finer {
        offer(ui, "Again, finer", finer, SummaryAnswer::Finer);
    }
    answer
}

fn quality_text(quality: &QualityMonitor) -> String {
    let (done, all) = quality.progress();
    match (quality.result(), all) {
        (Some(point), _) => {
            let views = if all == 1 { "view" } else { "views" };
            format!("{:.2} dB, SSIM {:.3} on {all} {views}", point.psnr, point.ssim)
        }
        (None, 0) => "no views".to_owned(),
        (None, _) => match &quality.problem {
            Some(_) => "could not be measured".to_owned(),
            None => format!("measuring: {done} of {all} views"),
        },
    }
}

fn covered(quality: &QualityMonitor) -> String {
    let found = quality.result().and_then(|point| point.covered);
    found.map_or("–".to_owned(), |(psnr, share)| {
        format!("{psnr:.2} dB over {:.0} % of the pixels", 100.0 * share)
    })
}

fn facts(snapshot: &Snapshot) -> [(&'static str, String); 3] {
    // At least 1: all frames may have been skipped.
    let per_frame = 1e3 * snapshot.pace.trained_s / snapshot.frames_done.max(1) as f64;
    [
        ("Time", format!("{:.1} s, {per_frame:.0} ms a frame", snapshot.pace.trained_s)),
        ("Components", snapshot.model.used.to_string()),
        ("Model", format!("{:.1} MB in memory", snapshot.model.bytes as f64 * 1e-6)),
    ]
}
