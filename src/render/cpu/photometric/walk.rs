//! The second walk over a tile: from the difference of photograph and picture to sums per splat.
//!
//! It goes from front to back like the first one and stops where that stopped, so that both see the
//! same splats: what lies behind a splat is the finished pixel less what was walked over. A walk from
//! back to front, as others do it, has to divide the transmittance back and to remember where each
//! pixel ended.
//!
//! Coverage is learnt beside colour: crack filling hides gaps from the colours, and without it splats
//! shrink until they show at other distances (`photometric.md`, Coverage).
//!
//! Crack filling is part of the derivative (`photometric.md`, Crack filling): a pixel's colour is `C·f(A)`
//! with `f = min(1/F, 1/A)`, so where it is filled, every splat also shares in what fills it.

use super::super::record::{ConicRecord, Gradient, Records};
use super::super::tile::{
    GROUPS, LANE_COLUMNS, Passed, Plane, Tile, offset_color, pass, row_is_finished, span, untouched,
};
use super::sums::{
    COLOR, COLOR_CURVATURE, CURVATURE, GRADIENT, ImageSums, N_IMAGE_SUMS, N_QUADRATIC, WEIGHT,
};
use crate::math::image::Image;
use crate::math::simd::{LANES, Vector};
use crate::render::constants::TILE;

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
}

/// A tile between the walks; one after the other, in the same memory.
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
    /// See [`PixelRule::coverage`].
    coverage: f32,
    open_rows: u32,
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
            coverage: 0.0,
            open_rows: 0,
            error: (0.0, 0.0),
        }
    }
}

impl SecondWalk {
    /// Begins anew with a tile that was drawn in the rows of `mask`, against the photograph: colour over
    /// black and coverage of each pixel.
    pub(super) fn begin(
        &mut self,
        tile: &Tile,
        photograph: &Image<[f32; 4]>,
        rule: PixelRule,
        mask: u32,
    ) {
        let (left, top) = tile.corner();
        let (columns, rows) = (photograph.width - left, photograph.height - top);
        (self.left, self.top, self.coverage) = (left, top, rule.coverage);
        (self.open_rows, self.error) = (0, (0.0, 0.0));
        for row in (0..TILE.min(rows)).filter(|row| mask & (1 << row) != 0) {
            self.open_rows |= 1 << row;
            (0..GROUPS).for_each(|half| self.clear(row * GROUPS + half, half * LANES, columns));
            for column in 0..TILE.min(columns) {
                self.compare(tile, photograph, rule, row, column);
            }
        }
    }

    /// Forgets a group whose first pixel has the column `first` of so many.
    fn clear(&mut self, group: usize, first: usize, columns: usize) {
        self.transmittance[group] = untouched(first, columns);
        let planes = [&mut self.fill, &mut self.share, &mut self.end, &mut self.lacking];
        let planes = planes.into_iter().chain(&mut self.behind).chain(&mut self.residual);
        planes.for_each(|plane| plane[group] = [0.0; LANES]);
    }

