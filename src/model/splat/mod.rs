//! What renderers draw and files hold: splats, their appearance, and exposure and poses of the frames
//! they were learnt from.

pub mod appearance;
pub mod exposure;
pub mod framing;
pub mod observed_cone;
pub mod plain;
pub mod pose_log;
pub mod splats;
pub mod viewpoint;
