//! The second walk over a tile: from the difference of photograph and picture to sums per splat.
//!
//! It goes from front to back through what the first one kept: what lies behind a splat is the finished
//! pixel less what was walked over. A walk from back to front, as others do it, has to divide the
//! transmittance back.
//!
//! Coverage is learnt beside colour: crack filling hides gaps from the colours, and without it splats
//! shrink until they show at other distances (`photometric.md`, Coverage).
//!
//! Crack filling is part of the derivative (`photometric.md`, Crack filling): a pixel's colour is `C·f(A)`
//! with `f = min(1/F, 1/A)`, so where it is filled, every splat also shares in what fills it.

use super::super::raster::{BATCH, Batch};
use super::super::record::{ConicRecord, Gradient};
use super::super::tile::{GROUPS, LANE_COLUMNS, Plane, capped};
use super::drawn::{DrawnTile, Hit, color_at, whitened};
use super::moments::{HitTerms, sum_hits};
use super::sums::ImageSums;
use super::target::{TargetTile, rows_of};
use crate::math::simd::{EVERY_BIT, LANES, Vector};
use crate::render::constants::{ALPHA_CAP, TILE};

/// Least weight that a pixel's share is divided by.
pub(in crate::render) const MIN_WEIGHT: f32 = 1e-8;

/// Coverage from which on a pixel's difference is counted as noise.
pub(in crate::render) const SEEN: f32 = 0.5;

/// How pixels count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelRule {
    /// Coverage from which on a pixel is filled.
    pub full_coverage: f32,
    /// Scale of the Cauchy weight `1/(1 + |r|²/τ²)` of a residual `r`, colour units.
    pub tau: f32,
    /// How much a coverage that is wrong by 1 counts beside a colour that is, squared.
    pub coverage: f32,
    /// The same of a pixel whose splats all lie far from the depth that was measured of it.
    pub depth: f32,
}

/// A tile between the walks; one after the other, in the same memory. Pixels beyond the image show no splat,
/// so that it does not matter what is kept of them as long as it is finite.
pub(super) struct SecondWalk {
    left: usize,
    top: usize,
    transmittance: Plane,
    /// Finished colour that lies behind what was walked over.
    behind: [Plane; 3],
    /// Factor of crack filling, `f`.
    fill: Plane,
    /// Weighted residual, `ρ·r`.
    residual: [Plane; 3],
    /// Weight of a pixel's curvature but for the splat's own weight: `ρ·A^¾`.
    share: Plane,
    /// What is left to the background at the end, where it is known what should be; else 0.
    end: Plane,
    /// Weighted coverage that lacks.
    lacking: Plane,
    /// Wrongness that lies behind what was walked over, and the weighted one of all.
    wrong: Plane,
    wronged: Plane,
    /// See [`PixelRule`].
    coverage: f32,
    depth: f32,
    /// Squared differences of covered pixels that count, and how many these are.
    error: (f64, f64),
}

impl Default for SecondWalk {
    fn default() -> Self {
        let empty = [[0.0; LANES]; TILE * GROUPS];
        Self {
            left: 0,
            top: 0,
            transmittance: empty,
            behind: [empty; 3],
            fill: empty,
            residual: [empty; 3],
            share: empty,
            end: empty,
            lacking: empty,
            wrong: empty,
            wronged: empty,
            coverage: 0.0,
            depth: 0.0,
            error: (0.0, 0.0),
        }
    }
}

impl SecondWalk {
    /// Begins anew with a tile that was drawn in the rows of `mask`, against what was measured of it.
    #[inline(always)]
    pub(super) fn begin<V: Vector>(
        &mut self,
        tile: &DrawnTile,
        target: &TargetTile,
        rule: PixelRule,
        mask: u32,
    ) {
        [self.left, self.top] = tile.corner();
        (self.coverage, self.depth, self.error) = (rule.coverage, rule.depth, (0.0, 0.0));
        for row in rows_of(mask) {
            for group in row * GROUPS..(row + 1) * GROUPS {
                self.compare::<V>(tile, target, rule, group);
            }
        }
    }

