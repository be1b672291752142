//! ROS 2 messages in MCAP files (<https://mcap.dev/spec>): found in one pass, read one by one, images as files.
//!
//! A file is a signature and records: opcode, length, content. Chunks contain records, perhaps compressed.
//! The pass reads the beginnings of messages and seeks over the rest, so memory stays flat and files
//! without an index are read too. Compressed chunks are unpacked as streams.

use super::decode::codes16;
use super::error::FrameProblem;
use super::folder::{MAX_IMAGE_BYTES, RetryingFile, starts_with};
use super::lengths::{MAX_FACTOR, check_size};
use crate::math::image::Image;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use lz4_flex::frame::FrameDecoder;
use std::collections::HashMap;
use std::io::{BufReader, Error, ErrorKind, Read, Result as IoResult, Seek, SeekFrom, copy, sink};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
/// Opcodes of records.
const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const DATA_END: u8 = 15;
/// Bytes of opcode and length before a record, and of the fields before a message's content.
const RECORD_HEAD: u64 = 9;
const MESSAGE_HEAD: u64 = 22;
/// Most bytes of a record that are read at once; names and transforms are shorter.
const MAX_HEAD: u64 = 1 << 20;
/// Most bytes of a chunk before its records.
const MAX_CHUNK_HEAD: u64 = 256;

/// Topic of a file, and the kind of its messages.
#[derive(Debug)]
pub(super) struct Channel {
    pub topic: String,
    pub schema: String,
    pub encoding: String,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Packing {
    Zstd,
    Lz4,
}

/// Place of a message's content: in the file, or in the unpacked chunk at that place of the file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    at: u64,
    length: u64,
    chunk: Option<Chunk>,
}

#[derive(Clone, Copy, Debug)]
struct Chunk {
    at: u64,
    length: u64,
    packing: Packing,
}

/// Function that returns the bytes of the image file that a message holds.
pub(super) type AsFile = fn(&[u8]) -> Result<Vec<u8>, FrameProblem>;

/// Image in a message.
#[derive(Debug)]
pub(super) struct Message {
    pub bag: Arc<PathBuf>,
    pub place: Place,
    pub as_file: AsFile,
    /// Path in messages for the user.
    pub shown: PathBuf,
}

impl Message {
    pub fn read(&self) -> Result<Vec<u8>, FrameProblem> {
        (self.as_file)(&self.place.read(&self.bag)?)
    }
}

impl Place {
    fn read(&self, bag: &Path) -> Result<Vec<u8>, FrameProblem> {
        if self.length > MAX_IMAGE_BYTES {
            let found = format!("{} bytes", self.length);
            return Err(FrameProblem::Entry { expected: "an image of at most 256 MiB", found });
        }
        let mut file = BufReader::new(RetryingFile::open(bag)?);
        file.seek(SeekFrom::Start(self.chunk.map_or(self.at, |chunk| chunk.at)))?;
        let mut bytes = Vec::new();
        match self.chunk {
            None => file.take(self.length).read_to_end(&mut bytes)?,
            Some(chunk) => {
                let mut unpacked = chunk.unpack(file)?;
                skip(&mut unpacked, self.at)?;
                unpacked.take(self.length).read_to_end(&mut bytes)?
            }
        };
        match bytes.len() as u64 == self.length {
            true => Ok(bytes),
            false => Err(FrameProblem::Read(ErrorKind::UnexpectedEof.into())),
        }
    }
}

impl Chunk {
    fn unpack<'a>(&self, file: impl Read + 'a) -> IoResult<Box<dyn Read + 'a>> {
        let packed = file.take(self.length);
        Ok(match self.packing {
            Packing::Zstd => Box::new(zstd::stream::read::Decoder::new(packed)?),
            Packing::Lz4 => Box::new(FrameDecoder::new(packed)),
        })
    }
}

/// True if the file starts with the signature of MCAP.
///
/// # Errors
/// Disk errors, so that an unreadable file is not mistaken for another kind of file.
pub(super) fn is_bag(path: &Path) -> IoResult<bool> {
    starts_with(path, MAGIC)
}

/// Message found by [`scan`]: channel, place, time of recording in nanoseconds and first bytes.
pub(super) struct Found<'a> {
    pub channel: &'a Rc<Channel>,
    pub place: Place,
    pub logged: u64,
    pub head: &'a [u8],
}

