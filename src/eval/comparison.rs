//! Comparison of a render with its photograph: over the whole frame, over covered pixels, and with colours
//! aligned (`evaluation.md`, Covered and aligned).
//!
//! The three scores measure the whole frame, the part that the model represents, and the error without
//! exposure differences. The alignment is fitted per view by least squares, because cameras with
//! automatic exposure change it per frame.

use super::metrics::{MetricError, decibels, is_left_out, same_size};
use super::ssim::ssim;
use crate::math::image::{Image, RgbImage};
use rayon::prelude::*;

/// Accumulated opacity from which a pixel counts as covered.
pub(super) const COVERED: f32 = 0.5;

/// Similarity of a render and its photograph, with PSNR in dB.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Comparison {
    pub psnr: f64,
    pub ssim: f64,
    /// Share of pixels with coverage ≥ [`COVERED`].
    pub coverage: f64,
    /// Scores that require covered pixels; `None` if no pixel is covered.
    pub covered: Option<Covered>,
}

/// Scores that require covered pixels; those named `aligned` are measured with colours aligned.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Covered {
    pub psnr: f64,
    pub aligned_psnr: f64,
    /// PSNR over the whole frame with the colours of covered pixels aligned, dB.
    pub aligned_psnr_frame: f64,
    pub aligned_ssim: f64,
    /// The render with colours aligned.
    pub aligned: RgbImage,
}

/// Colour alignment per channel, `gain · colour + offset`: the least-squares fit of a render to its
/// photograph. It compensates differences of exposure and white balance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Alignment {
    pub gain: [f64; 3],
    pub offset: [f64; 3],
}

/// Compares a render with its photograph. The colour alignment is fitted and applied to covered pixels
/// only. Other pixels show the background, which is not part of the model.
pub(super) fn compare(
    render: &RgbImage,
    coverage: &Image<f32>,
    truth: &RgbImage,
) -> Result<Comparison, MetricError> {
    same_size(render, truth, "ground truth")?;
    same_size(render, coverage, "coverage")?;
    let sums = Sums::of(render, coverage, truth);
    if sums.n_pixels == 0 {
        return Err(MetricError::NoPixels);
    }
    let covered = match sums.n_covered {
        0 => None,
        _ => {
            let aligned = sums.alignment().apply(render, coverage);
            // Recomputed rather than derived from the fit: clamping to `[0, 1]` changes the error.
            let after = Sums::of(&aligned, coverage, truth);
            Some(Covered {
                psnr: sums.psnr_covered(),
                aligned_psnr: after.psnr_covered(),
                aligned_psnr_frame: after.psnr(),
                aligned_ssim: ssim(&aligned, truth)?,
                aligned,
            })
        }
    };
    Ok(Comparison {
        psnr: sums.psnr(),
        ssim: ssim(render, truth)?,
        coverage: sums.n_covered as f64 / sums.n_pixels as f64,
        covered,
    })
}

/// Returns the mean squared error over the whole frame and all channels, with the colours of covered
/// pixels aligned.
pub(super) fn aligned_error(
    render: &RgbImage,
    coverage: &Image<f32>,
    truth: &RgbImage,
) -> Result<f64, MetricError> {
    same_size(render, truth, "ground truth")?;
    same_size(render, coverage, "coverage")?;
    let sums = Sums::of(render, coverage, truth);
    let error = match sums.n_covered {
        0 => sums.error,
        _ => Sums::of(&sums.alignment().apply(render, coverage), coverage, truth).error,
    };
    Ok(error / (3 * sums.n_pixels) as f64)
}

impl Alignment {
    pub(super) fn apply(&self, render: &RgbImage, coverage: &Image<f32>) -> RgbImage {
        let aligned = render.data.par_iter().zip(&coverage.data).map(|(&pixel, &coverage)| {
            // The background is not part of the model; aligning it would reward guessing its colour.
            if coverage < COVERED {
                return pixel;
            }
            std::array::from_fn(|i| {
                // Clamped as by a display.
                (self.gain[i] * f64::from(pixel[i]) + self.offset[i]).clamp(0.0, 1.0) as f32
            })
        });
        Image::from_vec(render.width, render.height, aligned.collect())
    }
}

