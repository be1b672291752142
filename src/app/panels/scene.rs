//! What is open: what is known of the dataset or model, and the frames that were skipped.

use crate::app::state::Snapshot;
use eframe::egui::{Grid, RichText, ScrollArea, Ui};

/// Draws the panel.
pub fn ui(snapshot: &Snapshot, ui: &mut Ui) {
    let Some(opened) = &snapshot.opened else {
        ui.label("Nothing is open.");
        return;
    };
    ScrollArea::vertical().show(ui, |ui| {
        Grid::new("info").num_columns(2).striped(true).show(ui, |ui| {
            for (label, value) in &opened.info {
                ui.label(RichText::new(label).weak());
                ui.add(eframe::egui::Label::new(value).wrap());
                ui.end_row();
            }
        });
        if snapshot.skipped.is_empty() {
            return;
        }
        ui.add_space(8.0);
        ui.label(RichText::new(format!("Skipped frames: {}", snapshot.skipped.len())).strong());
        for frame in snapshot.skipped.iter() {
            ui.label(&frame.message);
        }
    });
}
