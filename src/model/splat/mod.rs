//! Splats as drawn and as stored in files: their appearance, and exposures and poses of the training frames.

pub mod appearance;
pub mod framing;
pub mod observed_cone;
pub mod pose_log;
pub mod splats;
pub mod texture;
pub mod viewpoint;
