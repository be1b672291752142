//! Golden pixels of both renderers.

use super::device::Gpu;
use crate::common::oracle::{Oracle, Sample};
use crate::common::render_cases::{GoldenView, golden_views};
use std::collections::BTreeMap;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::gpu::GpuError;
use vbgs_studio::render::{ALPHA_CUT, TRANSMITTANCE_STOP};

/// Half floats resolve a channel to 2.4e-4; a golden pixel blends up to forty splats.
const TOLERANCE: f64 = 2e-3;
/// Relative distance to the alpha cut and the transmittance stop within which a pixel counts as on it. The
/// transmittance of opaque splats has few digits left.
const CUT_BAND: f64 = 1e-4;
const STOP_BAND: f64 = 1e-3;

#[test]
fn golden_pixels_of_every_renderer() {
    let views = golden_views();
    let Some(gpu) = Gpu::new() else { return };
    let mut worst: BTreeMap<(&str, &str), f64> = BTreeMap::new();
    let mut n_pixels: BTreeMap<&str, usize> = BTreeMap::new();
    for view in &views {
        let splats: Vec<Splat> = view.splats.iter().map(Splat::from).collect();
        if ["exact_line", "exact_ref"].contains(&view.variant) {
            assert_cpu_only(&gpu, view, &splats);
            continue;
        }
        let image = gpu.image(&splats, &view.camera, &view.options);
        for ([i, j], expected) in &view.pixels {
            let found = over(image.at(*i, *j), view.options.background);
            let label = format!("{} {} ({i}, {j})", view.case, view.variant);
            let error = error_of(view, [*i, *j], &found, expected);
            assert!(error <= TOLERANCE, "{label}: {found:?} for {:?}", expected.rgba);
            let worst = worst.entry((view.variant, &view.case)).or_default();
            *worst = worst.max(error);
            *n_pixels.entry(view.variant).or_default() += 1;
        }
    }
    for ((variant, case), worst) in &worst {
        println!("{variant} {case}: {worst:.1e}");
    }
    println!("golden pixels {n_pixels:?}");
    assert_eq!((n_pixels["projected"], n_pixels["exact"]), (98, 105));
    assert_eq!(n_pixels["exact_footprint"], 105);
    gpu.assert_no_faults();
}

/// Error of a pixel. On a threshold either branch is right.
fn error_of(view: &GoldenView, [i, j]: [usize; 2], found: &[f64; 4], expected: &Sample) -> f64 {
    let error = |sample: &Sample| {
        let pairs = found.iter().zip(&sample.rgba);
        pairs.map(|(found, expected)| (found - expected).abs()).fold(0.0, f64::max)
    };
    let plain = error(expected);
    if plain <= TOLERANCE {
        return plain;
    }
    let oracle = Oracle::new(&view.splats, &view.camera, &view.options);
    let cuts = [1.0 - CUT_BAND, 1.0 + CUT_BAND];
    let stops = [1.0 - STOP_BAND, 1.0 + STOP_BAND];
    let branches = cuts.into_iter().flat_map(|cut| stops.map(|stop| (cut, stop)));
    branches
        .map(|(cut, stop)| {
            error(&oracle.with_thresholds(ALPHA_CUT * cut, TRANSMITTANCE_STOP * stop).pixel(i, j))
        })
        .fold(plain, f64::min)
}

fn over(texel: &[f32; 4], background: [f32; 3]) -> [f64; 4] {
    let coverage = f64::from(texel[3]);
    std::array::from_fn(|channel| match background.get(channel) {
        Some(behind) => {
            let value = f64::from(texel[channel]) + (1.0 - coverage) * f64::from(*behind);
            value.clamp(0.0, 1.0)
        }
        None => coverage,
    })
}

fn assert_cpu_only(gpu: &Gpu, view: &GoldenView, splats: &[Splat]) {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let scene = gpu.scene(splats);
    let refused = gpu.renderer().render(
        &gpu.device,
        &gpu.queue,
        &mut encoder,
        &scene,
        &view.camera,
        &view.options,
    );
    assert!(matches!(refused, Err(GpuError::CpuOnly { .. })), "{}: {refused:?}", view.variant);
}
