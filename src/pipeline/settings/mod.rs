//! Settings of a run: what a user asks, and what becomes of it on a dataset.

pub mod method;
mod presets;
pub mod scene;

pub use presets::{Foreign, GivenSettings, preset_file};
