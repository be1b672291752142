//! Settings of the scene preset: the user's values, and their result on a dataset.

pub mod error;
pub mod run;
mod start;
pub mod table;

pub use error::SceneError;
pub use run::SceneRun;
pub use table::SceneOverrides;
