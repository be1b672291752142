//! Training data of one frame: normalised points for the published algorithm, measured surfaces for the
//! scene preset. `dataset` creates them, `train` consumes them.

pub mod points;
pub mod surface;
