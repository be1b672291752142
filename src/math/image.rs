//! Row-major images.

/// Row-major image: pixel `(column, row)` is `data[row * width + column]`.
///
/// ```
/// use vbgs_studio::math::image::Image;
///
/// let image = Image::from_vec(2, 1, vec![[0.0f32; 3], [1.0, 0.5, 0.0]]);
/// assert_eq!(image.at(1, 0)[0], 1.0);
/// assert_eq!(image.to_rgb8(), [0, 0, 0, 255, 128, 0]);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Image<T> {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// `width * height` values, rows from the top.
    pub data: Vec<T>,
}

/// sRGB-encoded colour image, each channel in `[0, 1]`.
pub type RgbImage = Image<[f32; 3]>;

impl<T: Clone> Image<T> {
    /// Creates an image filled with one value.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, data: vec![value; width * height] }
    }
}

impl<T> Image<T> {
    /// Wraps `data`, which must hold `width * height` values.
    pub fn from_vec(width: usize, height: usize, data: Vec<T>) -> Self {
        assert_eq!(data.len(), width * height, "an image holds width * height values");
        Self { width, height, data }
    }

    /// Returns the value at `(column, row)`.
    #[inline]
    pub fn at(&self, column: usize, row: usize) -> &T {
        &self.data[row * self.width + column]
    }

    /// Applies `f` to every value and returns the results as an image.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Image<U> {
        Image { width: self.width, height: self.height, data: self.data.iter().map(f).collect() }
    }
}

/// Converts a channel value in `[0, 1]` to a byte, rounded to nearest. Values outside are clamped; NaN
/// becomes 0.
#[inline]
pub fn unit_to_byte(value: f32) -> u8 {
    // The cast saturates and maps NaN to 0.
    (value * 255.0 + 0.5) as u8
}

impl RgbImage {
    /// Returns interleaved RGB bytes, rows from the top, for PNG encoders and textures.
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.data.iter().flat_map(|p| p.map(unit_to_byte)).collect()
    }
}

/// Splits a slice into consecutive parts of the given sizes. Parts beyond the end of the slice are
/// empty.
pub fn split_by_sizes<T>(list: &mut [T], sizes: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    let mut rest = list;
    sizes.map(|size| rest.split_off_mut(..size).unwrap_or_default()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_as_long_as_asked_while_the_list_lasts() {
        let mut list = [0, 1, 2, 3, 4];
        assert_eq!(
            split_by_sizes(&mut list, [2, 0, 3].into_iter()),
            [&[0, 1][..], &[], &[2, 3, 4]]
        );
        assert_eq!(split_by_sizes(&mut list, [3, 3, 1].into_iter()), [&[0, 1, 2][..], &[], &[3]]);
    }
}
