//! What the user should read, over the top of the viewport, until dismissed.

use crate::app::state::{Notice, NoticeKind, Snapshot};
use eframe::egui::{Align2, Area, Color32, Frame, Id, RichText, Ui, Vec2};

/// Notices shown at once; the newest come first.
const SHOWN: usize = 3;

/// Draws the newest notices after `dismissed_up_to`; returns the serial up to which the user has
/// dismissed them now.
pub fn ui(snapshot: &Snapshot, dismissed_up_to: u64, ui: &Ui) -> u64 {
    let waiting: Vec<&Notice> =
        snapshot.notices.iter().rev().filter(|n| n.serial > dismissed_up_to).take(SHOWN).collect();
    let mut dismissed = dismissed_up_to;
    if waiting.is_empty() {
        return dismissed;
    }
    let top = ui.max_rect().center_top() + Vec2::new(0.0, 10.0);
    Area::new(Id::unique("notices")).fixed_pos(top).pivot(Align2::CENTER_TOP).show(
        ui.ctx(),
        |ui| {
            Frame::popup(ui.style()).show(ui, |ui| {
                ui.set_max_width(620.0);
                for notice in &waiting {
                    ui.horizontal(|ui| {
                        let (word, color) = heading(notice.kind);
                        ui.label(RichText::new(word).strong().color(color));
                        ui.add(eframe::egui::Label::new(&notice.text).wrap());
                    });
                }
                if ui.button("Dismiss").clicked() {
                    // Older ones too, which there was no room for: else every click
                    // would bring up three more.
                    dismissed = snapshot.notices.last().map_or(dismissed, |n| n.serial);
                }
            });
        },
    );
    dismissed
}

fn heading(kind: NoticeKind) -> (&'static str, Color32) {
    match kind {
        NoticeKind::Info => ("Note", Color32::from_rgb(110, 170, 240)),
        NoticeKind::Warning => ("Warning", Color32::from_rgb(230, 180, 80)),
        NoticeKind::Error => ("Error", Color32::from_rgb(240, 100, 90)),
    }
}
