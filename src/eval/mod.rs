//! Quality of a model, and reports of runs.
#![doc = include_str!("../../docs/design/evaluation.md")]

pub mod choices;
pub mod comparison;
pub mod cracks;
pub mod metrics;
pub mod near;
pub mod report;
pub mod scale;
pub mod seen;
pub mod sharpness;
pub mod ssim;
pub mod surfaces;
pub mod trajectory_error;
pub mod view_alignment;
pub mod views;
