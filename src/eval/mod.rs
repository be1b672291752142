//! Quality of a model, and reports of runs.
#![doc = include_str!("eval.md")]

pub mod aligned;
pub mod choices;
pub mod comparison;
mod control_group;
pub mod cracks;
pub mod learnt;
pub mod machine;
pub mod measure;
pub mod memory;
pub mod metrics;
pub mod near;
pub mod report;
pub mod scale;
pub mod seen;
pub mod sharpness;
pub mod sizes;
pub mod spread;
pub mod ssim;
pub mod surfaces;
pub mod table;
pub mod trajectory_error;
pub mod view_alignment;
pub mod views;

mod partial_coverage;
mod reproject;
mod sweep;
