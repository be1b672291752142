//! Golden pixels of every case and variant.

use crate::common::agreement::{branches, largest_error, samples};
use crate::common::oracle::{Oracle, Sample};
use crate::common::render_cases::{GoldenView, golden_views};
use crate::draw;
use std::collections::BTreeMap;
use vbgs_studio::model::splat::splats::Splat;

/// See `rendering.md`, Tolerances.
const F64_TOLERANCE: f64 = 1e-9;
const F32_TOLERANCE: f64 = 2e-5;
/// Relative tolerance of depth in f32: division by a coverage of 1/255 leaves about five digits.
const F32_DEPTH_TOLERANCE: f64 = 1e-4;

/// Pinhole pixels in five variants, fisheye pixels in the four variants that support them.
const N_PIXELS: usize = (105 - 7) * 5 + 7 * 4;

#[test]
fn the_oracle_draws_golden_pixels() {
    let views = golden_views();
    let (mut n_pixels, mut worst) = (0, BTreeMap::new());
    for view in &views {
        let oracle = Oracle::new(&view.splats, &view.camera, &view.options);
        for (pixel, expected) in &view.pixels {
            let found = oracle.pixel(pixel[0], pixel[1]);
            let error = largest_error(&found, expected).max((found.depth - expected.depth).abs());
            let label = format!("{} {} {pixel:?}", view.case, view.variant);
            let error = error - (1.0 - expected.rgba[3]) * view.background_rounding;
            assert!(error <= F64_TOLERANCE, "{label}: {found:?} for {expected:?}");
            assert_eq!(found.n_blended, expected.n_blended, "{label}");
            note(&mut worst, view, error);
            n_pixels += 1;
        }
    }
    println!("golden, oracle: {n_pixels} pixels, beyond the rounding of backgrounds {worst:?}");
    assert_eq!(n_pixels, N_PIXELS);
}

#[test]
fn the_cpu_renderer_draws_golden_pixels() {
    let views = golden_views();
    let (mut n_pixels, mut worst, mut on_threshold) = (0, BTreeMap::new(), Vec::new());
    for view in &views {
        let oracle = Oracle::new(&view.splats, &view.camera, &view.options);
        let splats: Vec<Splat> = view.splats.iter().map(Splat::from).collect();
        let image = samples(&draw(&splats, &view.camera, &view.options));
        for ([i, j], expected) in &view.pixels {
            let (i, j) = (*i, *j);
            let found = image.at(i, j);
            n_pixels += 1;
            if matches(found, expected) {
                note(&mut worst, view, largest_error(found, expected));
                continue;
            }
            let either = branches(&oracle, i, j);
            assert!(
                either.iter().any(|branch| matches(found, branch)),
                "{} {} ({i}, {j}): {found:?}, expected {expected:?} or one of {either:?}",
                view.case,
                view.variant
            );
            on_threshold.push(view.case.as_str());
        }
    }
    println!("golden, CPU: {n_pixels} pixels, worst {worst:?}, other branch: {on_threshold:?}");
    assert!(on_threshold.iter().all(|n| ["opacity_one_cap", "cutoff_boundary"].contains(n)));
    assert_eq!(n_pixels, N_PIXELS);
}

fn note(worst: &mut BTreeMap<&'static str, f64>, view: &GoldenView, error: f64) {
    let entry = worst.entry(view.variant).or_insert(0.0);
    *entry = entry.max(error);
}

fn matches(found: &Sample, expected: &Sample) -> bool {
    let depth_error = (found.depth - expected.depth).abs();
    largest_error(found, expected) <= F32_TOLERANCE
        && depth_error <= F32_DEPTH_TOLERANCE * expected.depth.abs()
}
