//! Import of model files. The format is detected from the content.

use super::error::{ExportError, Fault, shorten, try_with_capacity};
use super::gaussian::Gaussian;
use super::imported::{Imported, Intake, ModelKind, Rows};
use super::{glb, ply, sog, spz};
use glam::{DMat3, DVec3};
use std::borrow::Cow;
use std::fs::File;
use std::io::{ErrorKind, Read, Result as IoResult, Seek, SeekFrom};
use std::path::Path;

/// Maximum number of splats that [`read`] accepts, about 1.4 GB as PLY.
pub const DEFAULT_MAX_SPLATS: usize = 20_000_000;

/// Reads a model: PLY (splats, points or PlayCanvas' compressed form), GLB, glTF with `data:` or sibling
/// buffers, SPZ 1 to 4, SOG 2 or `.splat`. The format is detected from the content. Accepts up to
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
    read_file_with(path, Intake { max_splats, is_stored: true })
}

/// Reads a model like [`read`] without storing its splats, for [`Imported::outline`], kind and notes.
///
/// # Errors
/// As [`read`].
pub fn read_outline(path: &Path) -> Result<Imported, ExportError> {
    read_file_with(path, Intake { max_splats: DEFAULT_MAX_SPLATS, is_stored: false })
}

fn read_file_with(path: &Path, intake: Intake) -> Result<Imported, ExportError> {
    let import = || {
        let (file, size) = open_file(path)?;
        // A file named without a folder is in the present one.
        let folder = path.parent().filter(|folder| *folder != "").unwrap_or(Path::new("."));
        let imported = parse(Source::of_file(&file, size), folder, intake)?;
        Ok(Imported { bytes: size, ..imported })
    };
    import().map_err(|fault: Fault| fault.with_path(path))
}

pub(super) fn decode(bytes: &[u8]) -> Result<Imported, Fault> {
    let intake = Intake { max_splats: DEFAULT_MAX_SPLATS, is_stored: true };
    parse(Source::of_bytes(bytes), Path::new(""), intake)
}

/// Number of bytes by which the kind of a file is told.
const PROBED_BYTES: usize = N_PROBED * ROW_BYTES;

/// Checks by the first bytes of a file that it may be a model.
///
/// # Errors
/// The file cannot be read or starts like no model.
pub fn check_start(path: &Path) -> Result<(), ExportError> {
    let check = || {
        let (file, size) = open_file(path)?;
        kind_of(&mut Source::of_file(&file, size)).map(drop)
    };
    check().map_err(|fault: Fault| fault.with_path(path))
}

enum FileKind {
    Ply,
    Glb,
    Gltf,
    Spz,
    Sog,
    Splat,
}

/// Returns a text without a byte order mark, with which some editors begin it, and spaces.
fn text_of(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start()
}

fn parse(mut source: Source, folder: &Path, intake: Intake) -> Result<Imported, Fault> {
    match kind_of(&mut source)? {
        // Large files of fixed rows are read in blocks.
        FileKind::Ply => ply::read::ply(source, intake),
        FileKind::Splat => read_splat(source, intake),
        FileKind::Glb => glb::read::glb(&source.all()?, folder, intake),
        FileKind::Gltf => glb::read::gltf(text_of(&source.all()?), folder, intake),
        FileKind::Spz => spz::read::spz(&source.all()?, intake),
        FileKind::Sog => sog::sog(&source.all()?, intake),
    }
}

/// Returns the kind of an unread file by its first bytes.
fn kind_of(source: &mut Source) -> Result<FileKind, Fault> {
    let n = source.left.min(PROBED_BYTES as u64) as usize;
    let start = source.peek(n).map_err(read_fault)?;
    if start.starts_with(b"ply\n") || start.starts_with(b"ply\r") {
        Ok(FileKind::Ply)
    } else if start.starts_with(b"glTF") {
        Ok(FileKind::Glb)
    } else if text_of(start).starts_with(b"{") {
        Ok(FileKind::Gltf)
    } else if spz::read::is_plain(start) || spz::read::is_gzip(start) {
        Ok(FileKind::Spz)
    } else if sog::is_zip(start) {
        Ok(FileKind::Sog)
    } else if is_likely(start) {
        // Last, because this format has no magic bytes.
        Ok(FileKind::Splat)
    } else {
        let found = match start {
            [] => "an empty file".to_owned(),
            _ => {
                let start = String::from_utf8_lossy(start.get(..16).unwrap_or(start));
                format!("a file starting \"{}\"", shorten(&start))
            }
        };
        Err(Fault::NotAModel { found })
    }
}

