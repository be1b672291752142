//! Decodes image files to colour and depth arrays.

use super::depth::{Depth, DepthCodes, DepthKind};
use super::entry::MaskSource;
use super::error::{FrameProblem, MAX_EXTRA_MIB, MAX_PICTURE_MIB};
use super::folder::{RetryingFile, open_file};
use super::lengths;
use super::options::ByteSource;
use super::surface::sensor::Sensor;
use crate::math::image::Image;
use bytemuck::AnyBitPattern;
use bytemuck::allocation::try_cast_vec;
use image::error::DecodingError;
use image::metadata::Orientation;
use image::{
    ColorType, DynamicImage, GrayImage, ImageDecoder, ImageError, ImageFormat, ImageReader,
    ImageResult, Limits, RgbImage, RgbaImage,
};
use jpeg_decoder::PixelFormat;
use std::cell::Cell;
use std::io::{BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DepthEncoding {
    pub codes: CodeKind,
    pub kind: DepthKind,
    pub trusted: [f64; 2],
    pub units_per_metre: f64,
    pub sensor: Sensor,
}

impl DepthEncoding {
    /// True if a stored depth value must be multiplied by a unit to give a length.
    pub fn has_unit(&self) -> bool {
        matches!(self.codes, CodeKind::Linear16(_) | CodeKind::ByContent(_))
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum CodeKind {
    /// 8-bit codes in the first channel of an image ([`DepthCodes::Inverse8`]).
    Inverse8,
    /// 16-bit codes in the first channel of an image; the value is the step in world units.
    Linear16(f64),
    /// 16-bit codes or floats, depending on the file's content (PNG, TIFF, EXR, NPY). The value is the
    /// number of world units per stored unit.
    ByContent(f64),
    /// 32-bit floats in world units, one per pixel of the camera. The file has no header and is
    /// uncompressed or LZFSE-compressed.
    BareFloats,
}

pub(super) struct ImageHeader {
    pub width: u32,
    pub height: u32,
    pub bits_per_channel: u16,
    /// Orientation of the picture by EXIF, which is not applied to the size.
    pub orientation: Orientation,
}

impl ImageHeader {
    /// Returns the size of the picture turned by its EXIF orientation.
    pub fn upright(&self) -> (u32, u32) {
        turned_size((self.width, self.height), self.orientation)
    }
}

fn turned_size((width, height): (u32, u32), orientation: Orientation) -> (u32, u32) {
    match orientation {
        Orientation::NoTransforms
        | Orientation::Rotate180
        | Orientation::FlipHorizontal
        | Orientation::FlipVertical => (width, height),
        _ => (height, width),
    }
}

pub(super) fn header(source: &ByteSource) -> Result<ImageHeader, FrameProblem> {
    match source {
        // Not read whole: opening a dataset reads thousands of headers.
        ByteSource::File(path) => header_of(BufReader::new(RetryingFile::open(path)?)),
        _ => header_of(Cursor::new(source.read()?)),
    }
}

fn header_of(bytes: impl BufRead + Seek) -> Result<ImageHeader, FrameProblem> {
    catch_decoder_panic(|| {
        // The content decides, not the name: a JPEG named `.png` is decoded as JPEG.
        let mut reader = ImageReader::new(bytes).with_guessed_format()?;
        reader.limits(chunk_limits());
        let mut decoder = reader.into_decoder()?;
        let (width, height) = decoder.dimensions();
        // A damaged orientation is none.
        let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
        let color = decoder.color_type();
        let bits_per_channel = color.bits_per_pixel() / u16::from(color.channel_count());
        Ok(ImageHeader { width, height, bits_per_channel, orientation })
    })
}

pub(super) fn depth_size(source: &ByteSource) -> Result<(u32, u32), FrameProblem> {
    // Images need only their header; other depth files are read whole below.
    if let ByteSource::File(path) = source {
        let mut magic = [0; 4];
        if open_file(path)?.read_exact(&mut magic).is_ok() && !lengths::is_known(&magic) {
            return header(source).map(|header| (header.width, header.height));
        }
    }
    let bytes = source.read()?;
    if !lengths::is_known(&bytes) {
        return header_of(Cursor::new(bytes)).map(|header| (header.width, header.height));
    }
    catch_decoder_panic(|| lengths::size(&bytes))
}

/// True if a depth file stores floats, false if it stores whole numbers.
pub(super) fn stores_floats(source: &ByteSource) -> Result<bool, FrameProblem> {
    let mut magic = [0; 4];
    if open_file(source.path())?.read_exact(&mut magic).is_err() || !lengths::is_known(&magic) {
        return Ok(false);
    }
    let codes = catch_decoder_panic(|| lengths::decode(&source.read()?, 1.0, None))?;
    Ok(matches!(codes, DepthCodes::Lengths(_)))
}

/// Decodes a photograph to `size`, which is that of the file divided by `divisor`.
pub(super) fn color(
    source: &ByteSource,
    size: (u32, u32),
    divisor: u32,
) -> Result<Image<[u8; 4]>, FrameProblem> {
    let bytes = source.read()?;
    // Grey and RGB become opaque RGBA, so that later stages handle one format.
    let image = match divisor {
        1 => decode_with(&bytes, size, PHOTOGRAPH, |decoder| opaque(decoder, &bytes))?,
        _ => divided_jpeg(&bytes, size, divisor)?,
    };
    let (width, height) = (image.width() as usize, image.height() as usize);
    // No copy if the capacity is a multiple of a pixel.
    let data = try_cast_vec(image.into_rgba8().into_raw())
        .unwrap_or_else(|(_, rgba)| rgba.as_chunks().0.to_vec());
    Ok(Image::from_vec(width, height, data))
}

/// Decodes RGB to RGBA in the memory of the result, and other images as they are. `bytes` is the file
/// of `decoder`.
fn opaque(decoder: Box<dyn ImageDecoder + '_>, bytes: &[u8]) -> ImageResult<DynamicImage> {
    let (width, height) = decoder.dimensions();
    let n = width as usize * height as usize;
    if decoder.color_type() != ColorType::Rgb8 {
        return DynamicImage::from_decoder(decoder);
    }
    if is_jpeg(bytes)
        && let Some(pixels) = rgba_of_jpeg(bytes)?
    {
        let image = RgbaImage::from_raw(width, height, pixels).map(DynamicImage::ImageRgba8);
        return Ok(image.unwrap_or_default());
    }
    let mut bytes = vec![0; 4 * n];
    decoder.read_image(bytes.get_mut(n..).unwrap_or_default())?;
    let cells = Cell::from_mut(bytes.as_mut_slice()).as_slice_of_cells();
    let rgb = cells.get(n..).unwrap_or_default();
    // Of one memory: an RGBA pixel never reaches an RGB pixel that is not read yet.
    for (to, from) in cells.as_chunks::<4>().0.iter().zip(rgb.as_chunks().0) {
        let [r, g, b] = from.each_ref().map(Cell::get);
        to.iter().zip([r, g, b, u8::MAX]).for_each(|(to, value)| to.set(value));
    }
    let image = RgbaImage::from_raw(width, height, bytes).map(DynamicImage::ImageRgba8);
    Ok(image.unwrap_or_default())
}

/// Decodes a JPEG of luma and chroma to opaque RGBA, with the bits that its RGB has. Writing four bytes a pixel
/// at once saves a pass over the photograph. `None` for other colour spaces.
fn rgba_of_jpeg(bytes: &[u8]) -> ImageResult<Option<Vec<u8>>> {
    // As `image` decodes: lenient, and of any size, which the caller has checked.
    let options = DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(usize::MAX)
        .set_max_height(usize::MAX)
        .jpeg_set_out_colorspace(ColorSpace::RGBA);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let mut decode = || {
        decoder.decode_headers()?;
        let is_usual = decoder.input_colorspace() == Some(ColorSpace::YCbCr);
        is_usual.then(|| decoder.decode()).transpose()
    };
    let failure = |error| DecodingError::new(ImageFormat::Jpeg.into(), error);
    decode().map_err(|error| ImageError::Decoding(failure(error)))
}

fn is_jpeg(bytes: &[u8]) -> bool {
    image::guess_format(bytes).is_ok_and(|format| format == ImageFormat::Jpeg)
}

const PHOTOGRAPH: &str = "an image";

/// Size of a photograph's file and the divisor of its sides that lets decoding fit into memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Decoding {
    pub size: [u32; 2],
    pub divisor: u32,
    /// Memory that decoding takes, bytes.
    pub bytes: u64,
}

/// Largest memory per pixel of a decoded photograph, bytes: a turned progressive JPEG without subsampling.
const MOST_PER_PIXEL: u64 = 14;
/// Divisors of the sides of a JPEG by which it can be decoded.
const DIVISORS: [u32; 4] = [1, 2, 4, 8];

impl Decoding {
    /// Decoding to the size of the file.
    pub fn whole(size: [u32; 2]) -> Self {
        let bytes = size.iter().fold(4, |n: u64, side| n.saturating_mul(u64::from(*side)));
        Self { size, divisor: 1, bytes }
    }

    /// Finds how a photograph of `size` is decoded, upright if its camera is. Reads the start of a large JPEG.
    pub fn of(source: &ByteSource, size: [u32; 2]) -> Self {
        let whole = Self::whole(size);
        if whole.bytes <= (MAX_PICTURE_MIB << 20) / MOST_PER_PIXEL * 4 {
            return whole;
        }
        // A file that cannot be read is reported when it is decoded.
        let outline = match source {
            ByteSource::File(path) => RetryingFile::open(path)
                .ok()
                .and_then(|file| JpegOutline::read(BufReader::new(file))),
            _ => source.read().ok().and_then(|bytes| JpegOutline::read(Cursor::new(bytes))),
        };
        let Some(outline) = outline else { return whole };
        // The orientation is not applied to a picture of its camera's size.
        let is_turned = outline.is_turned && outline.size != size;
        Self { size, ..JpegOutline { is_turned, ..outline }.decoding() }
    }
}

/// What decides on the memory that a JPEG takes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct JpegOutline {
    size: [u32; 2],
    /// Number of samples of all components.
    n_samples: u64,
    is_progressive: bool,
    is_turned: bool,
}

impl JpegOutline {
    /// Reads the segments before the first scan; `None` for other files and damaged ones.
    fn read(mut source: impl Read + Seek) -> Option<Self> {
        let mut start = [0; 2];
        source.read_exact(&mut start).ok()?;
        let (mut outline, mut is_turned) = (None, false);
        if start != [0xFF, 0xD8] {
            return None;
        }
        while outline.is_none() {
            let mut segment = [0; 4];
            source.read_exact(&mut segment).ok()?;
            let [0xFF, marker, high, low] = segment else { return None };
            let length = u16::from_be_bytes([high, low]).checked_sub(2)?;
            let mut content = Vec::new();
            match marker {
                // Frames, without the tables and the reserved marker between their markers.
                0xC0..=0xCF if ![0xC4, 0xC8, 0xCC].contains(&marker) => {
                    source.by_ref().take(length.into()).read_to_end(&mut content).ok()?;
                    outline = Some(Self::of_frame(&content, marker)?);
                }
                0xE1 => {
                    source.by_ref().take(length.into()).read_to_end(&mut content).ok()?;
                    let chunk = content.strip_prefix(b"Exif\0\0");
                    let turn = chunk.and_then(Orientation::from_exif_chunk);
                    is_turned |= turn.is_some_and(|turn| turned_size((2, 1), turn) == (1, 2));
                }
                _ => drop(source.seek(SeekFrom::Current(length.into())).ok()?),
            }
        }
        outline.map(|outline| Self { is_turned, ..outline })
    }

    fn of_frame(content: &[u8], marker: u8) -> Option<Self> {
        let &[_, h0, h1, w0, w1, _, ref components @ ..] = content else { return None };
        let size = [[w0, w1], [h0, h1]].map(|side| u32::from(u16::from_be_bytes(side)));
        let n = u64::from(size[0]) * u64::from(size[1]);
        let factors = components
            .as_chunks::<3>()
            .0
            .iter()
            .map(|[_, factors, _]| [factors >> 4, factors & 15].map(u64::from));
        let most = factors.clone().fold([1; 2], |most, f| [most[0].max(f[0]), most[1].max(f[1])]);
        let n_samples = factors.map(|[x, y]| n * x * y / (most[0] * most[1])).sum();
        let is_progressive = matches!(marker, 0xC2 | 0xC6 | 0xCA | 0xCE);
        Some(Self { size, n_samples, is_progressive, is_turned: false })
    }

    /// Returns the smallest divisor that lets decoding fit into memory, or the largest.
    fn decoding(&self) -> Decoding {
        let size = self.size;
        let of = |divisor| Decoding { size, divisor, bytes: self.bytes(divisor) };
        let fits = |decoding: &Decoding| decoding.bytes <= MAX_PICTURE_MIB << 20;
        DIVISORS.map(of).into_iter().find(fits).unwrap_or(of(8))
    }

    /// Returns the memory that decoding takes, bytes.
    fn bytes(&self, divisor: u32) -> u64 {
        let side = |side: u32| u64::from(side.div_ceil(divisor));
        let n = side(self.size[0]).saturating_mul(side(self.size[1])).min(1 << 40);
        let coefficients = if self.is_progressive { 2 * self.n_samples } else { 0 };
        // Without division, pixels are decoded to their place. Otherwise samples become RGB, and that RGBA.
        let decoded = match divisor {
            1 => coefficients + 4 * n,
            _ => (coefficients + self.n_samples / u64::from(divisor).pow(2) + 3 * n).max(7 * n),
        };
        decoded.max(if self.is_turned { 8 * n } else { 0 })
    }

    fn check(&self, divisor: u32) -> Result<(), FrameProblem> {
        let mib = self.bytes(divisor).div_ceil(1 << 20);
        match mib <= MAX_PICTURE_MIB {
            true => Ok(()),
            false => Err(FrameProblem::TooLarge { size: self.size.into(), mib }),
        }
    }
}

/// Decodes a JPEG to `size`, that of its picture with sides divided by `divisor`.
fn divided_jpeg(
    bytes: &[u8],
    size: (u32, u32),
    divisor: u32,
) -> Result<DynamicImage, FrameProblem> {
    let damaged = |error| {
        let format = ImageFormat::Jpeg.into();
        FrameProblem::from(ImageError::Decoding(DecodingError::new(format, error)))
    };
    if !has_jpeg_end(bytes) {
        return Err(FrameProblem::TruncatedJpeg);
    }
    // Checked again: the file may be another by now.
    if let Some(outline) = JpegOutline::read(Cursor::new(bytes)) {
        JpegOutline { is_turned: false, ..outline }.check(divisor)?;
    }
    catch_decoder_panic(|| {
        let mut decoder = jpeg_decoder::Decoder::new(bytes);
        decoder.read_info().map_err(damaged)?;
        let Some(info) = decoder.info() else { return Err(FrameProblem::DecoderCrash) };
        let side = |side: u16| u32::from(side).div_ceil(divisor) as u16;
        let (width, height) =
            decoder.scale(side(info.width), side(info.height)).map_err(damaged)?;
        let found = (u32::from(width), u32::from(height));
        let orientation = decoder.exif_data().and_then(Orientation::from_exif_chunk);
        let orientation = orientation.filter(|_| found != size);
        let orientation = orientation.unwrap_or(Orientation::NoTransforms);
        if turned_size(found, orientation) != size {
            return Err(FrameProblem::Size { what: PHOTOGRAPH, expected: size, found });
        }
        let pixels = decoder.decode().map_err(damaged)?;
        // Coefficients are no longer needed.
        drop(decoder);
        let image = match info.pixel_format {
            PixelFormat::RGB24 => RgbImage::from_raw(found.0, found.1, pixels).map(Into::into),
            PixelFormat::L8 => GrayImage::from_raw(found.0, found.1, pixels).map(Into::into),
            PixelFormat::L16 | PixelFormat::CMYK32 => None,
        };
        let mut image: DynamicImage = image.ok_or(FrameProblem::JpegColors)?;
        image.apply_orientation(orientation);
        Ok(image)
    })
}

const GRAY16_HINT: &str = "export depth as 16-bit gray PNG";

pub(super) fn depth(
    source: &ByteSource,
    encoding: &DepthEncoding,
    size: (u32, u32),
) -> Result<Depth, FrameProblem> {
    let bytes = source.read()?;
    let image = || decode(&bytes, size, "depth");
    let codes = match encoding.codes {
        CodeKind::BareFloats => lengths::bare_floats(&bytes, size)?,
        CodeKind::ByContent(unit) if lengths::is_known(&bytes) => {
            catch_decoder_panic(|| lengths::decode(&bytes, unit, Some(size)))?
        }
        CodeKind::ByContent(unit) | CodeKind::Linear16(unit) => {
            let codes = first_channel(&image()?, "16-bit gray", GRAY16_HINT)?;
            DepthCodes::Linear16 { codes, unit }
        }
        CodeKind::Inverse8 => {
            let hint = "export all depth of a split in one format";
            DepthCodes::Inverse8(first_channel(&image()?, "8-bit", hint)?)
        }
    };
    let DepthEncoding { kind, trusted, units_per_metre: metre, .. } = *encoding;
    Ok(Depth { codes, kind, trusted, units_per_metre: metre })
}

/// Decodes a sensor's confidence map, 0 to 2 per pixel. The file is a grey image, or bytes without
/// header for an image of `size`. Maps in shades of grey have 0 for 0, white for 2 and others for 1.
pub(super) fn confidence(source: &ByteSource, size: (u32, u32)) -> Result<Image<u8>, FrameProblem> {
    let bytes = source.read()?;
    let mut map = match image::guess_format(&bytes) {
        Ok(_) => {
            let gray = decode(&bytes, size, "depth")?.into_luma8();
            Image::from_vec(gray.width() as usize, gray.height() as usize, gray.into_raw())
        }
        Err(_) => lengths::bare_bytes(&bytes, size)?,
    };
    if map.data.iter().any(|sure| *sure > 2) {
        let level = |sure: u8| (sure > 0) as u8 + (sure == u8::MAX) as u8;
        map.data.iter_mut().for_each(|sure| *sure = level(*sure));
    }
    Ok(map)
}

/// Decodes a mask for photographs of `size`; true at pixels that are used.
pub(super) fn mask(mask: &MaskSource, size: (u32, u32)) -> Result<Image<bool>, FrameProblem> {
    let bytes = mask.file.read()?;
    // A JPEG does not keep black exactly; other files may number what they show from 1.
    let least = if is_jpeg(&bytes) { 128 } else { 1 };
    let gray = decode(&bytes, size, "a mask")?.into_luma8();
    let used: Vec<bool> = gray.iter().map(|v| (*v >= least) == mask.hides_black).collect();
    if !used.contains(&true) {
        let expected = "a mask with used pixels";
        return Err(FrameProblem::Entry { expected, found: "none".to_owned() });
    }
    Ok(Image::from_vec(size.0 as usize, size.1 as usize, used))
}

/// Decodes the 16-bit codes of an image in memory.
pub(super) fn codes16(bytes: &[u8]) -> Result<Image<u16>, FrameProblem> {
    let ImageHeader { width, height, .. } = header_of(Cursor::new(bytes))?;
    let image = decode(bytes, (width, height), "depth")?;
    first_channel(&image, "16-bit gray", GRAY16_HINT)
}

/// Returns the first channel of an image whose channels have the size of `T`. Fails for other images;
/// the error contains `expected` and `hint`.
fn first_channel<T: AnyBitPattern>(
    image: &DynamicImage,
    expected: &'static str,
    hint: &'static str,
) -> Result<Image<T>, FrameProblem> {
    let color = image.color();
    let n_channels = usize::from(color.channel_count());
    if usize::from(color.bits_per_pixel()) != 8 * size_of::<T>() * n_channels {
        let found = format!("{color:?}");
        return Err(FrameProblem::DepthFormat { expected, found, hint });
    }
    // Exporters write grey depth into every colour channel; the first one suffices. The bytes are those of
    // a vector of `T`, so they are aligned.
    let channels = bytemuck::cast_slice::<u8, T>(image.as_bytes());
    let data = channels.iter().step_by(n_channels).copied().collect();
    Ok(Image::from_vec(image.width() as usize, image.height() as usize, data))
}

fn decode(
    bytes: &[u8],
    size: (u32, u32),
    what: &'static str,
) -> Result<DynamicImage, FrameProblem> {
    decode_with(bytes, size, what, |decoder| DynamicImage::from_decoder(decoder))
}

/// Decodes an image by `read` and checks that it has the given size; `what` names the image in messages. The
/// memory that a header can request is bounded.
fn decode_with(
    bytes: &[u8],
    size: (u32, u32),
    what: &'static str,
    read: impl FnOnce(Box<dyn ImageDecoder + '_>) -> ImageResult<DynamicImage>,
) -> Result<DynamicImage, FrameProblem> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format()?;
    reader.limits(chunk_limits());
    // Decoders silently fill the rest of a truncated JPEG with grey. A truncated PNG is an error of its
    // decoder, but only after the memory is allocated.
    let format = reader.format();
    if format == Some(ImageFormat::Jpeg) && !has_jpeg_end(bytes) {
        return Err(FrameProblem::TruncatedJpeg);
    }
    catch_decoder_panic(|| {
        let mut decoder = reader.into_decoder()?;
        let found = decoder.dimensions();
        // Turned only where the camera's size is that of the upright picture.
        let orientation = match found == size {
            true => Orientation::NoTransforms,
            false => decoder.orientation().unwrap_or(Orientation::NoTransforms),
        };
        // Checked before decoding: a small file may unpack to a thousand times its bytes.
        if turned_size(found, orientation) != size {
            return Err(FrameProblem::Size { what, expected: size, found });
        }
        // As RGBA, and as stored if that differs.
        let stored = match decoder.color_type() {
            ColorType::Rgb8 | ColorType::Rgba8 => 0,
            _ => decoder.total_bytes(),
        };
        let rgba = u64::from(found.0).saturating_mul(found.1.into()).saturating_mul(4);
        let mib = rgba.saturating_add(stored).div_ceil(1 << 20);
        if mib > MAX_PICTURE_MIB {
            return Err(FrameProblem::TooLarge { size: found, mib });
        }
        // A turned picture is decoded beside the stored one.
        if turned_size((2, 1), orientation) == (1, 2) && 2 * mib > MAX_PICTURE_MIB {
            return Err(FrameProblem::TooLarge { size: found, mib: 2 * mib });
        }
        if format == Some(ImageFormat::Jpeg)
            && let Some(outline) = JpegOutline::read(Cursor::new(bytes))
        {
            JpegOutline { is_turned: false, ..outline }.check(1)?;
        }
        if format == Some(ImageFormat::Png) {
            let (width, height) = size;
            let size = [width as usize, height as usize];
            lengths::check_unpacked(bytes, size, decoder.total_bytes())?;
        }
        let mut image = read(Box::new(decoder))?;
        image.apply_orientation(orientation);
        Ok(image)
    })
}

/// Returns limits for what a decoder unpacks besides pixels: a profile of colours in a PNG may be of any
/// length.
fn chunk_limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_EXTRA_MIB << 20);
    limits
}

