//! Panels, each of which is a tab.

use serde::{Deserialize, Serialize};

/// What a panel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum SideTab {
    /// What training and drawing take.
    Latency,
    /// How good the scene is.
    Quality,
    /// What is open.
    Scene,
    /// The selected splat.
    Inspector,
    /// What is hidden, deleted and cropped.
    Edit,
    /// Where the camera of a film goes.
    Path,
    /// How is trained and drawn.
    Settings,
}

impl SideTab {
    /// Every tab, in the order they stand.
    pub const ALL: [SideTab; 7] = [
        SideTab::Latency,
        SideTab::Quality,
        SideTab::Scene,
        SideTab::Inspector,
        SideTab::Edit,
        SideTab::Path,
        SideTab::Settings,
    ];

    /// As it is named in the window.
    pub fn label(self) -> &'static str {
        match self {
            SideTab::Latency => "Latency",
            SideTab::Quality => "Quality",
            SideTab::Scene => "Scene",
            SideTab::Inspector => "Inspector",
            SideTab::Edit => "Edit",
            SideTab::Path => "Path",
            SideTab::Settings => "Settings",
        }
    }
}
