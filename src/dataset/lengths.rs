//! Depth files other than PNG: floats and codes as EXR, TIFF, NPY, NPZ or without a header.
//!
//! Every reader compares the size stated in a file with its number of bytes before it allocates memory.

use super::archive::{open_zip, read_member};
use super::depth::DepthCodes;
use super::error::FrameProblem;
use crate::math::image::Image;
use exr::block::lines::LineRef;
use exr::block::reader::ChunksReader;
use exr::error::UnitResult;
use exr::io::Data;
use exr::math::Vec2;
use exr::meta::attribute::SampleType;
use exr::prelude::f16;
use std::borrow::Cow;
use std::io::{Cursor, Read};
use tiff::decoder::{Decoder, DecodingResult, Limits};

/// Columns and rows that a depth image must have; `None` accepts any size.
type Size = Option<(u32, u32)>;

/// Function that decodes the bytes of a depth file to codes or lengths, with the number of world units per
/// stored unit. It compares the size before it decodes pixels.
type Reader = fn(&[u8], f64, Size) -> Result<DepthCodes, FrameProblem>;

const KINDS: [(&[u8], Reader); 7] = [
    (b"\x93NUM", read_npy),
    (b"PK\x03\x04", read_npz),
    (b"\x76\x2f\x31\x01", read_exr),
    (b"II*\0", read_tiff),
    (b"MM\0*", read_tiff),
    // Files with 64-bit offsets.
    (b"II+\0", read_tiff),
    (b"MM\0+", read_tiff),
];

fn reader(bytes: &[u8]) -> Option<Reader> {
    KINDS.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|(_, reader)| *reader)
}

pub(super) fn is_known(bytes: &[u8]) -> bool {
    reader(bytes).is_some()
}

/// Returns the columns and rows that a depth file states, without decoding pixels.
pub(super) fn size(bytes: &[u8]) -> Result<(u32, u32), FrameProblem> {
    // No image has this size: readers compare it before they decode.
    match decode(bytes, 1.0, Some((0, 0))) {
        Err(FrameProblem::Size { found, .. }) => Ok(found),
        other => Err(other.err().unwrap_or(FrameProblem::NoDepthValues)),
    }
}

/// Decodes a depth file (EXR, TIFF, NPY or NPZ) to codes or lengths, with `unit` world units per stored unit.
pub(super) fn decode(bytes: &[u8], unit: f64, size: Size) -> Result<DepthCodes, FrameProblem> {
    match reader(bytes) {
        Some(read) => read(bytes, unit, size),
        None => Err(FrameProblem::DepthFile {
            expected: "depth as EXR, TIFF, NPY or NPZ",
            found: "another kind of file".to_owned(),
        }),
    }
}

fn lengths(
    [width, height]: [usize; 2],
    values: impl Iterator<Item = f32>,
    unit: f64,
) -> DepthCodes {
    let mut values: Vec<f32> = values.collect();
    drop_background(&mut values, unit);
    // Scaled in f64, so that the product is rounded once.
    values.iter_mut().for_each(|value| *value = (f64::from(*value) * unit) as f32);
    DepthCodes::Lengths(Image::from_vec(width, height, values))
}

/// Length that no depth reaches in any unit of the world.
const BEYOND: f64 = 1e6;
/// Largest half-precision number; files of such numbers store it for anything larger.
const LARGEST_HALF: f32 = 65504.0;
/// Ratio of a background's value to the largest other value, above which it is no surface.
const FAR_BEYOND: f32 = 4.0;

/// Replaces values without a surface by 0. Renderers write the background as a large number, the same
/// in every pixel. `unit` is the number of world units per value.
fn drop_background(values: &mut [f32], unit: f64) {
    let is_length =
        |v: &f32| *v < LARGEST_HALF || *v > LARGEST_HALF && f64::from(*v) * unit < BEYOND;
    // The comparisons are false for NaN, so NaN becomes a hole as well.
    values.iter_mut().filter(|v| !is_length(v)).for_each(|v| *v = 0.0);
    let most = values.iter().fold(0.0, |most: f32, v| v.max(most));
    let others = values.iter().filter(|v| **v < most).fold(0.0, |most: f32, v| v.max(most));
    // An image of one value shows a wall rather than a background.
    if others > 0.0 && most > FAR_BEYOND * others {
        values.iter_mut().filter(|v| **v == most).for_each(|v| *v = 0.0);
    }
}

