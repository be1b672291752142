//! Import of model files. The format is detected from the content.

use super::error::{ExportError, Fault, shorten, try_with_capacity};
use super::imported::Imported;
use super::{glb, ply, splat, spz};
use std::io::Read;
use std::path::Path;

/// Maximum number of splats [`read`] accepts: about 1.4 GB of PLY.
pub const DEFAULT_MAX_SPLATS: usize = 20_000_000;

/// Reads a model: PLY (splats, points or PlayCanvas' compressed form), GLB, glTF with `data:` or sibling
/// buffers, SPZ 1 to 4 or `.splat`. The format is detected from the content. Accepts up to
/// [`DEFAULT_MAX_SPLATS`] rows.
///
/// # Errors
/// The file cannot be read, is no model, is damaged, or uses unsupported features, as the [`Fault`] states.
/// Non-finite rows are no error; they are counted.
pub fn read(path: &Path) -> Result<Imported, ExportError> {
    read_up_to(path, DEFAULT_MAX_SPLATS)
}

/// Reads like [`read`], with another limit on the number of rows.
///
/// # Errors
/// As [`read`], and [`Fault::TooMany`] above `max_splats`.
pub fn read_up_to(path: &Path, max_splats: usize) -> Result<Imported, ExportError> {
    let import = || {
        let bytes = read_file(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let imported = parse(&bytes, folder, max_splats)?;
        Ok(Imported { bytes: bytes.len() as u64, ..imported })
    };
    import().map_err(|fault: Fault| fault.with_path(path))
}

/// Reads a model from memory, without sibling files.
pub(super) fn decode(bytes: &[u8]) -> Result<Imported, Fault> {
    parse(bytes, Path::new(""), DEFAULT_MAX_SPLATS)
}

fn parse(bytes: &[u8], folder: &Path, max_splats: usize) -> Result<Imported, Fault> {
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start();
    if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
        ply::read::ply(bytes, max_splats)
    } else if bytes.starts_with(b"glTF") {
        glb::read::glb(bytes, folder, max_splats)
    } else if text.starts_with(b"{") {
        glb::read::gltf(text, folder, max_splats)
    } else if spz::read::is_plain(bytes) || spz::read::is_gzip(bytes) {
        spz::read::spz(bytes, max_splats)
    } else if splat::is_likely(bytes) {
        // Last, because this format has no magic bytes.
        splat::read_splat(bytes, max_splats)
    } else {
        let start = String::from_utf8_lossy(bytes.get(..16).unwrap_or(bytes));
        let found = match bytes {
            [] => "an empty file".to_owned(),
            _ => format!("a file starting \"{}\"", shorten(&start)),
        };
        Err(Fault::NotAModel { found })
    }
}

/// Reads a complete file into memory reserved for its actual size.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, Fault> {
    let io = |source: std::io::Error| match source.kind() {
        std::io::ErrorKind::NotFound => Fault::Missing,
        _ => Fault::Io { action: "read", source },
    };
    // Checked before opening: opening a FIFO blocks until it has a writer, and a device may never end.
    let kind = std::fs::metadata(path).map_err(io)?.file_type();
    if !kind.is_file() {
        return Err(if kind.is_dir() { Fault::IsFolder } else { Fault::IsStream });
    }
    let mut file = std::fs::File::open(path).map_err(io)?;
    let size = file.metadata().map_err(io)?.len();
    let room = usize::try_from(size).map_err(|_| Fault::OutOfMemory { bytes: size })?;
    let mut bytes = try_with_capacity(room)?;
    file.read_to_end(&mut bytes).map_err(io)?;
    Ok(bytes)
}
