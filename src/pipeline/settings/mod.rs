//! Settings of a run: the user's values, and their result on a dataset.

pub mod method;
mod presets;
pub mod scene;

pub use presets::{ForeignSetting, GivenSettings, preset_file};
