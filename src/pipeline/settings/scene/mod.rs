//! Settings of the scene preset: what a user may say, and what becomes of it on a dataset.

pub mod error;
pub mod run;
mod start;
pub mod table;

pub use error::SceneError;
pub use run::SceneRun;
pub use table::SceneOverrides;
