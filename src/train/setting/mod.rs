//! Declaration of settings: ranges, parsing of values, and the tables that define every option once.

pub mod table;
pub mod value;

pub use value::{ConfigError, MAX_COMPONENTS, Preset};
