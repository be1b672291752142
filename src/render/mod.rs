//! Splat rendering: conventions shared by all renderers (`rendering.md`, Conventions).
//!
//! Colours are sRGB-encoded and blended in that encoding. Alpha is premultiplied: an image is
//! `C + T·background` with transmittance `T` and coverage `A = 1 − T`. Camera axes follow OpenCV;
//! the centre of pixel `(i, j)` is at `(i + ½, j + ½)`.
#![doc = include_str!("rendering.md")]

pub mod attributes;
pub mod compare;
mod constants;
pub mod finish;
mod lens;
mod options;
pub mod outline;
pub mod paint;
pub mod pick;

pub mod cpu;
#[cfg(feature = "gui")]
pub mod gpu;

pub use constants::{
    ALPHA_CAP, ALPHA_CUT, EVALUATION_NEAR, FOOTPRINT_PX2, FRUSTUM_MARGIN, LOW_PASS_PX2,
    MAX_SCALE_FLOOR_RATIO, POINT_SCALE, REFERENCE_VARIANCE, SCALE_FLOOR, TILE, TRANSMITTANCE_STOP,
    VIEWPORT_NEAR_SHARE, near_plane_for, scale_floor,
};
pub use options::{
    Antialias, DisplayStyle, ExactOptions, Exposing, Lens, Paint, RenderMethod, RenderOptions,
    Renderer, Response, Support,
};
