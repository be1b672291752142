//! Image pyramids: at coarse levels, gradients point towards the solution even from many pixels away.

use crate::math::image::Image;

/// Minimum alpha at which a texel counts as opaque.
const OPAQUE: u8 = 250;

/// Smoothed image at several resolutions. Smoothing extends the range over which the colour gradient is
/// valid.
pub(super) struct Pyramid(Vec<Image<[u8; 4]>>);

/// Colour in `[0, 1]` and its derivatives with respect to column and row, per pixel of the
/// full-resolution image.
pub(super) struct InterpolatedColor {
    pub color: [f64; 3],
    pub slope: [[f64; 2]; 3],
}

impl Pyramid {
    pub fn new(image: Image<[u8; 4]>, levels: usize) -> Self {
        let mut sizes = vec![image];
        while sizes.len() < levels {
            let half = halved(&sizes[sizes.len() - 1]);
            sizes.push(half);
        }
        Self(sizes.iter().map(smoothed).collect())
    }

    /// Interpolates the colour bilinearly at pixel coordinates of the full-resolution image (pixel
    /// centres at +½). Returns `None` outside the image and where it is not opaque.
    #[inline]
    pub fn sample(&self, level: usize, [u, v]: [f64; 2]) -> Option<InterpolatedColor> {
        let Image { width, height, data } = &self.0[level];
        let shrink = 1.0 / (1u32 << level) as f64;
        let (x, y) = (u * shrink - 0.5, v * shrink - 0.5);
        // Negated, so that NaN is outside as well.
        if !(x >= 0.0 && y >= 0.0 && x < *width as f64 - 1.0 && y < *height as f64 - 1.0) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        let (s, t) = (x - column as f64, y - row as f64);
        let at = row * width + column;
        let texels = [data[at], data[at + 1], data[at + width], data[at + width + 1]];
        // A texel at a silhouette contains background, which belongs to no component.
        if texels.iter().any(|texel| texel[3] < OPAQUE) {
            return None;
        }
        let mut sample = InterpolatedColor { color: [0.0; 3], slope: [[0.0; 2]; 3] };
        for i in 0..3 {
            let [a, b, c, d] = texels.map(|texel| f64::from(texel[i]) / 255.0);
            let (top, bottom) = (a + (b - a) * s, c + (d - c) * s);
            sample.color[i] = top + (bottom - top) * t;
            let across = (b - a) + ((d - c) - (b - a)) * t;
            sample.slope[i] = [across * shrink, (bottom - top) * shrink];
        }
        Some(sample)
    }
}

/// Halves the resolution by averaging 2 × 2 texels. An odd last row or column is dropped.
fn halved(image: &Image<[u8; 4]>) -> Image<[u8; 4]> {
    let (width, height) = ((image.width / 2).max(1), (image.height / 2).max(1));
    let mut data = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            let texel = |i: usize, j: usize| {
                // An image of one row or column has no second texel.
                image.at((2 * column + i).min(image.width - 1), (2 * row + j).min(image.height - 1))
            };
            let four = [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)];
            data.push(std::array::from_fn(|i| {
                ((four.iter().map(|t| u32::from(t[i])).sum::<u32>() + 2) / 4) as u8
            }));
        }
    }
    Image::from_vec(width, height, data)
}

/// Smooths an image with a 3 × 3 binomial filter. Alpha is the minimum over the filter's window.
fn smoothed(image: &Image<[u8; 4]>) -> Image<[u8; 4]> {
    const TAPS: [(isize, u32); 3] = [(-1, 1), (0, 2), (1, 1)];
    let Image { width, height, .. } = *image;
    // Borders are clamped, so size and pixel positions are preserved.
    let near = |at: usize, step: isize, end: usize| at.saturating_add_signed(step).min(end - 1);
    let mut out = image.clone();
    for row in 0..height {
        for column in 0..width {
            // The weights sum to 16: the initial 8 rounds to nearest.
            let (mut sum, mut alpha) = ([8; 3], u8::MAX);
            for (down, weight) in TAPS {
                for (right, factor) in TAPS {
                    let texel = image.at(near(column, right, width), near(row, down, height));
                    (0..3).for_each(|i| sum[i] += weight * factor * u32::from(texel[i]));
                    alpha = alpha.min(texel[3]);
                }
            }
            let [r, g, b] = sum.map(|sum| (sum / 16) as u8);
            out.data[row * width + column] = [r, g, b, alpha];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Colour increases linearly by column and row at every level.
    #[test]
    fn slopes_are_per_pixel_of_the_whole_image() {
        let ramp = |i: usize| [(2 * (i % 32)) as u8, (4 * (i / 32)) as u8, 7, 255];
        let image = Image::from_vec(32, 24, (0..32 * 24).map(ramp).collect());
        let pyramid = Pyramid::new(image, 3);
        for level in 0..3 {
            let sample = pyramid.sample(level, [15.3, 10.9]).unwrap();
            // Averages of neighbours are rounded to bytes.
            let near = |a: f64, b: f64| (a * 255.0 - b).abs() < 1.0;
            assert!(
                near(sample.color[0], 2.0 * 14.8) && near(sample.color[1], 4.0 * 10.4),
                "{level}"
            );
            assert!(near(sample.slope[0][0], 2.0) && near(sample.slope[1][1], 4.0), "{level}");
            assert_eq!((sample.slope[0][1], sample.slope[2]), (0.0, [0.0; 2]));
        }
    }

    #[test]
    fn neither_outside_nor_through_holes_is_anything_seen() {
        let mut image = Image::filled(8, 8, [9, 9, 9, 255]);
        image.data[3 * 8 + 3][3] = 0;
        let pyramid = Pyramid::new(image, 1);
        assert!(pyramid.sample(0, [6.0, 6.0]).is_some());
        for at in [[0.4, 4.0], [4.0, 7.6], [3.6, 3.6], [4.6, 3.0], [f64::NAN, 4.0]] {
            assert!(pyramid.sample(0, at).is_none(), "{at:?}");
        }
    }
}
