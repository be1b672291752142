//! Benches over a folder of scenes: finds the scenes and stores finished runs.
//!
//! Several scenes take hours on small machines. Each finished run is stored in its own file, so a
//! restarted bench continues where it stopped. Runs of another build are measured again, so that a
//! table never mixes two builds.

use super::findings::BenchError;
use crate::dataset::{self, Dataset, LoadOptions};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(Serialize, Deserialize)]
struct Kept<R> {
    /// Checksum of the executable that measured the rows.
    program: u32,
    /// All other inputs that the rows depend on.
    of: Value,
    rows: Vec<R>,
}

/// Returns the rows stored in a file if its executable and its inputs `of` match. Otherwise runs
/// `measure` and stores the rows.
pub(super) fn kept_or_new<R: Serialize + DeserializeOwned>(
    file: &Path,
    of: Value,
    measure: impl FnOnce() -> Result<Vec<R>, BenchError>,
) -> Result<Vec<R>, BenchError> {
    let program = program()?;
    let is_same = |kept: &Kept<R>| kept.program == program && kept.of == of;
    let earlier = std::fs::read(file).ok().and_then(|b| serde_json::from_slice(&b).ok());
    if let Some(Kept { rows, .. }) = earlier.filter(is_same) {
        return Ok(rows);
    }
    let kept = Kept { program, of, rows: measure()? };
    std::fs::write(file, serde_json::to_vec_pretty(&kept)?)
        .map_err(|source| BenchError::File { path: file.to_owned(), source })?;
    Ok(kept.rows)
}

fn program() -> Result<u32, BenchError> {
    let path = std::env::current_exe()
        .map_err(|source| BenchError::File { path: "running executable".into(), source })?;
    // Hash the executable, because the package version is equal for many builds.
    let bytes = std::fs::read(&path).map_err(|source| BenchError::File { path, source })?;
    Ok(crc32fast::hash(&bytes))
}

pub(super) fn make(folder: &Path) -> Result<(), BenchError> {
    std::fs::create_dir_all(folder)
        .map_err(|source| BenchError::File { path: folder.to_owned(), source })
}

/// Opens all subfolders that are scenes with training frames, sorted by path. The second list holds
/// a note for each skipped subfolder.
pub(super) fn scenes(data: &Path) -> Result<(Vec<Arc<Dataset>>, Vec<String>), BenchError> {
    let listing = std::fs::read_dir(data)
        .map_err(|source| BenchError::File { path: data.to_owned(), source })?;
    let folders = listing.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.is_dir());
    let mut folders: Vec<PathBuf> = folders.collect();
    folders.sort();
    let (mut scenes, mut left_out) = (Vec::new(), Vec::new());
    for folder in folders {
        match dataset::open(&folder, &LoadOptions::default()) {
            Err(error) => left_out.push(format!("left out: {error}")),
            Ok(dataset) => match dataset.training_split() {
                Err(error) => left_out.push(format!("left out: {error}")),
                Ok(_) => scenes.push(Arc::new(dataset)),
            },
        }
    }
    if scenes.is_empty() {
        let first =
            left_out.into_iter().next().unwrap_or_else(|| "there are no subfolders".to_owned());
        return Err(BenchError::NoScene { folder: data.to_owned(), first });
    }
    Ok((scenes, left_out))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_this_program_and_run_alone_are_taken_from_a_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("run.json");
        let measured = |of: &str, rows: u32| {
            kept_or_new(&file, Value::from(of), || Ok(vec![rows])).expect("measured")
        };
        assert_eq!(measured("stream", 1), [1]);
        assert_eq!(measured("stream", 2), [1], "measured before");
        assert_eq!(measured("reversed", 3), [3], "another run");
        let text = std::fs::read_to_string(&file).expect("kept");
        let program = program().expect("a program");
        let other = text.replace(&program.to_string(), &program.wrapping_add(1).to_string());
        assert_ne!(text, other);
        std::fs::write(&file, other).expect("written");
        assert_eq!(measured("reversed", 4), [4], "another program");
    }
}
