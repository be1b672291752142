//! Comparison at a fraction of the photograph's size (`evaluation.md`, Scale).
//!
//! Phones take photographs of 1920×1440 pixels with depth of 256×192. Full size requires detail that
//! measured points cannot provide, and takes sixteen times as long as a quarter. The photograph is
//! area-averaged in encoded values, as in the reduced images of published benchmarks, and the camera is
//! scaled accordingly.

use crate::dataset::Dataset;
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::{Image, RgbImage};
use crate::render::cpu::CpuRenderer;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Scale at which views are compared, as a fraction of a photograph's width and height, in (0, 1].
///
/// ```
/// use vbgs_studio::eval::scale::EvalScale;
///
/// let half: EvalScale = "0.5".parse()?;
/// assert_eq!((half.value(), half.to_string()), (0.5, "0.5".to_owned()));
/// assert!("2".parse::<EvalScale>().is_err());
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "f64", try_from = "f64")]
pub struct EvalScale(f64);

impl EvalScale {
    /// Full size.
    pub const FULL: Self = Self(1.0);

    /// Returns the fraction.
    pub fn value(self) -> f64 {
        self.0
    }

    /// True if views are compared at full size.
    pub fn is_full(self) -> bool {
        self == Self::FULL
    }

    /// Returns the camera of a photograph, scaled to the size of the compared image.
    pub fn camera(self, camera: Camera) -> Camera {
        if self.is_full() {
            return camera;
        }
        Camera { intrinsics: camera.intrinsics.scaled(self.0), ..camera }
    }

    /// Resamples a photograph to the image size of its scaled camera.
    pub fn photograph(self, photograph: RgbImage, scaled: &Intrinsics) -> RgbImage {
        if self.is_full() {
            return photograph;
        }
        area_averaged(&photograph, [scaled.width as usize, scaled.height as usize])
    }
}

impl Default for EvalScale {
    /// Returns full size, which applies to reports without this field.
    fn default() -> Self {
        Self::FULL
    }
}

fn out_of_range(found: &str) -> String {
    format!("expected a number above 0 and at most 1, found `{found}`")
}

impl TryFrom<f64> for EvalScale {
    type Error = String;

    fn try_from(value: f64) -> Result<Self, String> {
        match value > 0.0 && value <= 1.0 {
            true => Ok(Self(value)),
            false => Err(out_of_range(&value.to_string())),
        }
    }
}

impl From<EvalScale> for f64 {
    fn from(scale: EvalScale) -> Self {
        scale.0
    }
}

impl FromStr for EvalScale {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found: Option<f64> = text.parse().ok();
        // Text such as `nan` parses, but is out of range.
        found.and_then(|value| Self::try_from(value).ok()).ok_or_else(|| out_of_range(text))
    }
}

impl fmt::Display for EvalScale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Reduces an image to equal or smaller sides by area averaging. Partially covered pixels are weighted
/// by their covered share.
pub(super) fn area_averaged(picture: &RgbImage, [width, height]: [usize; 2]) -> RgbImage {
    // Along rows, then along columns: the mean over an area is separable.
    let (columns, rows) = (spans(picture.width, width), spans(picture.height, height));
    let mut narrow = Image::filled(width, picture.height, [0.0f32; 3]);
    narrow.data.par_chunks_mut(width).zip(picture.data.par_chunks(picture.width)).for_each(
        |(out, row)| {
            for (out, span) in out.iter_mut().zip(&columns) {
                *out = mean(span, |i| row[i]);
            }
        },
    );
    let mut small = Image::filled(width, height, [0.0f32; 3]);
    small.data.par_chunks_mut(width).zip(&rows).for_each(|(out, span)| {
        for (column, out) in out.iter_mut().enumerate() {
            *out = mean(span, |row| *narrow.at(column, row));
        }
    });
    small
}

/// Source pixels covered by one target pixel along an axis.
struct Span {
    first: usize,
    /// Weights of the source pixels; their sum is 1.
    shares: Vec<f64>,
}

fn spans(from: usize, to: usize) -> Vec<Span> {
    let length = from as f64 / to as f64;
    let span = |i: usize| {
        let (start, end) = (i as f64 * length, (i + 1) as f64 * length);
        // Rounding may place the last span beyond the image.
        let first = (start as usize).min(from - 1);
        let last = (end.ceil() as usize).clamp(first + 1, from);
        let covered = |pixel: usize| end.min(pixel as f64 + 1.0) - start.max(pixel as f64);
        Span { first, shares: (first..last).map(|p| covered(p).max(0.0) / length).collect() }
    };
    (0..to).map(span).collect()
}

