//! Import of SPZ versions 1 to 4: decompression of a file into its columns, and their rows.
//!
//! Sizes in a file are untrusted, and both compressions exceed ratios of a thousand. All columns are therefore
//! unpacked twice and never stored: once to check that they have the bytes of the splats that the header states, and
//! once more while their rows are read. Unpacking stops one byte after the size needed for the splats.

use super::quantise::{coefficient, color, first_three, fixed, half, scale, smallest_three};
use crate::export::error::Fault;
use crate::export::gaussian::{AxisRotation, Gaussian, harmonics_to_directional};
use crate::export::imported::{Imported, Intake, ModelKind, Note, Rows};
use flate2::bufread::GzDecoder;
use glam::{DMat3, DVec3};
use std::io::{BufReader, ErrorKind, Read};

pub(in crate::export) fn is_gzip(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x1F, 0x8B])
}

/// True for a file of version 4, or of an older version without its gzip compression.
pub(in crate::export) fn is_plain(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

pub(in crate::export) fn spz(bytes: &[u8], intake: Intake) -> Result<Imported, Fault> {
    let mut file = match is_gzip(bytes) {
        true => gzip(bytes, intake.max_splats)?,
        false => plain(bytes, intake.max_splats)?,
    };
    let header = file.header;
    let mut notes = Vec::new();
    let n_coefficients = 3 * header.n_coefficients().saturating_sub(N_DEGREE_1);
    if n_coefficients > 0 {
        notes.push(Note::ViewDependentColorIgnored { n_coefficients });
    }
    if header.unknown_flags() != 0 {
        notes.push(Note::NotUsed { what: format!("flags {:#04x}", header.unknown_flags()) });
    }
    let turn = axes(&file.records, &mut notes).then(AxisRotation::Y_UP_TO_Z_UP);
    let is_directional = header.n_coefficients() > 0;
    let size = (bytes.len() as u64).saturating_mul(USUAL_FACTOR);
    let mut rows = Rows::with_capacity(header.n_splats as usize, is_directional, size, intake)?;
    for _ in 0..header.n_splats {
        let splat = splat(&mut file, &mut rows)?;
        rows.push(splat.rotated(&turn));
    }
    let imported = rows.finish(ModelKind::Splats, notes, Vec::new())?;
    let imported = if header.is_antialiased() { imported.antialiased() } else { imported };
    Ok(Imported { defined_up: Some(DVec3::Z), ..imported })
}

/// Type of the record `SPZ_ADOBE_coordinate_system`, which holds a number of a system of axes.
const AXES_RECORD: u32 = 0xADBE_0003;
/// Systems of axes by their numbers, 1 and up: the directions of x, y and z, left or right, down or up, back or
/// front.
const SYSTEMS: [&[u8; 3]; 16] = [
    b"LDB", b"RDB", b"LUB", b"RUB", b"LDF", b"RDF", b"LUF", b"RUF", b"LFD", b"RFD", b"LFU", b"RFU",
    b"LBD", b"RBD", b"LBU", b"RBU",
];

/// Returns the rotation or mirroring of the axes stated by the file to x right, y up and z back. Adds notes about
/// records that are not used.
fn axes(records: &[(u32, Vec<u8>)], notes: &mut Vec<Note>) -> AxisRotation {
    let number = |(kind, content): &(u32, Vec<u8>)| {
        let number = content.as_slice().try_into().ok().map(u32::from_le_bytes);
        number.filter(|_| *kind == AXES_RECORD)
    };
    // The last record applies, as in the reference reader.
    let used = records.iter().rposition(|record| number(record).is_some());
    let others = records.iter().enumerate().filter(|(i, _)| Some(*i) != used);
    let names =
        others.map(|(_, (kind, content))| format!("{kind:#010x} ({} bytes)", content.len()));
    let names: Vec<String> = names.take(MAX_NAMED_RECORDS).collect();
    notes.extend(Note::not_used("extension record", names.iter().map(String::as_str)));
    let Some(number) = used.and_then(|i| number(records.get(i)?)) else {
        return AxisRotation::IDENTITY;
    };
    let system = (number as usize).checked_sub(1).and_then(|i| SYSTEMS.get(i));
    let Some(system) = system else {
        let (name, used) = ("axis system", "right, up, back");
        notes.push(Note::Unsupported { name, value: number.to_string(), used });
        return AxisRotation::IDENTITY;
    };
    AxisRotation::from_axes(system.map(|letter| match letter {
        b'L' => DVec3::NEG_X,
        b'R' => DVec3::X,
        b'D' => DVec3::NEG_Y,
        b'U' => DVec3::Y,
        b'F' => DVec3::NEG_Z,
        _ => DVec3::Z,
    }))
}

const MAX_NAMED_RECORDS: usize = 8;
/// Largest factor by which columns of recorded scenes are compressed.
const USUAL_FACTOR: u64 = 5;

const N_DEGREE_1: usize = 3;
/// Largest number of harmonic coefficients per channel, of degree 4.
const MAX_COEFFICIENTS: usize = 24;

/// Reads the next splat.
fn splat(file: &mut Unpacked, rows: &mut Rows) -> Result<Gaussian, Fault> {
    let header = &file.header;
    let [positions, opacities, colors, scales, rotations, harmonics] = &mut file.columns;
    let mean = match header.version {
        1 => {
            let [a, b, c, d, e, f] = positions.next()?;
            [[a, b], [c, d], [e, f]].map(half)
        }
        _ => {
            let [a, b, c, d, e, f, g, h, j] = positions.next()?;
            [[a, b, c], [d, e, f], [g, h, j]].map(|bytes| fixed(bytes, header.fraction_bits))
        }
    };
    let rotation = match header.version {
        1 | 2 => first_three(rotations.next()?),
        _ => smallest_three(rotations.next()?),
    };
    let directional = match header.n_coefficients() {
        0 => DMat3::ZERO,
        n => {
            let mut bytes = [[0; 3]; MAX_COEFFICIENTS];
            harmonics.read(bytes.as_flattened_mut().get_mut(..3 * n).unwrap_or_default())?;
            let [first, second, third, ..] = bytes;
            let vector = |bytes: [u8; 3]| DVec3::from_array(bytes.map(coefficient));
            harmonics_to_directional([first, second, third].map(vector))
        }
    };
    let [opacity] = opacities.next()?;
    Ok(Gaussian {
        mean: DVec3::from_array(mean),
        opacity: f64::from(opacity) / 255.0,
        color: color(colors.next()?),
        scale: scale(scales.next()?),
        rotation: rows.rotation(rotation),
        directional,
        seen: DVec3::ZERO,
    })
}

/// Size in bytes of the version 4 header, without extensions and the table of streams.
pub(super) const NGSP_BYTES: usize = 32;
/// Size in bytes of a stream's entry in the table of version 4, which holds its compressed and
/// uncompressed lengths.
const ENTRY_BYTES: usize = 16;
/// Binary logarithm of the largest accepted Zstandard window.
// Six streams are unpacked at a time. Level 19 of the `zstd` program, its highest without `--ultra`, has 23.
const MAX_WINDOW_LOG: u32 = 24;
/// Largest ratio of columns to file above [`ANY_FACTOR_BYTES`]. Recorded scenes compress by less than 5.
const MAX_FACTOR: usize = 16;
/// Largest size of columns that may be compressed by any factor, bytes: a million equal splats.
const ANY_FACTOR_BYTES: usize = 16 << 20;

pub(super) struct Unpacked<'a> {
    pub header: SpzHeader,
    /// Columns of all splats, in the order of [`SpzHeader::widths`].
    pub columns: [Column<'a>; 6],
    /// Type and content of every extension record, in file order.
    pub records: Vec<(u32, Vec<u8>)>,
}

/// Bytes of a column that are not read yet. A block of them is in memory.
pub(super) struct Column<'a> {
    name: &'static str,
    source: BufReader<Unpacking<'a>>,
}

