//! Declaration of settings: ranges, parsing of values, and the tables that define every option once.

mod preset;
mod range;
pub mod table;
pub mod value;

pub use preset::Preset;
pub use range::{ConfigError, MAX_COMPONENTS};
