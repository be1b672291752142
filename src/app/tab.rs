//! Panels in tabs.

use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum SideTab {
    Latency,
    Quality,
    Scene,
    Inspector,
    Edit,
    Path,
    Settings,
}

impl SideTab {
    pub const ALL: [SideTab; 7] = [
        SideTab::Latency,
        SideTab::Quality,
        SideTab::Scene,
        SideTab::Inspector,
        SideTab::Edit,
        SideTab::Path,
        SideTab::Settings,
    ];

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
