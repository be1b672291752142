//! Signal colours of text, readable on dark and light panels.

use crate::app::color_mode::ColorMode;
use crate::math::image::unit_to_byte;
use crate::render::attributes::{Attribute, Range, UNKNOWN};
use crate::render::finish::ramp;
use eframe::egui::{
    Align, Align2, Area, Color32, Context, Frame, Id, Layout, Pos2, Rect, RichText, Sense, Theme,
    Ui, Vec2, pos2,
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

/// Opacity of weak text.
const WEAK_TEXT: f32 = 0.8;
/// Gray level of text on dark panels, of which weak text has the contrast that small text needs.
const TEXT_ON_DARK: u8 = 165;

/// Raises the contrast of text and links. Egui draws weak text too pale.
pub fn strengthen_text(context: &Context) {
    context.all_styles_mut(|style| style.visuals.weak_text_alpha = WEAK_TEXT);
    context.style_mut_of(Theme::Dark, |style| {
        style.visuals.widgets.noninteractive.fg_stroke.color = Color32::from_gray(TEXT_ON_DARK);
    });
    let link = SignalColor::Blue.for_theme(false);
    context.style_mut_of(Theme::Light, |style| style.visuals.hyperlink_color = link);
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

    /// Returns the relative luminance as defined by WCAG 2.1.
    fn luminance(color: Color32) -> f64 {
        let linear = |byte: u8| match f64::from(byte) / 255.0 {
            v if v <= 0.04045 => v / 12.92,
            v => ((v + 0.055) / 1.055).powf(2.4),
        };
        0.2126 * linear(color.r()) + 0.7152 * linear(color.g()) + 0.0722 * linear(color.b())
    }

    /// Returns the contrast of text over an opaque colour as defined by WCAG 2.1.
    fn contrast(text: Color32, below: Color32) -> f64 {
        let pair = [luminance(below.blend(text)), luminance(below)];
        let [least, most] = [pair[0].min(pair[1]), pair[0].max(pair[1])];
        (most + 0.05) / (least + 0.05)
    }

    #[test]
    fn all_text_of_both_themes_has_the_contrast_that_small_text_needs() {
        let context = Context::default();
        strengthen_text(&context);
        for theme in [Theme::Dark, Theme::Light] {
            let visuals = &context.style_of(theme).visuals;
            let texts = [
                ("text", visuals.text_color()),
                ("weak text", visuals.weak_text_color()),
                ("strong text", visuals.strong_text_color()),
                ("link", visuals.hyperlink_color),
            ];
            let signals =
                [SignalColor::Blue, SignalColor::Green, SignalColor::Yellow, SignalColor::Red];
            let signals = signals.map(|color| ("signal", color.for_theme(theme == Theme::Dark)));
            let panel = visuals.panel_fill;
            let below = [
                ("panel", panel),
                ("pop-up", visuals.window_fill),
                ("row", panel.blend(visuals.faint_bg_color)),
                ("field", visuals.text_edit_bg_color()),
            ];
            for (what, text) in texts.into_iter().chain(signals) {
                for (place, below) in below {
                    let found = contrast(text, below);
                    assert!(found >= 4.5, "{theme:?}: {what} {text:?} on a {place}: {found:.2}");
                }
            }
            let widgets = &visuals.widgets;
            for look in [&widgets.inactive, &widgets.hovered, &widgets.active, &widgets.open] {
                let found = contrast(look.text_color(), panel.blend(look.weak_bg_fill));
                assert!(found >= 4.5, "{theme:?}: button {look:?}: {found:.2}");
            }
            let selection = visuals.selection;
            let found = contrast(selection.stroke.color, panel.blend(selection.bg_fill));
            assert!(found >= 4.5, "{theme:?}: selection: {found:.2}");
        }
    }

    #[test]
    fn numbers_are_short() {
        let shown =
            [0.0, 32.0, 12.345, 123456.0, -3.456, 0.01234, 1.234e-5, 5e7].map(format_number);
        assert_eq!(shown, ["0", "32", "12.3", "123456", "-3.46", "0.0123", "1.23e-5", "5.00e7"]);
    }
}