    /// Sets what one pixel's splats need of it.
    fn compare(
        &mut self,
        tile: &Tile,
        photograph: &Image<[f32; 4]>,
        rule: PixelRule,
        row: usize,
        column: usize,
    ) {
        let (group, lane) = (row * GROUPS + column / LANES, column % LANES);
        let [t, r, g, b, _] = tile.planes().map(|plane| plane[group][lane]);
        let end = t.abs();
        let covered = 1.0 - end;
        let fill = (1.0 / rule.full_coverage).min(1.0 / covered);
        // The derivative of `1/A` where the pixel is filled, times what is left to the background.
        let filled = if covered > rule.full_coverage { end / (covered * covered) } else { 0.0 };
        let [red, green, blue, target] =
            photograph.data[(self.top + row) * photograph.width + self.left + column];
        let color = [r, g, b];
        let residual: [f32; 3] = std::array::from_fn(|k| [red, green, blue][k] - color[k] * fill);
        let squared: f32 = residual.iter().map(|r| r * r).sum();
        // Where nothing is drawn yet the difference says nothing of noise.
        if covered >= SEEN {
            self.error.0 += f64::from(squared);
            self.error.1 += 1.0;
        }
        let rho = 1.0 / (1.0 + squared / (rule.tau * rule.tau));
        for k in 0..3 {
            self.behind[k][group][lane] = color[k] * (fill + filled);
            self.residual[k][group][lane] = rho * residual[k];
        }
        // What is mostly covered lies inside a surface, as far as nobody knows better.
        let target = if target.is_nan() && covered >= SEEN { 1.0 } else { target };
        if !target.is_nan() {
            self.end[group][lane] = end;
            self.lacking[group][lane] = rho * rule.coverage * (target - covered);
        }
        self.fill[group][lane] = fill;
        self.share[group][lane] = rho * covered.sqrt() * covered.sqrt().sqrt();
    }

    /// Sum of the squared differences of photograph and picture over channels and counted pixels, and
    /// the number of these.
    pub(super) fn error(&self) -> (f64, f64) {
        self.error
    }

    /// Adds the sums of the listed splats, nearest first, to theirs.
    #[inline(always)]
    pub(super) fn walk<V: Vector>(&mut self, list: &[u32], all: &Records, sums: &mut [ImageSums]) {
        for &index in list {
            if self.open_rows == 0 {
                break;
            }
            let index = index as usize;
            let gradient = all.gradients.get(index);
            self.add_splat::<V>(&all.records[index], gradient, &mut sums[index]);
        }
    }

    #[inline(always)]
    fn add_splat<V: Vector>(
        &mut self,
        splat: &ConicRecord,
        gradient: Option<&Gradient>,
        sums: &mut ImageSums,
    ) {
        let rows = span(splat.rect.y0, splat.rect.y1, self.top);
        let columns = span(splat.rect.x0, splat.rect.x1, self.left);
        let groups = columns.start / LANES..columns.end.div_ceil(LANES);
        let x0 = self.left as f32 + 0.5 - splat.u;
        let x =
            [V::load(&LANE_COLUMNS[0]) + V::splat(x0), V::load(&LANE_COLUMNS[1]) + V::splat(x0)];
        let mut lanes = [V::splat(0.0); N_IMAGE_SUMS];
        let mut any = false;
        for row in rows {
            if self.open_rows & (1 << row) == 0 {
                continue;
            }
            let y = V::splat((self.top + row) as f32 + 0.5 - splat.v);
            let mut stopped = false;
            for half in groups.clone() {
                let group = row * GROUPS + half;
                let (hit, ended) =
                    self.add_group::<V>(group, splat, gradient, [x[half], y], &mut lanes);
                any |= hit;
                stopped |= ended;
            }
            if stopped && row_is_finished(&self.transmittance, row) {
                self.open_rows &= !(1 << row);
            }
        }
        if any {
            add_lanes(sums, &lanes);
        }
    }

