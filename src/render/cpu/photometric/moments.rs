//! Sums the contributions of pixel groups to one splat.
//!
//! A splat has few pixel groups in a tile but many sums. The terms of each group are computed first. Then one
//! kind of sum at a time is accumulated over all groups. The sums of one kind stay in registers, whereas the
//! sums of all kinds together would spill. Groups and then lanes are added in a fixed order, so the results
//! are bit-identical on every instruction set.

use crate::math::simd::{LANES, Vector};

const N_ABOVE: usize = N_QUARTIC - N_QUADRATIC;

/// Contribution of eight pixels to the sums of a splat.
#[derive(Clone, Copy)]
pub(super) struct HitTerms<V> {
    /// Whitened offset from the splat's centre, `[p, q]`.
    pub whitened_offset: [V; 2],
    /// Derivative of the objective with respect to `ln α`.
    pub alpha_gradient: V,
    /// Gauss-Newton curvature of the objective with respect to `ln α`.
    pub alpha_curvature: V,
    /// Gauss-Newton curvature of the objective with respect to each colour channel.
    pub color_curvature: V,
    /// Derivatives of the objective with respect to the colour channels.
    pub color_gradients: [V; 3],
    /// Blending weight.
    pub weight: V,
}

impl<V: Vector> HitTerms<V> {
    #[inline(always)]
    pub(super) fn none() -> Self {
        let zero = V::splat(0.0);
        Self {
            whitened_offset: [zero; 2],
            alpha_gradient: zero,
            alpha_curvature: zero,
            color_curvature: zero,
            color_gradients: [zero; 3],
            weight: zero,
        }
    }

    #[inline(always)]
    fn quadratic(&self) -> [V; N_QUADRATIC] {
        let [p, q] = self.whitened_offset;
        [V::splat(1.0), p, q, p * p, p * q, q * q]
    }

    /// Returns the third-order monomials of the offset, then the fourth-order ones, each in decreasing
    /// powers of `p`.
    #[inline(always)]
    fn higher_moments(&self) -> [V; N_ABOVE] {
        let [_, p, q, pp, pq, qq] = self.quadratic();
        [pp * p, pp * q, p * qq, q * qq, pp * pp, pp * pq, pp * qq, pq * qq, qq * qq]
    }
}

#[inline(always)]
pub(super) fn sum_hits<V: Vector>(hits: &[HitTerms<V>], sums: &mut ImageSums) {
    let zero = V::splat(0.0);
    let mut lanes = [zero; N_IMAGE_SUMS];
    let mut slopes = [zero; N_QUADRATIC];
    let mut weight = zero;
    for hit in hits {
        add(&mut slopes, hit.alpha_gradient, hit.quadratic());
        weight = weight + hit.weight;
    }
    lanes[GRADIENT..][..N_QUADRATIC].copy_from_slice(&slopes);
    lanes[WEIGHT] = weight;
    let mut bends = [zero; N_QUADRATIC];
    for hit in hits {
        add(&mut bends, hit.alpha_curvature, hit.quadratic());
    }
    lanes[CURVATURE..][..N_QUADRATIC].copy_from_slice(&bends);
    // Split from the quadratic moments: 15 sums at once would not fit in registers.
    let mut bends = [zero; N_ABOVE];
    for hit in hits {
        add(&mut bends, hit.alpha_curvature, hit.higher_moments());
    }
    lanes[CURVATURE + N_QUADRATIC..][..N_ABOVE].copy_from_slice(&bends);
    let mut pulls = [[zero; 3]; 3];
    for hit in hits {
        for (pulls, pull) in pulls.iter_mut().zip(hit.color_gradients) {
            add(pulls, pull, [V::splat(1.0), hit.whitened_offset[0], hit.whitened_offset[1]]);
        }
    }
    for (k, pulls) in pulls.iter().enumerate() {
        lanes[COLOR + 3 * k..][..3].copy_from_slice(pulls);
    }
    let mut bends = [zero; N_QUADRATIC];
    for hit in hits {
        add(&mut bends, hit.color_curvature, hit.quadratic());
    }
    lanes[COLOR_CURVATURE..][..N_QUADRATIC].copy_from_slice(&bends);
    add_lanes(sums, &lanes);
}

#[inline(always)]
fn add<V: Vector, const N: usize>(sums: &mut [V; N], factor: V, moments: [V; N]) {
    for (sum, moment) in sums.iter_mut().zip(moments) {
        *sum = *sum + factor * moment;
    }
}

#[inline(always)]
fn add_lanes<V: Vector>(sums: &mut ImageSums, lanes: &[V; N_IMAGE_SUMS]) {
    let (mut whole, mut eights) = (sums.chunks_exact_mut(LANES), lanes.chunks_exact(LANES));
    for (sums, lanes) in whole.by_ref().zip(eights.by_ref()) {
        let mut rows = [lanes[0]; LANES];
        rows.copy_from_slice(lanes);
        (V::load(sums) + V::lane_sums(rows)).store(sums);
    }
    // The last, partial group is padded with zeros and summed in the same order.
    let (rest, lanes) = (whole.into_remainder(), eights.remainder());
    let mut rows = [V::splat(0.0); LANES];
    rows[..lanes.len()].copy_from_slice(lanes);
    let added = V::lane_sums(rows).to_array();
    rest.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
}

/// Number of moments up to second order: `1, p, q, p², pq, q²`.
pub const N_QUADRATIC: usize = 6;
/// Number of moments up to fourth order, sorted by order and then by decreasing powers of `p`.
pub const N_QUARTIC: usize = 15;

/// First index of the gradient moments of `ln α` in [`ImageSums`]. The following constants are the first
/// indices of the other groups of sums.
pub(super) const GRADIENT: usize = 0;
pub(super) const CURVATURE: usize = GRADIENT + N_QUADRATIC;
pub(super) const COLOR: usize = CURVATURE + N_QUARTIC;
pub(super) const COLOR_CURVATURE: usize = COLOR + 9;
pub(super) const WEIGHT: usize = COLOR_CURVATURE + N_QUADRATIC;
/// Number of sums over the pixels of a photograph that are accumulated per splat.
pub const N_IMAGE_SUMS: usize = WEIGHT + 1;

/// Sums of one splat in one view: gradient and curvature moments of `ln α`, gradient and curvature
/// moments of the colours, and total weight.
pub type ImageSums = [f32; N_IMAGE_SUMS];

/// Index of the moment `pⁱqʲ` in the order described at [`N_QUARTIC`].
pub(super) const fn moment(i: usize, j: usize) -> usize {
    let order = i + j;
    order * (order + 1) / 2 + j
}
