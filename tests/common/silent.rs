//! Files on a drive that does not answer: whoever opens one waits, by the system's own (`silent_file.c`).

use super::skip::skip;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A file that does not answer until the end of the test.
pub struct SilentFile {
    holder: Child,
}

impl SilentFile {
    /// A file that does not answer from now on; `None` where files cannot be held and need not be. `scratch`
    /// is for the program that holds it.
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
            _ => skip("this file system knows no leases", "use another folder for temporary files"),
        }
    }
}

impl Drop for SilentFile {
    /// It answers, so that no thread is left behind.
    fn drop(&mut self) {
        drop(self.holder.stdin.take());
        let _ = self.holder.wait();
    }
}

/// A 16-bit depth image without a surface.
pub fn image_of_holes(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::ImageBuffer::<image::Luma<u16>, _>::new(width, height);
    image::DynamicImage::ImageLuma16(image).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}
