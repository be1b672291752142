//! Golden pixels of every case and variant, and the settings of the published renderers.

use crate::common::agreement::{branches, largest_error, samples};
use crate::common::oracle::{Oracle, Sample};
use crate::common::render_cases::{GoldenView, golden_views};
use crate::draw;
use std::collections::BTreeMap;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::{Exposing, RenderOptions, Renderer};

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

#[test]
fn only_the_projected_one_of_the_published_renderers_widens_a_thin_splat() {
    let intrinsics = Intrinsics { width: 8, height: 8, fx: 20.0, fy: 20.0, cx: 4.0, cy: 4.0 };
    let camera = Camera { intrinsics, pose: Pose::IDENTITY };
    // 0.005 pixels wide, between four pixel centres.
    let thin = Splat { mean: [0.0, 0.0, 4.0], opacity: 0.9, scale: [1e-3; 3], ..Splat::default() };
    let coverage = |options| draw(&[thin], &camera, &options).coverage.data[3 * 8 + 3];
    let published = |renderer| coverage(RenderOptions::published(renderer, [0.0; 3]));
    // Half a squared pixel from the centre, with a variance of 0.3 px².
    let widened = 0.9 * (-0.5f32 * 0.5 / 0.3).exp();
    assert!((published(Renderer::Projected) - widened).abs() < 1e-3);
    assert_eq!(published(Renderer::Exact), 0.0);
    let evaluated = coverage(RenderOptions::evaluation(Renderer::Exact.into(), [0.0; 3]));
    assert!((evaluated - widened).abs() < 1e-2, "{evaluated}");
}

#[test]
fn published_settings_differ_from_evaluations_in_exposure_and_the_exact_renderer() {
    for renderer in [Renderer::Projected, Renderer::Exact] {
        let evaluation = RenderOptions::evaluation(renderer.into(), [0.0; 3]);
        let published = RenderOptions::published(renderer, [0.0; 3]);
        let is_projected = renderer == Renderer::Projected;
        assert_eq!(published.method == evaluation.method, is_projected, "{renderer}");
        let modes = [evaluation, published].map(|options| options.exposure_mode);
        assert_eq!(modes, [Exposing::Recorded, Exposing::Neutral]);
        let RenderOptions { method, exposure_mode, .. } = evaluation;
        assert_eq!(RenderOptions { method, exposure_mode, ..published }, evaluation, "{renderer}");
    }
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
