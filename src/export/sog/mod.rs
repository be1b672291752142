//! SOG version 2 (`files.md`, SOG): a zip archive of `meta.json` and lossless WebP images, one pixel a splat. This
//! file holds the import; [`mod@write`] is the export.
//!
//! Sizes in a file are untrusted: the archive states few members, members unpack to a multiple of their size, and an
//! image is decoded only if its pixels are about as many as the splats.

#[expect(clippy::indexing_slicing, reason = "indices are pixels of images and levels of codebooks")]
pub(super) mod write;

use super::error::{Fault, shorten};
use super::gaussian::{AxisRotation, Gaussian, harmonic_to_color, harmonics_to_directional};
use super::imported::{Imported, Intake, ModelKind, Note, Rows};
use crate::math::foreign::{CountedHeaders, open_zip};
use glam::{DMat3, DVec3};
use image_webp::WebPDecoder;
use serde::{Deserialize, Serialize};
use std::f64::consts::SQRT_2;
use std::io::{Cursor, Read};
use zip::ZipArchive;

const META: &str = "meta.json";
const VERSION: u64 = 2;
/// Number of levels of a codebook.
const N_LEVELS: usize = 256;
/// Number of palette entries in a row of the image of centroids.
const ROW_ENTRIES: usize = 64;
/// Numbers of harmonic coefficients per channel above degree 0, by the number of bands.
const N_COEFFICIENTS: [usize; 3] = [3, 8, 15];
/// Value of the fourth channel of a rotation whose first component is left out.
const FIRST_MODE: u8 = 252;

#[derive(Serialize, Deserialize)]
struct Meta {
    version: u64,
    #[serde(default)]
    asset: Asset,
    count: u64,
    #[serde(default)]
    antialias: bool,
    means: Means,
    scales: Coded,
    quats: Images,
    sh0: Coded,
    #[serde(rename = "shN", skip_serializing_if = "Option::is_none")]
    harmonics: Option<Palette>,
}

#[derive(Default, Serialize, Deserialize)]
struct Asset {
    #[serde(default)]
    generator: String,
}

#[derive(Serialize, Deserialize)]
struct Means {
    mins: [f64; 3],
    maxs: [f64; 3],
    files: Vec<String>,
}

#[derive(Serialize, Deserialize)]
struct Images {
    files: Vec<String>,
}

#[derive(Serialize, Deserialize)]
struct Coded {
    codebook: Codebook,
    files: Vec<String>,
}

#[derive(Serialize, Deserialize)]
struct Palette {
    count: u64,
    bands: usize,
    codebook: Codebook,
    files: Vec<String>,
}

/// Levels by their index; some writers leave the first one empty.
#[derive(Serialize, Deserialize)]
struct Codebook(Vec<Option<f32>>);

impl Codebook {
    /// Decodes a pixel. A level that is missing becomes NaN, so that its splats count as broken.
    fn vector(&self, [r, g, b, _]: [u8; 4]) -> DVec3 {
        let level = |byte: u8| self.0.get(usize::from(byte)).copied().flatten();
        DVec3::from_array([r, g, b].map(|byte| level(byte).map_or(f64::NAN, f64::from)))
    }
}

/// Transforms a coordinate to the logarithmic domain, in which positions are rounded.
fn to_log(v: f64) -> f64 {
    v.signum() * v.abs().ln_1p()
}

fn from_log(n: f64) -> f64 {
    n.signum() * n.abs().exp_m1()
}

/// Decodes the quaternion `w x y z`; NaN for an unknown mode.
fn quaternion([a, b, c, mode]: [u8; 4]) -> [f64; 4] {
    let [a, b, c] = [a, b, c].map(|byte| (f64::from(byte) / 255.0 - 0.5) * SQRT_2);
    let rest = (1.0 - a * a - b * b - c * c).max(0.0).sqrt();
    match mode.checked_sub(FIRST_MODE) {
        Some(0) => [rest, a, b, c],
        Some(1) => [a, rest, b, c],
        Some(2) => [a, b, rest, c],
        Some(3) => [a, b, c, rest],
        _ => [f64::NAN; 4],
    }
}

pub(super) fn is_zip(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}

