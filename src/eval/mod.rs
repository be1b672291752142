//! How good an image is.

pub mod metrics;
