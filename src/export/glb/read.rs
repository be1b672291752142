//! Parsing of a GLB or `.gltf` into JSON and buffers.

use super::{Buffer, EXTENSION, Root, container, import};
use crate::export::error::{Fault, shorten};
use crate::export::imported::{Imported, Intake};
use crate::math::foreign::{JsonOutline, MAX_JSON_MEMORY};
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use base64::{Engine, alphabet};
use std::borrow::Cow;
use std::fs::File;
use std::path::{Component, Path, PathBuf};

/// Maximum size in bytes of the JSON in a GLB (`files.md`, Limits).
const MAX_JSON_BYTES: usize = 64 << 20;
/// Maximum nesting of JSON arrays and objects (`files.md`, Limits).
const MAX_JSON_DEPTH: usize = 64;
/// glTF extensions that a file may require: the splat extension, and extensions that do not affect the
/// import.
const KNOWN_EXTENSIONS: [&str; 2] = [EXTENSION, "KHR_materials_unlit"];

/// What fails if a file beside the glTF cannot be read.
pub(super) const BUFFER_FILE: &str = "read the buffer file";

pub(in crate::export) fn glb(
    bytes: &[u8],
    folder: &Path,
    intake: Intake,
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
    import_document(json, bin, folder, intake)
}

/// Reads the model of a `.gltf`, whose buffers are `data:` URIs or files in `folder`.
pub(in crate::export) fn gltf(
    json: &[u8],
    folder: &Path,
    intake: Intake,
) -> Result<Imported, Fault> {
    import_document(json, None, folder, intake)
}

fn import_document(
    json: &[u8],
    bin: Option<&[u8]>,
    folder: &Path,
    intake: Intake,
) -> Result<Imported, Fault> {
    // Checked before parsing: the parser's own limit reports neither file nor cause.
    check_outline(json)?;
    let root: Root = serde_json::from_slice(json)
        .map_err(|e| Fault::malformed("JSON", "glTF 2.0", shorten_error(&e)))?;
    // Later minor versions are compatible.
    if !root.asset.version.starts_with("2.") {
        let found = format!("\"{}\"", shorten(&root.asset.version));
        return Err(Fault::malformed("asset.version", "2.0", found));
    }
    // A required extension changes the meaning of the data.
    let unknown = |name: &&String| !KNOWN_EXTENSIONS.contains(&name.as_str());
    if let Some(name) = root.extensions_required.iter().find(unknown) {
        let feature = format!("the file requires the extension {}", shorten(name));
        return Err(container::unsupported(feature));
    }
    let mut buffers = Vec::with_capacity(root.buffers.len());
    for (index, declared) in root.buffers.iter().enumerate() {
        buffers.push(buffer(declared, index, bin, folder)?);
    }
    import::model(&root, &buffers, intake)
}

/// Bytes of a buffer.
pub(super) enum BufferBytes<'a> {
    Loaded(Cow<'a, [u8]>),
    /// File of which only the rows of accessors are read, and the number of its bytes that belong to the buffer.
    File(File, usize),
}

impl BufferBytes<'_> {
    pub fn len(&self) -> usize {
        match self {
            Self::Loaded(bytes) => bytes.len(),
            Self::File(_, length) => *length,
        }
    }
}

fn buffer<'a>(
    declared: &Buffer,
    index: usize,
    bin: Option<&'a [u8]>,
    folder: &Path,
) -> Result<BufferBytes<'a>, Fault> {
    let place = format!("buffer {index}");
    let length = declared.byte_length;
    // Bytes after byteLength do not belong to the buffer: the BIN chunk may be padded, a file longer.
    let loaded = match (&declared.uri, bin) {
        (Some(uri), _) => match uri.strip_prefix("data:") {
            Some(data) => data_uri(data, &place)?.into(),
            None => {
                return Ok(BufferBytes::File(open_sibling(uri, length, folder, &place)?, length));
            }
        },
        (None, Some(bin)) if index == 0 => Cow::Borrowed(bin),
        (None, _) => return Err(Fault::malformed(place, "a uri or a BIN chunk", "neither")),
    };
    let found = format!("{} bytes", loaded.len());
    let cut = match loaded {
        Cow::Borrowed(bytes) => bytes.get(..length).map(Cow::Borrowed),
        Cow::Owned(mut bytes) if bytes.len() >= length => {
            bytes.truncate(length);
            Some(Cow::Owned(bytes))
        }
        Cow::Owned(_) => None,
    };
    cut.map(BufferBytes::Loaded)
        .ok_or_else(|| Fault::malformed(place, format!("{length} bytes"), found))
}

