//! Bounds on the distance from a group of points to their nearest means, by the triangle inequality.
//! Margins for rounding admit extra candidates but never lose one.

use super::columns::Columns;
use super::kernel::{bounding_box, reach2};
use crate::math::simd::Vector;
use std::ops::Range;

/// Relative margin of every radius: a hundred rounding errors.
pub(super) const RELATIVE_MARGIN: f32 = 1.0 + 1e-5;
/// Margin of every radius per unit of the largest coordinate: ten rounding errors.
const COORDINATE_MARGIN: f32 = 1e-6;
/// Margin of every radius against underflow of its square.
const MIN_MARGIN: f32 = 1e-18;
/// Largest radius whose square is safely finite.
pub(super) const MAX_RADIUS: f32 = 1e18;

/// Bounding box and bounding sphere of the points of a group or chunk.
#[derive(Clone, Copy)]
pub(super) struct Extent {
    pub lo: [f32; 3],
    pub hi: [f32; 3],
    /// Centre of the box.
    pub centre: [f32; 3],
    /// Largest distance of a point from the centre.
    reach: f32,
    /// Part of the margin that does not depend on the radius.
    absolute_margin: f32,
}

impl Extent {
    /// Computes the extent of entries `range` of `points`.
    #[inline(always)]
    pub fn of_points<V: Vector>(points: &Columns, range: Range<usize>) -> Self {
        let [lo, hi] = bounding_box::<V>(points, range.clone());
        // Halved before adding: the sum of two large corners would overflow.
        let mut centre = [0.0; 3];
        for axis in 0..3 {
            centre[axis] = 0.5 * lo[axis] + 0.5 * hi[axis];
        }
        let reach2 = reach2::<V>(points, range, centre);
        let largest = lo.iter().chain(&hi).fold(0f32, |largest, v| largest.max(v.abs()));
        let slack = COORDINATE_MARGIN * largest + MIN_MARGIN;
        Self { lo, hi, centre, reach: reach2.sqrt(), absolute_margin: slack }
    }

    /// Longest edge of the box.
    #[inline]
    pub fn length(&self) -> f32 {
        (0..3).fold(0f32, |length, axis| length.max(self.hi[axis] - self.lo[axis]))
    }

    /// True if coordinates are finite and their squares do not overflow.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.reach.is_finite() && self.absolute_margin.is_finite()
    }

    /// Upper bound on the distance from the box to its points' neighbours, given that of the centre's
    /// neighbours from the centre.
    #[inline(always)]
    pub fn neighbour_radius(&self, nearest: f32) -> f32 {
        (nearest + self.reach) * RELATIVE_MARGIN + self.absolute_margin
    }

    /// Upper bound on the distance from the box to anything within `reach` of one of its points.
    #[inline(always)]
    pub fn radius_for_reach(&self, reach: f32) -> f32 {
        reach * RELATIVE_MARGIN + self.absolute_margin
    }

    /// Upper bound on the distance from the centre to its points' nearest entries, given the squared
    /// distance of the centre's nearest; `None` if squares might overflow.
    #[inline(always)]
    pub fn centre_radius(&self, nearest2: f32) -> Option<f32> {
        // Twice the reach: a point's neighbours are bounded from the centre's, then measured from the
        // centre again.
        let limit = (nearest2.sqrt() + 2.0 * self.reach) * RELATIVE_MARGIN + self.absolute_margin;
        // A point lies up to `reach` off the centre, and the kernel needs finite squared distances.
        (self.is_finite() && limit + self.reach < MAX_RADIUS).then_some(limit)
    }
}