/// Finds all messages of a file. `wanted` is the number of first bytes that `visit` gets of a channel's
/// messages.
///
/// # Errors
/// Disk errors, and records that are cut off or not of the format. Messages before were visited.
pub(super) fn scan(
    path: &Path,
    wanted: fn(&Channel) -> u64,
    visit: &mut dyn FnMut(Found),
) -> IoResult<()> {
    let mut file = BufReader::new(RetryingFile::open(path)?);
    let end = file.seek(SeekFrom::End(0))?;
    let mut at = file.seek(SeekFrom::Start(MAGIC.len() as u64))?;
    let (schemas, channels) = (HashMap::new(), HashMap::new());
    let mut scan = Scan { schemas, channels, wanted, visit, buffer: Vec::new() };
    let (mut all_packed, mut all_unpacked) = (0u64, 0u64);
    while at < end {
        let (opcode, length) = record_head(&mut file)?;
        at += RECORD_HEAD;
        let next = at.checked_add(length).filter(|next| *next <= end).ok_or_else(cut_off)?;
        let read = match opcode {
            // Indexes and copies follow.
            DATA_END => break,
            CHUNK => {
                read_exactly(&mut file, length.min(MAX_CHUNK_HEAD), &mut scan.buffer)?;
                let (name, unpacked, n) = chunk_head(&scan.buffer).ok_or_else(cut_off)?;
                let packing = match name {
                    "" => None,
                    "zstd" => Some(Packing::Zstd),
                    "lz4" => Some(Packing::Lz4),
                    other => return Err(wrong(&format!("a chunk packed by `{other}`"))),
                };
                let length = length - n;
                at += n;
                file.seek_relative(n as i64 - scan.buffer.len() as i64)?;
                // Records of a chunk that is not compressed are like others.
                let Some(packing) = packing else { continue };
                // All chunks together: many small ones may take as long as a large one.
                all_packed += length;
                all_unpacked = all_unpacked.saturating_add(unpacked);
                // Images of one value are packed well.
                if all_unpacked > MAX_IMAGE_BYTES && all_unpacked / MAX_FACTOR > all_packed {
                    return Err(wrong("a chunk that unpacks implausibly"));
                }
                let chunk = Chunk { at, length, packing };
                scan.packed(chunk, &mut chunk.unpack(&mut file)?, unpacked)?;
                file.seek(SeekFrom::Start(next))?;
                next - at
            }
            _ => scan.record(&mut file, (opcode, length), at, None)?,
        };
        file.seek_relative((next - at - read) as i64)?;
        at = next;
    }
    Ok(())
}

/// Returns the compression of a chunk, the size of its records, and the number of bytes before them.
fn chunk_head(content: &[u8]) -> Option<(&str, u64, u64)> {
    let mut fields = Fields(content);
    let unpacked = fields.u64_at(16)?;
    fields.take(28)?;
    let packing = fields.text()?;
    fields.take(8)?;
    Some((packing, unpacked, (content.len() - fields.0.len()) as u64))
}

struct Scan<'a> {
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Rc<Channel>>,
    wanted: fn(&Channel) -> u64,
    visit: &'a mut dyn FnMut(Found),
    buffer: Vec<u8>,
}

