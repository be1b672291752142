//! Loading a MODEL argument.

use super::failure::Failure;
use std::path::Path;
use vbgs_studio::export::{self, Imported};

/// Reads a model and says on stderr what was ignored or guessed.
pub fn load(path: &Path) -> Result<Imported, Failure> {
    let model = export::read(path)?;
    for note in &model.notes {
        eprintln!("note: {}: {note}", path.display());
    }
    if model.skipped > 0 {
        eprintln!(
            "warning: {}: {} rows that are not finite were left out",
            path.display(),
            model.skipped
        );
    }
    Ok(model)
}