/// Runs `read` and turns a panic of a third-party image decoder into an error.
fn catch_decoder_panic<T>(
    read: impl FnOnce() -> Result<T, FrameProblem>,
) -> Result<T, FrameProblem> {
    // Unwind safe: nothing that the panic could have left half done is used afterwards.
    catch_unwind(AssertUnwindSafe(read)).unwrap_or(Err(FrameProblem::DecoderCrash))
}

/// True if an end-of-image marker follows the first scan of a JPEG. Inside a scan, a zero byte follows
/// every 0xFF data byte, so `FF D9` there cannot be data. Markers of thumbnails precede the first scan.
pub(super) fn has_jpeg_end(bytes: &[u8]) -> bool {
    const START_OF_SCAN: u8 = 0xDA;
    // The search begins after the start-of-image marker, which has no length field.
    let mut at = 2;
    while let Some(&[0xFF, marker, high, low]) = bytes.get(at..at + 4) {
        if marker == START_OF_SCAN {
            let scans = bytes.get(at..).unwrap_or_default();
            return scans.windows(2).any(|pair| pair == [0xFF, 0xD9]);
        }
        at += match marker {
            0xFF => 1, // padding before a marker
            _ => 2 + usize::from(u16::from_be_bytes([high, low])),
        };
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_above_the_limit_is_refused_by_its_size() {
        let mut png = Cursor::new(Vec::new());
        image::RgbImage::new(1, 1).write_to(&mut png, ImageFormat::Png).unwrap();
        let mut png = png.into_inner();
        // Width and height follow signature, length and kind of the first chunk.
        png[16..20].copy_from_slice(&16384u32.to_be_bytes());
        png[20..24].copy_from_slice(&16384u32.to_be_bytes());
        let checksum = crc32fast::hash(&png[12..29]);
        png[29..33].copy_from_slice(&checksum.to_be_bytes());
        let error = decode(&png, (16384, 16384), "an image").unwrap_err().to_string();
        let expected =
            "found 16384x16384 pixels that take 1024 MiB decoded, expected at most 208 MiB";
        assert!(error.starts_with(expected), "{error}");
        let kind = image::error::LimitErrorKind::InsufficientMemory;
        let extra = image::ImageError::Limits(image::error::LimitError::from_kind(kind));
        let error = FrameProblem::from(extra).to_string();
        assert!(error.starts_with("found more than 32 MiB besides the pixels"), "{error}");
    }

    /// A photograph whose red grows with the columns and green with the rows, turned by its EXIF data.
    fn turned_jpeg() -> Vec<u8> {
        let pixel = |x: u32, y: u32| image::Rgb([4 * x as u8, 6 * y as u8, 90]);
        let photograph = RgbImage::from_fn(48, 40, pixel);
        let mut jpeg = Cursor::new(Vec::new());
        photograph.write_to(&mut jpeg, ImageFormat::Jpeg).unwrap();
        let exif = b"\xFF\xE1\0\x22Exif\0\0MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
        [&jpeg.get_ref()[..2], exif, &jpeg.get_ref()[2..]].concat()
    }

    #[test]
    fn a_divided_photograph_is_the_mean_of_its_pixels() {
        let jpeg = turned_jpeg();
        let whole =
            decode_with(&jpeg, (40, 48), PHOTOGRAPH, |d| opaque(d, &jpeg)).unwrap().into_rgb8();
        for divisor in [2, 4, 8] {
            let size = (40 / divisor, 48 / divisor);
            let divided = divided_jpeg(&jpeg, size, divisor).unwrap().into_rgb8();
            for (x, y) in [(0, 0), (40 / divisor - 1, 0), (1, 48 / divisor - 1)] {
                let of = |channel: usize| {
                    let at = (0..divisor * divisor).map(|i| [i % divisor, i / divisor]);
                    let values = at.map(|[i, j]| {
                        f64::from(whole.get_pixel(divisor * x + i, divisor * y + j).0[channel])
                    });
                    values.sum::<f64>() / f64::from(divisor * divisor)
                };
                let found = divided.get_pixel(x, y).0;
                for channel in 0..3 {
                    let error = (f64::from(found[channel]) - of(channel)).abs();
                    assert!(error < 6.0, "{divisor} {x} {y} {channel}: {found:?} {}", of(channel));
                }
            }
        }
        let error = divided_jpeg(&jpeg, (25, 20), 2).unwrap_err();
        assert!(matches!(error, FrameProblem::Size { .. }), "{error}");
        assert!(matches!(
            divided_jpeg(&jpeg[..600], (20, 24), 2),
            Err(FrameProblem::TruncatedJpeg)
        ));
    }

    #[test]
    fn large_photographs_are_divided_until_they_fit() {
        let outline = JpegOutline::read(Cursor::new(turned_jpeg())).unwrap();
        let (size, n_samples) = ([48, 40], outline.n_samples);
        assert_eq!(
            outline,
            JpegOutline { size, n_samples, is_progressive: false, is_turned: true }
        );
        assert!((48 * 40..=3 * 48 * 40).contains(&n_samples), "{n_samples}");
        let of = |width: u32, height: u32, is_progressive, is_turned| {
            let n_samples = u64::from(width * height) * 3 / 2;
            let size = [width, height];
            JpegOutline { size, n_samples, is_progressive, is_turned }.decoding().divisor
        };
        assert_eq!([of(8192, 6144, false, false), of(8192, 6144, true, false)], [1, 2]);
        assert_eq!([of(8192, 6144, false, true), of(6000, 4000, true, true)], [2, 1]);
        assert_eq!([of(12000, 9000, false, false), of(16320, 12240, false, false)], [2, 4]);
        let huge = JpegOutline { size: [u32::MAX; 2], ..outline };
        assert!(huge.check(8).is_err() && huge.decoding().divisor == 8);
        for end in 0..40 {
            assert_eq!(JpegOutline::read(Cursor::new(&turned_jpeg()[..end])), None, "{end}");
        }
    }

    #[test]
    fn jpegs_have_the_bytes_of_their_rgb() {
        let pixel = |x: u32, y: u32| [(7 * x) as u8, (5 * y) as u8, (x * y) as u8];
        // No multiples of the blocks of a JPEG.
        let (width, height) = (93, 61);
        let rgb = image::RgbImage::from_fn(width, height, |x, y| image::Rgb(pixel(x, y)));
        let mut file = Cursor::new(Vec::new());
        rgb.write_to(&mut file, ImageFormat::Jpeg).unwrap();
        let bytes = file.into_inner();
        let expected = image::load_from_memory(&bytes).unwrap().into_rgba8();
        assert_eq!(rgba_of_jpeg(&bytes).unwrap().unwrap(), *expected);
        let read = decode_with(&bytes, (width, height), PHOTOGRAPH, |d| opaque(d, &bytes));
        assert_eq!(read.unwrap().into_rgba8(), expected);
        let mut gray = Cursor::new(Vec::new());
        DynamicImage::from(rgb).to_luma8().write_to(&mut gray, ImageFormat::Jpeg).unwrap();
        assert_eq!(rgba_of_jpeg(gray.get_ref()).unwrap(), None);
    }

    #[test]
    fn a_decoder_that_panics_is_an_error_of_the_file() {
        let crash = catch_decoder_panic::<()>(|| panic!("a defect of the decoder"));
        assert!(matches!(crash, Err(FrameProblem::DecoderCrash)), "{crash:?}");
        assert!(matches!(catch_decoder_panic(|| Ok(7)), Ok(7)));
        let error = catch_decoder_panic::<()>(|| Err(FrameProblem::TruncatedJpeg));
        assert!(matches!(error, Err(FrameProblem::TruncatedJpeg)), "{error:?}");
    }
}
