//! SPZ (`export.md`, SPZ): one column of bytes an attribute, compressed together by gzip up to version
//! 3 and each by itself with Zstandard in version 4. Files are y-up, x right and z backward, as
//! glTF's are; splats here are z-up.

mod columns;
mod container;
mod quantise;
pub(super) mod read;
pub(super) mod write;
