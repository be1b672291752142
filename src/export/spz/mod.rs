//! SPZ (`export.md`, SPZ): one column of bytes an attribute, compressed together by gzip up to version
//! 3 and each by itself with Zstandard in version 4. Files are y-up, x right and z backward, as
//! glTF's are; splats here are z-up.

mod columns;
mod container;
#[expect(clippy::indexing_slicing, reason = "places among four, of two bits each")]
mod quantise;
pub(super) mod read;
#[expect(clippy::indexing_slicing, reason = "writes splats in an order of their own numbers")]
pub(super) mod write;
