//! Photographs inside a video, extracted by the installed `ffmpeg`.
//!
//! Phones store colour as HEVC, whose decoders are large and encumbered by patents. Users of such videos
//! usually have `ffmpeg`. It runs once, when the first photograph is requested, into a temporary folder
//! that is deleted with the dataset. Folders of killed processes are deleted before the next extraction.

use super::error::FrameProblem;
use super::folder::{RetryingFile, is_file};
use crate::math::camera::Intrinsics;
use glam::{DVec2, DVec3};
use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::Duration;
use tempfile::{Builder, TempDir};

#[derive(Debug)]
pub(super) struct Video {
    pub path: PathBuf,
    frames: OnceLock<Result<ExtractionFolder, String>>,
}

impl Video {
    pub fn new(path: PathBuf) -> Self {
        Self { path, frames: OnceLock::new() }
    }

    pub fn is_ffmpeg_available() -> bool {
        let version = Command::new("ffmpeg").arg("-version").stdin(Stdio::null()).output();
        version.is_ok_and(|output| output.status.success())
    }

    pub fn frame(&self, index: usize) -> Result<PathBuf, FrameProblem> {
        // The first caller extracts the frames; concurrent ones wait for its result.
        let unpacked = self.frames.get_or_init(|| extract_frames(&self.path));
        let folder = unpacked.as_ref().map_err(|found| FrameProblem::Video(found.clone()))?;
        let file = folder.path.path().join(format!("{index:06}.jpg"));
        match is_file(&file)? {
            true => Ok(file),
            false => Err(FrameProblem::Video(format!("no frame {index} in it"))),
        }
    }
}

/// Largest number of pictures that are unpacked; that of 70 minutes at 60 Hz is smaller.
const MAX_UNPACKED: usize = 1 << 18;

/// Names of the ffmpeg option that extracts every frame once: since ffmpeg 5.1, and in older versions.
const EVERY_FRAME: [&str; 2] = ["-fps_mode", "-vsync"];

fn extract_frames(path: &Path) -> Result<ExtractionFolder, String> {
    let temporary = std::env::temp_dir();
    ExtractionFolder::remove_leftovers(&temporary);
    let folder = ExtractionFolder::create_in(&temporary).map_err(|e| e.to_string())?;
    // An absolute path: a relative name may start with a dash or a protocol prefix.
    let video = std::path::absolute(path).map_err(|e| e.to_string())?;
    let [option, older] = EVERY_FRAME;
    let mut output = run(&video, folder.path.path(), option)?;
    // Only for this error: any other would just occur twice.
    if !output.status.success() && first_line(&output).contains(option.trim_start_matches('-')) {
        output = run(&video, folder.path.path(), older)?;
    }
    match output.status.success() {
        true => Ok(folder),
        false => Err(first_line(&output)),
    }
}

/// Temporary folder with the photographs of a video, or with the files of an archive.
#[derive(Debug)]
pub(super) struct ExtractionFolder {
    pub path: TempDir,
    /// Locked as long as the process lives; the system releases the lock of a killed one.
    _lock: File,
}

impl ExtractionFolder {
    const PREFIX: &str = "vbgs-studio-unpacked-";
    const LOCK: &str = "lock";
    /// Age of a folder that is surely locked if its process lives.
    const SETTLED: Duration = Duration::from_secs(60);

    pub fn create_in(temporary: &Path) -> io::Result<Self> {
        let path = Builder::new().prefix(Self::PREFIX).tempdir_in(temporary)?;
        let lock = File::create_new(path.path().join(Self::LOCK))?;
        // On a file system without locks, leftovers stay; nothing else depends on the lock.
        let _ = lock.lock();
        Ok(Self { path, _lock: lock })
    }

