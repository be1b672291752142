//! Splat rendering: conventions shared by all renderers (`rendering.md`, Conventions).
//!
//! Colours are sRGB-encoded and blended in that encoding. Alpha is premultiplied: an image is
//! `C + T·background` with transmittance `T` and coverage `A = 1 − T`. Camera axes follow OpenCV;
//! the centre of pixel `(i, j)` is at `(i + ½, j + ½)`.
#![doc = include_str!("../../docs/design/rendering.md")]

pub mod attributes;
pub mod compare;
pub mod finish;
mod options;
pub mod pick;

pub mod cpu;
#[cfg(feature = "gui")]
pub mod gpu;

pub use options::{
    ALPHA_CAP, ALPHA_CUT, Antialias, DisplayStyle, EVALUATION_NEAR, ExactOptions, Exposing,
    FOOTPRINT_PX2, FRUSTUM_MARGIN, LOW_PASS_PX2, Lens, MAX_SCALE_FLOOR_RATIO, POINT_SCALE, Paint,
    REFERENCE_VARIANCE, RenderMethod, RenderOptions, Renderer, Response, SCALE_FLOOR, TILE,
    TRANSMITTANCE_STOP, VIEWPORT_NEAR_SHARE, near_plane_for, scale_floor,
};
