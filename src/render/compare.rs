//! Combines two images of one viewport: a wipe between them, or their difference.
//! `shaders/composite.wgsl` uses the same formulas.
//!
//! Images are combined after crack filling, exposure and compositing over the background, so that each
//! appears as it does alone. The second image is sampled bilinearly, because photographs and renders seldom
//! have the same size.

use crate::math::image::RgbImage;
use rayon::prelude::*;

/// Method of combining two images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Combination {
    /// Shows the first image left of a divider and the second one from there on. The value is the
    /// divider's position as a fraction of the viewport width.
    Wipe(f32),
    /// Shows `gain·|first − second|` per channel, limited to 1: black where the two images agree. The
    /// value is the gain.
    Difference(f32),
}

/// Rectangle in fractions of the viewport: `(0, 0)` is its upper left corner, `(1, 1)` its lower right
/// one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// Upper left corner.
    pub min: [f32; 2],
    /// Lower right corner; exceeds `min` on both axes.
    pub max: [f32; 2],
}

impl Area {
    /// The whole viewport.
    pub const FULL: Self = Self { min: [0.0; 2], max: [1.0; 2] };

    fn contains(&self, p: [f32; 2]) -> bool {
        (0..2).all(|axis| self.min[axis] <= p[axis] && p[axis] < self.max[axis])
    }

    /// Converts a position from fractions of the viewport to fractions of the rectangle.
    fn inner(&self, p: [f32; 2]) -> [f32; 2] {
        std::array::from_fn(|axis| (p[axis] - self.min[axis]) / (self.max[axis] - self.min[axis]))
    }
}

/// Brightness factor of the first image outside the area of the second one.
pub const OUTSIDE_BRIGHTNESS: f32 = 0.35;

/// Combines `first`, which fills the viewport, with `second`, which is scaled to fill `area`. Writes the
/// result to `first`. Outside `area`, `first` is darkened by [`OUTSIDE_BRIGHTNESS`].
///
/// ```
/// use vbgs_studio::math::image::Image;
/// use vbgs_studio::render::compare::{Area, Combination, combine};
/// let mut picture = Image::filled(4, 1, [0.25f32; 3]);
/// let other = Image::filled(4, 1, [0.5f32; 3]);
/// combine(&mut picture, &other, Area::FULL, Combination::Wipe(0.5));
/// assert_eq!(picture.data, [[0.25; 3], [0.25; 3], [0.5; 3], [0.5; 3]]);
/// ```
pub fn combine(first: &mut RgbImage, second: &RgbImage, area: Area, how: Combination) {
    let (width, height) = (first.width, first.height);
    // A chunk size of 0 would panic, and an empty image has no pixel to sample.
    if width == 0 || second.data.is_empty() {
        return;
    }
    first.data.par_chunks_mut(width).enumerate().for_each(|(row, pixels)| {
        for (column, pixel) in pixels.iter_mut().enumerate() {
            // Pixel centres, as the rasteriser of a GPU interpolates them.
            let p = [(column as f32 + 0.5) / width as f32, (row as f32 + 0.5) / height as f32];
            *pixel = combine_pixel(*pixel, second, p, area, how);
        }
    });
}

fn combine_pixel(
    first: [f32; 3],
    second: &RgbImage,
    p: [f32; 2],
    area: Area,
    how: Combination,
) -> [f32; 3] {
    if !area.contains(p) {
        return first.map(|v| OUTSIDE_BRIGHTNESS * v);
    }
    match how {
        Combination::Wipe(divider) if p[0] < divider => first,
        Combination::Wipe(_) => bilinear(second, area.inner(p)),
        Combination::Difference(gain) => {
            let other = bilinear(second, area.inner(p));
            std::array::from_fn(|i| (gain * (first[i] - other[i]).abs()).min(1.0))
        }
    }
}