pub(super) fn bare_floats(bytes: &[u8], size: (u32, u32)) -> Result<DepthCodes, FrameProblem> {
    let bytes = unpacked(bytes, size, size_of::<f32>())?;
    let values = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b));
    Ok(lengths([size.0 as usize, size.1 as usize], values, 1.0))
}

pub(super) fn bare_bytes(bytes: &[u8], size: (u32, u32)) -> Result<Image<u8>, FrameProblem> {
    let bytes = unpacked(bytes, size, 1)?.into_owned();
    Ok(Image::from_vec(size.0 as usize, size.1 as usize, bytes))
}

/// Returns the values of a file without header, decompressed if necessary; checks that their number
/// matches the image.
fn unpacked(
    bytes: &[u8],
    (width, height): (u32, u32),
    per_pixel: usize,
) -> Result<Cow<'_, [u8]>, FrameProblem> {
    // At most 33 million times a few bytes, which cannot overflow.
    let expected = n_pixels([width as usize, height as usize]).map(|n| n * per_pixel);
    let wrong = |found: String| FrameProblem::DepthFile {
        expected: "values without a header, of the size stated in the metadata, plain or LZFSE-compressed",
        found,
    };
    let short = |n: usize| wrong(format!("{n} bytes for {width}x{height} pixels of {per_pixel}"));
    let Some(expected) = expected else { return Err(short(bytes.len())) };
    if bytes.len() == expected {
        return Ok(Cow::Borrowed(bytes));
    }
    // Start of LZFSE blocks; for any other file, the size is wrong.
    if !bytes.starts_with(b"bvx") {
        return Err(short(bytes.len()));
    }
    let mut decoder = lzfse_rust::LzfseRingDecoder::default();
    let mut out = Vec::new();
    let mut stream = decoder.reader_bytes(bytes);
    // One byte more detects a file with too much data, without unpacking all of it.
    let read = stream.by_ref().take(expected as u64 + 1).read_to_end(&mut out);
    read.map_err(|e| wrong(e.to_string()))?;
    if out.len() == expected { Ok(Cow::Owned(out)) } else { Err(short(out.len())) }
}

/// Returns the number of bytes that a file without header has when decompressed; `None` if it is damaged
/// or larger than an image.
pub(super) fn unpacked_bytes(bytes: &[u8]) -> Option<u64> {
    if !bytes.starts_with(b"bvx") {
        return Some(bytes.len() as u64);
    }
    let mut decoder = lzfse_rust::LzfseRingDecoder::default();
    let most = (MAX_PIXELS * size_of::<f32>()) as u64;
    // Counted only, so that nothing is allocated.
    let mut stream = decoder.reader_bytes(bytes).take(most + 1);
    std::io::copy(&mut stream, &mut std::io::sink()).ok().filter(|n| *n <= most)
}

/// Returns the size of an image of floats in so many bytes, with the aspect ratio of the photograph.
pub(super) fn size_of_floats(bytes: u64, (width, height): (u32, u32)) -> Option<(u32, u32)> {
    let n = bytes / size_of::<f32>() as u64;
    // From `w · h = n`, with `w / h` of the photograph.
    let columns = (n as f64 * f64::from(width) / f64::from(height)).sqrt().round();
    let rows = (n as f64 / columns.max(1.0)).round();
    let is_exact = (columns * rows) as u64 == n && n > 0 && columns <= f64::from(u32::MAX);
    is_exact.then_some((columns as u32, rows as u32))
}

/// Decodes the array of depth in an NPZ archive: the only one, or the one whose name contains "depth".
fn read_npz(bytes: &[u8], unit: f64, size: Size) -> Result<DepthCodes, FrameProblem> {
    let mut zip = open_zip(Cursor::new(bytes))?;
    let names: Vec<String> = zip.file_names().filter_map(Result::ok).map(Cow::into_owned).collect();
    let name = match &names[..] {
        [name] => name,
        _ => names.iter().find(|name| name.contains("depth")).ok_or_else(|| {
            FrameProblem::DepthFile {
                expected: "an NPZ of one array, or with an array named depth",
                found: shorten(&names.join(", ")),
            }
        })?,
    };
    read_npy(&read_member(&mut zip, name, MAX_ARRAY_BYTES)?, unit, size)
}

