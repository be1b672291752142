//! A phone that records the scene: photographs of varying exposure and with motion blur, depth as a
//! lidar reports it, and poses that drift.

pub(super) mod camera;
pub(super) mod contents;
pub(super) mod drift;
pub(super) mod walk;

mod door;
mod exposure;
mod fields;
mod lidar;
mod parts;
