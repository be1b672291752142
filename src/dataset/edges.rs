//! Flying pixels: depth between two surfaces that a sensor or an image filter mixed. Both rules compare a
//! pixel with its four pairs of opposite neighbours (horizontal, vertical, two diagonals; borders
//! replicated). They drop the pixel if a pair jumps and the pixel lies well inside the jump.
//!
//! * 8-bit codes (`dataset.md`, Edge filter): a jump is ≥ 6 levels, well inside is `[min + 2, max − 2]`;
//!   code 0 (background) is treated like any other.
//! * Metric depth: the same rule with the noise half-width `q` (`dataset.md`, Sensors) at the pixel's own
//!   depth in place of a level: a jump is ≥ 6 q, well inside is `[min + 2 q, max − 2 q]`. In small images
//!   slanted surfaces jump from pixel to pixel, so a jump must also exceed the step of a plane tilted by
//!   80° over two pixels. Holes are missing measurements, so a pair with a hole is ignored.

use super::depth::sensor_noise;

/// Smallest jump between opposite neighbours, in levels (or `q`).
const JUMP: u8 = 6;
/// Distance from both sides of the jump, in levels (or `q`).
const MARGIN: u8 = 2;
/// Depth step of a plane tilted by 80° between opposite diagonal neighbours, in pixel widths:
/// `2·√2·tan 80°`.
const STEEPEST_PLANE: f32 = 16.0;

/// Image with a replicated border of one pixel; its memory is reused between frames.
#[derive(Clone, Debug, Default)]
pub(super) struct Padded<T> {
    values: Vec<T>,
    stride: usize,
}

impl<T: Copy> Padded<T> {
    /// Converts the values, `width` per row, and replicates the borders.
    pub fn fill<S: Copy>(&mut self, width: usize, data: &[S], mut convert: impl FnMut(S) -> T) {
        self.values.clear();
        self.stride = width + 2;
        if width == 0 {
            return;
        }
        let height = data.len() / width;
        self.values.reserve((height + 2) * self.stride);
        // First and last row twice: at a border a pixel is its own neighbour and not an edge.
        for row in (0..height).take(1).chain(0..height).chain((0..height).last()) {
            let source = &data[row * width..(row + 1) * width];
            self.values.push(convert(source[0]));
            self.values.extend(source.iter().map(|v| convert(*v)));
            self.values.push(convert(source[width - 1]));
        }
    }

    /// The padded rows above, at and below row `row` of the image.
    fn padded_rows(&self, row: usize) -> [&[T]; 3] {
        let at = |i: usize| &self.values[(row + i) * self.stride..(row + i + 1) * self.stride];
        [at(0), at(1), at(2)]
    }
}

/// Writes 1 for each mixed pixel of the row, else 0.
#[inline(always)]
pub(super) fn mark_mixed_levels(image: &Padded<u8>, row: usize, mixed: &mut [u8]) {
    mark_between_opposite(image, row, mixed, |a, d, b| {
        let (low, high) = (a.min(b), a.max(b));
        // `&` instead of `&&`: without branches the row vectorises.
        (high - low >= JUMP)
            & (d >= low.saturating_add(MARGIN))
            & (d <= high.saturating_sub(MARGIN))
    });
}

/// Writes 1 for each mixed pixel of a row of lengths, else 0. Lengths are in world units (0 at holes),
/// `metre` in world units per metre, `focal` in pixels.
#[inline(always)]
pub(super) fn mark_mixed_lengths(
    image: &Padded<f32>,
    row: usize,
    focal: f32,
    metre: f32,
    mixed: &mut [u8],
) {
    let per_metre = 1.0 / metre;
    let per_depth = STEEPEST_PLANE / focal;
    mark_between_opposite(image, row, mixed, |a, d, b| {
        let q = metre * sensor_noise(d * per_metre);
        let jump = (f32::from(JUMP) * q).max(per_depth * d);
        let (low, high) = (a.min(b), a.max(b));
        let margin = f32::from(MARGIN) * q;
        (low > 0.0) & (high - low >= jump) & (d >= low + margin) & (d <= high - margin)
    });
}

/// Passes over whole rows of one length, which the compiler vectorises.
#[inline(always)]
fn mark_between_opposite<T: Copy>(
    image: &Padded<T>,
    row: usize,
    mixed: &mut [u8],
    is_between: impl Fn(T, T, T) -> bool,
) {
    let width = mixed.len();
    let [above, here, below] = image.padded_rows(row);
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

#[cfg(test)]
mod tests {
    use super::*;

    fn middle<T: Copy>(image: [T; 9], judge: impl Fn(&Padded<T>, &mut [u8])) -> bool {
        let mut padded = Padded { values: Vec::new(), stride: 0 };
        padded.fill(3, &image, |v| v);
        let mut mixed = [0; 3];
        judge(&padded, &mut mixed);
        mixed[1] == 1
    }

    #[test]
    fn levels_between_a_jump_are_mixed() {
        for (a, d, b, is_mixed) in [
            (100, 103, 106, true),
            (100, 102, 106, true),
            (100, 101, 106, false),
            (100, 104, 106, true),
            (100, 105, 106, false),
            (100, 102, 105, false),
            (106, 103, 100, true),
            (0, 90, 180, true),
            (0, 179, 180, false),
            (250, 255, 255, false),
        ] {
            let judge = |p: &Padded<u8>, m: &mut [u8]| mark_mixed_levels(p, 1, m);
            let turned = [
                [d, d, d, a, d, b, d, d, d],
                [d, a, d, d, d, d, d, b, d],
                [a, d, d, d, d, d, d, d, b],
                [d, d, b, d, d, d, a, d, d],
            ];
            for image in turned {
                assert_eq!(middle(image, judge), is_mixed, "{image:?}");
            }
        }
    }

    #[test]
    fn lengths_between_a_jump_are_mixed_unless_a_plane_or_a_hole_explains_them() {
        for (a, d, b, focal, is_mixed) in [
            (1.0, 1.05, 1.1, 585.0, true),
            (1.0, 1.004, 1.1, 585.0, false),
            (1.0, 1.05, 0.0, 585.0, false),
            (0.0, 1.05, 1.1, 585.0, false),
            (1.0, 1.008, 1.016, 585.0, false),
            // 30 mm over two pixels is an edge in a large image, a slant in a small one.
            (1.0, 1.015, 1.03, 585.0, true),
            (1.0, 1.015, 1.03, 120.0, false),
            // Noise grows with the square of the distance.
            (3.0, 3.05, 3.1, 585.0, false),
            (3.0, 3.2, 3.4, 585.0, true),
        ] {
            let judge = |p: &Padded<f32>, m: &mut [u8]| mark_mixed_lengths(p, 1, focal, 1.0, m);
            let image: [f32; 9] = [d, d, d, a, d, b, d, d, d];
            assert_eq!(middle(image, judge), is_mixed, "{image:?} at focal length {focal}");
        }
    }

    #[test]
    fn borders_are_replicated() {
        let mut padded = Padded { values: Vec::new(), stride: 0 };
        padded.fill(2, &[1u8, 2, 3, 4], |v| v);
        assert_eq!(padded.values, [1, 1, 2, 2, 1, 1, 2, 2, 3, 3, 4, 4, 3, 3, 4, 4]);
    }
}
