//! Quality of a model, and reports of runs.
#![doc = include_str!("../../docs/design/evaluation.md")]

pub mod choices;
mod comparison;
pub mod cracks;
mod detail;
mod machine;
pub mod metrics;
pub mod near;
pub mod report;
pub mod scale;
pub mod seen;
mod sharpness;
pub mod ssim;
mod surfaces;
pub mod trajectory_error;
mod view_alignment;
pub mod views;
