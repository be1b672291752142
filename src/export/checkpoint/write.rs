//! Encoding of checkpoint files.

use super::super::atomic;
use super::container::Section;
use super::element::Checkpoint;
use super::error::CheckpointError;
use super::{check, container, mixture, scene, sections};
use crate::model::attributes::StoredModel;
use std::io;
use std::io::Write;
use std::path::Path;

/// Writes a checkpoint atomically (see [`atomic::write_atomic`]); returns the number of bytes.
///
/// # Errors
/// The file cannot be written, or [`read`](super::read()) would reject the model. In the latter case, all
/// files are untouched.
pub fn write(path: &Path, checkpoint: &Checkpoint) -> Result<u64, CheckpointError> {
    check_readable(path, checkpoint)?;
    Ok(atomic::write_atomic(path, |out| write_to(out, checkpoint))?)
}

/// Writes like [`write()`] and retains an existing file as `<name>.bak`.
///
/// # Errors
/// As [`write()`]; the older file is then untouched.
pub fn write_keeping_old(path: &Path, checkpoint: &Checkpoint) -> Result<u64, CheckpointError> {
    check_readable(path, checkpoint)?;
    Ok(atomic::write_with_backup(path, |out| write_to(out, checkpoint))?)
}

/// Returns an error for a model that could not be read back.
fn check_readable(path: &Path, checkpoint: &Checkpoint) -> Result<(), CheckpointError> {
    // An unreadable file must not replace a valid one.
    let checked = match &checkpoint.model {
        StoredModel::Mixture { normalization, state, .. } => {
            check::check_normalization(normalization).and_then(|()| check::check_mixture(state))
        }
        StoredModel::Scene(state) => check::check_scene(state),
    };
    checked.map_err(|defect| CheckpointError::Unreadable { path: path.to_owned(), defect })
}

/// Encodes a checkpoint as the bytes of a file.
pub fn to_bytes(checkpoint: &Checkpoint) -> Vec<u8> {
    let mut bytes = Vec::new();
    let written = write_to(&mut bytes, checkpoint);
    debug_assert!(written.is_ok(), "a vector accepts all bytes");
    bytes
}

fn write_to(out: &mut dyn Write, checkpoint: &Checkpoint) -> io::Result<()> {
    let Checkpoint { config, meta, numerics, history, cursor, model } = checkpoint;
    let visited = cursor.visited.iter().map(|&frame| u64::from(frame));
    let cursor = [cursor.frames, cursor.points].into_iter().chain(visited).collect();
    let mut sections = vec![
        Section::new(sections::CONFIG, config.as_bytes()),
        Section::new(sections::META, meta.as_bytes()),
        Section::new(sections::NUMERICS, numerics.as_bytes()),
        Section::owned::<u64>(sections::CURSOR, cursor),
    ];
    sections.extend(match model {
        StoredModel::Mixture { normalization, hyper, state } => {
            mixture::sections(normalization, hyper, state)
        }
        StoredModel::Scene(state) => scene::sections(state),
    });
    sections.extend(history.as_ref().map(|h| Section::new(sections::HISTORY, h.as_bytes())));
    container::write(out, &sections)
}
