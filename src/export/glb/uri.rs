//! Buffers of a `.gltf`: `data:` URIs and files beside it.

use crate::export::error::{Fault, shorten};
use std::path::{Component, Path, PathBuf};

/// Loads the buffer of a URI, of which `length` bytes are needed.
pub(super) fn load(uri: &str, length: usize, folder: &Path, place: &str) -> Result<Vec<u8>, Fault> {
    if let Some(data) = uri.strip_prefix("data:") {
        let bytes = data.split_once(";base64,").and_then(|(_, text)| decode_base64(text));
        return bytes.ok_or_else(|| {
            Fault::malformed(place, "a data: URI with base64", format!("\"{}\"", shorten(uri)))
        });
    }
    let path = folder.join(sibling(uri).ok_or_else(|| {
        Fault::malformed(place, "a file beside the glTF", format!("\"{}\"", shorten(uri)))
    })?);
    read_sibling(&path, length, place)
}

fn read_sibling(path: &Path, length: usize, place: &str) -> Result<Vec<u8>, Fault> {
    let expected = || format!("{} with at least {length} bytes", path.display());
    let size = match std::fs::metadata(path) {
        Ok(metadata) if metadata.is_file() => metadata.len(),
        Ok(_) => return Err(Fault::malformed(place, expected(), "something that is no file")),
        Err(e) => return Err(Fault::malformed(place, expected(), e.to_string())),
    };
    // Checked before reading: the file may have any size.
    if size < length as u64 {
        return Err(Fault::malformed(place, expected(), format!("{size} bytes")));
    }
    std::fs::read(path).map_err(|source| Fault::Io { action: "read the buffer file", source })
}

/// Decodes a URI into a relative path, if it stays inside the folder of the glTF.
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
    let digits = text.trim_end_matches('=').as_bytes();
    let mut bytes = Vec::with_capacity(digits.len() / 4 * 3 + 2);
    for group in digits.chunks(4) {
        let mut bits = 0u32;
        for &digit in group {
            let value = match digit {
                b'A'..=b'Z' => digit - b'A',
                b'a'..=b'z' => digit - b'a' + 26,
                b'0'..=b'9' => digit - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                _ => return None,
            };
            bits = bits << 6 | u32::from(value);
        }
        let n_bytes = group.len() * 6 / 8;
        if n_bytes == 0 {
            return None; // one digit holds less than a byte
        }
        let aligned = bits << (32 - 6 * group.len());
        bytes.extend(aligned.to_be_bytes().into_iter().take(n_bytes));
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
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
