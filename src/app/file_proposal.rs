//! Folder and name that are proposed for files of what is open.

use std::path::{Path, PathBuf, absolute};

/// Name of files of what has no folder of its own.
const DEMO: &str = "demo";

/// A folder and a name without an ending.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileProposal {
    /// Where: beside what is open, the current folder for the demo. Absolute where that can be found
    /// out.
    pub folder: PathBuf,
    /// Name without an ending.
    pub stem: String,
}

impl FileProposal {
    /// Files beside an opened folder or file, of the same name; `None` is the demo.
    pub fn beside(opened: Option<&Path>) -> Self {
        let Some(opened) = opened else {
            return Self { folder: full(Path::new(".")), stem: DEMO.to_owned() };
        };
        let mut path = full(opened);
        if path.file_name().is_none() {
            // `a/..` names a folder too, but only the file system knows by what name.
            path = path.canonicalize().unwrap_or(path);
        }
        // Only files have endings: what follows the point in the name of a folder belongs to it.
        let name = if path.is_file() { path.file_stem() } else { path.file_name() };
        let stem = name.map_or_else(|| DEMO.to_owned(), |name| name.to_string_lossy().into_owned());
        let folder = path.parent().map_or_else(|| path.clone(), Path::to_path_buf);
        Self { folder, stem }
    }

    /// The proposal with an ending, which is given without its point.
    pub fn path(&self, ending: &str) -> PathBuf {
        self.folder.join(format!("{}.{ending}", self.stem))
    }
}

/// The path from the root, or as it is where the current folder is unknown.
fn full(path: &Path) -> PathBuf {
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
