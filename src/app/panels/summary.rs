//! Card shown after the last frame: quality, time, size, and next steps.

use super::card::{self, CardPlace};
use crate::app::command::UiCommand;
use crate::app::quality::QualityMonitor;
use crate::app::state::Snapshot;
use eframe::egui::{Button, Grid, RichText, Ui};

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SummaryAnswer {
    Command(UiCommand),
    /// Train on the same frames with a finer structural scale.
    Finer,
    /// Show the figures of every view.
    Quality,
    /// Close the card.
    Close,
}

/// Draws the card. `finer` describes the next finer run, if there is one.
pub fn ui(
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
        (None, _) => match quality.problem() {
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
    let per_frame = 1e3 * snapshot.trained_s / snapshot.frames_done.max(1) as f64;
    [
        ("Time", format!("{:.1} s, {per_frame:.0} ms a frame", snapshot.trained_s)),
        ("Components", snapshot.used.to_string()),
        ("Model", format!("{:.1} MB in memory", snapshot.model_bytes as f64 * 1e-6)),
    ]
}
