//! Parsing of a GLB or `.gltf` into JSON and buffers.

use super::schema::{Buffer, Root};
use super::{EXTENSION, container, import, uri};
use crate::export::error::{Fault, shorten};
use crate::export::imported::Imported;
use std::borrow::Cow;
use std::path::Path;

/// Maximum size of the JSON in a GLB (`export.md`, Limits).
const MAX_JSON_BYTES: usize = 64 << 20;
/// Maximum nesting of JSON arrays and objects (`export.md`, Limits).
const MAX_JSON_DEPTH: usize = 64;
/// Extensions that a file may require: the splat extension, and those that do not affect the import.
const KNOWN_EXTENSIONS: [&str; 2] = [EXTENSION, "KHR_materials_unlit"];

pub(in crate::export) fn glb(
    bytes: &[u8],
    folder: &Path,
    max_splats: usize,
) -> Result<Imported, Fault> {
    let (json, bin) = container::split(bytes)?;
    if json.len() > MAX_JSON_BYTES {
        let found = format!("{} bytes", json.len());
        return Err(Fault::malformed(
            "JSON chunk",
            format!("{MAX_JSON_BYTES} bytes at most"),
            found,
        ));
    }
    import_document(json, bin, folder, max_splats)
}

/// Reads the model of a `.gltf`, whose buffers are `data:` URIs or files in `folder`.
pub(in crate::export) fn gltf(
    json: &[u8],
    folder: &Path,
    max_splats: usize,
) -> Result<Imported, Fault> {
    import_document(json, None, folder, max_splats)
}

fn import_document(
    json: &[u8],
    bin: Option<&[u8]>,
    folder: &Path,
    max_splats: usize,
) -> Result<Imported, Fault> {
    // Checked before parsing: the parser's own limit reports neither file nor cause.
    check_nesting(json)?;
    let root: Root = serde_json::from_slice(json)
        .map_err(|e| Fault::malformed("JSON", "glTF 2.0", shorten_error(&e)))?;
    if !root.asset.version.starts_with("2.") {
        let found = format!("\"{}\"", shorten(&root.asset.version));
        return Err(Fault::malformed("asset.version", "2.0", found));
    }
    // A required extension changes the meaning of the data.
    let unknown = |name: &&String| !KNOWN_EXTENSIONS.contains(&name.as_str());
    if let Some(name) = root.extensions_required.iter().find(unknown) {
        return Err(Fault::Unsupported {
            feature: format!("the file requires the extension {}", shorten(name)),
            advice: "export plain, uncompressed attributes",
        });
    }
    let mut buffers = Vec::with_capacity(root.buffers.len());
    for (index, declared) in root.buffers.iter().enumerate() {
        buffers.push(buffer(declared, index, bin, folder)?);
    }
    import::model(&root, &buffers, max_splats)
}

fn buffer<'a>(
    declared: &Buffer,
    index: usize,
    bin: Option<&'a [u8]>,
    folder: &Path,
) -> Result<Cow<'a, [u8]>, Fault> {
    let place = format!("buffer {index}");
    let length = declared.byte_length;
    let mut bytes = match (&declared.uri, bin) {
        (Some(uri), _) => Cow::Owned(uri::load(uri, length, folder, &place)?),
        (None, Some(bin)) if index == 0 => Cow::Borrowed(bin),
        (None, _) => return Err(Fault::malformed(place, "a uri or a BIN chunk", "neither")),
    };
    if bytes.len() < length {
        let found = format!("{} bytes", bytes.len());
        return Err(Fault::malformed(place, format!("{length} bytes"), found));
    }
    // Bytes after byteLength do not belong to the buffer: the BIN chunk may be padded, a file longer.
    match &mut bytes {
        Cow::Borrowed(slice) => *slice = slice.get(..length).unwrap_or(slice),
        Cow::Owned(vec) => vec.truncate(length),
    }
    Ok(bytes)
}

/// Limits nesting with a clear message; serde_json's own recursion limit has none.
fn check_nesting(json: &[u8]) -> Result<(), Fault> {
    let (mut depth, mut in_string, mut escaped) = (0usize, false, false);
    for &byte in json {
        match byte {
            _ if escaped => escaped = false,
            b'\\' if in_string => escaped = true,
            b'"' => in_string = !in_string,
            b'{' | b'[' if !in_string => depth += 1,
            b'}' | b']' if !in_string => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > MAX_JSON_DEPTH {
            let expected = format!("at most {MAX_JSON_DEPTH} nested levels");
            return Err(Fault::malformed("JSON", expected, "more"));
        }
    }
    Ok(())
}

/// Shortens a parser error, which may quote long strings of the file, to its position.
fn shorten_error(error: &serde_json::Error) -> String {
    let text = error.to_string();
    if text.len() <= 120 {
        text
    } else {
        format!("an error at line {}, column {}", error.line(), error.column())
    }
}
