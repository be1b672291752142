//! Container of a checkpoint: header, section table and checksums.
//!
//! Checks run from the outside inwards and allocate only for data that the file is known to contain
//! (`files.md`, Checkpoint container). A length in a damaged file therefore cannot cause a large
//! allocation. Sections start at multiples of 64 bytes (a cache line), in table order, with only zeros
//! between them, so the encoding is unique.

use super::super::error::{shorten, try_with_capacity};
use super::element::{ElementType, Stored};
use super::error::{Defect, tag_text};
use super::sections;
use super::sections::VERSION;
use bytemuck::{Pod, Zeroable};
use std::borrow::Cow;
use std::cmp::Ordering;
use std::io;
use std::io::{Read, Write};

// Line endings and a byte with the high bit set reveal damage by text-mode transfers.
pub(super) const MAGIC: [u8; 8] = *b"\x89VBGS\r\n\x1a";
// About 40 tags are known. The bound keeps the table small whatever a damaged header states.
const MAX_SECTIONS: usize = 64;
// A cache line.
const ALIGNMENT: u64 = 64;
const CRC_BYTES: usize = 4;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Header {
    magic: [u8; 8],
    major: u16,
    minor: u16,
    n_sections: u32,
    file_bytes: u64,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Entry {
    tag: [u8; 4],
    element: u32,
    offset: u64,
    length: u64,
    crc: u32,
    reserved: u32,
}

pub(super) struct Section<'a> {
    tag: [u8; 4],
    element: ElementType,
    parts: Vec<Cow<'a, [u8]>>,
}

impl<'a> Section<'a> {
    pub fn new<T: Stored>(tag: [u8; 4], elements: &'a [T]) -> Self {
        Self {
            tag,
            element: T::ELEMENT,
            parts: vec![Cow::Borrowed(bytemuck::cast_slice(elements))],
        }
    }

    pub fn owned<T: Stored>(tag: [u8; 4], elements: Vec<T>) -> Self {
        let bytes = match bytemuck::try_cast_vec(elements) {
            Ok(bytes) => bytes,
            // A vector of another alignment cannot be reinterpreted and is copied.
            Err((_, elements)) => bytemuck::cast_slice(&elements).to_vec(),
        };
        Self { tag, element: T::ELEMENT, parts: vec![Cow::Owned(bytes)] }
    }

    pub fn from_runs<T: Stored>(tag: [u8; 4], runs: impl Iterator<Item = &'a [u8]>) -> Self {
        Self { tag, element: T::ELEMENT, parts: runs.map(Cow::Borrowed).collect() }
    }

    pub fn extended<T: Stored>(mut self, elements: &'a [T]) -> Self {
        debug_assert!(T::ELEMENT == self.element);
        self.parts.push(Cow::Borrowed(bytemuck::cast_slice(elements)));
        self
    }

    fn length(&self) -> u64 {
        self.parts.iter().map(|part| part.len() as u64).sum()
    }

    fn crc(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        self.parts.iter().for_each(|part| hasher.update(part));
        hasher.finalize()
    }
}

pub(super) fn write(out: &mut dyn Write, sections: &[Section]) -> io::Result<()> {
    let mut end = (size_of::<Header>() + size_of::<Entry>() * sections.len() + CRC_BYTES) as u64;
    // Offsets and checksums come first: the table precedes the sections, and a pipe cannot seek.
    let entries: Vec<Entry> = sections
        .iter()
        .map(|section| {
            let offset = end.next_multiple_of(ALIGNMENT);
            end = offset + section.length();
            Entry {
                tag: section.tag,
                element: section.element as u32,
                offset,
                length: section.length(),
                crc: section.crc(),
                reserved: 0,
            }
        })
        .collect();
    let header = Header {
        magic: MAGIC,
        major: VERSION.0,
        minor: VERSION.1,
        n_sections: sections.len() as u32,
        file_bytes: end,
    };
    let mut head = bytemuck::bytes_of(&header).to_vec();
    head.extend_from_slice(bytemuck::cast_slice(&entries));
    head.extend_from_slice(&crc32fast::hash(&head).to_le_bytes());
    out.write_all(&head)?;
    let mut at = head.len() as u64;
    for (section, entry) in sections.iter().zip(&entries) {
        io::copy(&mut io::repeat(0).take(entry.offset - at), out)?;
        section.parts.iter().try_for_each(|part| out.write_all(part))?;
        at = entry.offset + entry.length;
    }
    Ok(())
}

