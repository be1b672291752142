//! What the colours of the viewport mean.

use crate::render::Paint;
use crate::render::attributes::Attribute;
use serde::{Deserialize, Serialize};

/// What a splat's colour shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColorMode {
    /// The colour that was learned.
    #[default]
    Color,
    /// How many points the component has explained.
    Evidence,
    /// How uncertain the component's mean still is.
    Uncertainty,
    /// How well the current frame's points fit the component.
    Elbo,
    /// The frame that the component was born in.
    Birth,
    /// Distance from the camera.
    Depth,
    /// Direction of the shortest axis.
    Normal,
}

impl ColorMode {
    /// Every mode, in the order of the menu.
    pub const ALL: [ColorMode; 7] = [
        ColorMode::Color,
        ColorMode::Evidence,
        ColorMode::Uncertainty,
        ColorMode::Elbo,
        ColorMode::Birth,
        ColorMode::Depth,
        ColorMode::Normal,
    ];

    /// As menus show it.
    pub fn label(self) -> &'static str {
        match self {
            ColorMode::Color => "Colour",
            ColorMode::Evidence => "Evidence",
            ColorMode::Uncertainty => "Uncertainty",
            ColorMode::Elbo => "Per-point ELBO",
            ColorMode::Birth => "Birth frame",
            ColorMode::Depth => "Depth",
            ColorMode::Normal => "Normal",
        }
    }

    /// One sentence on what it shows.
    pub fn tooltip(self) -> &'static str {
        match self {
            ColorMode::Color => "The colours that were learned",
            ColorMode::Evidence => "How many points each component has explained",
            ColorMode::Uncertainty => "How uncertain each component's position still is",
            ColorMode::Elbo => "How well the current frame's points fit each component",
            ColorMode::Birth => "The frame that each component was born in",
            ColorMode::Depth => "Distance from the camera: violet is near, yellow is far",
            ColorMode::Normal => "Direction of each splat's shortest axis, as red, green and blue",
        }
    }

    /// How the renderer colours splats in this mode, with depths (world units) between `range`.
    /// Values that only the trainer knows come as the splats' own colours.
    pub fn paint(self, range: [f32; 2]) -> Paint {
        match self {
            ColorMode::Depth => Paint::Depth(range),
            ColorMode::Normal => Paint::Normal,
            ColorMode::Color
            | ColorMode::Evidence
            | ColorMode::Uncertainty
            | ColorMode::Elbo
            | ColorMode::Birth => Paint::Stored,
        }
    }

    /// What the splats' own colours are replaced by in this mode, if so.
    pub fn attribute(self) -> Option<Attribute> {
        match self {
            ColorMode::Evidence => Some(Attribute::Evidence),
            ColorMode::Uncertainty => Some(Attribute::Uncertainty),
            ColorMode::Elbo => Some(Attribute::Elbo),
            ColorMode::Birth => Some(Attribute::Birth),
            ColorMode::Color | ColorMode::Depth | ColorMode::Normal => None,
        }
    }

    /// Why a scene cannot be shown in this mode, if so; `available` are the modes whose values the scene
    /// brings with it.
    pub fn why_not(self, available: &[ColorMode]) -> Option<&'static str> {
        match self {
            ColorMode::Color | ColorMode::Depth | ColorMode::Normal => None,
            _ if available.contains(&self) => None,
            ColorMode::Evidence => Some("What is open does not tell each splat's evidence"),
            ColorMode::Uncertainty => Some("What is open does not tell each splat's uncertainty"),
            ColorMode::Elbo => Some("What is open does not tell how well points fit each splat"),
            ColorMode::Birth => Some("What is open does not tell when each splat was born"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_a_scene_tells_can_be_shown() {
        let offered = |available: &[ColorMode]| -> Vec<ColorMode> {
            ColorMode::ALL.into_iter().filter(|mode| mode.why_not(available).is_none()).collect()
        };
        assert_eq!(offered(&[]), [ColorMode::Color, ColorMode::Depth, ColorMode::Normal]);
        assert_eq!(offered(&ColorMode::ALL), ColorMode::ALL);
    }
}
