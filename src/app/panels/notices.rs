//! Notices at the top of the viewport, one line each. Warnings and errors stay until closed; information
//! disappears.

use super::signal_color::SignalColor;
use crate::app::state::{Notice, NoticeKind, NoticeOffer, Snapshot};
use eframe::egui::{
    Align2, Area, Color32, CursorIcon, Frame, Id, Label, RichText, ScrollArea, Sense, Ui, Vec2,
};
use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

// More would cover the viewport; older ones follow when these are closed.
const SHOWN: usize = 3;
const WIDTH: f32 = 620.0;
/// Distance from the top of the viewport, points.
// Captions of compared pictures lie above.
const TOP: f32 = 40.0;
/// Width at the right of the viewport that the orientation axes and their button occupy, points.
const AXES: f32 = 80.0;
/// Height above which the notices scroll, as a fraction of the viewport's height, and minimum value of that
/// height, points.
// The viewport below needs room in small windows.
const MAX_SHARE: f32 = 0.35;
const MIN_HEIGHT: f32 = 60.0;
/// Label of the button that opens the recording of which the user has chosen a part.
pub const OPEN_ABOVE: &str = "Open the folder above";
const INFO_DURATION: Duration = Duration::from_secs(20);

/// Serial numbers of closed notices and of those shown in full, and for every displayed notice the time at
/// which it first appeared.
#[derive(Default)]
pub struct NoticeBoard {
    closed: BTreeSet<u64>,
    in_full: BTreeSet<u64>,
    shown_since: BTreeMap<u64, Instant>,
}

impl NoticeBoard {
    /// Draws the newest open notices. Returns the height that they occupy at the top of the viewport,
    /// points, and the offer that the user takes.
    pub fn ui(&mut self, snapshot: &Snapshot, ui: &Ui) -> (f32, Option<NoticeOffer>) {
        self.remove_old(&snapshot.notices);
        let open: Vec<&Notice> =
            snapshot.notices.iter().rev().filter(|n| self.is_open(n)).collect();
        if open.is_empty() {
            return (0.0, None);
        }
        // Restricted to the viewport: over the panels they would block controls.
        let place = ui.max_rect().with_max_x(ui.max_rect().right() - AXES);
        let room = place.width() - 40.0;
        let top = place.center_top() + Vec2::new(0.0, TOP);
        let most = (MAX_SHARE * ui.max_rect().height()).max(MIN_HEIGHT);
        let mut asked = None;
        let area = Area::new(Id::unique("notices")).fixed_pos(top).pivot(Align2::CENTER_TOP);
        let shown = area.show(ui.ctx(), |ui| {
            Frame::popup(ui.style()).show(ui, |ui| {
                ui.set_max_width(WIDTH.min(room));
                ScrollArea::vertical().max_height(most).show(ui, |ui| {
                    for notice in open.iter().take(SHOWN) {
                        asked = self.row(notice, ui).or(asked.take());
                    }
                });
                if open.len() > 1 && ui.small_button("Close all").clicked() {
                    self.closed.extend(open.iter().map(|notice| notice.serial));
                }
            });
        });
        (shown.response.rect.bottom() - ui.max_rect().top(), asked)
    }

    /// Draws a notice in one line. A click on its text shows all of it.
    fn row(&mut self, notice: &Notice, ui: &mut Ui) -> Option<NoticeOffer> {
        let mut asked = None;
        ui.horizontal(|ui| {
            if ui.small_button("×").on_hover_text("Close this notice").clicked() {
                self.closed.insert(notice.serial);
            }
            let (word, color) = label_and_color(notice.kind, ui.visuals().dark_mode);
            ui.label(RichText::new(word).strong().color(color));
            if let Some(offer) = &notice.offer {
                let (label, hint) = match offer {
                    NoticeOffer::OpenAs(_) => (
                        "Open as…",
                        "Open it with other options: poses, depth unit, intrinsics".to_owned(),
                    ),
                    NoticeOffer::OpenAbove(above) => (OPEN_ABOVE, above.display().to_string()),
                };
                if ui.small_button(label).on_hover_text(hint).clicked() {
                    asked = Some(offer.clone());
                }
            }
            let label = Label::new(&notice.text).sense(Sense::click());
            if self.in_full.contains(&notice.serial) {
                ui.add(label.wrap());
            } else {
                let line = ui.add(label.truncate()).on_hover_text(&notice.text);
                if line.on_hover_cursor(CursorIcon::PointingHand).clicked() {
                    self.in_full.insert(notice.serial);
                }
            }
        });
        self.shown_since.entry(notice.serial).or_insert_with(Instant::now);
        if notice.kind == NoticeKind::Info {
            // egui does not repaint without input, so the notice would stay.
            ui.ctx().request_repaint_after(INFO_DURATION);
        }
        asked
    }

    fn is_open(&self, notice: &Notice) -> bool {
        let age = self.shown_since.get(&notice.serial).map(Instant::elapsed);
        let has_faded = notice.kind == NoticeKind::Info && age.is_some_and(|a| a >= INFO_DURATION);
        !self.closed.contains(&notice.serial) && !has_faded
    }

    fn remove_old(&mut self, notices: &[Notice]) {
        // The worker drops old notices; without this the sets would grow for ever.
        let oldest = notices.first().map_or(u64::MAX, |notice| notice.serial);
        self.closed.retain(|&serial| serial >= oldest);
        self.in_full.retain(|&serial| serial >= oldest);
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