/// Decodes an NPY array of depth. The array has two axes, or three of which the first or last has length
/// one.
fn read_npy(bytes: &[u8], unit: f64, size: Size) -> Result<DepthCodes, FrameProblem> {
    let wrong = |found: String| FrameProblem::DepthFile {
        expected: "a little-endian NPY array of rows and columns (f2, f4, f8, u2, u4, u8, i2, i4, i8)",
        found,
    };
    let (header, data) = split(bytes).ok_or_else(|| wrong("a damaged header".to_owned()))?;
    let kind = text_of(header, "descr").ok_or_else(|| wrong(shorten(header)))?;
    let shape = shape(header).ok_or_else(|| wrong(shorten(header)))?;
    let [height, width] = shape;
    let n = width.checked_mul(height).ok_or_else(|| wrong(shorten(header)))?;
    let width_of = kind.get(2..).and_then(|digits| digits.parse::<usize>().ok()).unwrap_or(0);
    // Exact: a file longer or shorter than its header states is damaged.
    if n.checked_mul(width_of) != Some(data.len()) || n == 0 {
        return Err(wrong(format!("{} bytes of data for {}", data.len(), shorten(header))));
    }
    check_same([width, height], size)?;
    let is_by_columns = header.contains("'fortran_order': True");
    let values = match kind {
        "<u2" => {
            let codes = numbers(data, u16::from_le_bytes);
            let codes = Image::from_vec(width, height, by_rows(codes, shape, is_by_columns));
            return Ok(DepthCodes::Linear16 { codes, unit });
        }
        "<f2" => numbers(data, |b| f16::from_le_bytes(b).to_f32()),
        "<f4" => numbers(data, f32::from_le_bytes),
        "<f8" => numbers(data, |b| f64::from_le_bytes(b) as f32),
        "<u4" => numbers(data, |b| u32::from_le_bytes(b) as f32),
        "<u8" => numbers(data, |b| u64::from_le_bytes(b) as f32),
        "<i2" => numbers(data, |b| f32::from(i16::from_le_bytes(b))),
        "<i4" => numbers(data, |b| i32::from_le_bytes(b) as f32),
        "<i8" => numbers(data, |b| i64::from_le_bytes(b) as f32),
        _ => return Err(wrong(format!("values of type {kind}"))),
    };
    Ok(lengths([width, height], by_rows(values, shape, is_by_columns).into_iter(), unit))
}

fn numbers<const N: usize, T>(data: &[u8], number: impl Fn([u8; N]) -> T) -> Vec<T> {
    data.as_chunks().0.iter().map(|bytes| number(*bytes)).collect()
}

/// Returns the values of an array row by row.
fn by_rows<T: Copy>(values: Vec<T>, [height, width]: [usize; 2], is_by_columns: bool) -> Vec<T> {
    if !is_by_columns {
        return values;
    }
    let column = |i: usize| values.iter().skip(i).step_by(height).take(width).copied();
    (0..height).flat_map(column).collect()
}

fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    // Signature, two bytes of version, then the header's length in two bytes or, from version 2, in four.
    let rest = bytes.get(8..)?;
    let (length, rest) = match bytes.get(6)? {
        1 => (usize::from(u16::from_le_bytes([*rest.first()?, *rest.get(1)?])), rest.get(2..)?),
        _ => (u32::from_le_bytes(*rest.first_chunk()?) as usize, rest.get(4..)?),
    };
    let (header, data) = rest.split_at_checked(length).filter(|_| length <= MAX_NPY_HEADER)?;
    Some((std::str::from_utf8(header).ok()?, data))
}

fn text_of<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    header.split_once(&format!("'{key}':"))?.1.split('\'').nth(1)
}

/// Returns the rows and columns that an NPY header states.
fn shape(header: &str) -> Option<[usize; 2]> {
    let list = header.split_once("'shape':")?.1.split_once('(')?.1.split_once(')')?.0;
    let axes: Option<Vec<usize>> =
        list.split(',').map(str::trim).filter(|t| !t.is_empty()).map(|t| t.parse().ok()).collect();
    // A channel axis of length one comes last or first, depending on the exporter.
    match axes?[..] {
        [rows, columns] | [rows, columns, 1] | [1, rows, columns] => Some([rows, columns]),
        _ => None,
    }
}

fn shorten(header: &str) -> String {
    // A message must not reproduce a damaged file.
    header.trim().chars().take(80).collect()
}

/// Names of depth channels in EXR files, in order of preference, after the names of layer and pass.
const EXR_CHANNELS: [&str; 5] = ["Z", "Y", "R", "V", "depth"];