#[derive(Clone, Copy, Default)]
struct Sums {
    /// Number of pixels that no mask leaves out.
    n_pixels: usize,
    n_covered: usize,
    /// Sum of squared errors over all pixels and channels.
    error: f64,
    /// Sum of squared errors over covered pixels and all channels.
    error_covered: f64,
    moments: [Moments; 3],
}

/// Sums over covered pixels for one channel, with `x` from the render and `y` from the photograph.
#[derive(Clone, Copy, Default)]
struct Moments {
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
}

impl Sums {
    fn of(render: &RgbImage, coverage: &Image<f32>, truth: &RgbImage) -> Self {
        let width = render.width;
        // Collected in order and added below: the last digits of a parallel sum would depend on the threads.
        let rows: Vec<Self> = render
            .data
            .par_chunks(width)
            .zip(coverage.data.par_chunks(width))
            .zip(truth.data.par_chunks(width))
            .map(|((render, coverage), truth)| Self::of_row(render, coverage, truth))
            .collect();
        let mut sums = Self::default();
        rows.iter().for_each(|row| sums.add(row));
        sums
    }

    fn of_row(render: &[[f32; 3]], coverage: &[f32], truth: &[[f32; 3]]) -> Self {
        let mut sums = Self::default();
        for ((render, &coverage), truth) in render.iter().zip(coverage).zip(truth) {
            // f32 sums over a million pixels would lose digits.
            let (x, y) = (render.map(f64::from), truth.map(f64::from));
            let error: f64 = x.iter().zip(&y).map(|(x, y)| (x - y) * (x - y)).sum();
            if is_left_out(truth) {
                continue;
            }
            sums.n_pixels += 1;
            sums.error += error;
            if coverage >= COVERED {
                sums.n_covered += 1;
                sums.error_covered += error;
                for (moments, (x, y)) in sums.moments.iter_mut().zip(x.into_iter().zip(y)) {
                    moments.x += x;
                    moments.y += y;
                    moments.xx += x * x;
                    moments.xy += x * y;
                }
            }
        }
        sums
    }

    fn add(&mut self, other: &Self) {
        self.n_pixels += other.n_pixels;
        self.n_covered += other.n_covered;
        self.error += other.error;
        self.error_covered += other.error_covered;
        for (sum, part) in self.moments.iter_mut().zip(&other.moments) {
            sum.x += part.x;
            sum.y += part.y;
            sum.xx += part.xx;
            sum.xy += part.xy;
        }
    }

    fn psnr(&self) -> f64 {
        decibels(self.error / (3 * self.n_pixels) as f64)
    }

    fn psnr_covered(&self) -> f64 {
        decibels(self.error_covered / (3 * self.n_covered) as f64)
    }

    /// Returns the least-squares fit of the colours. Requires at least one covered pixel.
    fn alignment(&self) -> Alignment {
        let fits = self.moments.map(|m| m.fit(self.n_covered as f64));
        Alignment { gain: fits.map(|f| f[0]), offset: fits.map(|f| f[1]) }
    }
}

/// Variance of a channel, with values in `[0, 1]`, below which no gain can be determined. All pixels of
/// such a channel have the same byte value.
pub(super) const MIN_VARIANCE: f64 = 1e-8;

