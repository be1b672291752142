//! Binary container of a GLB: header, JSON chunk and BIN chunk, with lengths in multiples of 4.

use super::read::{BUFFER_FILE, BufferBytes};
use super::{Accessor, COLOR_0, OPACITY, POSITION, ROTATION, Root, SCALE, SH_0, SH_1};
use crate::export::error::{Fault, shorten, try_with_capacity};
use std::borrow::Cow;
use std::fs::File;
use std::io;
use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::ops::Range;

// `glTF`, `JSON` and `BIN\0` as little-endian words.
const MAGIC: u32 = 0x4654_6C67;
const JSON: u32 = 0x4E4F_534A;
const BIN: u32 = 0x004E_4942;

// The file's header and the heads of both chunks.
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

// Component types have the numbers of OpenGL.
const I8: u32 = 5120;
const U8: u32 = 5121;
const I16: u32 = 5122;
pub(super) const U16: u32 = 5123;
pub(super) const U32: u32 = 5125;
pub(super) const F32: u32 = 5126;

const VEC3: &[&str] = &["VEC3"];
const FLOATS: &[(u32, bool)] = &[(F32, false)];
const FRACTIONS: &[(u32, bool)] = &[(F32, false), (U8, true), (U16, true)];

/// Returns the permitted vector types of an attribute, and its permitted component types with their
/// `normalized` flags (`files.md`, GLB). `COLOR_0` follows glTF 2.0, 3.7.2.1.
fn permitted_types(semantic: &str) -> (&'static [&'static str], &'static [(u32, bool)]) {
    match semantic {
        ROTATION => (&["VEC4"], &[(F32, false), (I8, true), (I16, true)]),
        SCALE => (
            VEC3,
            &[
                (F32, false),
                (U8, false),
                (U16, false),
                (U8, true),
                (U16, true),
                (I8, false),
                (I16, false),
                (I8, true),
                (I16, true),
            ],
        ),
        OPACITY => (&["SCALAR"], FRACTIONS),
        COLOR_0 => (&["VEC3", "VEC4"], FRACTIONS),
        POSITION | SH_0 => (VEC3, FLOATS),
        _ if SH_1.contains(&semantic) => (VEC3, FLOATS),
        _ => (&[], &[]),
    }
}

pub(super) struct Column<'a> {
    bytes: Cow<'a, [u8]>,
    /// File with the rows while they are not read, and the place of the first.
    unread: Option<(&'a File, u64)>,
    stride: usize,
    row_bytes: usize,
    component: u32,
    normalized: bool,
    pub count: usize,
    pub place: String,
}

impl<'a> Column<'a> {
    pub fn open(
        root: &Root,
        buffers: &'a [BufferBytes],
        index: usize,
        semantic: &str,
    ) -> Result<Self, Fault> {
        let place = format!("accessor {index} ({semantic})");
        let fault = |expected: &str, found: String| Fault::malformed(&place, expected, found);
        let accessor = root.accessors.get(index).ok_or_else(|| {
            fault("an accessor of that number", format!("{} accessors", root.accessors.len()))
        })?;
        let row_bytes = row_bytes(accessor, semantic, &place)?;
        let view_index = match (accessor.buffer_view, &accessor.sparse) {
            (Some(view), None) => view,
            _ => return Err(unsupported(format!("{place} is sparse"))),
        };
        let (buffer, view, stride) = view_bytes(root, buffers, view_index, &place)?;
        let stride = stride.unwrap_or(row_bytes);
        if stride < row_bytes {
            return Err(fault(&format!("a byteStride of {row_bytes} or more"), stride.to_string()));
        }
        let needed = match accessor.count {
            0 => Some(0),
            // No padding need follow the last row.
            n => (n - 1).checked_mul(stride).and_then(|bytes| bytes.checked_add(row_bytes)),
        };
        let rows = needed.and_then(|n| part(view.clone(), accessor.byte_offset, n));
        let rows = rows.ok_or_else(|| {
            fault(
                &format!("{} rows inside bufferView {view_index}", accessor.count),
                format!("{} bytes", view.len()),
            )
        })?;
        let (bytes, unread) = match buffer {
            BufferBytes::Loaded(bytes) => (bytes.get(rows).unwrap_or_default(), None),
            BufferBytes::File(file, _) => (&[][..], Some((file, rows.start as u64))),
        };
        let Accessor { component_type: component, normalized, count, .. } = *accessor;
        let bytes = Cow::Borrowed(bytes);
        Ok(Self { bytes, unread, stride, row_bytes, component, normalized, count, place })
    }

