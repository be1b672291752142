//! What the settings of both presets share: ranges, values as a user says them, and the tables that
//! declare every option once.

mod preset;
mod range;
pub mod table;
pub mod value;

pub use preset::Preset;
pub use range::{ConfigError, MAX_COMPONENTS};