/// Samples an image bilinearly between pixel centres, as GPUs do. `share` is the position in fractions
/// of width and height. Beyond the outermost pixel centres, the border pixels are repeated.
fn bilinear(image: &RgbImage, share: [f32; 2]) -> [f32; 3] {
    let axis = |share: f32, n: usize| {
        // Values belong to pixel centres, not corners.
        let at = share * n as f32 - 0.5;
        let below = at.floor();
        let index = |i: f32| (i.max(0.0) as usize).min(n - 1);
        (index(below), index(below + 1.0), at - below)
    };
    let (left, right, x) = axis(share[0], image.width);
    let (top, bottom, y) = axis(share[1], image.height);
    let mix = |a: f32, b: f32, t: f32| a + t * (b - a);
    std::array::from_fn(|i| {
        let upper = mix(image.at(left, top)[i], image.at(right, top)[i], x);
        let lower = mix(image.at(left, bottom)[i], image.at(right, bottom)[i], x);
        mix(upper, lower, y)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::image::Image;

    /// Returns an image in which no two pixels are equal.
    fn picture(width: usize, height: usize, seed: f32) -> RgbImage {
        let value = |i: usize| (seed + 0.37 * i as f32).fract();
        let data = (0..width * height).map(|i| [value(3 * i), value(3 * i + 1), value(3 * i + 2)]);
        Image::from_vec(width, height, data.collect())
    }

    #[test]
    fn a_wipe_shows_each_picture_on_its_side() {
        let (first, second) = (picture(8, 5, 0.1), picture(8, 5, 0.6));
        for (divider, n_first) in [(0.0, 0), (0.375, 3), (0.4, 3), (1.0, 8)] {
            let mut shown = first.clone();
            combine(&mut shown, &second, Area::FULL, Combination::Wipe(divider));
            for (i, pixel) in shown.data.iter().enumerate() {
                let side = if i % 8 < n_first { &first } else { &second };
                for (found, expected) in pixel.iter().zip(side.data[i]) {
                    assert!((found - expected).abs() < 1e-5, "{divider}, pixel {i}");
                }
            }
        }
    }

    #[test]
    fn a_difference_is_black_where_pictures_agree_and_never_more_than_white() {
        let first = picture(6, 4, 0.2);
        let mut shown = first.clone();
        combine(&mut shown, &first, Area::FULL, Combination::Difference(50.0));
        assert!(shown.data.iter().flatten().all(|v| *v < 1e-3));
        let mut second = first.clone();
        second.data[7] = first.data[7].map(|v| if v < 0.5 { v + 0.1 } else { v - 0.1 });
        for (gain, expected) in [(4.0, 0.4), (50.0, 1.0)] {
            let mut shown = first.clone();
            combine(&mut shown, &second, Area::FULL, Combination::Difference(gain));
            assert!(shown.data[7].iter().all(|v| (v - expected).abs() < 1e-4), "{gain}");
        }
    }

    #[test]
    fn a_smaller_picture_fills_its_area_and_the_rest_is_dimmed() {
        let mut shown = Image::filled(8, 4, [0.8f32; 3]);
        let second = Image::from_vec(2, 1, vec![[0.0; 3], [1.0; 3]]);
        let area = Area { min: [0.25, 0.0], max: [0.75, 1.0] };
        combine(&mut shown, &second, area, Combination::Wipe(0.0));
        let row: Vec<f32> = shown.data[..8].iter().map(|p| p[0]).collect();
        let dim = OUTSIDE_BRIGHTNESS * 0.8;
        let expected = [dim, dim, 0.0, 0.25, 0.75, 1.0, dim, dim];
        assert!(row.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{row:?}");
    }

    #[test]
    fn empty_pictures_are_left_alone() {
        let mut empty = picture(0, 0, 0.0);
        combine(&mut empty, &picture(2, 2, 0.0), Area::FULL, Combination::Wipe(0.5));
        let mut shown = picture(2, 2, 0.3);
        combine(&mut shown, &empty, Area::FULL, Combination::Wipe(0.0));
        assert_eq!(shown, picture(2, 2, 0.3));
    }
}
