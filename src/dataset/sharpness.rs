//! Sharpness and brightness of a photograph, one number each.
//!
//! Sharpness is the ratio of the energy of single-pixel differences to that of differences four pixels
//! wide. Blur reduces the former and retains the latter, while the depicted scene changes both alike. So
//! frames of one camera are comparable even if they show different things. Plain gradient energy was tried
//! first; it calls every view of a bare wall blurred.

use crate::math::image::Image;

/// Photographs are averaged down to at most this width: phones smooth at full size, which hides blur, and
/// smaller images are faster.
const MAX_COLUMNS: usize = 640;
/// Side of the blocks for coarse differences, pixels.
const COARSE: usize = 4;

/// Sharpness and brightness of one photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoQuality {
    /// Ratio of fine to coarse difference energy; comparable within one camera only. `None` without any
    /// detail.
    pub sharpness: Option<f64>,
    /// Mean encoded luma over opaque pixels, 0 to 1.
    pub brightness: f64,
}

impl PhotoQuality {
    /// Measures a photograph; transparent pixels count as black for sharpness.
    pub fn of(photograph: &Image<[u8; 4]>) -> Self {
        let luma = photograph.map(|&[r, g, b, a]| {
            let luma = 0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b);
            luma / 255.0 * f32::from(a) / 255.0
        });
        let opaque: f64 = photograph.data.iter().map(|pixel| f64::from(pixel[3]) / 255.0).sum();
        let total: f64 = luma.data.iter().map(|&v| f64::from(v)).sum();
        let fine = blocks(&luma, photograph.width.div_ceil(MAX_COLUMNS).max(1));
        let [energy, coarse] = [energy(&fine), energy(&blocks(&fine, COARSE))];
        // A step of a hundredth of a code: anything below is rounding, not detail.
        let has_detail = coarse > 1e-9;
        Self { sharpness: has_detail.then(|| energy / coarse), brightness: total / opaque.max(1.0) }
    }
}

/// Means of whole blocks of `side`×`side` pixels.
fn blocks(picture: &Image<f32>, side: usize) -> Image<f32> {
    if side == 1 {
        return picture.clone();
    }
    let (width, height) = (picture.width / side, picture.height / side);
    let mut small = Image::filled(width, height, 0.0f32);
    for (i, mean) in small.data.iter_mut().enumerate() {
        let (x, y) = (i % width * side, i / width * side);
        let rows = (y..y + side).map(|row| &picture.data[row * picture.width + x..][..side]);
        *mean = rows.flatten().sum::<f32>() / (side * side) as f32;
    }
    small
}

/// Mean squared difference to the left and upper neighbours; 0 without neighbours.
fn energy(picture: &Image<f32>) -> f64 {
    let Image { width, height, data } = picture;
    let (mut sum, mut n) = (0.0, 0usize);
    for y in 1..*height {
        for x in 1..*width {
            let here = data[y * width + x];
            let (left, above) = (data[y * width + x - 1], data[(y - 1) * width + x]);
            sum += f64::from((here - left).powi(2) + (here - above).powi(2));
            n += 1;
        }
    }
    if n == 0 { 0.0 } else { sum / n as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn textured(scale: f64) -> Image<[u8; 4]> {
        let value = |i: usize| {
            let (x, y) = ((i % 160) as f64, (i / 160) as f64);
            let wave = (x / 0.9).sin() * (y / 1.1).cos() + (x / 23.0).sin() + (y / 17.0).cos();
            (scale * (128.0 + 30.0 * wave)) as u8
        };
        let pixel = |i| [value(i), value(i), value(i), 255];
        Image::from_vec(160, 120, (0..160 * 120).map(pixel).collect())
    }

    fn sharpness(picture: &Image<[u8; 4]>) -> f64 {
        PhotoQuality::of(picture).sharpness.unwrap()
    }

    #[test]
    fn blur_lowers_sharpness_and_exposure_does_not() {
        let sharp = textured(1.0);
        let mean = |i: usize| {
            let (x, y) = (i % 160, i / 160);
            let of = |x: usize, y: usize| u32::from(sharp.at(x.min(159), y.min(119))[0]);
            let sum: u32 = (0..5)
                .flat_map(|j| (0..5).map(move |i| (i, j)))
                .map(|(i, j)| of(x + i, y + j))
                .sum();
            [(sum / 25) as u8; 3]
        };
        let pixel = |i| {
            let [r, g, b] = mean(i);
            [r, g, b, 255]
        };
        let blurred = Image::from_vec(160, 120, (0..160 * 120).map(pixel).collect());
        assert!(sharpness(&blurred) < 0.5 * sharpness(&sharp));
        let dim = textured(0.6);
        assert!((sharpness(&dim) / sharpness(&sharp) - 1.0).abs() < 0.1);
        let ratio = PhotoQuality::of(&dim).brightness / PhotoQuality::of(&sharp).brightness;
        assert!((ratio - 0.6).abs() < 0.01, "{ratio}");
    }

    #[test]
    fn a_picture_without_detail_is_neither_sharp_nor_blurred() {
        for (width, height) in [(64, 48), (3, 2), (1, 1)] {
            let grey = Image::filled(width, height, [128, 128, 128, 255]);
            let measure = PhotoQuality::of(&grey);
            assert_eq!(measure.sharpness, None);
            assert!((measure.brightness - 128.0 / 255.0).abs() < 1e-3);
        }
    }

    #[test]
    fn only_opaque_pixels_have_a_brightness() {
        let mut half = Image::filled(8, 8, [200, 200, 200, 255]);
        half.data[..32].fill([255, 255, 255, 0]);
        let found = PhotoQuality::of(&half).brightness;
        assert!((found - 200.0 / 255.0).abs() < 1e-3, "{found}");
    }
}
