//! Sharpness: fine detail of a photograph that a render reproduces (`evaluation.md`, Sharpness).
//!
//! PSNR is hardly sensitive to sharpness: the finest bands contain little energy, and a blurred edge has a
//! smaller error than a displaced sharp one. Bands are therefore compared separately, by energy and
//! correlation.
//!
//! Both images are decomposed with the same masked blur, so neither the border nor uncovered areas count as
//! detail.

use super::comparison::COVERED;
use super::metrics;
use super::metrics::MetricError;
use super::ssim::ssim;
use crate::math::image::{Image, RgbImage};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Number of octave bands: details of about 1, 2, 4 and 8 pixels.
pub(super) const N_BANDS: usize = 4;
/// Binomial taps of the blur between two bands (Burt and Adelson 1983).
const TAPS: [f64; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];
/// Weights of red, green and blue in luma (BT.601), on encoded values.
const LUMA: [f64; 3] = [0.299, 0.587, 0.114];
/// Variance of a photograph's band (values in `[0, 1]`) below which it has no detail to compare.
const MIN_ENERGY: f64 = 1e-9;
/// Ratio of a render's energy to the photograph's, below which the render's detail is rounding noise.
const ROUNDING: f64 = 1e-12;

/// Comparison of one octave band.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SharpnessBand {
    /// Ratio of the render's energy in the band to the photograph's: 1 if equally sharp, less if
    /// blurred, more with spurious detail.
    pub energy_ratio: f64,
    /// Correlation of the bands of render and photograph, −1 to 1. It is high if detail is in the right
    /// places.
    pub correlation: f64,
}

/// Compares the luma of two images over covered pixels and returns the bands from the finest. Returns
/// `None` if the photograph has no detail in some band, or no pixel is covered. All images have equal
/// size.
pub(super) fn bands(
    render: &RgbImage,
    coverage: &Image<f32>,
    truth: &RgbImage,
) -> Option<[SharpnessBand; N_BANDS]> {
    let mask: Vec<f64> = coverage.data.iter().map(|&a| f64::from(u8::from(a >= COVERED))).collect();
    let n_covered: f64 = mask.iter().sum();
    let width = render.width;
    let mut levels = [luma(render), luma(truth)];
    let mut found = [SharpnessBand { energy_ratio: 0.0, correlation: 0.0 }; N_BANDS];
    for (octave, band) in found.iter_mut().enumerate() {
        let share = blurred(&mask, width, 1 << octave);
        let coarser = levels.each_ref().map(|level| {
            let kept: Vec<f64> = level.iter().zip(&mask).map(|(v, m)| v * m).collect();
            let sums = blurred(&kept, width, 1 << octave);
            // Includes the pixel's own weight, so the divisor is positive.
            let mean =
                |((sum, share), m): ((f64, &f64), &f64)| if *m > 0.0 { sum / share } else { 0.0 };
            sums.into_iter().zip(&share).zip(&mask).map(mean).collect::<Vec<f64>>()
        });
        let [mut rr, mut tt, mut rt] = [0.0; 3];
        for (i, m) in mask.iter().enumerate() {
            let [r, t] = [0, 1].map(|image| m * (levels[image][i] - coarser[image][i]));
            (rr, tt, rt) = (rr + r * r, tt + t * t, rt + r * t);
        }
        // Also covers NaN and images without pixels.
        if tt.is_nan() || tt <= MIN_ENERGY * n_covered {
            return None;
        }
        // A render without detail leaves rounding noise, whose correlation is meaningless.
        let correlation = if rr > ROUNDING * tt { rt / (rr * tt).sqrt() } else { 0.0 };
        *band = SharpnessBand { energy_ratio: rr / tt, correlation };
        levels = coarser;
    }
    Some(found)
}

pub(super) fn mean(views: &[[SharpnessBand; N_BANDS]]) -> Option<[SharpnessBand; N_BANDS]> {
    let mut means = *views.first()?;
    for (i, band) in means.iter_mut().enumerate() {
        band.energy_ratio = metrics::mean(views.iter().map(|bands| bands[i].energy_ratio))?;
        band.correlation = metrics::mean(views.iter().map(|bands| bands[i].correlation))?;
    }
    Some(means)
}

/// Returns the SSIM of the gradient magnitudes per channel (after Chen, Yang and Xie 2006). It is
/// insensitive to brightness, and low if edges are missing or blurred.
pub(super) fn gradient_ssim(render: &RgbImage, truth: &RgbImage) -> Result<f64, MetricError> {
    ssim(&gradients(render), &gradients(truth))
}

/// Returns a quarter of the Sobel gradient magnitude, so that a step from 0 to 1 has length 1. Border
/// pixels are repeated beyond the border.
fn gradients(image: &RgbImage) -> Image<[f64; 3]> {
    let Image { width, height, .. } = *image;
    let mut out = Image::filled(width, height, [0.0; 3]);
    out.data.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, out)| {
        let rows = [row.saturating_sub(1), row, (row + 1).min(height - 1)];
        for (column, out) in out.iter_mut().enumerate() {
            let columns = [column.saturating_sub(1), column, (column + 1).min(width - 1)];
            *out = std::array::from_fn(|channel| {
                let at = |i: usize, j: usize| f64::from(image.at(columns[i], rows[j])[channel]);
                let side = |i: usize| at(i, 0) + 2.0 * at(i, 1) + at(i, 2);
                let edge = |j: usize| at(0, j) + 2.0 * at(1, j) + at(2, j);
                0.25 * f64::hypot(side(2) - side(0), edge(2) - edge(0))
            });
        }
    });
    out
}

