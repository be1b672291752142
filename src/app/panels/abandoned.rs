//! Non-modal bar that offers to resume a run left behind by an earlier window.

use crate::app::abandoned::AbandonedRun;
use eframe::egui::{Color32, RichText, Ui};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Resume the run.
    Resume,
    /// Delete the autosave.
    Forget,
    /// Offer it again at the next start.
    NotNow,
}

pub fn ui(run: &AbandonedRun, ui: &mut Ui) -> Option<Answer> {
    let mut answer = None;
    ui.horizontal_wrapped(|ui| {
        ui.label(RichText::new("Unfinished run").strong().color(Color32::from_rgb(230, 180, 80)));
        let AbandonedRun { dataset, frames, planned_frames, .. } = run;
        let name = dataset.file_name().map_or(dataset.as_os_str(), |name| name);
        ui.label(format!(
            "of {}: {frames} of {planned_frames} frames were trained when the program ended unexpectedly",
            name.to_string_lossy()
        ))
        .on_hover_text(format!("{}\n{}", dataset.display(), run.file.display()));
        for (label, choice, tooltip) in [
            ("Continue", Answer::Resume, "Open the run and resume training"),
            ("Forget it", Answer::Forget, "Delete the autosave of this run"),
            ("Not now", Answer::NotNow, "Offer this again at the next start"),
        ] {
            if ui.button(label).on_hover_text(tooltip).clicked() {
                answer = Some(choice);
            }
        }
    });
    answer
}
