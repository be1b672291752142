//! Numerics, geometry, containers and checks of foreign text, shared by all layers.
//!
//! Nothing here depends on mixtures, files or windows. Lengths are in world units (metres if the
//! dataset is metric), angles in radians, colours sRGB-encoded in `[0, 1]`.

pub mod camera;
pub mod camera_path;
pub mod cholesky;
pub mod fixed;
pub mod foreign;
pub mod image;
pub mod least_squares;
pub mod measured_pixel;
pub mod orbit;
pub mod pose;
pub mod real;
pub mod rng;
pub mod simd;
pub mod special;
pub mod sym3;