pub(super) struct Container<'a> {
    pub version: (u16, u16),
    sections: Vec<(Entry, &'a [u8])>,
}

impl<'a> Container<'a> {
    /// Parses a checkpoint and checks everything except the values in its sections, in the order of
    /// `files.md`, Checkpoint container. Allocates only the section table, after a check that the file
    /// contains it.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, Defect> {
        let found = bytes.len() as u64;
        let head = size_of::<Header>();
        let Some(first) = bytes.get(..head).filter(|_| bytes.len() >= head + CRC_BYTES) else {
            return Err(too_short(bytes));
        };
        let header: Header = bytemuck::pod_read_unaligned(first);
        if header.magic != MAGIC {
            return Err(wrong_magic(bytes));
        }
        if header.major != VERSION.0 {
            return Err(Defect::Version { major: header.major, minor: header.minor });
        }
        // Checked before the table is read, because it determines the table's size.
        let n = header.n_sections as usize;
        if n > MAX_SECTIONS {
            let expected = format!("at most {MAX_SECTIONS} sections");
            return Err(Defect::malformed("header", expected, n.to_string()));
        }
        let table_end = head + n * size_of::<Entry>();
        let start = bytes.get(..table_end + CRC_BYTES);
        let Some((start, crc)) = start.and_then(|start| start.split_at_checked(table_end)) else {
            return Err(Defect::Truncated { expected: (table_end + CRC_BYTES) as u64, found });
        };
        // From here on the table is as it was written.
        if crc32fast::hash(start).to_le_bytes() != crc {
            return Err(Defect::Checksum { place: "header".into() });
        }
        check_length(header.file_bytes, found)?;
        let version = (header.major, header.minor);
        let mut sections = try_with_capacity(n).map_err(Defect::Memory)?;
        let mut end = table_end + CRC_BYTES;
        let table = start.get(head..).unwrap_or_default();
        for entry in table.chunks_exact(size_of::<Entry>()) {
            let entry: Entry = bytemuck::pod_read_unaligned(entry);
            let content = locate(bytes, &entry, end)?;
            end = entry.offset as usize + content.len();
            if crc32fast::hash(content) != entry.crc {
                return Err(Defect::Checksum { place: tag_text(entry.tag) });
            }
            // Later minor versions may add optional sections, marked by tags in lower case.
            if !sections::is_known(entry.tag) && !entry.tag[0].is_ascii_lowercase() {
                return Err(Defect::UnknownSection { tag: tag_text(entry.tag), version });
            }
            // A duplicate would never be read and could hold anything.
            if sections.iter().any(|(other, _): &(Entry, &[u8])| other.tag == entry.tag) {
                return Err(Defect::malformed(tag_text(entry.tag), "one such section", "two"));
            }
            sections.push((entry, content));
        }
        if end as u64 != header.file_bytes {
            let trailing = format!("{} more bytes", header.file_bytes - end as u64);
            return Err(Defect::malformed("header", "nothing after the last section", trailing));
        }
        Ok(Self { version, sections })
    }

    /// Returns the bytes of a section and the code of its element type; `None` if the section is
    /// missing.
    pub fn section(&self, tag: [u8; 4]) -> Option<(&'a [u8], u32)> {
        let found = self.sections.iter().find(|(entry, _)| entry.tag == tag);
        found.map(|(entry, bytes)| (*bytes, entry.element))
    }
}

