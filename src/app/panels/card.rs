//! A card over the lower left of the viewport: as tall as what is on it, as far as there is room for that. What
//! can be done is at its foot, which is always seen; the rest is scrolled where it must be.

use eframe::egui::{Align2, Area, Frame, Id, Pos2, ScrollArea, Ui, Vec2};

/// Distance of a card from the edges of the viewport and from what lies above it, points.
const MARGIN: f32 = 12.0;
/// Tallest foot, points.
const FOOT: f32 = 44.0;
/// A card with less room covers what lies above it: nothing could be read on it.
const MIN_HEIGHT: f32 = 40.0;

/// Where a card may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CardPlace {
    /// Its lower left corner.
    at: Pos2,
    /// Tallest content above the foot, points.
    pub room: f32,
}

impl CardPlace {
    /// In the viewport of `ui`, below what takes `taken` points from its top.
    pub fn below(taken: f32, ui: &Ui) -> Self {
        let viewport = ui.max_rect();
        let frame = Frame::popup(ui.style()).total_margin().sum().y;
        let room = viewport.height() - taken - 2.0 * MARGIN - frame - FOOT;
        let at = viewport.left_bottom() + Vec2::new(MARGIN, -MARGIN);
        Self { at, room: room.max(MIN_HEIGHT) }
    }
}

/// Draws a card with a foot. What it has no room for is scrolled to.
pub fn show(
    name: &'static str,
    place: CardPlace,
    ui: &Ui,
    contents: impl FnOnce(&mut Ui),
    foot: impl FnOnce(&mut Ui),
) {
    let area = Area::new(Id::unique(name)).fixed_pos(place.at).pivot(Align2::LEFT_BOTTOM);
    area.show(ui.ctx(), |ui| {
        Frame::popup(ui.style()).show(ui, |ui| {
            // Egui takes the room below the card's last place for all there is, which is too little for a card
            // that stands on its lower corner.
            let scrolled = ScrollArea::vertical().min_scrolled_height(place.room);
            scrolled.max_height(place.room).show(ui, contents);
            ui.add_space(4.0);
            foot(ui);
        });
    });
}