    /// Deletes the folders of killed processes. Other users may write to `temporary`, so no link is followed.
    pub fn remove_leftovers(temporary: &Path) {
        let Ok(entries) = fs::read_dir(temporary) else { return };
        for entry in entries.flatten() {
            let is_ours = entry.file_name().to_str().is_some_and(|n| n.starts_with(Self::PREFIX));
            if !is_ours || !entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                continue;
            }
            let lock = entry.path().join(Self::LOCK);
            let is_settled = |found: fs::Metadata| {
                let age = found.modified().ok().and_then(|time| time.elapsed().ok());
                found.is_file() && age.is_some_and(|age| age > Self::SETTLED)
            };
            if lock.symlink_metadata().is_ok_and(is_settled)
                && File::open(&lock).is_ok_and(|lock| lock.try_lock().is_ok())
            {
                // Errors are ignored: only space is lost.
                let _ = fs::remove_dir_all(entry.path());
            }
        }
    }
}

fn run(video: &Path, folder: &Path, every_frame: &str) -> Result<Output, String> {
    let mut ffmpeg = Command::new("ffmpeg");
    // Without rotation metadata: the camera matrix refers to the sensor's orientation.
    // The file alone: a crafted one could name others, or addresses, as its parts.
    ffmpeg.args(["-nostdin", "-v", "error", "-protocol_whitelist", "file"]);
    ffmpeg.args(["-f", "mov", "-noautorotate", "-i"]).arg(video);
    ffmpeg.args(["-frames:v", &MAX_UNPACKED.to_string()]);
    // `-q:v 2` is the best JPEG quality within ffmpeg's default limits; numbers start at 0, as frames do.
    ffmpeg.args([every_frame, "passthrough", "-q:v", "2", "-start_number", "0"]);
    let output = ffmpeg.arg(folder.join("%06d.jpg")).output();
    output.map_err(|e| format!("ffmpeg cannot be run ({e})"))
}

fn first_line(output: &Output) -> String {
    let message = String::from_utf8_lossy(&output.stderr);
    message.lines().next().unwrap_or("a failure of ffmpeg without a message").to_owned()
}

/// Largest size of a video's index, bytes; that of hours is smaller.
const MAX_INDEX: u64 = 64 << 20;
/// Largest number of pictures; that of 19 hours at 60 Hz is smaller.
const MAX_PICTURES: usize = 1 << 22;

/// Reads the times of an MP4 or MOV video's pictures, seconds, in the order in which they are shown.
/// Returns `None` for other or damaged files.
pub(super) fn picture_times(path: &Path) -> Option<Vec<f64>> {
    let mut file = RetryingFile::open(path).ok()?;
    loop {
        let mut head = [0; 16];
        file.read_exact(&mut head[..8]).ok()?;
        let mut rest = u64::from(u32_at(&head, 0)?).checked_sub(8);
        if rest.is_none() && u32_at(&head, 0)? == 1 {
            file.read_exact(&mut head[8..]).ok()?;
            rest = u64::from_be_bytes(*head[8..].first_chunk()?).checked_sub(16);
        }
        let rest = rest?;
        if &head[4..8] == b"moov" {
            let mut index = Vec::new();
            // Read until the file's end at most, whatever size is stated.
            file.take(rest.min(MAX_INDEX)).read_to_end(&mut index).ok()?;
            return times_in_index(&index);
        }
        file.seek(SeekFrom::Current(i64::try_from(rest).ok()?)).ok()?;
    }
}

fn times_in_index(index: &[u8]) -> Option<Vec<f64>> {
    let is_video = |track: &&[u8]| {
        let handler = find_box(track, &[b"mdia", b"hdlr"]);
        handler.and_then(|handler| handler.get(8..12)) == Some(b"vide")
    };
    let track = boxes(index).filter(|(kind, _)| kind == b"trak").map(|(_, t)| t).find(is_video)?;
    let header = find_box(track, &[b"mdia", b"mdhd"])?;
    let ticks = time_scale(header)?;
    let table = |kind| find_box(track, &[b"mdia", b"minf", b"stbl", kind]);
    let steps = runs(table(b"stts")?)?;
    let mut delays = table(b"ctts").and_then(runs).unwrap_or_default().into_iter();
    let start = edit_start(track, time_scale(find_box(index, &[b"mvhd"])?)?, ticks);
    let mut decoded = 0.0;
    let mut times = Vec::with_capacity(steps.len());
    for step in steps {
        // Signed in newer files; writers of older ones keep it small.
        let delay = delays.next().map_or(0, u32::cast_signed);
        times.push((decoded + f64::from(delay)) / ticks + start);
        decoded += f64::from(step);
    }
    times.sort_by(f64::total_cmp);
    Some(times)
}