pub(super) fn sog(bytes: &[u8], intake: Intake) -> Result<Imported, Fault> {
    let mut archive = Archive::open(bytes)?;
    let meta = archive.meta()?;
    let n = usize::try_from(meta.count).unwrap_or(usize::MAX);
    if n > intake.max_splats {
        return Err(Fault::TooMany { declared: meta.count, cap: intake.max_splats });
    }
    let size = bytes.len().saturating_mul(MAX_FACTOR).max(ANY_FACTOR_BYTES);
    if n.saturating_mul(SPLAT_BYTES) > size {
        let expected = format!("splats that unpack to at most {MAX_FACTOR} times the file's size");
        return Err(Fault::malformed(META, expected, format!("{n} in {} bytes", bytes.len())));
    }
    let low = archive.image(&meta.means.files, 0, n)?;
    let high = archive.image(&meta.means.files, 1, n)?;
    let scales = archive.image(&meta.scales.files, 0, n)?;
    let rotations = archive.image(&meta.quats.files, 0, n)?;
    let colors = archive.image(&meta.sh0.files, 0, n)?;
    let mut notes = Vec::new();
    let harmonics = match &meta.harmonics {
        None => None,
        Some(palette) => Some(Harmonics::read(&mut archive, palette, n, &mut notes)?),
    };
    let unpacked = (bytes.len() as u64).saturating_mul(USUAL_FACTOR);
    let mut rows = Rows::with_capacity(n, harmonics.is_some(), unpacked, intake)?;
    let (start, end) = (DVec3::from_array(meta.means.mins), DVec3::from_array(meta.means.maxs));
    for i in 0..n {
        let ([a, b, c, _], [x, y, z, _]) = (low.pixel(i), high.pixel(i));
        let share = [[a, x], [b, y], [c, z]].map(|v| f64::from(u16::from_le_bytes(v)) / 65535.0);
        let log = start + DVec3::from_array(share) * (end - start);
        let color = colors.pixel(i);
        let splat = Gaussian {
            mean: DVec3::from_array(log.to_array().map(from_log)),
            opacity: f64::from(color[3]) / 255.0,
            color: harmonic_to_color(meta.sh0.codebook.vector(color)),
            scale: meta.scales.codebook.vector(scales.pixel(i)).exp(),
            rotation: rows.rotation(quaternion(rotations.pixel(i))),
            directional: harmonics.as_ref().map_or(DMat3::ZERO, |all| all.directional(i)),
            seen: DVec3::ZERO,
        };
        // Viewers turn the axes of the file by half a turn about z: its y points down.
        rows.push(splat.rotated(&AxisRotation::Z_UP_TO_Y_DOWN.inverse()));
    }
    let imported = rows.finish(ModelKind::Splats, notes, Vec::new())?;
    let imported = if meta.antialias { imported.antialiased() } else { imported };
    Ok(Imported { defined_up: Some(DVec3::Z), ..imported })
}

/// Colours by direction: a palette of matrices, and the entry of every splat.
struct Harmonics {
    entries: Vec<DMat3>,
    labels: Image,
}

impl Harmonics {
    fn read(
        archive: &mut Archive,
        palette: &Palette,
        n: usize,
        notes: &mut Vec<Note>,
    ) -> Result<Self, Fault> {
        let bands = palette.bands.checked_sub(1).and_then(|band| N_COEFFICIENTS.get(band));
        let Some(&n_coefficients) = bands else {
            return Err(Fault::malformed(META, "1 to 3 bands", palette.bands.to_string()));
        };
        let count = palette.count as usize;
        if palette.count > MAX_PALETTE {
            let expected = format!("a palette of at most {MAX_PALETTE} entries");
            return Err(Fault::malformed(META, expected, palette.count.to_string()));
        }
        let unused = 3 * (n_coefficients - N_COEFFICIENTS[0]);
        if unused > 0 {
            notes.push(Note::ViewDependentColorIgnored { n_coefficients: unused });
        }
        let row = ROW_ENTRIES * n_coefficients;
        let centroids = archive.image(&palette.files, 0, row * count.div_ceil(ROW_ENTRIES))?;
        if centroids.width != row {
            let found = format!("{} pixels", centroids.width);
            return Err(Fault::malformed("centroids", format!("rows of {row} pixels"), found));
        }
        let of =
            |i: usize, k: usize| palette.codebook.vector(centroids.pixel(i * n_coefficients + k));
        let entry = |i| harmonics_to_directional([of(i, 0), of(i, 1), of(i, 2)]);
        let entries = (0..count).map(entry).collect();
        Ok(Self { entries, labels: archive.image(&palette.files, 1, n)? })
    }

    fn directional(&self, i: usize) -> DMat3 {
        let [low, high, ..] = self.labels.pixel(i);
        let entry = self.entries.get(usize::from(u16::from_le_bytes([low, high])));
        // A label without an entry makes the splat count as broken.
        entry.copied().unwrap_or(DMat3::NAN)
    }
}

/// Number of bytes of a splat in images of four channels.
const SPLAT_BYTES: usize = 24;
/// Largest ratio of unpacked images to file above [`ANY_FACTOR_BYTES`]. Recorded scenes compress by 2 to 4.
const MAX_FACTOR: usize = 16;
/// Largest size of images that may be compressed by any factor, bytes: 700,000 equal splats.
const ANY_FACTOR_BYTES: usize = 16 << 20;
/// Largest factor by which the splats of recorded scenes are compressed.
const USUAL_FACTOR: u64 = 5;
/// Maximum number of members: seven images and their description, besides what others add.
const MAX_MEMBERS: u64 = 64;
/// Maximum size of `meta.json`, bytes: five times that of three codebooks with long numbers.
const MAX_META_BYTES: u64 = 1 << 17;
/// Maximum number of pixels beyond the splats, besides as many again.
const SPARE_PIXELS: usize = 4096;
/// Maximum number of entries of a palette, whose labels have 16 bits.
const MAX_PALETTE: u64 = 1 << 16;