/// Opens a file; returns its size in bytes as well.
fn open_file(path: &Path) -> Result<(File, u64), Fault> {
    // Checked before opening: opening a FIFO blocks until it has a writer, and a device may never end.
    let kind = std::fs::metadata(path).map_err(read_fault)?.file_type();
    if !kind.is_file() {
        return Err(if kind.is_dir() { Fault::IsFolder } else { Fault::IsStream });
    }
    let file = File::open(path).map_err(read_fault)?;
    let size = file.metadata().map_err(read_fault)?.len();
    Ok((file, size))
}

pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, Fault> {
    let (file, size) = open_file(path)?;
    Ok(Source::of_file(&file, size).all()?.into_owned())
}

fn read_fault(source: std::io::Error) -> Fault {
    match source.kind() {
        ErrorKind::NotFound => Fault::Missing,
        _ => Fault::Io { action: "read", source },
    }
}

/// Size of the part of a file that is in memory, bytes.
const BLOCK: usize = 1 << 16;

/// Unread bytes of a model, in memory or in a file of which a block is in memory. Clones read independently.
#[derive(Clone)]
pub(super) struct Source<'a> {
    block: Cow<'a, [u8]>,
    /// Number of bytes of the block that were read.
    at: usize,
    /// File that continues the block, and the place where it does.
    file: Option<(&'a File, u64)>,
    /// Number of unread bytes.
    pub left: u64,
}

impl<'a> Source<'a> {
    pub fn of_bytes(bytes: &'a [u8]) -> Self {
        Self { block: Cow::Borrowed(bytes), at: 0, file: None, left: bytes.len() as u64 }
    }

    fn of_file(file: &'a File, size: u64) -> Self {
        Self { block: Cow::default(), at: 0, file: Some((file, 0)), left: size }
    }

    /// Returns unread bytes, at least `n`.
    pub fn peek(&mut self, n: usize) -> IoResult<&[u8]> {
        let there = self.block.len() - self.at;
        if n > there {
            let (Some((mut file, next)), true) = (self.file, n as u64 <= self.left) else {
                return Err(ErrorKind::UnexpectedEof.into());
            };
            let mut bytes = std::mem::take(&mut self.block).into_owned();
            bytes.drain(..self.at);
            bytes.resize(self.left.min(n.max(BLOCK) as u64) as usize, 0);
            file.seek(SeekFrom::Start(next))?;
            file.read_exact(bytes.get_mut(there..).unwrap_or_default())?;
            self.file = Some((file, next + (bytes.len() - there) as u64));
            (self.block, self.at) = (bytes.into(), 0);
        }
        Ok(self.block.get(self.at..).unwrap_or_default())
    }

    /// Reads the next `n` bytes.
    pub fn take(&mut self, n: usize) -> IoResult<&[u8]> {
        self.peek(n)?;
        (self.at, self.left) = (self.at + n, self.left - n as u64);
        Ok(self.block.get(self.at - n..self.at).unwrap_or_default())
    }

    pub fn skip(&mut self, n: u64) -> IoResult<()> {
        self.left = self.left.checked_sub(n).ok_or(ErrorKind::UnexpectedEof)?;
        let there = (self.block.len() - self.at) as u64;
        self.at += n.min(there) as usize;
        self.file = self.file.map(|(file, next)| (file, next + n.saturating_sub(there)));
        Ok(())
    }

    /// Reads the rest.
    fn all(self) -> Result<Cow<'a, [u8]>, Fault> {
        let Some((mut file, next)) = self.file else {
            return Ok(match self.block {
                Cow::Borrowed(bytes) => Cow::Borrowed(bytes.get(self.at..).unwrap_or_default()),
                Cow::Owned(mut bytes) => Cow::Owned(bytes.split_off(self.at)),
            });
        };
        let room =
            usize::try_from(self.left).map_err(|_| Fault::OutOfMemory { bytes: self.left })?;
        let mut bytes = try_with_capacity(room)?;
        let start = next - (self.block.len() - self.at) as u64;
        file.seek(SeekFrom::Start(start))
            .and_then(|_| file.take(self.left).read_to_end(&mut bytes))
            .map_err(read_fault)?;
        Ok(Cow::Owned(bytes))
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

fn read_splat(mut source: Source, intake: Intake) -> Result<Imported, Fault> {
    let size = source.left;
    let n = size / ROW_BYTES as u64;
    if !size.is_multiple_of(ROW_BYTES as u64) {
        let expected = format!("a multiple of {ROW_BYTES} bytes");
        return Err(Fault::malformed(".splat", expected, format!("{size} bytes")));
    }
    if n > intake.max_splats as u64 {
        return Err(Fault::TooMany { declared: n, cap: intake.max_splats });
    }
    let mut rows = Rows::with_capacity(n as usize, false, size, intake)?;
    for _ in 0..n {
        let record = source.take(ROW_BYTES).map_err(read_fault)?;
        let record = record.first_chunk().unwrap_or(&[0; ROW_BYTES]);
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
            seen: DVec3::ZERO,
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
