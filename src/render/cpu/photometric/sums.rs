//! Sums of one splat over the pixels of a photograph: moments in the splat's whitened image plane.
//!
//! `z = (p, q)` is the offset of a pixel from the splat's centre, whitened so that
//! `α = o·exp(−½|z|²)`. Every derivative of `ln α` by position, shape and opacity is a linear
//! combination of `p, q, ½p², pq, ½q², 1` (`photometric.md`, Image plane). The gradient therefore needs
//! six moments and the Gauss-Newton block fifteen, independent of the parameters. Moments about the
//! centre in units of the splat's own width stay near 1, which suits f32.

/// Number of moments up to second order: `1, p, q, p², pq, q²`.
pub const N_QUADRATIC: usize = 6;
/// Number of moments up to fourth order, sorted by order and then by decreasing powers of `p`.
pub const N_QUARTIC: usize = 15;

/// Offsets of the groups of sums.
pub(super) const GRADIENT: usize = 0;
pub(super) const CURVATURE: usize = GRADIENT + N_QUADRATIC;
pub(super) const COLOR: usize = CURVATURE + N_QUARTIC;
pub(super) const COLOR_CURVATURE: usize = COLOR + 9;
pub(super) const WEIGHT: usize = COLOR_CURVATURE + N_QUADRATIC;
/// Number of sums per splat.
pub const N_IMAGE_SUMS: usize = WEIGHT + 1;

/// Sums of one splat in one view: gradient and curvature moments of `ln α`, gradient and curvature moments
/// of the colours, and total weight.
pub type ImageSums = [f32; N_IMAGE_SUMS];

/// Index of the moment `pⁱqʲ` among [`N_QUARTIC`].
pub(super) const fn moment(i: usize, j: usize) -> usize {
    let order = i + j;
    order * (order + 1) / 2 + j
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_have_places_of_their_own() {
        let mut places: Vec<usize> =
            (0..5).flat_map(|order| (0..=order).map(move |j| moment(order - j, j))).collect();
        assert_eq!(places[..6], [0, 1, 2, 3, 4, 5]);
        places.sort_unstable();
        assert_eq!(places, (0..N_QUARTIC).collect::<Vec<_>>());
    }
}
