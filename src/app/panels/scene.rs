//! Scene panel: facts about the open dataset or model, skipped frames and outlier frames.

use super::signal_color::SignalColor;
use crate::app::state::Snapshot;
use crate::app::wording;
use crate::dataset::pose_check::PoseCheck;
use eframe::egui::{Grid, RichText, ScrollArea, Ui};

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
        if let Some(check) = &snapshot.poses {
            poses(check, ui);
        }
        let skipped: Vec<&str> = snapshot.skipped.iter().map(|s| s.message.as_str()).collect();
        list("Skipped frames", &skipped, ui);
        let doubts: Vec<&str> = snapshot.outlier_reports.iter().map(String::as_str).collect();
        list("Photographs that contradict the scene", &doubts, ui);
    });
}

/// Agreement of poses and depth, with a warning if it is poor.
fn poses(check: &PoseCheck, ui: &mut Ui) {
    ui.add_space(8.0);
    ui.label(RichText::new("Poses").strong());
    ui.label(wording::pose_agreement(check));
    if let Some(warning) = wording::pose_warning(check) {
        let color = SignalColor::Yellow.for_theme(ui.visuals().dark_mode);
        ui.label(RichText::new(warning).color(color));
    }
}

/// Titled list; omitted if it is empty.
fn list(title: &str, messages: &[&str], ui: &mut Ui) {
    if messages.is_empty() {
        return;
    }
    ui.add_space(8.0);
    ui.label(RichText::new(format!("{title}: {}", messages.len())).strong());
    for message in messages {
        ui.label(*message);
    }
}
