//! Names of files that are written without a prompt: never that of an existing file.

use std::path::{Path, PathBuf};

/// Returns the path, or the first unused one with a number before its extension.
pub fn unused(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    let numbered = (2..).map(|n| path.with_file_name(format!("{stem}-{n}.{ending}")));
    let mut paths = std::iter::once(path.to_owned()).chain(numbered);
    paths.find(|path| !path.exists()).unwrap_or_else(|| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn older_files_keep_their_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("room.latency.csv");
        for name in ["room.latency.csv", "room.latency-2.csv", "room.latency-3.csv"] {
            let free = unused(&path);
            assert_eq!(free, folder.path().join(name));
            std::fs::write(free, "").unwrap();
        }
    }
}
