//! What the viewport compares.

use super::compared_model::ComparedModel;
use crate::app::state::Opened;
use crate::render::Lens;

/// One picture, or two beside or against each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ViewMode {
    /// The chosen renderer alone.
    #[default]
    Single,
    /// Projected left of a divider, exact right of it.
    Wipe,
    /// What differs between projected and exact.
    Difference,
    /// The chosen renderer left of a divider, the photograph right of it.
    PhotoWipe,
    /// What differs between the chosen renderer and the photograph.
    PhotoDifference,
    /// The scene left of a divider, a second model right of it.
    ModelWipe,
    /// What differs between the scene and a second model.
    ModelDifference,
    /// The chosen renderer left of a divider, what training makes of the photograph right of it.
    Preparation,
}

impl ViewMode {
    /// Every mode, in the order of the menu.
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

    /// As menus show it.
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

    /// One sentence on what it shows.
    pub fn tooltip(self) -> &'static str {
        match self {
            ViewMode::Single => "The chosen renderer alone",
            ViewMode::Wipe => "Projected left of a divider that can be dragged, exact right of it",
            ViewMode::Difference => "What differs between projected and exact, amplified",
            ViewMode::PhotoWipe => "The render left of a divider, the photograph right of it",
            ViewMode::PhotoDifference => "What differs between render and photograph, amplified",
            ViewMode::ModelWipe => "The scene left of a divider, the second model right of it",
            ViewMode::ModelDifference => {
                "What differs between the scene and the second model, amplified"
            }
            ViewMode::Preparation => {
                "Which pixels of the photograph become points, and why the others do not"
            }
        }
    }

    /// Whether a photograph is part of it.
    pub fn has_photo(self) -> bool {
        matches!(self, ViewMode::PhotoWipe | ViewMode::PhotoDifference)
    }

    /// Whether a second model is part of it.
    pub fn has_model(self) -> bool {
        matches!(self, ViewMode::ModelWipe | ViewMode::ModelDifference)
    }

    /// Whether it is seen from a dataset's camera only.
    pub fn needs_frame(self) -> bool {
        self.has_photo() || self == ViewMode::Preparation
    }

    /// Whether it shows a difference.
    pub fn is_difference(self) -> bool {
        matches!(self, ViewMode::Difference | ViewMode::PhotoDifference | ViewMode::ModelDifference)
    }

    /// Why it cannot be chosen, if so.
    pub fn why_not(
        self,
        lens: Lens,
        opened: &Opened,
        compared: Option<&ComparedModel>,
    ) -> Option<&'static str> {
        match self {
            _ if self.has_model() && compared.is_none() => {
                Some("There is no second model: choose “Compare with a model…” first")
            }
            ViewMode::Wipe | ViewMode::Difference if lens == Lens::Fisheye => {
                Some("Only the exact renderer draws a fisheye; choose the pinhole in Settings")
            }
            _ if self.needs_frame() && opened.dataset.is_none() => {
                Some("A model has no photographs")
            }
            ViewMode::Preparation if opened.scene().is_none() => Some(
                "The paper's preset prepares no surfaces; choose the scene preset in Settings and reset",
            ),
            _ => None,
        }
    }
}
