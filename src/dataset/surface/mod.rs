//! Converts frames to observations (`dataset.md`, Plane fit). A robust plane is fitted around every pixel
//! in inverse depth; pixels without an accepted plane are dropped, the others take its depth and normal.
//!
//! | stage | file |
//! |---|---|
//! | codes to depth, noise and pixel status | `planes` |
//! | plane fit around every pixel, in blocks of eight | `fit` |
//! | depth, normal and colour of kept pixels | `emit`, `color_lookup`, `seen` |
//!
//! Inverse depth of a plane is affine in pixel coordinates, so the fit is linear and exact; depth itself is
//! not affine. The fit also filters flying pixels: a mixture of two surfaces lies on neither plane.

pub mod sample;
pub mod sampling;
pub mod sensor;
pub mod settings;
pub mod status;

mod color_lookup;
mod emit;
mod fit;
mod photographed;
mod planes;
mod preparer;
mod projection;
mod recipe;
mod seen;

pub use preparer::Preparer;
pub use sampling::PixelSampling;
pub use sensor::Sensor;
pub use settings::SurfaceSettings;
pub use status::{PixelStatus, SurfaceCounts};