/// Returns the rank of an EXR channel as depth, lowest first; `None` if its name is of no depth. `layer`
/// is the name of a part of the file, and `others` are the names in this part.
fn exr_rank(layer: &str, name: &str, others: &[String]) -> Option<usize> {
    let is = |part: &str, other: &str| part.eq_ignore_ascii_case(other);
    let (pass, last) = name.rsplit_once('.').unwrap_or(("", name));
    let rank = EXR_CHANNELS.iter().position(|known| is(last, known))?;
    if layer.split('.').chain(name.split('.')).any(|part| is(part, "depth")) {
        return Some(rank);
    }
    // The Z of a normal or position is no depth, and mist is relative.
    let is_x = |other: &String| other.rsplit_once('.').unwrap_or(("", other)) == (pass, "X");
    let is_vector = others.iter().any(is_x);
    let is_mist = pass.rsplit('.').next().is_some_and(|pass| is(pass, "mist"));
    (!is_vector && !is_mist).then_some(EXR_CHANNELS.len() + rank)
}

fn read_exr(bytes: &[u8], unit: f64, size: Size) -> Result<DepthCodes, FrameProblem> {
    let wrong = |found: String| FrameProblem::DepthFile { expected: "a whole EXR image", found };
    let damaged = |e: exr::error::Error| wrong(e.to_string());
    let reader = exr::block::read(Cursor::new(bytes), false).map_err(damaged)?;
    let channels = reader.headers().iter().enumerate().flat_map(|(layer, header)| {
        let part = header.own_attributes.layer_name.as_ref().map(ToString::to_string);
        let part = part.unwrap_or_default();
        let channels = &header.channels.list;
        let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
        let rank = |name| exr_rank(&part, name, &names).unwrap_or(usize::MAX);
        let ranks: Vec<usize> = names.iter().map(|name| rank(name)).collect();
        let channels = ranks.into_iter().zip(channels).enumerate();
        channels.map(move |(channel, (rank, kind))| (rank, (layer, header), (channel, kind)))
    });
    // Without any known name, the first channel: `min_by_key` returns the first of equals.
    let best = channels.min_by_key(|(rank, ..)| *rank);
    let (_, (layer, header), (channel, kind)) =
        best.ok_or_else(|| wrong("no channel".to_owned()))?;
    let (header, kind) = (header.clone(), kind.clone());
    let mut unpacked = 0u64;
    for header in reader.headers() {
        let size = [header.layer_size.width(), header.layer_size.height()];
        check_size(bytes, size, header.channels.bytes_per_pixel)?;
        // The crate lists the blocks of all parts.
        unpacked += (size[0] * size[1] * header.channels.bytes_per_pixel) as u64;
        check_unpacked(bytes, size, unpacked)?;
    }
    let (width, height) = (header.layer_size.width(), header.layer_size.height());
    check_same([width, height], size)?;
    if header.deep || kind.sampling != Vec2(1, 1) || header.max_block_byte_size() > MAX_BLOCK_BYTES
    {
        return Err(wrong("deep, subsampled or far too many channels".to_owned()));
    }
    let mut blocks = reader
        .filter_chunks(false, |_, tile, block| {
            block.layer == layer && tile.is_largest_resolution_level()
        })
        .map_err(damaged)?
        .sequential_decompressor(false);
    let mut values = vec![0.0; width * height];
    // Block by block: a file may hold hundreds of channels.
    while let Some(block) = blocks.decompress_next_block() {
        let block = block.map_err(damaged)?;
        for line in block.lines(&header.channels).filter(|l| l.location.channel == channel) {
            let Vec2(x, y) = line.location.position;
            let n = line.location.sample_count;
            let row = values.get_mut(y * width + x..).and_then(|rest| rest.get_mut(..n));
            let row = row.ok_or_else(|| wrong("a block outside the image".to_owned()))?;
            read_line(&line, kind.sample_type, row).map_err(damaged)?;
        }
    }
    Ok(lengths([width, height], values.into_iter(), unit))
}

/// Reads the samples of a line, of the given kind, into a row of the image.
fn read_line(line: &LineRef, kind: SampleType, row: &mut [f32]) -> UnitResult {
    match kind {
        SampleType::F16 => read_samples(line, row, f16::to_f32),
        SampleType::F32 => read_samples(line, row, |sample: f32| sample),
        SampleType::U32 => read_samples(line, row, |sample: u32| sample as f32),
    }
}