/// Unpacked bytes of a file.
type Unpacking<'a> = Box<dyn Read + 'a>;

impl<'a> Column<'a> {
    fn new(name: &'static str, source: Unpacking<'a>) -> Self {
        Self { name, source: BufReader::new(source) }
    }

    fn empty() -> Self {
        Self::new("", Box::new(std::io::empty()))
    }

    /// Reads the row of the next splat.
    pub fn next<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut row = [0; N];
        self.read(&mut row).map(|()| row)
    }

    pub fn read(&mut self, bytes: &mut [u8]) -> Result<(), Fault> {
        let fault = |e| malformed_column(self.name, "bytes of every splat", decoder_message(&e));
        self.source.read_exact(bytes).map_err(fault)
    }
}

fn malformed_column(name: &str, expected: impl Into<String>, found: impl Into<String>) -> Fault {
    Fault::malformed(format!("SPZ {name}"), expected, found)
}

/// Maximum size in bytes of the extension records of a gzip file.
const MAX_RECORD_BYTES: u64 = 1 << 20;

/// Splits extension records, each with its type, length and content; `None` if a length is wrong.
fn parse_records(mut bytes: &[u8]) -> Option<Vec<(u32, Vec<u8>)>> {
    let mut records = Vec::new();
    // Type 0 is reserved: zeros are padding.
    while bytes.iter().take(8).any(|byte| *byte != 0) {
        let (kind, rest) = bytes.split_first_chunk()?;
        let (length, rest) = rest.split_first_chunk()?;
        let (content, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        records.push((u32::from_le_bytes(*kind), content.to_vec()));
        bytes = rest;
    }
    Some(records)
}

pub(super) fn gzip(bytes: &[u8], max_splats: usize) -> Result<Unpacked<'_>, Fault> {
    one_stream(|| Box::new(GzDecoder::new(bytes)), bytes.len(), max_splats)
}

