//! Import of model files. The format is detected from the content.

use super::error::{ExportError, Fault, shorten, try_with_capacity};
use super::gaussian::Gaussian;
use super::imported::{Imported, ModelKind, Rows};
use super::{glb, ply, spz};
use glam::{DMat3, DVec3};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Maximum number of splats that [`read`] accepts, about 1.4 GB as PLY.
pub const DEFAULT_MAX_SPLATS: usize = 20_000_000;

/// Reads a model: PLY (splats, points or PlayCanvas' compressed form), GLB, glTF with `data:` or sibling
/// buffers, SPZ 1 to 4 or `.splat`. The format is detected from the content. Accepts up to
/// [`DEFAULT_MAX_SPLATS`] rows.
///
/// # Errors
/// The file cannot be read, is not a model, is damaged, or uses unsupported features, as the [`Fault`]
/// states. Non-finite rows are not an error; they are counted.
pub fn read(path: &Path) -> Result<Imported, ExportError> {
    read_up_to(path, DEFAULT_MAX_SPLATS)
}

/// Reads like [`read`], with `max_splats` as the limit on the number of rows.
///
/// # Errors
/// As [`read`], and [`Fault::TooMany`] above `max_splats`.
pub fn read_up_to(path: &Path, max_splats: usize) -> Result<Imported, ExportError> {
    let import = || {
        let bytes = read_file(path)?;
        // A file named without a folder is in the present one.
        let folder = path.parent().filter(|folder| *folder != "").unwrap_or(Path::new("."));
        let imported = parse(&bytes, folder, max_splats)?;
        Ok(Imported { bytes: bytes.len() as u64, ..imported })
    };
    import().map_err(|fault: Fault| fault.with_path(path))
}

pub(super) fn decode(bytes: &[u8]) -> Result<Imported, Fault> {
    parse(bytes, Path::new(""), DEFAULT_MAX_SPLATS)
}

/// Checks by the first bytes of a file that it may be a model.
///
/// # Errors
/// The file cannot be read or starts like no model.
pub fn check_start(path: &Path) -> Result<(), ExportError> {
    let check = || {
        let mut start = Vec::new();
        let most = (N_PROBED * ROW_BYTES) as u64;
        open_file(path)?.take(most).read_to_end(&mut start).map_err(read_fault)?;
        kind_of(&start).map(drop)
    };
    check().map_err(|fault| fault.with_path(path))
}

enum FileKind {
    Ply,
    Glb,
    Gltf,
    Spz,
    Splat,
}

/// Returns a text without a byte order mark, with which some editors begin it, and spaces.
fn text_of(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start()
}

fn parse(bytes: &[u8], folder: &Path, max_splats: usize) -> Result<Imported, Fault> {
    match kind_of(bytes)? {
        FileKind::Ply => ply::read::ply(bytes, max_splats),
        FileKind::Glb => glb::read::glb(bytes, folder, max_splats),
        FileKind::Gltf => glb::read::gltf(text_of(bytes), folder, max_splats),
        FileKind::Spz => spz::read::spz(bytes, max_splats),
        FileKind::Splat => read_splat(bytes, max_splats),
    }
}

fn kind_of(bytes: &[u8]) -> Result<FileKind, Fault> {
    if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
        Ok(FileKind::Ply)
    } else if bytes.starts_with(b"glTF") {
        Ok(FileKind::Glb)
    } else if text_of(bytes).starts_with(b"{") {
        Ok(FileKind::Gltf)
    } else if spz::read::is_plain(bytes) || spz::read::is_gzip(bytes) {
        Ok(FileKind::Spz)
    } else if is_likely(bytes) {
        // Last, because this format has no magic bytes.
        Ok(FileKind::Splat)
    } else {
        let start = String::from_utf8_lossy(bytes.get(..16).unwrap_or(bytes));
        let found = match bytes {
            [] => "an empty file".to_owned(),
            _ => format!("a file starting \"{}\"", shorten(&start)),
        };
        Err(Fault::NotAModel { found })
    }
}

pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, Fault> {
    let mut file = open_file(path)?;
    let size = file.metadata().map_err(read_fault)?.len();
    let room = usize::try_from(size).map_err(|_| Fault::OutOfMemory { bytes: size })?;
    let mut bytes = try_with_capacity(room)?;
    file.read_to_end(&mut bytes).map_err(read_fault)?;
    Ok(bytes)
}

fn open_file(path: &Path) -> Result<File, Fault> {
    // Checked before opening: opening a FIFO blocks until it has a writer, and a device may never end.
    let kind = std::fs::metadata(path).map_err(read_fault)?.file_type();
    if !kind.is_file() {
        return Err(if kind.is_dir() { Fault::IsFolder } else { Fault::IsStream });
    }
    File::open(path).map_err(read_fault)
}

fn read_fault(source: std::io::Error) -> Fault {
    match source.kind() {
        std::io::ErrorKind::NotFound => Fault::Missing,
        _ => Fault::Io { action: "read", source },
    }
}

/// Size of a splat in bytes: six f32 (position and scale), four bytes of colour and opacity, four of
/// rotation `w x y z`.
const ROW_BYTES: usize = 32;
/// Number of rows examined to detect the format, which has no magic bytes.
const N_PROBED: usize = 64;
/// Tolerance for the squared length of a unit quaternion whose components were rounded to 8 bits; 1
/// becomes 127/128.
const LENGTH_SLACK: f64 = 0.1;

/// True if most of the first rows are plausible splats, with finite values, no negative scales, and a
/// unit quaternion. False for text and images.
pub(super) fn is_likely(bytes: &[u8]) -> bool {
    let probed = bytes.as_chunks::<ROW_BYTES>().0.iter().take(N_PROBED);
    let likely = |row: &&[u8; ROW_BYTES]| {
        let Record { mean, scale, rotation, .. } = Record::of(row);
        let length: f64 = rotation.iter().map(|v| v * v).sum();
        mean.is_finite()
            && scale.is_finite()
            && scale.min_element() >= 0.0
            && (length - 1.0).abs() < LENGTH_SLACK
    };
    // False for an empty file.
    2 * probed.clone().filter(likely).count() > probed.len()
}

pub(super) fn read_splat(bytes: &[u8], max_splats: usize) -> Result<Imported, Fault> {
    let (records, rest) = bytes.as_chunks::<ROW_BYTES>();
    if !rest.is_empty() {
        let expected = format!("a multiple of {ROW_BYTES} bytes");
        return Err(Fault::malformed(".splat", expected, format!("{} bytes", bytes.len())));
    }
    if records.len() > max_splats {
        return Err(Fault::TooMany { declared: records.len() as u64, cap: max_splats });
    }
    let mut rows = Rows::with_capacity(records.len())?;
    for record in records {
        let Record { mean, scale, color: [r, g, b, opacity], rotation } = Record::of(record);
        let rotation = rows.rotation(rotation);
        rows.push(Gaussian {
            mean,
            opacity,
            color: DVec3::new(r, g, b),
            // A negative standard deviation is invalid, so the row counts as not finite.
            scale: if scale.min_element() < 0.0 { DVec3::NAN } else { scale },
            rotation,
            directional: DMat3::ZERO,
        });
    }
    rows.finish(ModelKind::Splats, Vec::new(), Vec::new())
}

struct Record {
    mean: DVec3,
    scale: DVec3,
    /// Red, green, blue and opacity, 0 to 1.
    color: [f64; 4],
    /// Quaternion `w x y z`; byte 128 represents 0, in steps of 1/128.
    rotation: [f64; 4],
}

impl Record {
    fn of(row: &[u8; ROW_BYTES]) -> Self {
        let [x, y, z, sx, sy, sz, color, rotation]: [[u8; 4]; 8] = bytemuck::cast(*row);
        let vector = |numbers: [[u8; 4]; 3]| DVec3::from_array(numbers.map(float));
        Self {
            mean: vector([x, y, z]),
            scale: vector([sx, sy, sz]),
            color: color.map(|byte| f64::from(byte) / 255.0),
            rotation: rotation.map(|byte| (f64::from(byte) - 128.0) / 128.0),
        }
    }
}

fn float(bytes: [u8; 4]) -> f64 {
    f64::from(f32::from_le_bytes(bytes))
}