impl Scan<'_> {
    fn packed(&mut self, chunk: Chunk, records: &mut dyn Read, size: u64) -> IoResult<()> {
        let mut at = 0;
        while at < size {
            let (opcode, length) = record_head(records)?;
            at += RECORD_HEAD;
            let read = self.record(records, (opcode, length), at, Some(chunk))?;
            skip(records, length - read)?;
            at = at.checked_add(length).ok_or_else(cut_off)?;
        }
        Ok(())
    }

    /// Reads the first bytes of a record's content at `at`; returns their number.
    fn record(
        &mut self,
        records: &mut dyn Read,
        (opcode, length): (u8, u64),
        at: u64,
        chunk: Option<Chunk>,
    ) -> IoResult<u64> {
        let read = match opcode {
            SCHEMA | CHANNEL => length.min(MAX_HEAD),
            MESSAGE => length.min(MESSAGE_HEAD),
            _ => 0,
        };
        read_exactly(records, read, &mut self.buffer)?;
        let mut fields = Fields(&self.buffer);
        match opcode {
            SCHEMA => {
                let (id, name) = fields.u16().zip(fields.text()).ok_or_else(cut_off)?;
                self.schemas.insert(id, name.to_owned());
            }
            CHANNEL => {
                let ids = fields.u16().zip(fields.u16());
                let (ids, texts) = ids.zip(fields.text().zip(fields.text())).ok_or_else(cut_off)?;
                let schema = self.schemas.get(&ids.1).cloned().unwrap_or_default();
                let (topic, encoding) = (texts.0.to_owned(), texts.1.to_owned());
                self.channels.insert(ids.0, Rc::new(Channel { topic, schema, encoding }));
            }
            MESSAGE => {
                let logged = fields.u64_at(6).ok_or_else(cut_off)?;
                let channel = fields.u16().and_then(|id| self.channels.get(&id).cloned());
                let length = length.checked_sub(MESSAGE_HEAD).ok_or_else(cut_off)?;
                let Some(channel) = channel else { return Ok(read) };
                let wanted = (self.wanted)(&channel).min(length).min(MAX_HEAD);
                read_exactly(records, wanted, &mut self.buffer)?;
                let place = Place { at: at + read, length, chunk };
                (self.visit)(Found { channel: &channel, place, logged, head: &self.buffer });
                return Ok(read + wanted);
            }
            _ => {}
        }
        Ok(read)
    }
}

fn read_exactly(records: &mut dyn Read, n: u64, buffer: &mut Vec<u8>) -> IoResult<()> {
    buffer.clear();
    // Grows with the data: the length may be wrong.
    records.take(n).read_to_end(buffer)?;
    if buffer.len() as u64 == n { Ok(()) } else { Err(cut_off()) }
}

/// Fields of a record, in little-endian order.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(taken)
    }

    fn u16(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(*self.take(2)?.first_chunk()?))
    }

    fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(*self.take(4)?.first_chunk()?))
    }

    fn u64_at(&self, at: usize) -> Option<u64> {
        Some(u64::from_le_bytes(*self.0.get(at..)?.first_chunk()?))
    }

    fn text(&mut self) -> Option<&'a str> {
        let length = self.u32()?;
        std::str::from_utf8(self.take(length as usize)?).ok()
    }
}

fn record_head(records: &mut dyn Read) -> IoResult<(u8, u64)> {
    let mut head = [0; RECORD_HEAD as usize];
    records.read_exact(&mut head)?;
    let [opcode, length @ ..] = head;
    Ok((opcode, u64::from_le_bytes(length)))
}

fn skip(records: &mut dyn Read, n: u64) -> IoResult<()> {
    match copy(&mut records.take(n), &mut sink())? == n {
        true => Ok(()),
        false => Err(cut_off()),
    }
}

fn cut_off() -> Error {
    wrong("a record that is cut off")
}

fn wrong(found: &str) -> Error {
    Error::new(ErrorKind::InvalidData, found.to_owned())
}

/// Values in the Common Data Representation: aligned to their size from the start of the content.
pub(super) struct Cdr<'a> {
    content: &'a [u8],
    at: usize,
    is_big: bool,
}

impl<'a> Cdr<'a> {
    pub fn new(message: &'a [u8]) -> Option<Self> {
        // Only the plain encodings, big- and little-endian; ROS writes no other.
        match message {
            [0, order @ (0 | 1), _, _, content @ ..] => {
                Some(Self { content, at: 0, is_big: *order == 0 })
            }
            _ => None,
        }
    }

    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let end = self.at.checked_add(n)?;
        let taken = self.content.get(self.at..end)?;
        self.at = end;
        Some(taken)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.at = self.at.next_multiple_of(N);
        let mut bytes: [u8; N] = self.take(N)?.try_into().ok()?;
        if self.is_big {
            bytes.reverse();
        }
        Some(bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    pub fn reals<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut reals = [0.0; N];
        for real in &mut reals {
            *real = f64::from_le_bytes(self.number()?);
        }
        Some(reals)
    }

