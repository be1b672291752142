//! The first walk over a tile: it draws, and keeps which pixels showed each splat.
//!
//! A third of the groups of pixels in a splat's rectangle lie outside its ellipse, and what a splat covers
//! of a pixel costs an exponential. The second walk reads both, so that it sees the very same splats, and
//! goes through the groups that show them alone. A pixel finishes after so many splats, whatever there are:
//! that bounds what a tile keeps.

use super::super::record::{ConicRecord, Gradient, Records};
use super::super::tile::{
    GROUPS, LANE_COLUMNS, Passed, Plane, covered, offset_color, pass, row_is_finished, untouched,
};
use super::target::{TargetTile, rows_of};
use crate::math::simd::{LANES, Vector};
use crate::render::constants::TILE;

/// A splat in eight pixels that show it.
pub(super) struct Hit {
    /// Alpha before the cap; 0 in a pixel that does not show it.
    pub free: [f32; LANES],
    /// The pixels' group.
    pub group: u32,
}

/// A splat that pixels of the tile show.
pub(super) struct Shown {
    /// Its place in the row's list.
    pub place: usize,
    /// Where its hits end, and those of the next one begin.
    pub end: usize,
}

/// A tile that was drawn; one after the other, in the same memory.
pub(super) struct DrawnTile {
    left: usize,
    top: usize,
    /// Negative once a pixel is finished, and where there is none.
    pub transmittance: Plane,
    pub color: [Plane; 3],
    /// Wrongness of what is drawn, where depth is known.
    pub wrong: Plane,
    open_rows: u32,
    /// Splats that pixels show, nearest first.
    pub shown: Vec<Shown>,
    pub hits: Vec<Hit>,
}

impl Default for DrawnTile {
    fn default() -> Self {
        let empty = [[0.0; LANES]; TILE * GROUPS];
        Self {
            left: 0,
            top: 0,
            transmittance: empty,
            color: [empty; 3],
            wrong: empty,
            open_rows: 0,
            shown: Vec::new(),
            hits: Vec::new(),
        }
    }
}

impl DrawnTile {
    /// Begins anew at pixel `(left, top)`, with `columns` pixels to the image's right edge and the rows of
    /// `mask`.
    pub(super) fn begin(&mut self, [left, top]: [usize; 2], columns: usize, mask: u32) {
        (self.left, self.top, self.open_rows) = (left, top, mask);
        self.shown.clear();
        self.hits.clear();
        for row in rows_of(mask) {
            for half in 0..GROUPS {
                let group = row * GROUPS + half;
                self.transmittance[group] = untouched(half * LANES, columns);
                self.color.iter_mut().for_each(|plane| plane[group] = [0.0; LANES]);
                self.wrong[group] = [0.0; LANES];
            }
        }
    }

    /// Pixel of the image at its upper left.
    pub(super) fn corner(&self) -> [usize; 2] {
        [self.left, self.top]
    }

    /// Draws the listed splats, nearest first, and how wrong they are beside what was measured; the first
    /// of all has the place `first` in the row's list.
    #[inline(always)]
    pub(super) fn draw<V: Vector>(
        &mut self,
        list: &[u32],
        all: &Records,
        first: usize,
        target: &TargetTile,
    ) {
        for &index in list {
            if self.open_rows == 0 {
                break;
            }
            let index = index as usize;
            let before = self.hits.len();
            self.draw_splat::<V>(&all.records[index], all.gradients.get(index), target);
            if self.hits.len() > before {
                self.shown.push(Shown { place: first + index, end: self.hits.len() });
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
        let (rows, groups) = covered(&splat.rect, [self.left, self.top]);
        let x0 = self.left as f32 + 0.5 - splat.u;
        let x =
            [V::load(&LANE_COLUMNS[0]) + V::splat(x0), V::load(&LANE_COLUMNS[1]) + V::splat(x0)];
        for row in rows_of(self.open_rows & ((1 << rows.end) - (1 << rows.start))) {
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

    /// Draws a splat in eight pixels; whether one of them was finished by it.
    #[inline(always)]
    fn draw_group<V: Vector>(
        &mut self,
        group: usize,
        splat: &ConicRecord,
        gradient: Option<&Gradient>,
        offset: [V; 2],
        target: &TargetTile,
    ) -> bool {
        let group = group % (TILE * GROUPS); // as it is: the compiler then checks no bounds
        let [p, q] = whitened(splat, offset);
        let exponent = V::splat(0.0) - (p * p + q * q);
        let passed = pass(&mut self.transmittance[group], splat, exponent);
        let Some(Passed { free, weight, stopped }) = passed else { return false };
        for (k, plane) in self.color.iter_mut().enumerate() {
            let color = color_at(splat, gradient, k, offset);
            (V::load(&plane[group]) + weight * color).store(&mut plane[group]);
        }
        if target.has_depth {
            let wrong = weight * target.wrongness(group, splat, offset);
            (V::load(&self.wrong[group]) + wrong).store(&mut self.wrong[group]);
        }
        let mut hit = Hit { free: [0.0; LANES], group: group as u32 };
        free.store(&mut hit.free);
        self.hits.push(hit);
        stopped
    }
}

/// Offsets from a splat's centre in units of its own width.
#[inline(always)]
pub(super) fn whitened<V: Vector>(splat: &ConicRecord, [x, y]: [V; 2]) -> [V; 2] {
    [V::splat(splat.p_x) * x + V::splat(splat.p_y) * y, V::splat(splat.q_y) * y]
}

/// One channel of a splat's colour at an offset from its centre, px.
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
