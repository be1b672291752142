//! Default folder and name for files written for the open dataset or model.

use std::path::{Path, PathBuf, absolute};

/// File name for the built-in demo, which has no path.
const DEMO: &str = "demo";

/// Default folder and file name without extension.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileProposal {
    /// Folder of the open file or dataset; the current folder for the demo. Absolute if it can be determined.
    pub folder: PathBuf,
    /// File name without extension.
    pub stem: String,
}

impl FileProposal {
    /// Proposes files next to an opened path and with its name; `None` is the demo.
    pub fn beside(opened: Option<&Path>) -> Self {
        let Some(opened) = opened else {
            return Self { folder: absolute_or_same(Path::new(".")), stem: DEMO.to_owned() };
        };
        let mut path = absolute_or_same(opened);
        if path.file_name().is_none() {
            // `a/..` is a folder too, but only the file system knows its name.
            path = path.canonicalize().unwrap_or(path);
        }
        // Only files have extensions: a dot in a folder's name is part of the name.
        let name = if path.is_file() { path.file_stem() } else { path.file_name() };
        let stem = name.map_or_else(|| DEMO.to_owned(), |name| name.to_string_lossy().into_owned());
        let folder = path.parent().map_or_else(|| path.clone(), Path::to_path_buf);
        Self { folder, stem }
    }

    /// Proposed path with `ending`, given without its dot.
    pub fn path(&self, ending: &str) -> PathBuf {
        self.folder.join(format!("{}.{ending}", self.stem))
    }
}

/// Absolute path; unchanged if the current folder is unknown.
fn absolute_or_same(path: &Path) -> PathBuf {
    absolute(path).unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_go_beside_what_is_open_and_are_named_by_it() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        let room = folder.join("my.room");
        std::fs::create_dir_all(room.join("train")).unwrap();
        let run = folder.join("run.1.vbgs");
        std::fs::write(&run, "").unwrap();
        for (opened, expected) in [
            (room.clone(), "my.room.ply"),
            (room.join("train").join(".."), "my.room.ply"),
            (run, "run.1.ply"),
        ] {
            let proposal = FileProposal::beside(Some(&opened));
            assert_eq!(proposal.path("ply"), folder.join(expected), "{}", opened.display());
        }
        let demo = FileProposal::beside(None);
        assert_eq!(demo.path("vbgs"), std::env::current_dir().unwrap().join("demo.vbgs"));
        assert!(FileProposal::beside(Some(Path::new("/"))).path("ply").is_absolute());
    }
}
