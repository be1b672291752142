//! Recently opened paths, newest first, stored between sessions.

use super::stored_text;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const MAX_PATHS: usize = 8;

#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecentPaths(Vec<PathBuf>);

impl RecentPaths {
    /// Reads paths written by [`Self::to_text`]. Damaged text yields none, because paths can be opened
    /// again by hand.
    pub fn from_text(text: &str) -> Self {
        stored_text::from_text("recent paths", text).0
    }

    pub fn to_text(&self) -> Result<String, ron::Error> {
        ron::to_string(self)
    }

    pub fn paths(&self) -> &[PathBuf] {
        &self.0
    }

    /// Moves an opened path to the front.
    pub fn note(&mut self, path: &Path) {
        self.0.retain(|known| known != path);
        self.0.insert(0, path.to_owned());
        self.0.truncate(MAX_PATHS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_come_first_and_survive_a_restart() {
        let mut recent = RecentPaths::default();
        for i in [0, 1, 2, 3, 4, 5, 6, 7, 8, 4] {
            recent.note(Path::new(&format!("/rooms/{i} a")));
        }
        let names = [4, 8, 7, 6, 5, 3, 2, 1].map(|i| PathBuf::from(format!("/rooms/{i} a")));
        assert_eq!(recent.paths(), names);
        assert_eq!(RecentPaths::from_text(&recent.to_text().unwrap()), recent);
        assert_eq!(RecentPaths::from_text("(nonsense"), RecentPaths::default());
    }
}