/// Returns the time at which the first picture's clock starts, seconds.
fn edit_start(track: &[u8], movie_ticks: f64, ticks: f64) -> f64 {
    let Some(list) = find_box(track, &[b"edts", b"elst"]) else { return 0.0 };
    let is_wide = list.first() == Some(&1);
    let mut start = 0.0;
    for entry in list.get(8..).unwrap_or_default().chunks_exact(if is_wide { 20 } else { 12 }) {
        let (length, media) = match is_wide {
            true => (u64_at(entry, 0), u64_at(entry, 8).map(u64::cast_signed)),
            false => (
                u32_at(entry, 0).map(u64::from),
                u32_at(entry, 4).map(|time| i64::from(time.cast_signed())),
            ),
        };
        let (Some(length), Some(media)) = (length, media) else { break };
        // An empty edit delays the pictures; the next one states where in them the video begins.
        if media >= 0 {
            return start - media as f64 / ticks;
        }
        start += length as f64 / movie_ticks;
    }
    start
}

/// Expands a table of pairs of count and value.
fn runs(table: &[u8]) -> Option<Vec<u32>> {
    let pairs = table.get(8..)?.chunks_exact(8).take(u32_at(table, 4)? as usize);
    let mut values = Vec::new();
    for pair in pairs {
        let (count, value) = (u32_at(pair, 0)? as usize, u32_at(pair, 4)?);
        if values.len().saturating_add(count) > MAX_PICTURES {
            return None;
        }
        values.resize(values.len() + count, value);
    }
    Some(values)
}

fn time_scale(header: &[u8]) -> Option<f64> {
    let ticks = u32_at(header, if header.first()? == &1 { 20 } else { 12 })?;
    (ticks > 0).then_some(f64::from(ticks))
}

fn find_box<'a>(bytes: &'a [u8], path: &[&[u8; 4]]) -> Option<&'a [u8]> {
    path.iter().try_fold(bytes, |inside, kind| Some(boxes(inside).find(|(k, _)| k == *kind)?.1))
}

/// Iterates over the boxes in a box: kind and content. Ends at a damaged one.
fn boxes(mut bytes: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    std::iter::from_fn(move || {
        let size = u32_at(bytes, 0)? as usize;
        let kind = *bytes.get(4..)?.first_chunk()?;
        let content = bytes.get(8..size)?;
        bytes = bytes.get(size..)?;
        Some((kind, content))
    })
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_be_bytes(*bytes.get(at..)?.first_chunk()?))
}

/// Readout time of a Kinect v1 photograph, seconds.
pub(super) const KINECT_COLOR: f64 = 0.0261;
/// Readout time of a Kinect v1 depth image, seconds.
pub(super) const KINECT_DEPTH: f64 = 0.0305;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct RollingShutter {
    /// Rotation of the camera from the readout of the first row to that of the last row. The rotation
    /// vector is in radians, in camera axes (x right, y down).
    pub rotation: DVec3,
}

impl RollingShutter {
    /// True if the rotation displaces every row by less than half a pixel.
    pub fn is_negligible(&self, k: &Intrinsics) -> bool {
        self.rotation.length() * k.fx.max(k.fy) < 1.0
    }