pub(super) fn plain(bytes: &[u8], max_splats: usize) -> Result<Unpacked<'_>, Fault> {
    let header = SpzHeader::parse(&header_of(&mut &*bytes)?)?;
    // Before version 4 the only compression is the outer gzip, which this file lacks.
    if header.version < 4 {
        one_stream(|| Box::new(bytes), bytes.len(), max_splats)
    } else {
        streams(bytes, max_splats)
    }
}

fn header_of(source: &mut impl Read) -> Result<[u8; HEADER_BYTES], Fault> {
    let mut header = [0; HEADER_BYTES];
    let short = |e: std::io::Error| {
        Fault::malformed(HEADER, format!("{HEADER_BYTES} bytes"), decoder_message(&e))
    };
    source.read_exact(&mut header).map_err(short)?;
    Ok(header)
}

/// Reads a file of version 1 to 3 and of `size` bytes, with header and columns in one stream, which `open` starts
/// to unpack.
fn one_stream<'a>(
    open: impl Fn() -> Unpacking<'a>,
    size: usize,
    max_splats: usize,
) -> Result<Unpacked<'a>, Fault> {
    let mut source = open();
    let header = SpzHeader::parse(&header_of(&mut source)?)?;
    check_count(&header, size, max_splats)?;
    if header.version > 3 {
        let found = format!("version {}", header.version);
        return Err(Fault::malformed(HEADER, "version 1 to 3 inside gzip", found));
    }
    let sizes = header.widths().map(|width| header.n_splats as usize * width);
    for (needed, name) in sizes.into_iter().zip(COLUMN_NAMES) {
        skip(&mut source, needed, name)?;
    }
    let mut records = Vec::new();
    if header.has_extensions() {
        let mut bytes = Vec::new();
        let rest = source.by_ref().take(MAX_RECORD_BYTES).read_to_end(&mut bytes);
        let found = rest.ok().filter(|n| *n > 0).and_then(|_| parse_records(&bytes));
        // Some writers place the records elsewhere, and with them all that follows.
        records = found.ok_or_else(|| Fault::Unsupported {
            feature: format!("extensions in SPZ version {}", header.version),
            advice: "save the file as SPZ version 4 or as PLY",
        })?;
    }
    // This read also verifies the checksum after the last column.
    let found = match source.read(&mut [0]) {
        Ok(0) => None,
        Ok(_) => Some("more bytes".to_owned()),
        Err(e) => Some(decoder_message(&e)),
    };
    if let Some(found) = found {
        return Err(Fault::malformed("SPZ", "an end after the last column", found));
    }
    let mut columns = [(); 6].map(|()| Column::empty());
    let mut start = HEADER_BYTES;
    for ((column, needed), name) in columns.iter_mut().zip(sizes).zip(COLUMN_NAMES) {
        if needed > 0 {
            let mut source = open();
            skip(&mut source, start, name)?;
            *column = Column::new(name, source);
        }
        start += needed;
    }
    Ok(Unpacked { header, columns, records })
}

