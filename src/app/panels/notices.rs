//! Notices at the top of the viewport. Warnings and errors stay until closed; information disappears.

use super::signal_color::SignalColor;
use crate::app::state::{Notice, NoticeKind, Snapshot};
use eframe::egui::{Align2, Area, Color32, Frame, Id, Label, RichText, ScrollArea, Ui, Vec2};
use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

// More would cover the viewport; older ones follow when these are closed.
const SHOWN: usize = 3;
const WIDTH: f32 = 620.0;
const MARGIN: f32 = 10.0;
/// Height above which the notices scroll, as a fraction of the viewport's height, and minimum value of that
/// height, points.
// Cards and viewport below need room in small windows.
const MAX_SHARE: f32 = 0.35;
const MIN_HEIGHT: f32 = 60.0;
const INFO_DURATION: Duration = Duration::from_secs(20);

/// Serial numbers of closed notices, and for every displayed notice the time at which it first appeared.
#[derive(Default)]
pub struct NoticeBoard {
    closed: BTreeSet<u64>,
    shown_since: BTreeMap<u64, Instant>,
}

impl NoticeBoard {
    /// Draws the newest open notices. Returns the height that they occupy at the top of the viewport,
    /// points.
    pub fn ui(&mut self, snapshot: &Snapshot, ui: &Ui) -> f32 {
        self.remove_old(&snapshot.notices);
        let open: Vec<&Notice> =
            snapshot.notices.iter().rev().filter(|n| self.is_open(n)).take(SHOWN).collect();
        if open.is_empty() {
            return 0.0;
        }
        // Restricted to the viewport: over the panels they would block controls.
        let room = ui.max_rect().width() - 40.0;
        let top = ui.max_rect().center_top() + Vec2::new(0.0, MARGIN);
        let most = (MAX_SHARE * ui.max_rect().height()).max(MIN_HEIGHT);
        let area = Area::new(Id::unique("notices")).fixed_pos(top).pivot(Align2::CENTER_TOP);
        let shown = area.show(ui.ctx(), |ui| {
            Frame::popup(ui.style()).show(ui, |ui| {
                ui.set_max_width(WIDTH.min(room));
                ScrollArea::vertical().max_height(most).show(ui, |ui| {
                    open.into_iter().for_each(|notice| self.row(notice, ui));
                });
            });
        });
        shown.response.rect.bottom() - ui.max_rect().top()
    }

    fn row(&mut self, notice: &Notice, ui: &mut Ui) {
        ui.horizontal(|ui| {
            if ui.small_button("×").on_hover_text("Close this notice").clicked() {
                self.closed.insert(notice.serial);
            }
            let (word, color) = label_and_color(notice.kind, ui.visuals().dark_mode);
            ui.label(RichText::new(word).strong().color(color));
            ui.add(Label::new(&notice.text).wrap());
        });
        self.shown_since.entry(notice.serial).or_insert_with(Instant::now);
        if notice.kind == NoticeKind::Info {
            // egui does not repaint without input, so the notice would stay.
            ui.ctx().request_repaint_after(INFO_DURATION);
        }
    }

    fn is_open(&self, notice: &Notice) -> bool {
        let age = self.shown_since.get(&notice.serial).map(Instant::elapsed);
        let has_faded = notice.kind == NoticeKind::Info && age.is_some_and(|a| a >= INFO_DURATION);
        !self.closed.contains(&notice.serial) && !has_faded
    }

    fn remove_old(&mut self, notices: &[Notice]) {
        // The worker drops old notices; without this the two sets would grow for ever.
        let oldest = notices.first().map_or(u64::MAX, |notice| notice.serial);
        self.closed.retain(|&serial| serial >= oldest);
        self.shown_since.retain(|&serial, _| serial >= oldest);
    }
}

fn label_and_color(kind: NoticeKind, is_dark: bool) -> (&'static str, Color32) {
    match kind {
        NoticeKind::Info => ("Note", SignalColor::Blue.for_theme(is_dark)),
        NoticeKind::Warning => ("Warning", SignalColor::Yellow.for_theme(is_dark)),
        NoticeKind::Error => ("Error", SignalColor::Red.for_theme(is_dark)),
    }
}
