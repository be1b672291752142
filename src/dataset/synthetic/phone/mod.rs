//! Model of a phone that records the scene: photographs with varying exposure and motion blur, lidar depth,
//! and poses with drift.

pub(super) mod camera;
pub(super) mod contents;
pub(super) mod walk;

mod lidar;
