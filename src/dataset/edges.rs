//! Flying pixels: depth that lies between two surfaces because a sensor or an image filter mixed
//! them. Both rules look at the four opposite neighbour pairs of a pixel (horizontal, vertical, two
//! diagonals; borders replicated) and drop the pixel if a pair jumps and the pixel lies well
//! inside the jump.
//!
//! * 8-bit codes (`model.md` 13): a jump is ≥ 6 levels, well inside is `[min + 2, max − 2]`; code 0
//!   (background) takes part like any other.
//! * Metric depth: the same with the noise half-width `q` (`accuracy.md` 2) in place of a level,
//!   which for 8-bit depth is one level: a jump is ≥ 6 q, well inside is `[min + 2 q, max − 2 q]`,
//!   with `q` at the pixel's own depth. Holes there are missing measurements, so a pair with a hole
//!   says nothing.

use super::frame::sensor_noise;

/// Smallest jump between opposite neighbours, in levels (or `q`).
const JUMP: u8 = 6;
/// Distance from both sides of the jump, in levels (or `q`).
const MARGIN: u8 = 2;

/// An image with a replicated border of one pixel, kept between frames.
#[derive(Clone, Debug, Default)]
pub(super) struct Padded<T> {
    values: Vec<T>,
    stride: usize,
}

impl<T: Copy> Padded<T> {
    /// Copies `width` values per row through `convert` and replicates the borders.
    pub fn fill<S: Copy>(&mut self, width: usize, data: &[S], mut convert: impl FnMut(S) -> T) {
        self.values.clear();
        self.stride = width + 2;
        if width == 0 {
            return;
        }
        let height = data.len() / width;
        self.values.reserve((height + 2) * self.stride);
        for row in (0..height).take(1).chain(0..height).chain((0..height).last()) {
            let source = &data[row * width..(row + 1) * width];
            self.values.push(convert(source[0]));
            self.values.extend(source.iter().map(|v| convert(*v)));
            self.values.push(convert(source[width - 1]));
        }
    }

    /// The three padded rows around row `row` of the image.
    fn around(&self, row: usize) -> [&[T]; 3] {
        let at = |i: usize| &self.values[(row + i) * self.stride..(row + i + 1) * self.stride];
        [at(0), at(1), at(2)]
    }
}

/// Writes 1 where a pixel of the row is mixed, else 0.
pub(super) fn mixed_levels(image: &Padded<u8>, row: usize, mixed: &mut [u8]) {
    opposite_pairs(image, row, mixed, |a, d, b| {
        let (low, high) = (a.min(b), a.max(b));
        (high - low >= JUMP)
            & (d >= low.saturating_add(MARGIN))
            & (d <= high.saturating_sub(MARGIN))
    });
}

/// The same for lengths in world units, 0 at holes.
pub(super) fn mixed_lengths(image: &Padded<f32>, row: usize, mixed: &mut [u8]) {
    opposite_pairs(image, row, mixed, |a, d, b| {
        let q = sensor_noise(d);
        let (low, high) = (a.min(b), a.max(b));
        let margin = f32::from(MARGIN) * q;
        (low > 0.0)
            & (high - low >= f32::from(JUMP) * q)
            & (d >= low + margin)
            & (d <= high - margin)
    });
}

/// Whole-row passes over slices of one length, which the compiler turns into vector code.
#[inline(always)]
fn opposite_pairs<T: Copy>(
    image: &Padded<T>,
    row: usize,
    mixed: &mut [u8],
    is_between: impl Fn(T, T, T) -> bool,
) {
    let width = mixed.len();
    let [above, here, below] = image.around(row);
    let (al, ac, ar) = (&above[..width], &above[1..=width], &above[2..width + 2]);
    let (hl, hc, hr) = (&here[..width], &here[1..=width], &here[2..width + 2]);
    let (bl, bc, br) = (&below[..width], &below[1..=width], &below[2..width + 2]);
    for x in 0..width {
        let d = hc[x];
        let any = is_between(hl[x], d, hr[x])
            | is_between(ac[x], d, bc[x])
            | is_between(al[x], d, br[x])
            | is_between(ar[x], d, bl[x]);
        mixed[x] = u8::from(any);
    }
}
