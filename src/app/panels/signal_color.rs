//! Signal colours of text, readable on dark and light panels.

use crate::app::color_mode::ColorMode;
use crate::math::image::unit_to_byte;
use crate::render::attributes::{Attribute, Range, UNKNOWN};
use crate::render::finish::ramp;
use eframe::egui::{
    Align, Align2, Area, Color32, Frame, Id, Layout, Pos2, Rect, RichText, Sense, Ui, Vec2, pos2,
};

/// Colour that signals a state or severity. Text beside it states the same meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignalColor {
    /// Signals a finished state, or information.
    Blue,
    Green,
    /// Signals a waiting state, or a warning.
    Yellow,
    Red,
}

impl SignalColor {
    pub fn for_theme(self, is_dark: bool) -> Color32 {
        // Each has the contrast of 4.5 that small text needs (WCAG 2.1).
        let [on_dark, on_light] = match self {
            Self::Blue => [Color32::from_rgb(110, 170, 240), Color32::from_rgb(20, 90, 190)],
            Self::Green => [Color32::from_rgb(110, 200, 120), Color32::from_rgb(20, 115, 40)],
            Self::Yellow => [Color32::from_rgb(230, 180, 80), Color32::from_rgb(140, 85, 0)],
            Self::Red => [Color32::from_rgb(240, 100, 90), Color32::from_rgb(185, 30, 25)],
        };
        if is_dark { on_dark } else { on_light }
    }

    /// Returns text in this colour, for the theme of `ui`.
    pub fn text(self, text: impl Into<String>, ui: &Ui) -> RichText {
        RichText::new(text).color(self.for_theme(ui.visuals().dark_mode))
    }
}

const BAR: Vec2 = Vec2::new(180.0, 12.0);
const STRIPS: usize = 60;

pub fn ui(attribute: Attribute, range: Option<&Range>, corner: Pos2, ui: &Ui) {
    let area = Area::new(Id::unique("legend")).fixed_pos(corner).pivot(Align2::LEFT_BOTTOM);
    // Not interactive: the pointer over the legend still controls the camera.
    area.interactable(false).show(ui.ctx(), |ui| {
        Frame::popup(ui.style()).show(ui, |ui| {
            ui.set_width(BAR.x);
            ui.label(RichText::new(title(attribute)).strong());
            match range {
                Some(range) => bar(range, ui),
                None => {
                    ui.label(RichText::new(unknown_reason(attribute)).weak());
                }
            }
            // The share is known of every splat.
            if attribute != Attribute::Texture {
                ui.horizontal(|ui| {
                    swatch(Some(to_color32(UNKNOWN)), ui);
                    ui.label(RichText::new("unknown").weak());
                });
            }
        });
    });
}

fn title(attribute: Attribute) -> String {
    let mode = ColorMode::ALL.into_iter().find(|mode| mode.attribute() == Some(attribute));
    let name = mode.map_or("", ColorMode::label);
    match attribute.unit() {
        "" => name.to_owned(),
        unit => format!("{name}, {unit}"),
    }
}

fn unknown_reason(attribute: Attribute) -> &'static str {
    match attribute {
        Attribute::Elbo => "Available after the next trained frame",
        Attribute::Evidence | Attribute::Uncertainty | Attribute::Birth | Attribute::Texture => {
            "Available after the first trained frame"
        }
    }
}

fn bar(range: &Range, ui: &mut Ui) {
    let (rect, _) = ui.allocate_exact_size(BAR, Sense::hover());
    let step = rect.width() / STRIPS as f32;
    for strip in 0..STRIPS {
        let left = rect.left() + step * strip as f32;
        let strip_rect =
            Rect::from_min_max(pos2(left, rect.top()), pos2(left + step, rect.bottom()));
        let share = (strip as f32 + 0.5) / STRIPS as f32;
        ui.painter().rect_filled(strip_rect, 0.0, to_color32(ramp(share)));
    }
    let [lo, hi] = range.ends();
    ui.horizontal(|ui| {
        ui.label(format_number(lo));
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| ui.label(format_number(hi)));
    });
}

pub fn to_color32(color: [f32; 3]) -> Color32 {
    let [r, g, b] = color.map(unit_to_byte);
    Color32::from_rgb(r, g, b)
}

/// Draws a small square in `color`. Without a colour, the space stays empty.
pub fn swatch(color: Option<Color32>, ui: &mut Ui) {
    let (rect, _) = ui.allocate_exact_size(Vec2::splat(10.0), Sense::hover());
    if let Some(color) = color {
        ui.painter().rect_filled(rect, 2.0, color);
    }
}

/// Formats a number with about three significant digits. Very large and very small numbers have an
/// exponent.
pub fn format_number(value: f64) -> String {
    match value.abs() {
        a if a < 1e6 && a.fract() == 0.0 => format!("{value}"),
        a if (100.0..1e6).contains(&a) => format!("{value:.0}"),
        a if (10.0..100.0).contains(&a) => format!("{value:.1}"),
        a if (1.0..10.0).contains(&a) => format!("{value:.2}"),
        a if (1e-3..1.0).contains(&a) => format!("{value:.4}"),
        _ => format!("{value:.2e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::Visuals;

    /// Returns the relative luminance as defined by WCAG 2.1.
    fn luminance(color: Color32) -> f64 {
        let linear = |byte: u8| match f64::from(byte) / 255.0 {
            v if v <= 0.04045 => v / 12.92,
            v => ((v + 0.055) / 1.055).powf(2.4),
        };
        0.2126 * linear(color.r()) + 0.7152 * linear(color.g()) + 0.0722 * linear(color.b())
    }

    #[test]
    fn every_colour_has_the_contrast_that_small_text_needs() {
        for (visuals, is_dark) in [(Visuals::dark(), true), (Visuals::light(), false)] {
            for color in
                [SignalColor::Blue, SignalColor::Green, SignalColor::Yellow, SignalColor::Red]
            {
                let pair = [luminance(color.for_theme(is_dark)), luminance(visuals.panel_fill)];
                let [least, most] = [pair[0].min(pair[1]), pair[0].max(pair[1])];
                let contrast = (most + 0.05) / (least + 0.05);
                assert!(contrast >= 4.5, "{color:?}, dark: {is_dark}: {contrast:.2}");
            }
        }
    }

    #[test]
    fn numbers_are_short() {
        let shown =
            [0.0, 32.0, 12.345, 123456.0, -3.456, 0.01234, 1.234e-5, 5e7].map(format_number);
        assert_eq!(shown, ["0", "32", "12.3", "123456", "-3.46", "0.0123", "1.23e-5", "5.00e7"]);
    }
}