impl Moments {
    fn fit(&self, n: f64) -> [f64; 2] {
        let (x, y) = (self.x / n, self.y / n);
        let variance = self.xx / n - x * x;
        // A constant channel fits any line; gain 1 is used.
        let gain = if variance > MIN_VARIANCE { (self.xy / n - x * y) / variance } else { 1.0 };
        [gain, y - gain * x]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::metrics::{psnr, psnr_masked};
    use crate::math::rng::{Purpose, Rng};

    fn noise(width: usize, height: usize, seed: u64) -> RgbImage {
        let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
        let pixel = |_| std::array::from_fn(|_| rng.uniform() as f32);
        Image::from_vec(width, height, (0..width * height).map(pixel).collect())
    }

    #[test]
    fn the_plain_scores_are_those_of_the_metrics() {
        let (render, truth) = (noise(40, 30, 1), noise(40, 30, 2));
        let coverage = noise(40, 30, 3).map(|p| p[0]);
        let found = compare(&render, &coverage, &truth).unwrap();
        let mask = coverage.map(|&a| a >= COVERED);
        let covered = found.covered.unwrap();
        assert!((found.psnr - psnr(&render, &truth).unwrap()).abs() < 1e-10);
        let expected = psnr_masked(&render, &truth, &mask).unwrap();
        assert!((covered.psnr - expected).abs() < 1e-10);
        let share = mask.data.iter().filter(|&&c| c).count() as f64 / 1200.0;
        assert_eq!(found.coverage, share);
        assert_eq!(found.ssim, ssim(&render, &truth).unwrap());
    }

    /// No other gain and offset yields a smaller error.
    #[test]
    fn the_alignment_is_the_best_one() {
        let (render, other) =
            (noise(40, 30, 4).map(|p| p.map(|v| 0.3 + 0.3 * v)), noise(40, 30, 5));
        let mix = |(a, b): (&[f32; 3], &[f32; 3])| {
            std::array::from_fn(|i| 0.6 * a[i] + 0.1 * b[i] + [0.0, 0.05, 0.1][i])
        };
        let truth = Image::from_vec(40, 30, render.data.iter().zip(&other.data).map(mix).collect());
        let coverage = Image::filled(40, 30, 1.0);
        let covered = compare(&render, &coverage, &truth).unwrap().covered.unwrap();
        let best = Sums::of(&render, &coverage, &truth).alignment();
        for i in 0..3 {
            for (gain, offset) in [(0.02, 0.0), (-0.02, 0.0), (0.0, 0.004), (0.0, -0.004)] {
                let mut off = best;
                off.gain[i] += gain;
                off.offset[i] += offset;
                let worse = Sums::of(&off.apply(&render, &coverage), &coverage, &truth);
                assert!(worse.psnr_covered() < covered.aligned_psnr, "channel {i} {gain} {offset}");
            }
        }
    }

    /// Whatever the scene shows where a mask leaves pixels out, no score changes.
    #[test]
    fn masked_pixels_count_in_no_score() {
        let (render, mut truth) = (noise(48, 36, 6), noise(48, 36, 7));
        let coverage = Image::filled(48, 36, 1.0);
        let is_masked = |i: &usize| i % 48 < 12;
        let masked: Vec<usize> = (0..48 * 36).filter(is_masked).collect();
        masked.iter().for_each(|&i| truth.data[i] = [f32::NAN; 3]);
        let mut other = render.clone();
        masked.iter().for_each(|&i| other.data[i] = [1.0, 0.0, 1.0]);
        let [a, b] = [&render, &other].map(|shown| compare(shown, &coverage, &truth).unwrap());
        assert!(a.psnr.is_finite() && a.ssim.is_finite(), "{} {}", a.psnr, a.ssim);
        assert_eq!((a.psnr, a.ssim), (b.psnr, b.ssim));
        let [a, b] = [a, b].map(|found| found.covered.unwrap());
        assert_eq!(
            (a.psnr, a.aligned_psnr, a.aligned_ssim),
            (b.psnr, b.aligned_psnr, b.aligned_ssim)
        );
    }

    #[test]
    fn uncovered_pixels_keep_the_background() {
        let mut coverage = Image::filled(16, 12, 1.0);
        coverage.data[..16].fill(0.2);
        let render = Image::filled(16, 12, [0.25; 3]);
        let truth = Image::filled(16, 12, [0.5; 3]);
        let covered = compare(&render, &coverage, &truth).unwrap().covered.unwrap();
        let alignment = Sums::of(&render, &coverage, &truth).alignment();
        assert_eq!(alignment, Alignment { gain: [1.0; 3], offset: [0.25; 3] });
        assert!(covered.aligned_psnr > 100.0);
        let expected = -10.0 * (0.0625f64 / 12.0).log10();
        assert!((covered.aligned_psnr_frame - expected).abs() < 1e-9);
    }

    #[test]
    fn nothing_covered_has_no_covered_score() {
        let image = Image::filled(16, 12, [0.0; 3]);
        let found = compare(&image, &Image::filled(16, 12, 0.4), &image).unwrap();
        assert_eq!((found.coverage, found.covered), (0.0, None));
        let small = Image::filled(16, 11, 1.0);
        assert!(matches!(compare(&image, &small, &image), Err(MetricError::SizeMismatch { .. })));
    }
}
