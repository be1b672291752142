//! Comparison of images with the f64 oracle.

use crate::common::agreement::LOOK_UP_BAND;
use crate::common::oracle::{Oracle, Sample};
use vbgs_studio::math::camera::Camera;
use vbgs_studio::math::image::Image;
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::render::{ALPHA_CUT, RenderOptions, TRANSMITTANCE_STOP};

/// `rendering.md`, Tolerances: half-float accumulation.
pub const TOLERANCE: f64 = 4e-3;
/// Every layer rounds, so a few pixels with many layers may have this error.
const LOOSE: f64 = 1e-2;
const LOOSE_SHARE: f64 = 0.003;
/// Mean error of a channel: half a level of an 8-bit screen.
const MEAN: f64 = 0.5 / 255.0;

/// Relative distance of an alpha to the cut, and of a transmittance to the stop, within which either branch is
/// right. The transmittance of opaque splats has few digits left.
const CUT_BAND: f64 = 2e-4;
const STOP_BAND: f64 = 1e-3;

/// Oracle of what the GPU draws: black background.
pub fn oracle<'a>(
    splats: impl Into<SplatView<'a>>,
    camera: &Camera,
    options: &RenderOptions,
) -> Oracle {
    let options = RenderOptions { background: [0.0; 3], ..*options };
    Oracle::of(splats, camera, &options)
}

/// Panics if pixels exceed the tolerance without a reason, if too many do, or if one does by far.
pub fn assert_close(image: &Image<[f32; 4]>, oracle: &Oracle, label: &str) {
    let truth = oracle.render();
    assert_eq!((image.width, image.height), (truth.width, truth.height), "{label}");
    let (mut worst, mut sum, mut n_at_cut, mut n_loose) = (0.0f64, 0.0, 0, 0);
    for (index, (found, expected)) in image.data.iter().zip(&truth.data).enumerate() {
        let (i, j) = (index % truth.width, index / truth.width);
        let error = error(found, expected);
        sum += error;
        if error <= TOLERANCE {
            worst = worst.max(error);
        } else if is_near_threshold(found, oracle, [i, j], 0.0) {
            // Not counted: two splats of the largest alpha leave exactly the stop.
        } else if is_near_threshold(found, oracle, [i, j], CUT_BAND) {
            n_at_cut += 1;
        } else {
            assert!(error <= LOOSE, "{label} ({i}, {j}): {found:?} for {expected:?}");
            n_loose += 1;
        }
    }
    let n_pixels = truth.data.len() as f64;
    let mean = sum / n_pixels;
    println!("{label}: mean {mean:.1e}, worst {worst:.1e}, {n_at_cut} at the cut, {n_loose} loose");
    assert!(f64::from(n_at_cut) <= 0.02 * n_pixels, "{label}: {n_at_cut} pixels at the cut");
    assert!(f64::from(n_loose) <= LOOSE_SHARE * n_pixels, "{label}: {n_loose} pixels loose");
    assert!(mean <= MEAN, "{label}: mean {mean:e}");
}

/// True if the pixel matches the oracle with the stop, and the alpha cut by `cut_band`, moved up or down.
fn is_near_threshold(found: &[f32; 4], oracle: &Oracle, [i, j]: [usize; 2], cut_band: f64) -> bool {
    let stops = [1.0 - STOP_BAND, 1.0, 1.0 + STOP_BAND];
    let moved =
        [1.0 - cut_band, 1.0 + cut_band].into_iter().flat_map(|cut| stops.map(|s| (cut, s)));
    let oracles = oracle.texture_branches(LOOK_UP_BAND);
    moved.into_iter().any(|(cut, stop)| {
        oracles.iter().any(|oracle| {
            let thresholds = oracle.with_thresholds(ALPHA_CUT * cut, TRANSMITTANCE_STOP * stop);
            error(found, &thresholds.pixel(i, j)) <= TOLERANCE
        })
    })
}

/// Largest error of a channel; the oracle clamps colours to 1.
pub fn error(found: &[f32; 4], expected: &Sample) -> f64 {
    let pairs = found.iter().zip(&expected.rgba);
    pairs.fold(0.0, |worst, (found, expected)| {
        let error = (f64::from(*found).min(1.0) - expected).abs();
        if error <= worst { worst } else { error }
    })
}

pub fn largest_difference(a: &Image<[f32; 4]>, b: &Image<[f32; 4]>) -> f32 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let channels = a.data.iter().flatten().zip(b.data.iter().flatten());
    channels.fold(0.0, |worst, (x, y)| if (x - y).abs() <= worst { worst } else { (x - y).abs() })
}
