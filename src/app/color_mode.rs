//! Colour modes of the viewport.

use super::command::labelled;
use crate::render::Paint;
use crate::render::attributes::Attribute;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColorMode {
    #[default]
    Color,
    Evidence,
    Uncertainty,
    Elbo,
    Birth,
    Texture,
    Depth,
    Normal,
}

labelled! { ColorMode:
    Color: "Colour", "Learned colours";
    Evidence: "Evidence", "Number of points assigned to each splat";
    Uncertainty: "Uncertainty", "Standard deviation of each splat's position";
    Elbo: "Per-point ELBO", "How well the current frame's points fit each splat";
    Birth: "Birth frame", "Frame in which each splat was created";
    Texture: "Texture", "Share of a pixel's colour that its texels determine; 0 for splats without texture";
    Depth: "Depth", "Distance from the camera, from violet (near) to yellow (far)";
    Normal: "Normal", "Direction of each splat's shortest axis, coded as RGB";
}

impl ColorMode {
    /// Returns the renderer's paint mode. Depth colours cover the depths in `range`, world units.
    pub fn paint(self, range: [f32; 2]) -> Paint {
        match self {
            ColorMode::Depth => Paint::Depth(range),
            ColorMode::Normal => Paint::Normal,
            // The palette has replaced the stored colours by those of the attribute.
            ColorMode::Color
            | ColorMode::Evidence
            | ColorMode::Uncertainty
            | ColorMode::Elbo
            | ColorMode::Birth
            | ColorMode::Texture => Paint::Stored,
        }
    }

    pub fn attribute(self) -> Option<Attribute> {
        match self {
            ColorMode::Evidence => Some(Attribute::Evidence),
            ColorMode::Uncertainty => Some(Attribute::Uncertainty),
            ColorMode::Elbo => Some(Attribute::Elbo),
            ColorMode::Birth => Some(Attribute::Birth),
            ColorMode::Texture => Some(Attribute::Texture),
            ColorMode::Color | ColorMode::Depth | ColorMode::Normal => None,
        }
    }

    /// Returns the reason why the open scene cannot be shown in this mode, if any. `available` lists the
    /// attribute modes that the scene supports, besides that of textures.
    pub fn unavailable_reason(
        self,
        available: &[ColorMode],
        has_textures: bool,
    ) -> Option<&'static str> {
        match self {
            ColorMode::Color | ColorMode::Depth | ColorMode::Normal => None,
            ColorMode::Texture => (!has_textures).then_some("The open scene has no textures"),
            _ if available.contains(&self) => None,
            ColorMode::Evidence => Some("The open scene stores no evidence per splat"),
            ColorMode::Uncertainty => Some("The open scene stores no uncertainty per splat"),
            ColorMode::Elbo => Some("The open scene stores no ELBO per splat"),
            ColorMode::Birth => Some("The open scene stores no birth frame per splat"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_a_scene_tells_can_be_shown() {
        let offered = |available: &[ColorMode], has_textures| -> Vec<ColorMode> {
            ColorMode::ALL
                .into_iter()
                .filter(|mode| mode.unavailable_reason(available, has_textures).is_none())
                .collect()
        };
        let [color, depth, normal] = [ColorMode::Color, ColorMode::Depth, ColorMode::Normal];
        assert_eq!(offered(&[], false), [color, depth, normal]);
        assert_eq!(offered(&[], true), [color, ColorMode::Texture, depth, normal]);
        assert_eq!(offered(&ColorMode::ALL, true), ColorMode::ALL);
    }
}