    pub fn bytes(&mut self) -> Option<&'a [u8]> {
        let n = self.u32()? as usize;
        self.take(n)
    }

    pub fn text(&mut self) -> Option<&'a str> {
        Some(std::str::from_utf8(self.bytes()?).ok()?.trim_end_matches('\0'))
    }

    /// Returns time in seconds and name of the frame of reference.
    pub fn header(&mut self) -> Option<(f64, String)> {
        let (seconds, nanoseconds) = (self.u32()?.cast_signed(), self.u32()?);
        let frame = self.text()?.trim_start_matches('/').to_owned();
        Some((f64::from(seconds) + 1e-9 * f64::from(nanoseconds), frame))
    }
}

fn damaged(found: &str) -> FrameProblem {
    FrameProblem::Entry { expected: "a whole image message", found: found.to_owned() }
}

pub(super) fn packed_image(message: &[u8]) -> Result<Vec<u8>, FrameProblem> {
    let parts = || {
        let mut cdr = Cdr::new(message)?;
        cdr.header()?;
        Some((cdr.text()?, cdr.bytes()?))
    };
    let (format, bytes) = parts().ok_or_else(|| damaged("its beginning"))?;
    match format.contains("compressedDepth") {
        true => packed_depth(format, bytes),
        false => Ok(bytes.to_vec()),
    }
}

/// Returns the file of an image of ROS's transport `compressedDepth`: settings, then a PNG or run lengths.
/// Settings are a number, `a` and `b`: of floats, a code `c` states `a / (c - b)` metres, and 0 a hole.
fn packed_depth(format: &str, bytes: &[u8]) -> Result<Vec<u8>, FrameProblem> {
    let mut fields = Fields(bytes);
    let mut settings = || Some([fields.u32()?, fields.u32()?, fields.u32()?]);
    let [_, a, b] = settings().ok_or_else(|| damaged("its settings"))?;
    let (is_inverse, [a, b]) = (format.starts_with("32FC1"), [a, b].map(f32::from_bits));
    let codes = match format.contains("rvl") {
        true => run_lengths(fields)?,
        false if is_inverse => codes16(fields.0)?,
        false => return Ok(fields.0.to_vec()),
    };
    let size = (codes.width as u32, codes.height as u32);
    if !is_inverse {
        return Ok(npy("<u2", size, codes.data.into_iter().flat_map(u16::to_le_bytes)));
    }
    if !(a.is_finite() && a > 0.0 && b.is_finite()) {
        let expected = "settings of inverse depth: a positive number and a finite one";
        return Err(FrameProblem::Entry { expected, found: format!("{a} and {b}") });
    }
    // Lengths that are not finite and positive are holes.
    let length = |code| if code == 0 { 0.0 } else { a / (f32::from(code) - b) };
    Ok(npy("<f4", size, codes.data.into_iter().flat_map(|code| length(code).to_le_bytes())))
}

/// Unpacks 16-bit depth of the compression RVL (A. Wilson, Fast Lossless Depth Image Compression, 2017),
/// after width and height. Groups of three bits, the lowest first, with a fourth for another to come, make
/// numbers; they fill words from the top. Runs are numbers of holes and of codes, and the codes' steps.
fn run_lengths(mut fields: Fields) -> Result<Image<u16>, FrameProblem> {
    let size = fields.u32().zip(fields.u32()).ok_or_else(|| damaged("no size"))?;
    let size = [size.0, size.1].map(|side| side as usize);
    check_size(fields.0, size, size_of::<u16>())?;
    let words = fields.0.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word));
    let mut groups = words.flat_map(|word| (0..8).rev().map(move |i| (word >> (4 * i)) & 15));
    let mut number = || {
        let mut number = 0;
        for shift in (0..u32::BITS).step_by(3) {
            let group = groups.next()?;
            number |= (group & 7) << shift;
            if group < 8 {
                return Some(number);
            }
        }
        None
    };
    let n = size[0] * size[1];
    let (mut codes, mut code) = (Vec::with_capacity(n), 0u16);
    let mut run = || {
        let end = codes.len().checked_add(number()? as usize)?;
        (end <= n).then(|| codes.resize(end, 0))?;
        for _ in 0..number()? {
            let step = number()?;
            // The lowest bit is the sign.
            code = code.wrapping_add(((step >> 1) ^ (step & 1).wrapping_neg()) as u16);
            (codes.len() < n).then(|| codes.push(code))?;
        }
        Some(codes.len() < n)
    };
    while run().ok_or_else(|| damaged("run lengths that do not fill it"))? {}
    Ok(Image::from_vec(size[0], size[1], codes))
}

