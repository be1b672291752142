#[cfg(feature = "gui")]
pub mod gpu;
