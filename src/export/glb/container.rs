//! Binary container of a GLB: header, JSON chunk and BIN chunk, with lengths in multiples of 4.

use crate::export::error::Fault;
use std::io::{self, Write};

const MAGIC: u32 = 0x4654_6C67;
const JSON: u32 = 0x4E4F_534A;
const BIN: u32 = 0x004E_4942;

/// Bytes of the header and of both chunk headers.
const OVERHEAD_BYTES: u64 = 12 + 8 + 8;

pub(super) fn file_size(json: usize, bin: u64) -> u64 {
    OVERHEAD_BYTES + json.next_multiple_of(4) as u64 + bin
}

/// Writes everything before the content of the BIN chunk. The file must be smaller than 4 GiB and
/// `bin_length` a multiple of 4.
pub(super) fn write_start(out: &mut dyn Write, json: &str, bin_length: u64) -> io::Result<()> {
    let padded = json.len().next_multiple_of(4);
    let total = file_size(json.len(), bin_length);
    for word in [MAGIC, 2, total as u32, padded as u32, JSON] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(json.as_bytes())?;
    // glTF requires JSON to be padded with spaces. BIN needs no padding: rows are multiples of 4.
    (json.len()..padded).try_for_each(|_| out.write_all(b" "))?;
    out.write_all(&(bin_length as u32).to_le_bytes())?;
    out.write_all(&BIN.to_le_bytes())
}

/// Splits a file into the JSON text and the BIN content, if any.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Fault> {
    let header = |at| word(bytes, at, "GLB header");
    let (version, total) = (header(4)?, header(8)?);
    if version != 2 {
        return Err(Fault::malformed("GLB header", "version 2", format!("version {version}")));
    }
    // Extra bytes could hide content, missing ones mean truncation.
    if u64::from(total) != bytes.len() as u64 {
        let found = format!("{} bytes", bytes.len());
        return Err(Fault::malformed("GLB header", format!("a file of {total} bytes"), found));
    }
    let (json, behind) = chunk(bytes, 12, JSON, "JSON chunk")?;
    if behind >= bytes.len() {
        return Ok((json, None));
    }
    // Chunks after BIN belong to extensions; glTF requires readers to ignore unknown chunks.
    let (bin, _) = chunk(bytes, behind, BIN, "BIN chunk")?;
    Ok((json, Some(bin)))
}

/// Returns the content of the chunk at `start` and the start of the next one.
fn chunk<'a>(
    bytes: &'a [u8],
    start: usize,
    kind: u32,
    place: &str,
) -> Result<(&'a [u8], usize), Fault> {
    let length = word(bytes, start, place)? as usize;
    let found = word(bytes, start + 4, place)?;
    if found != kind {
        let found = format!("{found:#010x}");
        return Err(Fault::malformed(place, format!("chunk type {kind:#010x}"), found));
    }
    let content = bytes.get(start + 8..).unwrap_or_default();
    match content.get(..length) {
        Some(content) if length.is_multiple_of(4) => Ok((content, start + 8 + length)),
        Some(_) => Err(Fault::malformed(place, "a multiple of 4", format!("{length} bytes"))),
        None => {
            let found = format!("{} bytes", content.len());
            Err(Fault::malformed(place, format!("{length} bytes"), found))
        }
    }
}

fn word(bytes: &[u8], at: usize, place: &str) -> Result<u32, Fault> {
    match bytes.get(at..at + 4) {
        Some(&[a, b, c, d]) => Ok(u32::from_le_bytes([a, b, c, d])),
        _ => Err(Fault::malformed(place, "8 more bytes", "the end of the file")),
    }
}