    /// Reads the rows of a file, without what lies between them. Called after the number of rows is checked.
    pub fn load(&mut self) -> Result<(), Fault> {
        let Some((file, start)) = self.unread.take() else { return Ok(()) };
        let room = self.count.checked_mul(self.row_bytes);
        let room = room.ok_or(Fault::OutOfMemory { bytes: u64::MAX })?;
        let mut rows = try_with_capacity(room)?;
        rows.resize(room, 0);
        let mut source = BufReader::new(file);
        let mut read = || {
            source.seek(SeekFrom::Start(start))?;
            for (i, row) in rows.chunks_exact_mut(self.row_bytes).enumerate() {
                // Within the block in memory if the next row is there.
                source.seek_relative(if i == 0 {
                    0
                } else {
                    (self.stride - self.row_bytes) as i64
                })?;
                source.read_exact(row)?;
            }
            Ok(())
        };
        read().map_err(|source| Fault::Io { action: BUFFER_FILE, source })?;
        (self.bytes, self.stride) = (Cow::Owned(rows), self.row_bytes);
        Ok(())
    }

    pub fn is_signed_integer(&self) -> bool {
        matches!(self.component, I8 | I16)
    }

    pub fn get<const N: usize>(&self, row: usize) -> [f64; N] {
        // Rows are inside the view, as `open` checked; missing bytes would give NaN.
        let size = component_size(self.component);
        let row = self.bytes.get(row * self.stride..).unwrap_or_default();
        let bytes = |i: usize| row.get(i * size..(i + 1) * size).unwrap_or_default();
        std::array::from_fn(|i| self.component(bytes(i)))
    }

    fn component(&self, bytes: &[u8]) -> f64 {
        // Divided by the largest positive value of the type, as in glTF 2.0, 3.11; −128 is clamped to −1.
        let (value, largest) = match (self.component, bytes) {
            (I8, &[a]) => (f64::from(a as i8), 127.0),
            (U8, &[a]) => (f64::from(a), 255.0),
            (I16, &[a, b]) => (f64::from(i16::from_le_bytes([a, b])), 32767.0),
            (U16, &[a, b]) => (f64::from(u16::from_le_bytes([a, b])), 65535.0),
            // `permitted_types` has no other type of four bytes than F32.
            (_, &[a, b, c, d]) => (f64::from(f32::from_le_bytes([a, b, c, d])), 1.0),
            _ => (f64::NAN, 1.0),
        };
        if self.normalized { (value / largest).max(-1.0) } else { value }
    }
}

/// Returns the buffer of a view, its range in the buffer, and its stride.
fn view_bytes<'a, 'b>(
    root: &Root,
    buffers: &'a [BufferBytes<'b>],
    index: usize,
    place: &str,
) -> Result<(&'a BufferBytes<'b>, Range<usize>, Option<usize>), Fault> {
    let view = root.buffer_views.get(index).ok_or_else(|| {
        Fault::malformed(place, "a bufferView of that number", format!("number {index}"))
    })?;
    // Compression extensions have it in their name, such as `EXT_meshopt_compression`.
    if let Some(name) = view.extensions.keys().find(|name| name.contains("compression")) {
        return Err(unsupported(format!("{place} is compressed ({})", shorten(name))));
    }
    let (start, length) = (view.byte_offset, view.byte_length);
    let buffer = buffers.get(view.buffer);
    match buffer.and_then(|buffer| Some((buffer, part(0..buffer.len(), start, length)?))) {
        Some((buffer, range)) => Ok((buffer, range, view.byte_stride)),
        None => {
            let expected = format!("bufferView {index} inside buffer {}", view.buffer);
            Err(Fault::malformed(place, expected, format!("{length} bytes from {start}")))
        }
    }
}

fn row_bytes(accessor: &Accessor, semantic: &str, place: &str) -> Result<usize, Fault> {
    let (kinds, components) = permitted_types(semantic);
    let component = (accessor.component_type, accessor.normalized);
    if kinds.contains(&accessor.kind.as_str()) && components.contains(&component) {
        return Ok(row_size(&accessor.kind, accessor.component_type));
    }
    let components: Vec<String> = components.iter().copied().map(describe).collect();
    let expected = format!("{} of {}", kinds.join("/"), components.join("/"));
    let found = format!("{} of {}", shorten(&accessor.kind), describe(component));
    Err(Fault::malformed(place, expected, found))
}

fn describe((component, normalized): (u32, bool)) -> String {
    format!("{}{component}", if normalized { "normalized " } else { "" })
}

/// Returns the size in bytes of a row with a permitted vector type and the given component type.
pub(super) fn row_size(kind: &str, component: u32) -> usize {
    let width = match kind {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        _ => 4,
    };
    width * component_size(component)
}

fn component_size(component: u32) -> usize {
    match component {
        I8 | U8 => 1,
        I16 | U16 => 2,
        _ => 4,
    }
}

/// Returns the part of `length` bytes from `start` of a range; `None` if it is not inside.
fn part(whole: Range<usize>, start: usize, length: usize) -> Option<Range<usize>> {
    let start = whole.start.checked_add(start)?;
    let end = start.checked_add(length)?;
    (end <= whole.end).then_some(start..end)
}

pub(super) fn unsupported(feature: String) -> Fault {
    Fault::Unsupported { feature, advice: "export plain, uncompressed attributes" }
}