/// Reads a file of version 4: an uncompressed header, a table, and one Zstandard stream per column.
fn streams(bytes: &[u8], max_splats: usize) -> Result<Unpacked<'_>, Fault> {
    let header = SpzHeader::parse(&header_of(&mut &*bytes)?)?;
    check_count(&header, bytes.len(), max_splats)?;
    let [records, table, mut rest] = split_table(bytes, &header)?;
    let fault = || Fault::malformed("SPZ extensions", "records inside the header", "a longer one");
    let records = if header.has_extensions() { records } else { &[] };
    let records = parse_records(records).ok_or_else(fault)?;
    let entries = table.as_chunks::<8>().0.as_chunks::<2>().0.iter();
    let lengths = entries.map(|entry| entry.map(u64::from_le_bytes));
    let mut columns = [(); 6].map(|()| Column::empty());
    let named = header.widths().into_iter().zip(COLUMN_NAMES).zip(&mut columns);
    for ([packed, unpacked], ((width, name), column)) in lengths.zip(named) {
        let needed = header.n_splats as usize * width;
        if unpacked != needed as u64 {
            let expected = format!("{needed} bytes for {} splats", header.n_splats);
            return Err(malformed_column(name, expected, unpacked.to_string()));
        }
        let there = usize::try_from(packed).ok().and_then(|n| rest.split_at_checked(n));
        let Some((stream, behind)) = there else {
            let found = format!("{} bytes", rest.len());
            let expected = format!("{packed} compressed bytes");
            return Err(malformed_column(name, expected, found));
        };
        rest = behind;
        check_zstandard(stream, needed, name)?;
        *column = Column::new(name, Box::new(zstandard(stream, name)?));
    }
    Ok(Unpacked { header, columns, records })
}

/// Returns the extension records, the table of stream lengths, two for each stream, and the bytes of the
/// streams.
fn split_table<'a>(bytes: &'a [u8], header: &SpzHeader) -> Result<[&'a [u8]; 3], Fault> {
    // Degree 0 has no stream of harmonics.
    let n = if header.degree == 0 { 5 } else { 6 };
    if usize::from(header.n_streams) != n {
        let expected = format!("{n} streams for harmonics of degree {}", header.degree);
        return Err(Fault::malformed(HEADER, expected, header.n_streams.to_string()));
    }
    // Offset of the table: extension records of any length precede it.
    let start = match bytes.get(16..20) {
        Some(&[a, b, c, d]) => u32::from_le_bytes([a, b, c, d]) as usize,
        _ => return Err(Fault::malformed(HEADER, "32 bytes", format!("{}", bytes.len()))),
    };
    let records = bytes.get(NGSP_BYTES..start);
    let split = bytes.get(start..).and_then(|behind| behind.split_at_checked(n * ENTRY_BYTES));
    let parts = records.zip(split).map(|(records, (table, streams))| [records, table, streams]);
    parts.ok_or_else(|| {
        let expected = format!("a table of {} bytes after byte {NGSP_BYTES}", n * ENTRY_BYTES);
        Fault::malformed(HEADER, expected, format!("byte {start} of {}", bytes.len()))
    })
}

type Zstandard<'a> = zstd::Decoder<'static, &'a [u8]>;

fn zstandard<'a>(stream: &'a [u8], name: &str) -> Result<Zstandard<'a>, Fault> {
    let fault = |e: std::io::Error| {
        let expected =
            format!("a Zstandard stream with a window of at most 2^{MAX_WINDOW_LOG} bytes");
        malformed_column(name, expected, decoder_message(&e))
    };
    let mut decoder = zstd::Decoder::with_buffer(stream).map_err(fault)?.single_frame();
    decoder.window_log_max(MAX_WINDOW_LOG).map_err(fault)?;
    Ok(decoder)
}

/// Checks that a stream unpacks to `needed` bytes.
fn check_zstandard(stream: &[u8], needed: usize, name: &str) -> Result<(), Fault> {
    let mut decoder = zstandard(stream, name)?;
    skip(&mut decoder, needed, name)?;
    // One byte more reveals a longer stream.
    match decoder.read(&mut [0]) {
        Ok(0) => Ok(()),
        Ok(_) => Err(malformed_column(name, format!("{needed} bytes"), "more")),
        Err(e) => Err(malformed_column(name, "a Zstandard stream", decoder_message(&e))),
    }
}

/// Unpacks exactly `needed` bytes, which are not stored.
fn skip(source: &mut impl Read, needed: usize, name: &str) -> Result<(), Fault> {
    let mut block = [0; 1 << 13];
    let mut n = 0;
    let found = loop {
        let most = block.len().min(needed - n);
        match source.read(block.get_mut(..most).unwrap_or_default()) {
            _ if most == 0 => return Ok(()),
            Ok(0) => break format!("{n}"),
            Ok(read) => n += read,
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => break format!("{n} and then {}", decoder_message(&e)),
        }
    };
    Err(malformed_column(name, format!("{needed} bytes"), found))
}

