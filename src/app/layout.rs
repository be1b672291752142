//! What of the window is shown and where, kept between sessions.

use super::stored_text;
use serde::{Deserialize, Serialize};

/// Changes with what is stored: an older layout is not mistaken for one of now.
const VERSION: u32 = 1;

/// The window's parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WindowLayout {
    version: u32,
    /// Whether the strip of frames is open.
    pub shows_frames: bool,
}

impl Default for WindowLayout {
    fn default() -> Self {
        Self { version: VERSION, shows_frames: true }
    }
}

impl WindowLayout {
    /// Reads what an earlier session wrote by [`Self::to_text`]. What cannot be read falls back to the
    /// default, with a text that says so.
    pub fn from_text(text: &str) -> (Self, Option<String>) {
        let (read, notice) = stored_text::from_text::<Self>("the layout", text);
        if notice.is_none() && read.version != VERSION {
            let notice = format!(
                "the stored settings of the layout: expected version {VERSION}, found {}; the default is used instead",
                read.version
            );
            return (Self::default(), Some(notice));
        }
        (read, notice)
    }

    /// For the next session.
    pub fn to_text(&self) -> Result<String, ron::Error> {
        ron::to_string(self)
    }
}
