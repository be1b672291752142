//! Second walk over a tile: converts the difference between photograph and rendering to sums per splat.
//!
//! It processes the recorded splats from front to back. The colour behind a splat is the finished pixel minus
//! everything up to that splat. The usual walk from back to front must recover each transmittance by a
//! division.
//!
//! Coverage is fitted as well as colour. Crack filling hides gaps from the colours. Without a coverage
//! term, splats would shrink until gaps appear at other viewing distances (`photographs.md`, Coverage).
//!
//! Crack filling is part of the derivative (`photographs.md`, Crack filling). A pixel's colour is `C·f(A)`
//! with blended colour `C`, coverage `A`, full coverage `F` and `f = min(1/F, 1/A)`. So each splat of a
//! filled pixel also changes `f`.

use super::super::raster::{BATCH, Batch};
use super::super::record::{ConicRecord, Gradient};
use super::super::tile::{GROUPS, LANE_COLUMNS, Plane, cap_alpha};
use super::drawn::{DrawnTile, Hit, color_at, whiten_offset};
use super::moments::{HitTerms, ImageSums, sum_hits};
use super::target::{TargetTile, set_bits};
use crate::math::simd::{LANES, SET_LANE, Vector};
use crate::render::options::{ALPHA_CAP, TILE};

// Lower bound of the weight that a pixel's curvature share is divided by.
pub(in crate::render) const MIN_WEIGHT: f32 = 1e-8;

// Coverage from which a pixel's difference counts as noise and contributes to the error.
pub(in crate::render) const MIN_COUNTED_COVERAGE: f32 = 0.5;

/// Weighting of pixels and errors in the comparison of a photograph with its rendering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelRule {
    /// Coverage at which a pixel counts as fully covered.
    pub full_coverage: f32,
    /// Scale `τ` of the Cauchy weight `1/(1 + |r|²/τ²)` of a colour residual `r`, colour units.
    pub tau: f32,
    /// Weight of a pixel's squared coverage error relative to its squared colour error.
    pub coverage: f32,
    /// Weight of a pixel's squared depth error relative to its squared colour error; 0 ignores depth.
    /// The depth error approaches 1 if all splats of the pixel are far from its measured depth.
    pub depth: f32,
}

/// Pixel state of the second walk. One instance is reused for all tiles. Pixels outside the image show
/// no splat; their values are irrelevant as long as they are finite.
#[derive(Default)]
pub(super) struct SecondWalk {
    left: usize,
    top: usize,
    transmittance: Plane,
    /// Colour behind the splats processed so far, after crack filling; includes the derivative of `f`.
    behind: [Plane; 3],
    /// Crack filling factor `f`.
    fill: Plane,
    /// Colour residual `r` times its weight `ρ`.
    residual: [Plane; 3],
    /// Curvature weight shared by all splats of a pixel: `ρ·A^¾` with the residual's weight `ρ` and
    /// coverage `A`.
    curvature_weight: Plane,
    /// Final transmittance where coverage is compared, else 0.
    final_transmittance: Plane,
    /// Target coverage minus rendered coverage, times `ρ` and the weight of coverage errors; 0 where
    /// coverage is not compared.
    missing_coverage: Plane,
    /// Depth error of the splats behind those processed so far. `weighted_depth_error` is the depth
    /// error of all splats, times `ρ` and the weight of depth errors.
    depth_error_behind: Plane,
    weighted_depth_error: Plane,
    /// Weights of coverage and depth errors, see [`PixelRule`].
    coverage: f32,
    depth: f32,
    /// Sum of squared differences over the channels of covered pixels, and the number of these pixels.
    pub error: (f64, f64),
}

impl SecondWalk {
    /// Initialises the walk over the pixel rows of `mask` from a drawn tile and its target.
    #[inline(always)]
    pub(super) fn start_tile<V: Vector>(
        &mut self,
        tile: &DrawnTile,
        target: &TargetTile,
        rule: PixelRule,
        mask: u32,
    ) {
        (self.left, self.top) = (tile.left, tile.top);
        (self.coverage, self.depth, self.error) = (rule.coverage, rule.depth, (0.0, 0.0));
        for row in set_bits(mask) {
            for group in row * GROUPS..(row + 1) * GROUPS {
                self.compare::<V>(tile, target, rule, group);
            }
        }
    }