fn check_length(expected: u64, found: u64) -> Result<(), Defect> {
    match found.cmp(&expected) {
        Ordering::Less => Err(Defect::Truncated { expected, found }),
        Ordering::Equal => Ok(()),
        Ordering::Greater => {
            let expected = format!("{expected} bytes");
            Err(Defect::malformed("header", expected, found.to_string()))
        }
    }
}

/// Returns the bytes of a section. It must begin at or after `end`, the end of the previous section,
/// with only zeros in between.
fn locate<'a>(bytes: &'a [u8], entry: &Entry, end: usize) -> Result<&'a [u8], Defect> {
    let refuse = |expected: &str, found: String| {
        Err(Defect::malformed(format!("table entry `{}`", tag_text(entry.tag)), expected, found))
    };
    let range = usize::try_from(entry.offset).ok().zip(usize::try_from(entry.length).ok());
    let range = range.and_then(|(start, length)| Some(start..start.checked_add(length)?));
    let content = range.and_then(|range| Some((bytes.get(range.clone())?, range.start)));
    let Some((content, start)) = content else {
        let found = format!("{} bytes from {}", entry.length, entry.offset);
        return refuse(&format!("a place within the file's {} bytes", bytes.len()), found);
    };
    if !entry.offset.is_multiple_of(ALIGNMENT) {
        return refuse(&format!("an offset divisible by {ALIGNMENT}"), entry.offset.to_string());
    }
    // Overlapping sections would make the encoding ambiguous.
    if start < end {
        return refuse(&format!("an offset of {end} or more"), entry.offset.to_string());
    }
    // No checksum covers bytes between sections.
    let is_padding =
        |gap: &[u8]| gap.len() < ALIGNMENT as usize && gap.iter().all(|&byte| byte == 0);
    if !bytes.get(end..start).is_some_and(is_padding) {
        return refuse("only zeros up to the next multiple of 64", "something else".into());
    }
    // A type unknown here belongs to an optional section of a later version, which is never read.
    let size = ElementType::of_code(entry.element).map_or(1, ElementType::size);
    if !content.len().is_multiple_of(size) {
        return refuse(
            &format!("whole elements of {size} bytes"),
            format!("{} bytes", content.len()),
        );
    }
    if entry.reserved != 0 {
        return refuse("0 in the reserved field", entry.reserved.to_string());
    }
    Ok(content)
}

fn too_short(bytes: &[u8]) -> Defect {
    let is_start = !bytes.is_empty() && bytes.iter().zip(&MAGIC).all(|(a, b)| a == b);
    if is_start {
        let expected = (size_of::<Header>() + CRC_BYTES) as u64;
        return Defect::Truncated { expected, found: bytes.len() as u64 };
    }
    wrong_magic(bytes)
}

fn wrong_magic(bytes: &[u8]) -> Defect {
    if is_text_damaged(bytes) {
        return Defect::TextMode;
    }
    let start = String::from_utf8_lossy(bytes.get(..16).unwrap_or(bytes));
    let found = match bytes {
        [] => "an empty file".to_owned(),
        _ if bytes.starts_with(b"ply") => "a PLY file".to_owned(),
        _ if bytes.starts_with(b"glTF") => "a GLB file".to_owned(),
        _ => format!("a file starting \"{}\"", shorten(&start)),
    };
    Defect::NotACheckpoint { found }
}

/// True for a checkpoint that a text-mode transfer has damaged.
pub(super) fn is_text_damaged(bytes: &[u8]) -> bool {
    // The letters stay intact, the bytes around them do not. UTF-8 decoding with replacement turns the first
    // byte into three.
    !bytes.starts_with(&MAGIC)
        && [&b"\x89VBGS"[..], b"\tVBGS", b"\xEF\xBF\xBDVBGS", b"\xC2\x89VBGS"]
            .iter()
            .any(|start| bytes.starts_with(start) && bytes.len() >= start.len() + 3)
}