fn luma(image: &RgbImage) -> Vec<f64> {
    let of = |pixel: &[f32; 3]| pixel.iter().zip(LUMA).map(|(v, w)| f64::from(*v) * w).sum();
    image.data.iter().map(of).collect()
}

/// Blurs values with a separable filter whose taps are `step` pixels apart (à trous). Values beyond the
/// border count as zero. Spreading the taps, rather than shrinking the image, yields every band at every
/// pixel.
fn blurred(values: &[f64], width: usize, step: usize) -> Vec<f64> {
    let height = values.len() / width.max(1);
    let reach = |at: usize, end: usize| {
        let offsets = TAPS.iter().enumerate();
        offsets.filter_map(move |(i, tap)| {
            let source = (at + i * step).checked_sub(2 * step)?;
            (source < end).then_some((source, *tap))
        })
    };
    let mut across = vec![0.0; values.len()];
    across.par_chunks_mut(width.max(1)).zip(values.par_chunks(width.max(1))).for_each(
        |(out, row)| {
            for (column, out) in out.iter_mut().enumerate() {
                *out = reach(column, width).map(|(source, tap)| tap * row[source]).sum();
            }
        },
    );
    let mut both = vec![0.0; values.len()];
    both.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, out)| {
        // By rows, which are contiguous in memory.
        for (source, tap) in reach(row, height) {
            let line = &across[source * width..][..width];
            out.iter_mut().zip(line).for_each(|(out, value)| *out += tap * value);
        }
    });
    both
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    const SIZE: (usize, usize) = (48, 36);

    /// Returns noise on smooth waves, which has detail in every band.
    fn picture() -> RgbImage {
        let mut rng = Rng::new(7, Purpose::Synthetic, 0);
        let pixel = |i: usize| {
            let (x, y) = ((i % SIZE.0) as f64, (i / SIZE.0) as f64);
            let wave = 0.1 * (0.3 * x).sin() + 0.1 * (0.4 * y).cos();
            std::array::from_fn(|_| (0.5 + wave + 0.2 * (rng.uniform() - 0.5)) as f32)
        };
        Image::from_vec(SIZE.0, SIZE.1, (0..SIZE.0 * SIZE.1).map(pixel).collect())
    }

    fn soft(image: &RgbImage) -> RgbImage {
        let mut out = image.clone();
        for channel in 0..3 {
            let plane: Vec<f64> = image.data.iter().map(|p| f64::from(p[channel])).collect();
            let one = blurred(&vec![1.0; plane.len()], image.width, 1);
            let sums = blurred(&plane, image.width, 1);
            let mean = sums.iter().zip(one).map(|(s, n)| s / n);
            out.data.iter_mut().zip(mean).for_each(|(p, v)| p[channel] = v as f32);
        }
        out
    }

    #[test]
    fn an_image_is_as_sharp_as_itself() {
        let (image, coverage) = (picture(), Image::filled(SIZE.0, SIZE.1, 1.0));
        for band in bands(&image, &coverage, &image).unwrap() {
            assert_eq!(band.energy_ratio, 1.0);
            assert!((band.correlation - 1.0).abs() < 1e-12);
        }
        assert!((gradient_ssim(&image, &image).unwrap() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_blurred_copy_lacks_energy_and_keeps_its_places() {
        let (image, coverage) = (picture(), Image::filled(SIZE.0, SIZE.1, 1.0));
        let copy = soft(&image);
        let found = bands(&copy, &coverage, &image).unwrap();
        assert!(found[0].energy_ratio < 0.1 && found[1].energy_ratio < 0.85, "{found:?}");
        assert!(found[0].energy_ratio < found[1].energy_ratio, "{found:?}");
        assert!(found[3].energy_ratio > 0.8 && found[3].correlation > 0.95, "{found:?}");
        assert!(found[1].correlation > 0.9, "{found:?}");
        assert!(gradient_ssim(&copy, &image).unwrap() < 0.7);
    }

    #[test]
    fn a_shifted_copy_has_energy_in_the_wrong_places() {
        let (image, coverage) = (picture(), Image::filled(SIZE.0, SIZE.1, 1.0));
        let mut copy = image.clone();
        copy.data.rotate_right(3);
        let found = bands(&copy, &coverage, &image).unwrap();
        assert!((found[0].energy_ratio - 1.0).abs() < 0.1, "{found:?}");
        assert!(found[0].correlation.abs() < 0.2, "{found:?}");
    }

    #[test]
    fn what_is_not_covered_does_not_count() {
        let image = picture();
        let mut coverage = Image::filled(SIZE.0, SIZE.1, 1.0);
        let mut render = image.clone();
        for i in 0..SIZE.0 * SIZE.1 / 2 {
            (coverage.data[i], render.data[i]) = (0.1, [1.0, 0.0, 1.0]);
        }
        for band in bands(&render, &coverage, &image).unwrap() {
            assert_eq!(band.energy_ratio, 1.0);
        }
        assert_eq!(bands(&render, &coverage.map(|_| 0.0), &image), None);
        let flat = Image::filled(SIZE.0, SIZE.1, [0.5; 3]);
        assert_eq!(bands(&image, &coverage, &flat), None, "no detail to compare with");
        let found = bands(&flat, &Image::filled(SIZE.0, SIZE.1, 1.0), &image).unwrap();
        assert!(found[0].energy_ratio < 1e-20 && found[0].correlation == 0.0, "{found:?}");
    }
}
