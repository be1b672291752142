//! What renderers draw and files hold: splats, their appearance and the exposure of the frames
//! they were learnt from.

pub mod appearance;
pub mod exposure;
pub mod splats;