fn mean(span: &Span, pixel: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for (i, share) in span.shares.iter().enumerate() {
        let color = pixel(span.first + i);
        (0..3).for_each(|c| sum[c] += share * f64::from(color[c]));
    }
    sum.map(|value| value as f32)
}

/// Maximum number of views visited in parallel, because each needs a renderer with all its buffers.
const VIEWS_AT_ONCE: usize = 4;

/// Loads all views, applies `visit` to each in parallel and returns the results in order. `progress`
/// receives the number of views done.
pub fn visit_views<T: Send>(
    dataset: &Dataset,
    split: usize,
    views: &[usize],
    visit: impl Fn(&mut CpuRenderer, usize, Result<Frame, FrameError>) -> T + Sync,
    mut progress: impl FnMut(usize),
) -> Vec<T> {
    // No more than threads: further renderers would only hold memory.
    let at_once = VIEWS_AT_ONCE.min(rayon::current_num_threads());
    let mut renderers: Vec<CpuRenderer> = (0..at_once).map(|_| CpuRenderer::new()).collect();
    let mut found = Vec::with_capacity(views.len());
    // One view per renderer and batch: buffers are reused and results stay in order.
    for batch in views.chunks(at_once) {
        // One view per task: with two in one, another renderer would be idle.
        let visited = renderers.par_iter_mut().zip(batch).with_max_len(1);
        found.par_extend(
            visited.map(|(renderer, &index)| visit(renderer, index, dataset.load(split, index))),
        );
        progress(found.len());
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: usize, height: usize) -> RgbImage {
        let value = |i: usize| ((i * 7919) % 101) as f32 / 100.0;
        let pixel = |i: usize| [value(i), value(i + 1), value(2 * i)];
        Image::from_vec(width, height, (0..width * height).map(pixel).collect())
    }

    fn total(picture: &RgbImage) -> f64 {
        let sum: f64 = picture.data.iter().flatten().map(|&v| f64::from(v)).sum();
        sum / picture.data.len() as f64
    }

    #[test]
    fn whole_factors_average_blocks() {
        let full = picture(12, 8);
        let half = area_averaged(&full, [6, 4]);
        for (x, y) in [(0, 0), (5, 3), (2, 1)] {
            let block = [(0, 0), (1, 0), (0, 1), (1, 1)];
            let mean =
                block.iter().map(|(i, j)| full.at(2 * x + i, 2 * y + j)[1]).sum::<f32>() / 4.0;
            assert!((half.at(x, y)[1] - mean).abs() < 1e-6);
        }
    }

    #[test]
    fn every_pixel_counts_by_its_area() {
        let full = picture(17, 13);
        for size in [[17, 13], [16, 12], [11, 9], [5, 13], [1, 1]] {
            let small = area_averaged(&full, size);
            assert_eq!([small.width, small.height], size);
            assert!((total(&small) - total(&full)).abs() < 1e-6, "{size:?}");
        }
        let edge = Image::from_vec(3, 1, [0.0, 1.0, 0.0].map(|v| [v; 3]).to_vec());
        let halves = area_averaged(&edge, [2, 1]).data;
        assert!(halves.iter().all(|pixel| (pixel[0] - 1.0 / 3.0).abs() < 1e-6), "{halves:?}");
    }

    #[test]
    fn camera_and_photograph_shrink_alike() {
        let intrinsics = Intrinsics::from_horizontal_fov(1920, 1440, 1.1);
        let pose = crate::math::pose::Pose::IDENTITY;
        let quarter = EvalScale(0.25);
        let scaled = quarter.camera(Camera { intrinsics, pose }).intrinsics;
        assert_eq!((scaled.width, scaled.height, scaled.cx), (480, 360, 240.0));
        assert!((scaled.fov_x() - 1.1).abs() < 1e-12);
        assert_eq!(EvalScale::FULL.photograph(picture(4, 3), &scaled), picture(4, 3));
        for wrong in ["0", "-0.5", "1.01", "nan", "inf", "", "half", "1/2"] {
            assert!(wrong.parse::<EvalScale>().unwrap_err().contains("above 0"), "{wrong}");
        }
        assert_eq!("1".parse(), Ok(EvalScale::FULL));
    }
}
