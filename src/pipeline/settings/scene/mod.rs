//! Settings of the scene preset: what a user may say, and what becomes of it on a dataset.

pub mod error;
pub mod run;
mod start;
pub mod table;

pub use crate::pipeline::settings::units::{Budget, DEFAULT_PIXELS, NEARER_SHARE, StructuralScale};
pub use error::{DepthAdvice, SceneError};
pub use run::SceneRun;
pub use table::SceneOverrides;