    /// Finds the recorded position of the point that the camera sees along `slope` (x/z, y/z) at the
    /// middle row's time. Returns the slope of the point in the recorded image, and a factor. The factor
    /// converts recorded depth along the optical axis to depth along the middle row's axis.
    pub fn source_direction(&self, k: &Intrinsics, slope: DVec2) -> (DVec2, f64) {
        let ray = slope.extend(1.0);
        // Rotation to first order: within a readout of about 30 ms it is small.
        let across = self.rotation.cross(ray);
        // The row depends on the unknown direction; the estimate is exact to second order in the rotation.
        let rows = 1.0 / f64::from(k.height);
        let middle = (slope.y * k.fy + k.cy) * rows - 0.5;
        let row = middle / (1.0 + k.fy * rows * (across.y - slope.y * across.z));
        let seen = ray - row * across;
        let factor = 1.0 / seen.z;
        (factor * seen.truncate(), factor)
    }
}

#[cfg(test)]
mod extraction_tests {
    use super::*;
    use std::time::SystemTime;

    #[test]
    fn folders_of_killed_processes_alone_are_deleted() {
        let temporary = tempfile::tempdir().unwrap();
        let made = |name: &str, age_s: u64| {
            let folder = temporary.path().join(name);
            fs::create_dir(&folder).unwrap();
            fs::write(folder.join("000000.jpg"), "picture").unwrap();
            let lock = File::create_new(folder.join(ExtractionFolder::LOCK)).unwrap();
            lock.set_modified(SystemTime::now() - Duration::from_secs(age_s)).unwrap();
            (folder, lock)
        };
        let dead = made("vbgs-studio-unpacked-dead", 100).0;
        let young = made("vbgs-studio-unpacked-young", 1).0;
        let foreign = made("other-video-dead", 100).0;
        let (alive, lock) = made("vbgs-studio-unpacked-alive", 100);
        lock.lock().unwrap();
        let unlocked = temporary.path().join("vbgs-studio-unpacked-without");
        fs::create_dir(&unlocked).unwrap();
        let mut kept = vec![young, foreign.clone(), alive, unlocked];
        #[cfg(unix)]
        {
            let link = temporary.path().join("vbgs-studio-unpacked-link");
            std::os::unix::fs::symlink(&foreign, &link).unwrap();
            kept.push(link);
        }
        ExtractionFolder::remove_leftovers(temporary.path());
        assert!(!dead.exists());
        assert!(kept.iter().all(|folder| folder.exists()), "{kept:?}");
        assert!(foreign.join("000000.jpg").exists());
    }

    #[test]
    fn a_folder_is_locked_and_deleted_with_its_dataset() {
        let folder = ExtractionFolder::create_in(&std::env::temp_dir()).unwrap();
        let path = folder.path.path().to_owned();
        let other = File::open(path.join(ExtractionFolder::LOCK)).unwrap();
        assert!(other.try_lock().is_err());
        drop(folder);
        assert!(!path.exists());
    }
}

#[cfg(test)]
mod rolling_shutter_tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn a_row_saw_what_a_camera_turned_by_its_time_sees() {
        let k = Intrinsics::from_horizontal_fov(640, 480, 1.0);
        let shutter = RollingShutter { rotation: DVec3::new(0.01, -0.03, 0.02) };
        assert!(!shutter.is_negligible(&k) && RollingShutter::default().is_negligible(&k));
        for slope in [DVec2::new(0.3, -0.35), DVec2::new(-0.2, 0.3), DVec2::new(0.4, 0.0)] {
            let (at, factor) = shutter.source_direction(&k, slope);
            let row = (at.y * k.fy + k.cy) / f64::from(k.height) - 0.5;
            // A point that the row recorded 2 units ahead, in the axes of the middle row's camera.
            let turned = DQuat::from_scaled_axis(row * shutter.rotation) * (2.0 * at.extend(1.0));
            assert!((turned.truncate() / turned.z - slope).length() < 3e-4, "{turned}");
            assert!((2.0 * factor - turned.z).abs() < 1e-3, "{factor} {turned}");
        }
    }
}
