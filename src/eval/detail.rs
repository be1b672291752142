//! Detail: how much of a photograph's fine structure a render has in the right place (`evaluation.md`,
//! Sharpness).

use super::comparison::COVERED;
use super::metrics;
use super::report::ViewReport;
use super::sharpness::{SharpnessBand, bands};
use crate::math::image::{Image, RgbImage};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Least number of covered pixels: what the two blurs of the second octave combine, 13 × 13.
const MIN_PIXELS: usize = 13 * 13;

/// Correlation of render and photograph in the two finest octaves of luma, −1 to 1, of one view or as the
/// mean over views. It is 1 if all detail is in the right place, whatever its contrast.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Detail {
    /// Correlation in the finest octave, details of about one pixel.
    pub finest: f64,
    /// Correlation in the second octave, details of about two pixels.
    pub second: f64,
}

impl Detail {
    /// Compares two images of equal size over covered pixels. Returns `None` for fewer than
    /// [`MIN_PIXELS`] of them, or if the photograph has no detail there.
    pub(super) fn compare(
        render: &RgbImage,
        coverage: &Image<f32>,
        truth: &RgbImage,
    ) -> Option<Self> {
        let n_covered = coverage.data.iter().filter(|&&a| a >= COVERED).count();
        (n_covered >= MIN_PIXELS)
            .then(|| bands(render, coverage, truth))?
            .map(|bands| Self::of_bands(&bands))
    }

    pub(super) fn of_bands([finest, second]: &[SharpnessBand; 2]) -> Self {
        Self { finest: finest.correlation, second: second.correlation }
    }

    /// Returns the means over the views that have detail, or `None` without such views.
    pub fn mean(views: &[ViewReport]) -> Option<Self> {
        let of = |value: fn(Self) -> f64| {
            metrics::mean(views.iter().filter_map(|view| view.detail.map(value)))
        };
        Some(Self { finest: of(|detail| detail.finest)?, second: of(|detail| detail.second)? })
    }
}

/// Formats both correlations with two decimals and no zero before the point: `.26 .53`.
impl fmt::Display for Detail {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Adding zero removes the sign of a rounded negative zero.
        let short = |value: f64| {
            format!("{:.2}", (100.0 * value).round() / 100.0 + 0.0).replacen("0.", ".", 1)
        };
        write!(f, "{} {}", short(self.finest), short(self.second))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::sharpness::tests::{SIZE, naive_blur, picture, soft};
    use crate::math::rng::{Purpose, Rng};

    fn everywhere() -> Image<f32> {
        Image::filled(SIZE.0, SIZE.1, 1.0)
    }

    fn oracle(render: &RgbImage, coverage: &Image<f32>, truth: &RgbImage) -> [f64; 2] {
        let mask: Vec<bool> = coverage.data.iter().map(|&a| a >= 0.5).collect();
        let luma = |p: &[f32; 3]| {
            let [r, g, b] = p.map(f64::from);
            0.299 * r + 0.587 * g + 0.114 * b
        };
        let mut levels: Vec<Vec<f64>> =
            [render, truth].iter().map(|image| image.data.iter().map(luma).collect()).collect();
        [1, 2].map(|step| {
            let mut bands = Vec::new();
            for level in &mut levels {
                let coarser = naive_blur(level, &mask, SIZE.0, step);
                let band = level.iter().zip(&coarser).map(|(fine, coarse)| fine - coarse);
                bands.push(band.zip(&mask).filter(|(_, m)| **m).map(|(v, _)| v).collect());
                *level = coarser;
            }
            let product =
                |a: &Vec<f64>, b: &Vec<f64>| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let [r, t]: &[Vec<f64>; 2] = bands.as_slice().try_into().unwrap();
            product(r, t) / (product(r, r) * product(t, t)).sqrt()
        })
    }

    #[test]
    fn it_is_what_the_definition_gives() {
        let (truth, mut rng) = (picture(), Rng::new(3, Purpose::Synthetic, 0));
        let render = soft(&truth).map(|p| p.map(|v| v + 0.1 * (rng.uniform() as f32 - 0.5)));
        // Holes of several pixels, of single ones, and none.
        for share in [0.5, 0.95, 1.1] {
            let coverage = everywhere().map(|_| f32::from(u8::from(rng.uniform() < share)));
            let found = Detail::compare(&render, &coverage, &truth).unwrap();
            let [finest, second] = oracle(&render, &coverage, &truth);
            assert!((found.finest - finest).abs() < 1e-12, "{found:?} for {finest}");
            assert!((found.second - second).abs() < 1e-12, "{found:?} for {second}");
            assert!(finest < second && finest > 0.1, "{found:?}");
        }
    }

    #[test]
    fn the_same_picture_has_all_detail_and_a_blurred_one_less() {
        let (truth, coverage) = (picture(), everywhere());
        let same = Detail::compare(&truth, &coverage, &truth).unwrap();
        assert!((same.finest - 1.0).abs() < 1e-12 && (same.second - 1.0).abs() < 1e-12);
        assert_eq!(same.to_string(), "1.00 1.00");
        let found = Detail::compare(&soft(&soft(&truth)), &coverage, &truth).unwrap();
        assert!(found.finest < 0.8 && found.second > found.finest, "{found:?}");
    }

    #[test]
    fn contrast_and_brightness_do_not_change_it() {
        let (truth, coverage) = (picture(), everywhere());
        let render = soft(&truth);
        let before = Detail::compare(&render, &coverage, &truth).unwrap();
        let pale = render.map(|p| p.map(|v| 0.4 * v + 0.3));
        let after = Detail::compare(&pale, &coverage, &truth).unwrap();
        assert!((before.finest - after.finest).abs() < 1e-4, "{before:?} {after:?}");
        assert!((before.second - after.second).abs() < 1e-4, "{before:?} {after:?}");
    }

    #[test]
    fn the_threads_do_not_change_it() {
        let (truth, coverage) = (picture(), everywhere());
        let render = soft(&truth);
        let by = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Detail::compare(&render, &coverage, &truth).unwrap())
        };
        assert_eq!(by(1), by(3));
    }

    #[test]
    fn what_has_no_detail_to_compare_has_no_value() {
        let (truth, coverage) = (picture(), everywhere());
        let flat = Image::filled(SIZE.0, SIZE.1, [0.4; 3]);
        assert_eq!(Detail::compare(&truth, &coverage, &flat), None);
        let nothing = Detail::compare(&flat, &coverage, &truth).unwrap();
        assert_eq!(nothing, Detail { finest: 0.0, second: 0.0 });
        let mut corner = coverage.map(|_| 0.0);
        corner.data[..MIN_PIXELS - 1].fill(1.0);
        assert_eq!(Detail::compare(&truth, &corner, &truth), None);
        corner.data[MIN_PIXELS] = 1.0;
        assert!(Detail::compare(&truth, &corner, &truth).is_some());
        for side in 0..4 {
            let tiny = Image::from_vec(side, side, truth.data[..side * side].to_vec());
            assert_eq!(Detail::compare(&tiny, &tiny.map(|_| 1.0), &tiny), None);
        }
        assert_eq!(Detail::mean(&[]), None);
        assert_eq!(Detail { finest: -0.001, second: -0.257 }.to_string(), ".00 -.26");
    }
}
