//! Settings of a run: what a user asks, and what becomes of it on a dataset.

pub mod method;
mod published;
mod sample;
pub mod scene;
mod units;

pub use published::preset_file;
