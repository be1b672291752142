//! Encoding and decoding of checkpoint files.

use super::super::atomic;
use super::super::error::Fault;
use super::container::{Container, MAGIC, Section, is_text_damaged};
use super::element::{Checkpoint, Cursor, LoadedCheckpoint};
use super::error::{CheckpointError, Defect, tag_text};
use super::{check, container, mixture, scene, sections};
use crate::export::read::read_file;
use crate::model::attributes::StoredModel;
use std::borrow::Borrow;
use std::io;
use std::io::{Read, Write};
use std::path::Path;

/// True if the file starts like a checkpoint or like one damaged by a text-mode transfer. False for
/// unreadable files.
pub fn is_checkpoint(path: &Path) -> bool {
    let mut start = Vec::new();
    // Only regular files: reading a FIFO or device may block.
    let is_read = path.is_file()
        && std::fs::File::open(path)
            .is_ok_and(|file| file.take(16).read_to_end(&mut start).is_ok());
    is_read && (start.starts_with(&MAGIC) || is_text_damaged(&start))
}

/// Reads a checkpoint and validates all of it.
///
/// # Errors
/// The file cannot be read, is not a checkpoint, is damaged, has another major version, or holds
/// impossible values; the [`Defect`] states where.
pub fn read(path: &Path) -> Result<LoadedCheckpoint, CheckpointError> {
    let bytes = read_file(path).map_err(|fault| match fault {
        // The message for a missing model lists other formats.
        Fault::Missing => Fault::NoCheckpoint.with_path(path),
        other => other.with_path(path),
    })?;
    parse(&bytes).map_err(|defect| CheckpointError::Content { path: path.to_owned(), defect })
}

/// Reads a checkpoint from the bytes of a file.
///
/// # Errors
/// [`Defect`] for the same reasons as [`read`], except file errors.
pub fn parse(bytes: &[u8]) -> Result<LoadedCheckpoint, Defect> {
    let sections = Container::parse(bytes)?;
    // Detected by its sections: files of version 1.0 hold mixtures and name no preset.
    let model = match sections::OF_SCENES.iter().any(|tag| sections.has(*tag)) {
        true => StoredModel::Scene(scene::read(&sections)?),
        false => mixture::read(&sections)?,
    };
    let checkpoint = Checkpoint {
        config: sections.text(sections::CONFIG)?,
        meta: sections.text(sections::META)?,
        numerics: sections.text(sections::NUMERICS)?,
        history: sections
            .optional(sections::HISTORY, || sections.text(sections::HISTORY).map(Some))?,
        cursor: cursor(&sections)?,
        model,
    };
    Ok(LoadedCheckpoint { checkpoint, version: sections.version, bytes: bytes.len() as u64 })
}

fn cursor(sections: &Container) -> Result<Cursor, Defect> {
    let numbers: Vec<u64> = sections.elements(sections::CURSOR, None)?;
    let [frames, points, visited @ ..] = numbers.as_slice() else {
        let found = format!("{} numbers", numbers.len());
        return Err(Defect::malformed(tag_text(sections::CURSOR), "2 numbers or more", found));
    };
    let visited = check::check_visited(visited, *frames)?;
    Ok(Cursor { frames: *frames, points: *points, visited })
}

/// Writes a checkpoint atomically (see [`atomic::write_atomic`]); returns the number of bytes.
///
/// # Errors
/// The file cannot be written, or [`read`] would reject the model. In the latter case, all
/// files are untouched.
pub fn write(path: &Path, checkpoint: &Checkpoint) -> Result<u64, CheckpointError> {
    check_readable(path, checkpoint)?;
    Ok(atomic::write_atomic(path, |out| write_to(out, checkpoint))?)
}

/// Writes like [`write()`] and retains an existing file as `<name>.bak`. A checkpoint that is passed by value
/// is dropped before the disk has the file.
///
/// # Errors
/// As [`write()`]; the older file is then untouched.
pub fn write_keeping_old(
    path: &Path,
    checkpoint: impl Borrow<Checkpoint>,
) -> Result<u64, CheckpointError> {
    check_readable(path, checkpoint.borrow())?;
    // Moved into the closure: training copies each texture that it changes while the checkpoint shares it, and
    // a flush to the disk takes much longer than writing.
    Ok(atomic::write_with_backup(path, move |out| write_to(out, checkpoint.borrow()))?)
}

/// Returns an error for a model or visits that could not be read back.
fn check_readable(path: &Path, checkpoint: &Checkpoint) -> Result<(), CheckpointError> {
    // An unreadable file must not replace a valid one.
    let checked = match &checkpoint.model {
        StoredModel::Mixture { normalization, state, .. } => {
            check::check_normalization(normalization).and_then(|()| check::check_mixture(state))
        }
        StoredModel::Scene(state) => check::check_scene(state),
    };
    let Cursor { frames, visited, .. } = &checkpoint.cursor;
    let visited: Vec<u64> = visited.iter().map(|&frame| frame.into()).collect();
    let checked = checked.and_then(|()| check::check_visited(&visited, *frames).map(drop));
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
