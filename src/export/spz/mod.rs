//! SPZ (`files.md`, SPZ): one column of bytes per attribute. Up to version 3 all are compressed together
//! with gzip; in version 4 each is a Zstandard stream. Files are y-up with x right and z backward, as in
//! glTF; splats in memory are z-up.

#[expect(clippy::indexing_slicing, reason = "indices are two bits, into arrays of four")]
mod quantise;
pub(super) mod read;
#[expect(clippy::indexing_slicing, reason = "writes splats in a permutation of their own indices")]
pub(super) mod write;
