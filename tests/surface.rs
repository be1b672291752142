//! Frames to observations, against known planes, the oracle and real recordings.
#![allow(clippy::unwrap_used)]

mod common;

#[path = "surface/agreement.rs"]
mod agreement;
