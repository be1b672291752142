//! What a photograph says of one splat, summed over the pixels that show it: moments in the splat's
//! whitened image plane.
//!
//! With `z = (p, q)` the offset of a pixel from the splat's centre, whitened so that
//! `α = o·exp(−½|z|²)`, every derivative of `ln α` by position, shape and opacity is a linear
//! combination of `p, q, ½p², pq, ½q², 1` (`photometric.md`, Image plane). The gradient therefore needs
//! six moments and the Gauss-Newton block fifteen, whatever the parameters are; moments about the
//! centre in units of the splat's own width stay near 1, which f32 holds.

/// Moments of second order and below: `1, p, q, p², pq, q²`.
pub const N_QUADRATIC: usize = 6;
/// Moments of fourth order and below, by order, in an order by falling powers of `p`.
pub const N_QUARTIC: usize = 15;

/// Where each group of sums begins.
pub(super) const GRADIENT: usize = 0;
pub(super) const CURVATURE: usize = GRADIENT + N_QUADRATIC;
pub(super) const COLOR: usize = CURVATURE + N_QUARTIC;
pub(super) const COLOR_CURVATURE: usize = COLOR + 9;
pub(super) const WEIGHT: usize = COLOR_CURVATURE + N_QUADRATIC;
/// Sums of a splat.
pub const N_IMAGE_SUMS: usize = WEIGHT + 1;

/// Sums of one splat in one view: of the slope, of the curvature, of the colours, of their curvature,
/// and the weight.
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