    /// Compares eight pixels with the target and sets the pixels' initial state for the walk.
    #[inline(always)]
    fn compare<V: Vector>(
        &mut self,
        tile: &DrawnTile,
        target: &TargetTile,
        rule: PixelRule,
        group: usize,
    ) {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let left = V::load(&tile.transmittance[group]);
        // Finished pixels store their transmittance negated.
        let end = left.max(zero - left);
        let covered = one - end;
        let full = V::splat(rule.full_coverage);
        let fill = (one / full).min(one / covered);
        // Derivative of `1/A` in a filled pixel, times the final transmittance.
        let filled = end / (covered * covered);
        // Below full coverage `f` is constant. The selection also removes quotients by 0.
        let filled = V::select(covered.mask_at_most(full), zero, filled);
        let mut residual = [zero; 3];
        let mut squared = zero;
        for (k, residual) in residual.iter_mut().enumerate() {
            let color = V::load(&tile.color[k][group]);
            *residual = V::load(&target.color[k][group]) - color * fill;
            squared = squared + *residual * *residual;
            (color * (fill + filled)).store(&mut self.behind[k][group]);
        }
        let coverage = V::load(&target.coverage[group]);
        // Pixels that are left out have a negative coverage: they count nothing and weigh nothing.
        let is_left_out = coverage.mask_at_most(V::splat(-0.5));
        let counted = V::select(is_left_out, zero, covered);
        self.count_error(squared.to_array(), counted.to_array());
        let rho = one / (one + squared / V::splat(rule.tau * rule.tau));
        let rho = V::select(is_left_out, zero, rho);
        for (plane, residual) in self.residual.iter_mut().zip(residual) {
            (rho * residual).store(&mut plane[group]);
        }
        // Without a known coverage, a mostly covered pixel is assumed to lie inside a surface.
        // Unknown coverage is NaN, which fails every comparison, also with itself.
        let (is_number, is_seen) =
            (coverage.mask_at_most(coverage), V::splat(MIN_COUNTED_COVERAGE).mask_at_most(covered));
        let is_known = V::select(is_number, V::splat(SET_LANE), is_seen);
        let lacks = V::select(is_number, coverage, one) - covered;
        end.and(is_known).store(&mut self.final_transmittance[group]);
        let lacking = rho * V::splat(rule.coverage) * lacks;
        lacking.and(is_known).store(&mut self.missing_coverage[group]);
        if target.has_depth {
            let wrong = V::load(&tile.depth_error[group]);
            wrong.store(&mut self.depth_error_behind[group]);
            (rho * V::splat(rule.depth) * wrong).store(&mut self.weighted_depth_error[group]);
        }
        fill.store(&mut self.fill[group]);
        // `A^¾` by roots, which every instruction set rounds alike.
        (rho * covered.sqrt() * covered.sqrt().sqrt()).store(&mut self.curvature_weight[group]);
        self.transmittance[group] = [1.0; LANES];
    }

    /// Adds the squared differences of eight pixels to the error. Pixels with little coverage are
    /// skipped, because they carry no information about noise.
    #[inline(always)]
    fn count_error(&mut self, squared: [f32; LANES], covered: [f32; LANES]) {
        for (squared, _) in
            squared.into_iter().zip(covered).filter(|(_, covered)| *covered >= MIN_COUNTED_COVERAGE)
        {
            self.error.0 += f64::from(squared);
            self.error.1 += 1.0;
        }
    }

    /// Adds the contributions of the tile's splats, nearest first, to the sums of the row's list.
    #[inline(always)]
    pub(super) fn walk<V: Vector>(
        &mut self,
        tile: &DrawnTile,
        batches: &[Batch],
        target: &TargetTile,
        sums: &mut [ImageSums],
    ) {
        let mut terms = [HitTerms::<V>::none(); TILE * GROUPS];
        let mut first = 0;
        for shown in &tile.shown {
            let all = &batches[shown.list_index / BATCH].records;
            let index = shown.list_index % BATCH;
            let (splat, gradient) = (&all.records[index], all.gradients.get(index));
            let hits = &tile.hits[first..shown.end];
            for (terms, hit) in terms.iter_mut().zip(hits) {
                *terms = self.terms(hit, splat, gradient, target);
            }
            sum_hits(&terms[..hits.len().min(TILE * GROUPS)], &mut sums[shown.list_index]);
            first = shown.end;
        }
    }

