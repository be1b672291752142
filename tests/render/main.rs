//! The CPU renderer against golden pixels and its f64 oracle, the oracle against the definitions of both
//! renderers, and the image metrics.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

#[path = "../common/mod.rs"]
mod common;
mod conic;
mod exactness;
mod golden;
mod hostile;
mod images;
mod laws;
mod look;
mod metrics;
mod native;
mod photometric;

use common::agreement::{Agreement, samples};
use common::oracle::Oracle;
use vbgs_studio::math::camera::Camera;
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::RenderOptions;
use vbgs_studio::render::cpu::{CpuRenderer, Rendered};

/// Renders one image with a new renderer.
fn draw<'a>(
    splats: impl Into<SplatView<'a>>,
    camera: &Camera,
    options: &RenderOptions,
) -> Rendered {
    CpuRenderer::new().render(splats, camera, options)
}

/// See `rendering.md`, Tolerances.
const F32_TOLERANCE: f64 = 1e-4;

/// Compares a whole image of the CPU renderer with the oracle's.
fn agreement(view: SplatView, camera: &Camera, options: &RenderOptions, label: &str) -> Agreement {
    let oracle = Oracle::of(view, camera, options);
    let found = samples(&draw(view, camera, options));
    let agreement = Agreement::of(&found, &oracle, F32_TOLERANCE, label);
    println!("{label}: {agreement:?}");
    agreement
}

/// Bits of every value of an image.
fn bits(image: &Rendered) -> Vec<u32> {
    let planes = image.coverage.data.iter().chain(&image.depth.data);
    image.color.data.as_flattened().iter().chain(planes).map(|v| v.to_bits()).collect()
}

/// White ball with a deviation of 0.1 at the origin.
fn ball(opacity: f32) -> Splat {
    Splat { opacity, color: [1.0; 3], scale: [0.1; 3], ..Splat::default() }
}
