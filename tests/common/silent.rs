//! Simulates a drive that does not respond: opening a file blocks (`silent_file.c`).

use super::skip::skip;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A file whose opening blocks until this is dropped.
pub struct SilentFile {
    holder: Child,
}

impl SilentFile {
    /// Blocks opening of a file from now on; `None` if the file system cannot do so, outside strict mode.
    /// `scratch` is the folder for the helper program.
    #[track_caller]
    pub fn hold(scratch: &Path, file: &Path) -> Option<Self> {
        let program = scratch.join("silent_file");
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/common/silent_file.c");
        let compiled = Command::new("cc").arg(source).arg("-o").arg(&program).status();
        assert!(compiled.unwrap().success());
        let mut holder = Command::new(program)
            .arg(file)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = String::new();
        BufReader::new(holder.stdout.as_mut().unwrap()).read_line(&mut said).unwrap();
        let silent = Self { holder };
        match said.trim() {
            "held" => Some(silent),
            _ => skip(
                "this file system does not support leases",
                "use another folder for temporary files",
            ),
        }
    }
}

impl Drop for SilentFile {
    /// Unblocks the file, so that no thread stays blocked.
    fn drop(&mut self) {
        drop(self.holder.stdin.take());
        let _ = self.holder.wait();
    }
}

/// Encodes a 16-bit PNG depth image that contains only holes.
pub fn image_of_holes(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::ImageBuffer::<image::Luma<u16>, _>::new(width, height);
    image::DynamicImage::ImageLuma16(image).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}