fn decoder_message(error: &std::io::Error) -> String {
    crate::export::error::shorten(&error.to_string())
}

/// Checks the number of splats in a file of `size` bytes.
fn check_count(header: &SpzHeader, size: usize, max_splats: usize) -> Result<(), Fault> {
    let n = header.n_splats as usize;
    if n > max_splats {
        return Err(Fault::TooMany { declared: n as u64, cap: max_splats });
    }
    let unpacked = n.saturating_mul(header.widths().iter().sum());
    if unpacked > ANY_FACTOR_BYTES && unpacked / MAX_FACTOR > size {
        let expected = format!("splats that unpack to at most {MAX_FACTOR} times the file's size");
        return Err(Fault::malformed("SPZ", expected, format!("{n} splats in {size} bytes")));
    }
    Ok(())
}

/// First bytes of a file, or of its gzip content.
pub(super) const MAGIC: &[u8] = b"NGSP";
const MAX_DEGREE: u8 = 4;
// A coordinate has 24 bits.
const MAX_FRACTION_BITS: u8 = 24;
pub(super) const IS_ANTIALIASED: u8 = 1;
const HAS_EXTENSIONS: u8 = 2;

#[derive(Clone, Copy, Debug)]
pub(super) struct SpzHeader {
    pub version: u32,
    pub n_splats: u32,
    pub degree: u8,
    pub fraction_bits: u8,
    pub flags: u8,
    /// Number of compressed streams; 0 before version 4.
    pub n_streams: u8,
}

pub(super) const HEADER_BYTES: usize = 16;

impl SpzHeader {
    pub fn parse(bytes: &[u8; HEADER_BYTES]) -> Result<Self, Fault> {
        let &[magic @ .., v0, v1, v2, v3, n0, n1, n2, n3, degree, fraction_bits, flags, n_streams] =
            bytes;
        let version = u32::from_le_bytes([v0, v1, v2, v3]);
        let n_splats = u32::from_le_bytes([n0, n1, n2, n3]);
        let header = Self { version, n_splats, degree, fraction_bits, flags, n_streams };
        let fault =
            |expected: String, found: String| Err(Fault::malformed(HEADER, expected, found));
        if magic != MAGIC {
            return fault("\"NGSP\" at its start".into(), format!("{magic:02x?}"));
        }
        if !(1..=4).contains(&version) {
            return Err(Fault::Unsupported {
                feature: format!("{HEADER}: expected version 1 to 4, found {version}"),
                advice: "save the file as SPZ version 4 or as PLY",
            });
        }
        if degree > MAX_DEGREE {
            return fault(format!("harmonics of degree 0 to {MAX_DEGREE}"), degree.to_string());
        }
        if fraction_bits > MAX_FRACTION_BITS {
            let expected = format!("at most {MAX_FRACTION_BITS} fraction bits");
            return fault(expected, fraction_bits.to_string());
        }
        Ok(header)
    }

    pub fn is_antialiased(&self) -> bool {
        self.flags & IS_ANTIALIASED != 0
    }

    /// Returns the flags without a known meaning.
    pub fn unknown_flags(&self) -> u8 {
        self.flags & !(IS_ANTIALIASED | HAS_EXTENSIONS)
    }

    pub fn has_extensions(&self) -> bool {
        self.flags & HAS_EXTENSIONS != 0
    }

    /// Returns the number of bytes per splat in each column, in file order: position, opacity, colour,
    /// scale, rotation and harmonics above degree 0.
    pub fn widths(&self) -> [usize; 6] {
        let position = if self.version == 1 { 6 } else { 9 };
        let rotation = if self.version < 3 { 3 } else { 4 };
        [position, 1, 3, 3, rotation, 3 * self.n_coefficients()]
    }

    /// Returns the number of harmonic coefficients per channel above degree 0.
    pub fn n_coefficients(&self) -> usize {
        let degree = usize::from(self.degree);
        (degree + 1) * (degree + 1) - 1
    }
}

pub(super) const HEADER: &str = "SPZ header";
pub(super) const COLUMN_NAMES: [&str; 6] =
    ["positions", "opacities", "colours", "scales", "rotations", "harmonics"];
