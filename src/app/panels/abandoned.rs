//! The question about a run that an earlier window left behind. It blocks nothing: whoever wants to
//! look at something else first can.

use crate::app::abandoned::AbandonedRun;
use eframe::egui::{Color32, RichText, Ui};

/// What the user wants of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// To go on where it stopped.
    GoOn,
    /// To forget it.
    GiveUp,
    /// To be asked at the next start.
    NotNow,
}

/// Draws the line with its buttons.
pub fn ui(run: &AbandonedRun, ui: &mut Ui) -> Option<Answer> {
    let mut answer = None;
    ui.horizontal_wrapped(|ui| {
        ui.label(RichText::new("Unfinished run").strong().color(Color32::from_rgb(230, 180, 80)));
        let AbandonedRun { dataset, frames, planned_frames, .. } = run;
        let name = dataset.file_name().map_or(dataset.as_os_str(), |name| name);
        ui.label(format!(
            "of {}: {frames} of {planned_frames} frames were trained when the program ended without being closed",
            name.to_string_lossy()
        ))
        .on_hover_text(format!("{}\n{}", dataset.display(), run.file.display()));
        for (label, choice, tooltip) in [
            ("Continue", Answer::GoOn, "Open it and go on where it stopped"),
            ("Forget it", Answer::GiveUp, "Remove what was saved of it"),
            ("Not now", Answer::NotNow, "Ask again at the next start"),
        ] {
            if ui.button(label).on_hover_text(tooltip).clicked() {
                answer = Some(choice);
            }
        }
    });
    answer
}