/// Pixels of an uncompressed image.
struct Raw<'a> {
    size: (u32, u32),
    encoding: &'a str,
    is_big: bool,
    step: usize,
    data: &'a [u8],
}

impl<'a> Raw<'a> {
    fn read(message: &'a [u8]) -> Result<Self, FrameProblem> {
        let parts = || {
            let mut cdr = Cdr::new(message)?;
            cdr.header()?;
            let (height, width) = (cdr.u32()?, cdr.u32()?);
            let encoding = cdr.text()?;
            let [big] = cdr.number()?;
            let step = cdr.u32()? as usize;
            Some(Self {
                size: (width, height),
                encoding,
                is_big: big != 0,
                step,
                data: cdr.bytes()?,
            })
        };
        parts().ok_or_else(|| damaged("its beginning"))
    }

    /// Returns the pixels of `n` bytes, without padding at the ends of rows.
    fn pixels(&self, n: usize) -> Result<impl Iterator<Item = &'a [u8]>, FrameProblem> {
        let (width, height) = (self.size.0 as usize, self.size.1 as usize);
        let row = width.checked_mul(n).filter(|row| (1..=self.step).contains(row));
        let is_whole = self.step.checked_mul(height).is_some_and(|all| all <= self.data.len());
        let row = row.filter(|_| is_whole && height > 0).ok_or_else(|| {
            damaged(&format!("{} bytes for {width}x{height} pixels of {n}", self.data.len()))
        })?;
        let rows = self.data.chunks_exact(self.step).take(height);
        Ok(rows.flat_map(move |row_and_rest| row_and_rest.chunks_exact(n).take(row / n)))
    }
}

pub(super) fn n_channels(encoding: &str) -> Option<usize> {
    match encoding {
        "mono8" | "8UC1" => Some(1),
        "rgb8" | "bgr8" | "8UC3" => Some(3),
        "rgba8" | "bgra8" => Some(4),
        _ => None,
    }
}

/// Converts raw colours to a PNG.
pub(super) fn raw_color(message: &[u8]) -> Result<Vec<u8>, FrameProblem> {
    let raw = Raw::read(message)?;
    let n = n_channels(raw.encoding).ok_or_else(|| damaged(raw.encoding))?;
    // OpenCV's three channels are blue, green and red.
    let is_blue_first = raw.encoding.starts_with("bgr") || raw.encoding == "8UC3";
    let pixel = |pixel: &[u8]| match pixel {
        [b, g, r, ..] if is_blue_first => [*r, *g, *b],
        [r, g, b, ..] => [*r, *g, *b],
        other => [other.first().copied().unwrap_or_default(); 3],
    };
    let rgb: Vec<[u8; 3]> = raw.pixels(n)?.map(pixel).collect();
    let mut file = Vec::new();
    PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::NoFilter)
        .write_image(rgb.as_flattened(), raw.size.0, raw.size.1, ExtendedColorType::Rgb8)?;
    Ok(file)
}

/// Converts raw depth to a NumPy array.
pub(super) fn raw_depth(message: &[u8]) -> Result<Vec<u8>, FrameProblem> {
    let raw = Raw::read(message)?;
    let (kind, n) = if raw.encoding == "32FC1" { ("<f4", 4) } else { ("<u2", 2) };
    let mut bytes = Vec::new();
    for pixel in raw.pixels(n)? {
        match raw.is_big {
            true => bytes.extend(pixel.iter().rev()),
            false => bytes.extend(pixel),
        }
    }
    Ok(npy(kind, raw.size, bytes))
}

/// Returns the file of a NumPy array.
fn npy(kind: &str, (width, height): (u32, u32), bytes: impl IntoIterator<Item = u8>) -> Vec<u8> {
    let head =
        format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({height}, {width}), }}\n");
    let length = (head.len() as u16).to_le_bytes();
    let mut file = [&b"\x93NUMPY\x01\x00"[..], &length, head.as_bytes()].concat();
    file.extend(bytes);
    file
}
