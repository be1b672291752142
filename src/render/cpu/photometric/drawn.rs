//! First walk over a tile: draws it and records which pixels show each splat.
//!
//! A third of the pixel groups in a splat's rectangle lie outside its ellipse, and each alpha costs an
//! exponential. The second walk reuses the recorded groups and alphas, so it visits only visible groups and
//! uses exactly the same alphas. Memory per tile is bounded, because a pixel finishes after a limited number
//! of splats.

use super::super::record::{ConicRecord, Gradient, Records};
use super::super::tile::{
    BlendStep, GROUPS, LANE_COLUMNS, Plane, attenuate, covered_rows_and_groups,
    initial_transmittance, offset_color, row_is_finished,
};
use super::target::{TargetTile, set_bits};
use crate::math::simd::{LANES, Vector};
use crate::render::options::TILE;

/// Alphas of a splat in one group of eight pixels.
pub(super) struct Hit {
    /// Alpha before the cap; 0 in a pixel where the splat is invisible.
    pub free: [f32; LANES],
    pub group: u32,
}

pub(super) struct VisibleSplat {
    /// Index of the splat in the list of its row of tiles.
    pub list_index: usize,
    /// End of the splat's hits in [`DrawnTile::hits`]; the next splat's hits start there.
    pub end: usize,
}

/// Rendered tile. One instance is reused for all tiles of a row.
#[derive(Default)]
pub(super) struct DrawnTile {
    pub left: usize,
    pub top: usize,
    /// Transmittance of each pixel; negative if the pixel is finished or outside the image.
    pub transmittance: Plane,
    pub color: [Plane; 3],
    /// Depth errors of the splats in each pixel, summed with their blending weights; only set if
    /// measured depths are known.
    pub depth_error: Plane,
    open_rows: u32,
    /// Visible splats, nearest first.
    pub shown: Vec<VisibleSplat>,
    pub hits: Vec<Hit>,
}

impl DrawnTile {
    /// Clears the tile and moves it to pixel `(left, top)`. `columns` is the number of pixels from
    /// there to the image's right edge. `mask` has one bit per pixel row to draw.
    pub(super) fn reset(&mut self, [left, top]: [usize; 2], columns: usize, mask: u32) {
        (self.left, self.top, self.open_rows) = (left, top, mask);
        self.shown.clear();
        self.hits.clear();
        for row in set_bits(mask) {
            for half in 0..GROUPS {
                let group = row * GROUPS + half;
                self.transmittance[group] = initial_transmittance(half * LANES, columns);
                self.color.iter_mut().for_each(|plane| plane[group] = [0.0; LANES]);
                self.depth_error[group] = [0.0; LANES];
            }
        }
    }

    /// Blends the colours of the listed splats, nearest first, and their depth errors relative to the
    /// target. `first` is the index of the batch's first splat in the row's list.
    #[inline(always)]
    pub(super) fn draw<V: Vector>(
        &mut self,
        list: &[u32],
        all: &Records,
        first: usize,
        target: &TargetTile,
    ) {
        for &index in list {
            // All pixels are finished: the rest of a long list costs nothing.
            if self.open_rows == 0 {
                break;
            }
            let index = index as usize;
            let before = self.hits.len();
            self.draw_splat::<V>(&all.records[index], all.gradients.get(index), target);
            // Splats without a hit contribute to no sum; the second walk skips them.
            if self.hits.len() > before {
                self.shown.push(VisibleSplat { list_index: first + index, end: self.hits.len() });
            }
        }
    }

    #[inline(always)]
    fn draw_splat<V: Vector>(
        &mut self,
        splat: &ConicRecord,
        gradient: Option<&Gradient>,
        target: &TargetTile,
    ) {
        let (rows, groups) = covered_rows_and_groups(&splat.rect, [self.left, self.top]);
        let x0 = self.left as f32 + 0.5 - splat.u;
        let x =
            [V::load(&LANE_COLUMNS[0]) + V::splat(x0), V::load(&LANE_COLUMNS[1]) + V::splat(x0)];
        // A tile has 16 rows, so the shifts stay below the 32 bits of the mask.
        for row in set_bits(self.open_rows & ((1 << rows.end) - (1 << rows.start))) {
            let y = V::splat((self.top + row) as f32 + 0.5 - splat.v);
            let mut stopped = false;
            for half in groups.clone() {
                let group = row * GROUPS + half;
                stopped |= self.draw_group::<V>(group, splat, gradient, [x[half], y], target);
            }
            if stopped && row_is_finished(&self.transmittance, row) {
                self.open_rows &= !(1 << row);
            }
        }
    }

    /// Blends a splat into eight pixels. Returns true if a pixel became finished: it accepts no further
    /// splats.
    #[inline(always)]
    fn draw_group<V: Vector>(
        &mut self,
        group: usize,
        splat: &ConicRecord,
        gradient: Option<&Gradient>,
        offset: [V; 2],
        target: &TargetTile,
    ) -> bool {
        let group = group % (TILE * GROUPS); // no-op that removes the bounds checks
        let [p, q] = whiten_offset(splat, offset);
        let exponent = V::splat(0.0) - (p * p + q * q);
        let passed = attenuate(&mut self.transmittance[group], splat, exponent);
        let Some(BlendStep { uncapped_alpha: free, weight, stopped }) = passed else {
            return false;
        };
        for (k, plane) in self.color.iter_mut().enumerate() {
            let color = color_at(splat, gradient, k, offset);
            (V::load(&plane[group]) + weight * color).store(&mut plane[group]);
        }
        if target.has_depth {
            let wrong = weight * target.depth_error(group, splat, offset);
            (V::load(&self.depth_error[group]) + wrong).store(&mut self.depth_error[group]);
        }
        // Alphas before the cap, because the second walk depends on where the cap applies.
        let mut hit = Hit { free: [0.0; LANES], group: group as u32 };
        free.store(&mut hit.free);
        self.hits.push(hit);
        stopped
    }
}

/// Converts an offset in pixels from a splat's centre to the whitened offset `[p, q]`.
#[inline(always)]
pub(super) fn whiten_offset<V: Vector>(splat: &ConicRecord, [x, y]: [V; 2]) -> [V; 2] {
    [V::splat(splat.p_x) * x + V::splat(splat.p_y) * y, V::splat(splat.q_y) * y]
}

/// Returns one channel of a splat's colour at an offset, in pixels, from the splat's centre.
#[inline(always)]
pub(super) fn color_at<V: Vector>(
    splat: &ConicRecord,
    gradient: Option<&Gradient>,
    channel: usize,
    offset: [V; 2],
) -> V {
    match gradient {
        Some(gradient) => offset_color(splat.color[channel], gradient, channel, offset),
        None => V::splat(splat.color[channel]),
    }
}