fn read_samples<T: Data>(line: &LineRef, row: &mut [f32], to_f32: fn(T) -> f32) -> UnitResult {
    for (out, sample) in row.iter_mut().zip(line.read_samples()) {
        *out = to_f32(sample?);
    }
    Ok(())
}

fn read_tiff(bytes: &[u8], unit: f64, expected: Size) -> Result<DepthCodes, FrameProblem> {
    let wrong = |found: String| FrameProblem::DepthFile {
        expected: "a TIFF with one sample of 16 bits or more per pixel",
        found,
    };
    let damaged = |e: tiff::TiffError| wrong(e.to_string());
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_ARRAY_BYTES as usize;
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(damaged)?.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(damaged)?;
    let [width, height] = [width as usize, height as usize];
    // Accepted samples have at least two bytes.
    check_size(bytes, [width, height], 2)?;
    let size = [width, height];
    check_same(size, expected)?;
    let values: Vec<f32> = match decoder.read_image().map_err(damaged)? {
        DecodingResult::U16(codes) if codes.len() == width * height => {
            return Ok(DepthCodes::Linear16 { codes: Image::from_vec(width, height, codes), unit });
        }
        DecodingResult::F16(values) => values.into_iter().map(f16::to_f32).collect(),
        DecodingResult::F32(values) => values,
        DecodingResult::F64(values) => values.into_iter().map(|v| v as f32).collect(),
        DecodingResult::U32(values) => values.into_iter().map(|v| v as f32).collect(),
        DecodingResult::I16(values) => values.into_iter().map(f32::from).collect(),
        DecodingResult::I32(values) => values.into_iter().map(|v| v as f32).collect(),
        _ => return Err(wrong("other samples".to_owned())),
    };
    match values.len() == width * height {
        true => Ok(lengths(size, values.into_iter(), unit)),
        // A colour image is not depth.
        false => Err(wrong("several samples per pixel".to_owned())),
    }
}

/// Largest number of pixels of a depth image, 33 million.
const MAX_PIXELS: usize = 1 << 25;
/// Size limit for an unpacked array of an NPZ and for the samples of a TIFF, bytes.
const MAX_ARRAY_BYTES: u64 = 128 << 20;
/// Size limit for the header of an NPY, bytes; NumPy writes some hundred.
const MAX_NPY_HEADER: usize = 1 << 16;
/// Size limit for the pixels that an EXR compresses together, bytes.
const MAX_BLOCK_BYTES: usize = 32 << 20;
/// Upper limit for the compression factor of EXR, TIFF, PNG and zip files. Deflate compresses by a
/// factor of at most 1032.
pub(super) const MAX_FACTOR: u64 = 1040;

/// Returns the number of pixels of an image; `None` without pixels or with more than [`MAX_PIXELS`].
fn n_pixels([width, height]: [usize; 2]) -> Option<usize> {
    width.checked_mul(height).filter(|n| (1..=MAX_PIXELS).contains(n))
}

/// Checks, before allocation, that a file can contain an image of this size with `per_pixel` bytes per
/// pixel.
pub(super) fn check_size(
    bytes: &[u8],
    [width, height]: [usize; 2],
    per_pixel: usize,
) -> Result<(), FrameProblem> {
    let unpacked =
        n_pixels([width, height]).map_or(u64::MAX, |n| (n as u64).saturating_mul(per_pixel as u64));
    check_unpacked(bytes, [width, height], unpacked)
}

fn check_same(found: [usize; 2], expected: Size) -> Result<(), FrameProblem> {
    let found = found.map(|n| u32::try_from(n).unwrap_or(u32::MAX)).into();
    match expected {
        Some(expected) if expected != found => {
            Err(FrameProblem::Size { what: "depth", expected, found })
        }
        _ => Ok(()),
    }
}

/// Checks, before allocation, that the bytes of a compressed file can contain an image of `unpacked`
/// bytes.
pub(super) fn check_unpacked(
    bytes: &[u8],
    [width, height]: [usize; 2],
    unpacked: u64,
) -> Result<(), FrameProblem> {
    match unpacked <= (bytes.len() as u64).saturating_mul(MAX_FACTOR) {
        true => Ok(()),
        false => Err(FrameProblem::DepthFile {
            expected: "a size that the file's bytes can hold",
            found: format!("{width}x{height} pixels in {} bytes", bytes.len()),
        }),
    }
}
