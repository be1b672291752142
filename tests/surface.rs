//! Frames to observations, against known planes, the oracle and real recordings.
#![allow(clippy::unwrap_used)]

mod common;

#[path = "surface/agreement.rs"]
mod agreement;
#[path = "surface/calibration.rs"]
mod calibration;
#[path = "surface/drawn.rs"]
mod drawn;
#[path = "surface/fates.rs"]
mod fates;
#[path = "surface/planes.rs"]
mod planes;
