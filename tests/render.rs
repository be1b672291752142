//! The CPU renderer against golden pixels and its f64 oracle, the oracle against the laws of both
//! renderers, and the image metrics.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod common;
mod render {
    mod conic;
    mod exactness;
    mod golden;
    mod hostile;
    mod images;
    mod laws;
    mod look;
    mod metrics;
    mod native;
}

use vbgs_studio::math::camera::Camera;
use vbgs_studio::model::appearance::SplatView;
use vbgs_studio::model::splats::Splat;
use vbgs_studio::render::cpu::{CpuRenderer, Rendered};
use vbgs_studio::render::{Method, RenderOptions, Support};

/// What the CPU renderer draws.
const CPU_METHODS: [Method; 2] =
    [Method::Projected(Support::Alpha), Method::Projected(Support::Tile3Sigma)];

/// One image by a renderer of its own.
fn draw<'a>(
    splats: impl Into<SplatView<'a>>,
    camera: &Camera,
    options: &RenderOptions,
) -> Rendered {
    CpuRenderer::new().render(splats, camera, options)
}

/// Every number of an image.
fn bits(image: &Rendered) -> Vec<u32> {
    let planes = image.coverage.data.iter().chain(&image.depth.data);
    image.color.data.as_flattened().iter().chain(planes).map(|v| v.to_bits()).collect()
}

/// A white ball of 0.1 at the origin.
fn ball(opacity: f32) -> Splat {
    Splat { opacity, color: [1.0; 3], scale: [0.1; 3], ..Splat::default() }
}
