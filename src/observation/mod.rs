//! What one frame says: normalised points for the published algorithm, measured surfaces for the
//! scene preset. `dataset` makes them, `train` learns from them.

pub mod photograph;
pub mod points;
pub mod surface;