fn check_outline(json: &[u8]) -> Result<(), Fault> {
    let JsonOutline { depth, memory, .. } = JsonOutline::of(json);
    if depth > MAX_JSON_DEPTH {
        let expected = format!("at most {MAX_JSON_DEPTH} nested levels");
        return Err(Fault::malformed("JSON", expected, "more"));
    }
    if memory > MAX_JSON_MEMORY {
        let expected = format!("at most {MAX_JSON_MEMORY} bytes of values");
        return Err(Fault::malformed("JSON", expected, format!("about {memory}")));
    }
    Ok(())
}

/// Formats a JSON parser error; shortens a long message to the position of the error.
fn shorten_error(error: &serde_json::Error) -> String {
    // The message may quote strings of the file, of any length.
    let text = error.to_string();
    if text.len() <= 120 {
        text
    } else {
        format!("an error at line {}, column {}", error.line(), error.column())
    }
}

fn data_uri(data: &str, place: &str) -> Result<Vec<u8>, Fault> {
    let bytes = data.split_once(";base64,").and_then(|(_, text)| decode_base64(text));
    bytes.ok_or_else(|| {
        let found = format!("\"{}\"", shorten(&format!("data:{data}")));
        Fault::malformed(place, "a data: URI with base64", found)
    })
}

fn open_sibling(uri: &str, length: usize, folder: &Path, place: &str) -> Result<File, Fault> {
    let elsewhere =
        || Fault::malformed(place, "a file beside the glTF", format!("\"{}\"", shorten(uri)));
    let path = folder.join(sibling(uri).ok_or_else(elsewhere)?);
    // A link could hand out any file of the user. A missing file is reported below.
    let is_inside = |file: PathBuf| folder.canonicalize().is_ok_and(|real| file.starts_with(real));
    if !path.canonicalize().map_or(true, is_inside) {
        return Err(elsewhere());
    }
    let expected = || format!("{} with at least {length} bytes", path.display());
    let size = match std::fs::metadata(&path) {
        Ok(metadata) if metadata.is_file() => metadata.len(),
        Ok(_) => return Err(Fault::malformed(place, expected(), "something that is no file")),
        Err(e) => return Err(Fault::malformed(place, expected(), e.to_string())),
    };
    if size < length as u64 {
        return Err(Fault::malformed(place, expected(), format!("{size} bytes")));
    }
    File::open(&path).map_err(|source| Fault::Io { action: BUFFER_FILE, source })
}

/// Decodes a URI into a relative path; `None` if it is invalid or leaves the folder of the glTF.
fn sibling(uri: &str) -> Option<PathBuf> {
    let decoded = decode_percent(uri)?;
    // Excludes schemes, drive letters, foreign separators and embedded NUL bytes.
    let foreign = decoded.is_empty() || decoded.contains([':', '\\', '\0']);
    let path = PathBuf::from(decoded);
    let stays = path.components().all(|part| matches!(part, Component::Normal(_)));
    (!foreign && stays).then_some(path)
}

fn decode_percent(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'%' => 16 * hex(rest.next()?)? + hex(rest.next()?)?,
            other => other,
        });
    }
    String::from_utf8(bytes).ok()
}

fn hex(digit: u8) -> Option<u8> {
    char::from(digit).to_digit(16).map(|value| value as u8)
}

/// Decodes base64 with the standard alphabet (RFC 4648 §4), padding optional.
fn decode_base64(text: &str) -> Option<Vec<u8>> {
    const ANY_PADDING: GeneralPurposeConfig =
        GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
    GeneralPurpose::new(&alphabet::STANDARD, ANY_PADDING).decode(text).ok()
}

#[cfg(test)]
mod uri_tests {
    use super::*;

    #[test]
    fn base64_vectors_of_rfc_4648() {
        let cases = [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYg", "foob")];
        for (text, bytes) in cases {
            assert_eq!(decode_base64(text).as_deref(), Some(bytes.as_bytes()), "{text}");
        }
        for broken in ["Z", "Zm9vY", "Zm 9", "Z===="] {
            assert_eq!(decode_base64(broken), None, "{broken}");
        }
    }

    #[test]
    fn only_paths_inside_the_folder_are_siblings() {
        for (uri, path) in [("a.bin", "a.bin"), ("sub/my%20data.bin", "sub/my data.bin")] {
            assert_eq!(sibling(uri), Some(PathBuf::from(path)));
        }
        let outside = ["../a", "%2e%2e/a", "/etc/passwd", "a/../../b", "file:a", "C:a", "a\\b", ""];
        for uri in outside.into_iter().chain(["%zz", "%2", "a%00b"]) {
            assert_eq!(sibling(uri), None, "{uri}");
        }
    }
}
