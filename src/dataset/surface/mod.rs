//! Frames to observations (`dataset.md`, Plane fit): a robust plane is fitted around every pixel in inverse
//! depth, pixels that no plane explains are dropped, the others take its depth and normal.
//!
//! | stage | file |
//! |---|---|
//! | codes to depth, noise and the status of every pixel | `planes` |
//! | a plane around every pixel, in blocks of eight | `fit` |
//! | depth, normal, colour of the pixels that are kept | `emit`, `color_lookup`, `seen` |
//!
//! Inverse depth, because it is affine in the pixel on a plane: the fit is linear and exact there,
//! where depth itself would bend. A fit also is the filter of flying pixels: what mixes two surfaces
//! lies on neither plane.

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
