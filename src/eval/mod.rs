//! Quality of a model, and how runs report themselves.

pub mod metrics;
pub mod report;
pub mod views;