struct Archive<'a> {
    zip: ZipArchive<CountedHeaders<Cursor<&'a [u8]>>>,
}

impl<'a> Archive<'a> {
    fn open(bytes: &'a [u8]) -> Result<Self, Fault> {
        let Some(zip) = open_zip(Cursor::new(bytes), MAX_MEMBERS) else {
            let expected = format!("at most {MAX_MEMBERS} members in the archive");
            return Err(Fault::malformed("SOG", expected, "more"));
        };
        Ok(Self { zip: zip.map_err(|e| zip_fault("SOG", &e))? })
    }

    /// Unpacks a member of at most `most` bytes; memory grows only with the data received.
    fn member(&mut self, name: &str, most: u64) -> Result<Vec<u8>, Fault> {
        let place = || shorten(name);
        let member = self.zip.by_name(name).map_err(|e| zip_fault(&place(), &e))?;
        let mut bytes = Vec::new();
        let read = member.take(most + 1).read_to_end(&mut bytes);
        let found = match read {
            Ok(n) if n as u64 <= most => return Ok(bytes),
            Ok(_) => "more".to_owned(),
            Err(e) => shorten(&e.to_string()),
        };
        Err(Fault::malformed(place(), format!("at most {most} bytes"), found))
    }

    fn meta(&mut self) -> Result<Meta, Fault> {
        #[derive(Deserialize)]
        struct Version {
            version: Option<u64>,
        }
        let bytes = self.member(META, MAX_META_BYTES)?;
        let fault = |e: serde_json::Error| {
            Fault::malformed(META, "a description of SOG", shorten(&e.to_string()))
        };
        let found: Version = serde_json::from_slice(&bytes).map_err(fault)?;
        if found.version != Some(VERSION) {
            // Version 1 states none.
            let found = found.version.map_or("none".to_owned(), |version| version.to_string());
            return Err(Fault::Unsupported {
                feature: format!("{META}: expected version {VERSION}, found {found}"),
                advice: "save the file as SOG version 2 or as PLY",
            });
        }
        serde_json::from_slice(&bytes).map_err(fault)
    }

    /// Decodes the `i`-th of the named images, which must have `n` pixels, and little more.
    fn image(&mut self, files: &[String], i: usize, n: usize) -> Result<Image, Fault> {
        let fault = |expected: String, found: String| Err(Fault::malformed(META, expected, found));
        let Some(name) = files.get(i) else {
            return fault(format!("{} names of images", i + 1), files.len().to_string());
        };
        let most = n.saturating_mul(8).saturating_add(1 << 16);
        let bytes = self.member(name, most as u64)?;
        Image::decode(&bytes, n).map_err(|found| {
            let expected = format!("a lossless WebP of {n} pixels, and little more");
            Fault::malformed(shorten(name), expected, found)
        })
    }
}

fn zip_fault(place: &str, error: &zip::result::ZipError) -> Fault {
    Fault::malformed(place, "a member of a zip archive", shorten(&error.to_string()))
}

/// Decoded image with three or four channels.
struct Image {
    width: usize,
    has_alpha: bool,
    bytes: Vec<u8>,
}

impl Image {
    /// Decodes an image of at least `n` pixels. On failure returns what was found instead.
    fn decode(bytes: &[u8], n: usize) -> Result<Self, String> {
        let message = |e: image_webp::DecodingError| shorten(&e.to_string());
        let mut decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(message)?;
        let (width, height) = decoder.dimensions();
        let n_pixels = width as usize * height as usize;
        if n_pixels < n || n_pixels > 2 * n + SPARE_PIXELS {
            return Err(format!("{width} × {height}"));
        }
        if decoder.is_animated() || decoder.is_lossy() {
            return Err("a lossy or animated one".to_owned());
        }
        let has_alpha = decoder.has_alpha();
        let size = decoder.output_buffer_size().ok_or("no size")?;
        let mut pixels = vec![0; size];
        decoder.read_image(&mut pixels).map_err(message)?;
        Ok(Self { width: width as usize, has_alpha, bytes: pixels })
    }

    fn pixel(&self, i: usize) -> [u8; 4] {
        // Never missing: images have the pixels of all splats.
        match self.has_alpha {
            true => self.bytes.as_chunks().0.get(i).copied().unwrap_or_default(),
            false => {
                let [r, g, b] = self.bytes.as_chunks().0.get(i).copied().unwrap_or_default();
                [r, g, b, 255]
            }
        }
    }
}
