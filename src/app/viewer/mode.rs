//! Comparison modes of the viewport.

use super::compared_model::ComparedModel;
use crate::app::state::Opened;
use crate::render::Lens;

/// Comparison mode: one picture, or two as a wipe or a difference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ViewMode {
    /// The chosen renderer alone.
    #[default]
    Single,
    /// Projected renderer left of a divider, exact renderer right of it.
    Wipe,
    /// Difference between projected and exact renderer.
    Difference,
    /// Chosen renderer left of a divider, photograph right of it.
    PhotoWipe,
    /// Difference between the chosen renderer and the photograph.
    PhotoDifference,
    /// Scene left of a divider, second model right of it.
    ModelWipe,
    /// Difference between the scene and a second model.
    ModelDifference,
    /// Chosen renderer left of a divider, prepared photograph right of it.
    Preparation,
}

impl ViewMode {
    /// Every mode, in menu order.
    pub const ALL: [ViewMode; 8] = [
        ViewMode::Single,
        ViewMode::Wipe,
        ViewMode::Difference,
        ViewMode::PhotoWipe,
        ViewMode::PhotoDifference,
        ViewMode::ModelWipe,
        ViewMode::ModelDifference,
        ViewMode::Preparation,
    ];

    /// Label in menus.
    pub fn label(self) -> &'static str {
        match self {
            ViewMode::Single => "Single",
            ViewMode::Wipe => "Wipe renderers",
            ViewMode::Difference => "Renderer difference",
            ViewMode::PhotoWipe => "Wipe photograph",
            ViewMode::PhotoDifference => "Photograph difference",
            ViewMode::ModelWipe => "Wipe models",
            ViewMode::ModelDifference => "Model difference",
            ViewMode::Preparation => "Preparation",
        }
    }

    /// Tooltip in menus.
    pub fn tooltip(self) -> &'static str {
        match self {
            ViewMode::Single => "The chosen renderer alone",
            ViewMode::Wipe => "Projected left of a draggable divider, exact right of it",
            ViewMode::Difference => "Amplified difference between projected and exact renderer",
            ViewMode::PhotoWipe => "Render left of a draggable divider, photograph right of it",
            ViewMode::PhotoDifference => "Amplified difference between render and photograph",
            ViewMode::ModelWipe => "Scene left of a draggable divider, second model right of it",
            ViewMode::ModelDifference => {
                "Amplified difference between the scene and the second model"
            }
            ViewMode::Preparation => {
                "Which pixels of the photograph become points, and why the others are dropped"
            }
        }
    }

    /// True if the mode shows a photograph.
    pub fn has_photo(self) -> bool {
        matches!(self, ViewMode::PhotoWipe | ViewMode::PhotoDifference)
    }

    /// True if the mode shows a second model.
    pub fn has_model(self) -> bool {
        matches!(self, ViewMode::ModelWipe | ViewMode::ModelDifference)
    }

    /// True if the mode needs a dataset camera.
    pub fn needs_frame(self) -> bool {
        self.has_photo() || self == ViewMode::Preparation
    }

    /// True if the mode shows a difference.
    pub fn is_difference(self) -> bool {
        matches!(self, ViewMode::Difference | ViewMode::PhotoDifference | ViewMode::ModelDifference)
    }

    /// Reason why the mode is unavailable, if it is.
    pub fn unavailable_reason(
        self,
        lens: Lens,
        opened: &Opened,
        compared: Option<&ComparedModel>,
    ) -> Option<&'static str> {
        match self {
            _ if self.has_model() && compared.is_none() => {
                Some("No second model is open: choose “Compare with a model…” first")
            }
            ViewMode::Wipe | ViewMode::Difference if lens == Lens::Fisheye => {
                Some("Only the exact renderer supports a fisheye; choose the pinhole in Settings")
            }
            _ if self.needs_frame() && opened.dataset.is_none() => {
                Some("A model has no photographs")
            }
            ViewMode::Preparation if opened.scene().is_none() => Some(
                "The paper preset does not prepare surfaces; choose the scene preset in Settings and reset",
            ),
            _ => None,
        }
    }
}