    /// Sets what the splats of eight pixels need of them.
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
        let end = left.max(zero - left);
        let covered = one - end;
        let full = V::splat(rule.full_coverage);
        let fill = (one / full).min(one / covered);
        // The derivative of `1/A` where the pixel is filled, times what is left to the background.
        let filled = end / (covered * covered);
        let filled = V::select(covered.mask_at_most(full), zero, filled);
        let mut residual = [zero; 3];
        let mut squared = zero;
        for (k, residual) in residual.iter_mut().enumerate() {
            let color = V::load(&tile.color[k][group]);
            *residual = V::load(&target.color[k][group]) - color * fill;
            squared = squared + *residual * *residual;
            (color * (fill + filled)).store(&mut self.behind[k][group]);
        }
        self.count_error(squared.to_array(), covered.to_array());
        let rho = one / (one + squared / V::splat(rule.tau * rule.tau));
        for (plane, residual) in self.residual.iter_mut().zip(residual) {
            (rho * residual).store(&mut plane[group]);
        }
        // What is mostly covered lies inside a surface, as far as nobody knows better.
        let coverage = V::load(&target.coverage[group]);
        let (is_number, is_seen) =
            (coverage.mask_at_most(coverage), V::splat(SEEN).mask_at_most(covered));
        let is_known = V::select(is_number, V::splat(EVERY_BIT), is_seen);
        let lacks = V::select(is_number, coverage, one) - covered;
        end.and(is_known).store(&mut self.end[group]);
        let lacking = rho * V::splat(rule.coverage) * lacks;
        lacking.and(is_known).store(&mut self.lacking[group]);
        if target.has_depth {
            let wrong = V::load(&tile.wrong[group]);
            wrong.store(&mut self.wrong[group]);
            (rho * V::splat(rule.depth) * wrong).store(&mut self.wronged[group]);
        }
        fill.store(&mut self.fill[group]);
        (rho * covered.sqrt() * covered.sqrt().sqrt()).store(&mut self.share[group]);
        self.transmittance[group] = [1.0; LANES];
    }

    /// Where nothing is drawn yet the difference says nothing of noise.
    #[inline(always)]
    fn count_error(&mut self, squared: [f32; LANES], covered: [f32; LANES]) {
        for (squared, _) in squared.into_iter().zip(covered).filter(|(_, covered)| *covered >= SEEN)
        {
            self.error.0 += f64::from(squared);
            self.error.1 += 1.0;
        }
    }

    /// Sum of the squared differences of photograph and picture over channels and counted pixels, and
    /// the number of these.
    pub(super) fn error(&self) -> (f64, f64) {
        self.error
    }

    /// Adds the sums of the tile's splats, nearest first, to theirs in the row's list.
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
            let all = &batches[shown.place / BATCH].records;
            let index = shown.place % BATCH;
            let (splat, gradient) = (&all.records[index], all.gradients.get(index));
            let hits = &tile.hits[first..shown.end];
            for (terms, hit) in terms.iter_mut().zip(hits) {
                *terms = self.terms(hit, splat, gradient, target);
            }
            sum_hits(&terms[..hits.len().min(TILE * GROUPS)], &mut sums[shown.place]);
            first = shown.end;
        }
    }

    /// What eight pixels say of a splat that they show.
    #[inline(always)]
    fn terms<V: Vector>(
        &mut self,
        hit: &Hit,
        splat: &ConicRecord,
        gradient: Option<&Gradient>,
        target: &TargetTile,
    ) -> HitTerms<V> {
        let group = hit.group as usize % (TILE * GROUPS); // as it is: the compiler then checks no bounds
        let x = self.left as f32 + 0.5 - splat.u;
        let x = V::load(&LANE_COLUMNS[group % GROUPS]) + V::splat(x);
        let offset = [x, V::splat((self.top + group / GROUPS) as f32 + 0.5 - splat.v)];
        let [p, q] = whitened(splat, offset);
        let free = V::load(&hit.free);
        let alpha = capped(free);
        // Under the cap neither position nor shape nor opacity changes alpha.
        let moving = alpha.and(free.mask_at_most(V::splat(ALPHA_CAP as f32)));
        let front = V::load(&self.transmittance[group]);
        let weight = alpha * front;
        (front - weight).store(&mut self.transmittance[group]);
        let fill = V::load(&self.fill[group]);
        let filled = fill * weight;
        let per_open = V::splat(1.0) / (V::splat(1.0) - alpha);
        let ahead = fill * front;
        let (mut along, mut squared) = (V::splat(0.0), V::splat(0.0));
        let mut pulls = [V::splat(0.0); 3];
        for (k, pull) in pulls.iter_mut().enumerate() {
            let color = color_at(splat, gradient, k, offset);
            let behind = V::load(&self.behind[k][group]) - filled * color;
            behind.store(&mut self.behind[k][group]);
            // What one more unit of alpha would change of the pixel.
            let change = ahead * color - behind * per_open;
            let residual = V::load(&self.residual[k][group]);
            along = along + change * residual;
            squared = squared + change * change;
            *pull = residual * filled;
        }
        // Coverage is one more channel, in which every splat is 1 and what lies behind ends with 1.
        let closing = V::load(&self.end[group]) * per_open;
        along = along + closing * V::load(&self.lacking[group]);
        squared = squared + V::splat(self.coverage) * closing * closing;
        if target.has_depth {
            let wrongness = target.wrongness(group, splat, offset);
            let wronging = self.wronging(wrongness, group, [weight, front, per_open]);
            along = along - wronging * V::load(&self.wronged[group]);
            squared = squared + V::splat(self.depth) * wronging * wronging;
        }
        // `(A/w)^¾`: all splats of a pixel move at once, so a block alone would overshoot.
        let root = weight.max(V::splat(MIN_WEIGHT)).sqrt();
        let share = V::load(&self.share[group]) / (root * root.sqrt());
        HitTerms {
            at: [p, q],
            slope: along * moving,
            bend: share * squared * moving * moving,
            color_bend: share * filled * filled,
            pulls,
            weight,
        }
    }
    /// What one more unit of alpha would change of the wrongness of eight pixels. It is one more channel,
    /// which should show nothing. Where splats lie is for the points to say: only how much of them shows is
    /// asked.
    #[inline(always)]
    fn wronging<V: Vector>(
        &mut self,
        wrongness: V,
        group: usize,
        [weight, front, per_open]: [V; 3],
    ) -> V {
        let behind = V::load(&self.wrong[group]) - weight * wrongness;
        behind.store(&mut self.wrong[group]);
        front * wrongness - behind * per_open
    }
}
