//! Signal colours of text, readable on dark and light panels.

use eframe::egui::Color32;

/// Signal colour; its meaning is also stated in words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignalColor {
    /// Finished, or information.
    Blue,
    /// Running.
    Green,
    /// Waiting, or a warning.
    Yellow,
    /// Failed.
    Red,
}

impl SignalColor {
    /// Shade for text in the dark or the light theme.
    pub fn for_theme(self, is_dark: bool) -> Color32 {
        let [on_dark, on_light] = match self {
            Self::Blue => [Color32::from_rgb(110, 170, 240), Color32::from_rgb(20, 90, 190)],
            Self::Green => [Color32::from_rgb(110, 200, 120), Color32::from_rgb(20, 115, 40)],
            Self::Yellow => [Color32::from_rgb(230, 180, 80), Color32::from_rgb(140, 85, 0)],
            Self::Red => [Color32::from_rgb(240, 100, 90), Color32::from_rgb(185, 30, 25)],
        };
        if is_dark { on_dark } else { on_light }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::Visuals;

    /// Relative luminance (WCAG 2.1).
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
}
