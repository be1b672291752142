//! Compares whole images with the oracle, within the tolerances of `rendering.md`, Tolerances.

use super::oracle::{Oracle, Sample};
use vbgs_studio::math::image::Image;
use vbgs_studio::render::cpu::Rendered;
use vbgs_studio::render::{ALPHA_CUT, TRANSMITTANCE_STOP};

/// Relative distance within which a value counts as lying on a threshold.
const THRESHOLD_BAND: f64 = 1e-4;
/// Distance in texels, and relative change of a cosine, within which f32 may place a look-up.
pub const LOOK_UP_BAND: f64 = 1e-3;
/// Largest error of the few pixels that may exceed the tolerance.
const LOOSE: f64 = 1e-2;

/// Statistics of the comparison of an image with the oracle's.
#[derive(Debug, Default)]
pub struct Agreement {
    pub n_pixels: usize,
    /// Pixels over the tolerance that are explained by a value crossing a threshold.
    pub n_branched: usize,
    /// Other pixels over the tolerance.
    pub n_loose: usize,
    /// Largest error of a channel among pixels within the tolerance.
    pub worst: f64,
    /// Their summed errors over the number of all pixels.
    pub mean: f64,
    /// Their largest error of the depth.
    pub worst_depth: f64,
    /// Pixels with coverage above 0.5.
    pub n_covered: usize,
}

impl Agreement {
    /// Compares all pixels. Counts those that differ by more than `close`; they may differ by at most 1e-2
    /// unless a threshold explains the difference.
    pub fn of(found: &Image<Sample>, oracle: &Oracle, close: f64, label: &str) -> Self {
        let truth = oracle.render();
        assert_eq!((found.width, found.height), (truth.width, truth.height), "{label}");
        let mut agreement = Self { n_pixels: truth.data.len(), ..Self::default() };
        let mut sum = 0.0;
        for (index, (found, expected)) in found.data.iter().zip(&truth.data).enumerate() {
            let (i, j) = (index % truth.width, index / truth.width);
            agreement.n_covered += usize::from(expected.rgba[3] > 0.5);
            let error = largest_error(found, expected);
            if error <= close {
                sum += error;
                agreement.worst = agreement.worst.max(error);
                let depth_error = (found.depth - expected.depth).abs();
                agreement.worst_depth = agreement.worst_depth.max(depth_error);
            } else if branches(oracle, i, j).iter().any(|b| largest_error(found, b) <= close) {
                agreement.n_branched += 1;
            } else {
                assert!(error <= LOOSE, "{label} ({i}, {j}): {found:?} for {expected:?}");
                agreement.n_loose += 1;
            }
        }
        agreement.mean = sum / agreement.n_pixels as f64;
        agreement
    }

    /// Panics unless at most 0.1 % of the pixels exceed the tolerance without a threshold as explanation, and
    /// at most the given share with one. Opaque splats put many pixels on a threshold: two alphas at the cap
    /// leave a transmittance of 1e-4, which is the stop.
    pub fn assert_close(&self, share_on_thresholds: f64, label: &str) {
        let n_pixels = self.n_pixels as f64;
        assert!(self.n_loose as f64 <= 1e-3 * n_pixels, "{label}: {self:?}");
        assert!(self.n_branched as f64 <= share_on_thresholds * n_pixels, "{label}: {self:?}");
    }
}

/// Converts an image to samples; `n_blended` is 0.
pub fn samples(image: &Rendered) -> Image<Sample> {
    let planes = image.coverage.data.iter().zip(&image.depth.data);
    let data = image.color.data.iter().zip(planes).map(|(color, (coverage, depth))| {
        let [r, g, b] = color.map(f64::from);
        Sample { rgba: [r, g, b, f64::from(*coverage)], depth: f64::from(*depth), n_blended: 0 }
    });
    Image::from_vec(image.color.width, image.color.height, data.collect())
}

/// Largest absolute error of the four channels.
pub fn largest_error(found: &Sample, expected: &Sample) -> f64 {
    let pairs = found.rgba.iter().zip(&expected.rgba);
    pairs.fold(0.0, |worst, (f, e)| if (f - e).abs() <= worst { worst } else { (f - e).abs() })
}

/// Possible results of a pixel if rounding moved a value across a threshold.
pub fn branches(oracle: &Oracle, i: usize, j: usize) -> Vec<Sample> {
    let moved = [1.0 - THRESHOLD_BAND, 1.0 + THRESHOLD_BAND];
    let pairs = moved.into_iter().flat_map(|cut| moved.map(|stop| (cut, stop)));
    let at = |oracle: &Oracle, (cut, stop)| {
        oracle.with_thresholds(ALPHA_CUT * cut, TRANSMITTANCE_STOP * stop).pixel(i, j)
    };
    let oracles = oracle.texture_branches(LOOK_UP_BAND);
    pairs.flat_map(|pair| oracles.iter().map(move |oracle| at(oracle, pair))).collect()
}