    /// Computes the contribution of eight pixels to a splat's sums. Also advances the state of the
    /// pixels past the splat.
    #[inline(always)]
    fn terms<V: Vector>(
        &mut self,
        hit: &Hit,
        splat: &ConicRecord,
        gradient: Option<&Gradient>,
        target: &TargetTile,
    ) -> HitTerms<V> {
        let group = hit.group as usize % (TILE * GROUPS); // no-op that removes the bounds checks
        let x = self.left as f32 + 0.5 - splat.u;
        let x = V::load(&LANE_COLUMNS[group % GROUPS]) + V::splat(x);
        let offset = [x, V::splat((self.top + group / GROUPS) as f32 + 0.5 - splat.v)];
        let [p, q] = whiten_offset(splat, offset);
        let free = V::load(&hit.free);
        let alpha = cap_alpha(free);
        // While capped, alpha does not depend on position, shape or opacity.
        let moving = alpha.and(free.mask_at_most(V::splat(ALPHA_CAP as f32)));
        let front = V::load(&self.transmittance[group]);
        let weight = alpha * front;
        (front - weight).store(&mut self.transmittance[group]);
        let fill = V::load(&self.fill[group]);
        let filled = fill * weight;
        // The cap keeps alpha below 1, so the quotient is finite.
        let per_open = V::splat(1.0) / (V::splat(1.0) - alpha);
        let ahead = fill * front;
        let (mut along, mut squared) = (V::splat(0.0), V::splat(0.0));
        let mut pulls = [V::splat(0.0); 3];
        for (k, pull) in pulls.iter_mut().enumerate() {
            let color = color_at(splat, gradient, k, offset);
            let behind = V::load(&self.behind[k][group]) - filled * color;
            behind.store(&mut self.behind[k][group]);
            // Derivative of the pixel's colour with respect to alpha.
            let change = ahead * color - behind * per_open;
            let residual = V::load(&self.residual[k][group]);
            along = along + change * residual;
            squared = squared + change * change;
            *pull = residual * filled;
        }
        // Coverage is an extra channel in which every splat is 1 and the background is 0.
        let closing = V::load(&self.final_transmittance[group]) * per_open;
        along = along + closing * V::load(&self.missing_coverage[group]);
        squared = squared + V::splat(self.coverage) * closing * closing;
        if target.has_depth {
            let wrongness = target.depth_error(group, splat, offset);
            let wronging = self.depth_error_derivative(wrongness, group, [weight, front, per_open]);
            along = along - wronging * V::load(&self.weighted_depth_error[group]);
            squared = squared + V::splat(self.depth) * wronging * wronging;
        }
        // `(A/w)^¾`: all splats of a pixel move at once, so exact blocks would overshoot.
        let root = weight.max(V::splat(MIN_WEIGHT)).sqrt();
        let share = V::load(&self.curvature_weight[group]) / (root * root.sqrt());
        HitTerms {
            whitened_offset: [p, q],
            alpha_gradient: along * moving,
            alpha_curvature: share * squared * moving * moving,
            color_curvature: share * filled * filled,
            color_gradients: pulls,
            weight,
        }
    }
    /// Returns the derivative of the depth error of eight pixels with respect to alpha. The depth error
    /// is an extra channel with target 0. It only changes how visible splats are; the positions of
    /// splats are determined by the measured points.
    #[inline(always)]
    fn depth_error_derivative<V: Vector>(
        &mut self,
        wrongness: V,
        group: usize,
        [weight, front, per_open]: [V; 3],
    ) -> V {
        let behind = V::load(&self.depth_error_behind[group]) - weight * wrongness;
        behind.store(&mut self.depth_error_behind[group]);
        front * wrongness - behind * per_open
    }
}