    /// Adds eight pixels; whether any of them shows the splat, and whether one was finished by it.
    #[inline(always)]
    fn add_group<V: Vector>(
        &mut self,
        group: usize,
        splat: &ConicRecord,
        gradient: Option<&Gradient>,
        offset: [V; 2],
        sums: &mut [V; N_IMAGE_SUMS],
    ) -> (bool, bool) {
        let group = group % (TILE * GROUPS); // as it is: the compiler then checks no bounds
        let p = V::splat(splat.p_x) * offset[0] + V::splat(splat.p_y) * offset[1];
        let q = V::splat(splat.q_y) * offset[1];
        let exponent = V::splat(0.0) - (p * p + q * q);
        let passed = pass(&mut self.transmittance[group], splat, exponent);
        let Some(passed) = passed else { return (false, false) };
        // Under the cap neither position nor shape nor opacity changes alpha, hence `moving`.
        let Passed { alpha, moving, weight, front, stopped } = passed;
        let fill = V::load(&self.fill[group]);
        let filled = fill * weight;
        let per_open = V::splat(1.0) / (V::splat(1.0) - alpha);
        let ahead = fill * front;
        let (mut along, mut squared) = (V::splat(0.0), V::splat(0.0));
        for k in 0..3 {
            let color = match gradient {
                Some(gradient) => offset_color(splat.color[k], gradient, k, offset),
                None => V::splat(splat.color[k]),
            };
            let behind = V::load(&self.behind[k][group]) - filled * color;
            behind.store(&mut self.behind[k][group]);
            // What one more unit of alpha would change of the pixel.
            let change = ahead * color - behind * per_open;
            let residual = V::load(&self.residual[k][group]);
            along = along + change * residual;
            squared = squared + change * change;
            let pull = residual * filled;
            let at = COLOR + 3 * k;
            sums[at] = sums[at] + pull;
            sums[at + 1] = sums[at + 1] + pull * p;
            sums[at + 2] = sums[at + 2] + pull * q;
        }
        // Coverage is one more channel, in which every splat is 1 and what lies behind ends with 1.
        let closing = V::load(&self.end[group]) * per_open;
        along = along + closing * V::load(&self.lacking[group]);
        squared = squared + V::splat(self.coverage) * closing * closing;
        // `(A/w)^¾`: all splats of a pixel move at once, so a block alone would overshoot.
        let root = weight.max(V::splat(MIN_WEIGHT)).sqrt();
        let share = V::load(&self.share[group]) / (root * root.sqrt());
        let slopes = [along * moving, share * squared * moving * moving, share * filled * filled];
        add_moments(sums, [p, q], slopes);
        sums[WEIGHT] = sums[WEIGHT] + weight;
        (true, stopped)
    }
}

/// Adds every lane to its sum. Lane by lane, so that the sum has the same bits on every instruction set.
#[inline(always)]
fn add_lanes<V: Vector>(sums: &mut ImageSums, lanes: &[V; N_IMAGE_SUMS]) {
    let (mut whole, mut eights) = (sums.chunks_exact_mut(LANES), lanes.chunks_exact(LANES));
    for (sums, lanes) in whole.by_ref().zip(eights.by_ref()) {
        let mut rows = [lanes[0]; LANES];
        rows.copy_from_slice(lanes);
        (V::load(sums) + V::lane_sums(rows)).store(sums);
    }
    let (rest, lanes) = (whole.into_remainder(), eights.remainder());
    let mut rows = [V::splat(0.0); LANES];
    rows[..lanes.len()].copy_from_slice(lanes);
    let added = V::lane_sums(rows).to_array();
    rest.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
}

/// Adds moments at `(p, q)`: quadratic ones of the slope, quartic ones of the curvature, quadratic ones
/// of the colour's curvature.
#[inline(always)]
fn add_moments<V: Vector>(
    sums: &mut [V; N_IMAGE_SUMS],
    [p, q]: [V; 2],
    [slope, bend, color_bend]: [V; 3],
) {
    let [pp, pq, qq] = [p * p, p * q, q * q];
    let quadratic = [V::splat(1.0), p, q, pp, pq, qq];
    for (i, moment) in quadratic.into_iter().enumerate() {
        sums[GRADIENT + i] = sums[GRADIENT + i] + slope * moment;
        sums[CURVATURE + i] = sums[CURVATURE + i] + bend * moment;
        sums[COLOR_CURVATURE + i] = sums[COLOR_CURVATURE + i] + color_bend * moment;
    }
    let above = [pp * p, pp * q, p * qq, q * qq, pp * pp, pp * pq, pp * qq, pq * qq, qq * qq];
    for (i, moment) in above.into_iter().enumerate() {
        let at = CURVATURE + N_QUADRATIC + i;
        sums[at] = sums[at] + bend * moment;
    }
}
