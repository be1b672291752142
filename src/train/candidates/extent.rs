//! How far from a group of points their nearest means can be: bounds by the triangle inequality,
//! with margins for rounding, which cost candidates, never correctness.

use super::columns::Columns;
use super::kernel::{bounding_box, reach2};
use crate::math::simd::Vector;
use std::ops::Range;

/// Relative margin of every radius: a hundred roundings.
pub(super) const RELATIVE_MARGIN: f32 = 1.0 + 1e-5;
/// Margin of every radius per unit of the largest coordinate: ten roundings.
const COORDINATE_MARGIN: f32 = 1e-6;
/// Margin of every radius against underflow of its square.
const MIN_MARGIN: f32 = 1e-18;
/// Radius whose square is safely finite.
pub(super) const MAX_RADIUS: f32 = 1e18;

/// The points of a group or chunk from outside.
#[derive(Clone, Copy)]
pub(super) struct Extent {
    /// Lower corner of the box around the points.
    pub lo: [f32; 3],
    /// Upper corner of the box around the points.
    pub hi: [f32; 3],
    /// Middle of the box.
    pub centre: [f32; 3],
    /// Largest distance of a point to the middle.
    reach: f32,
    /// Part of the margin that does not depend on the radius.
    slack: f32,
}

impl Extent {
    /// Extent of the entries `range` of `points`.
    #[inline(always)]
    pub fn of<V: Vector>(points: &Columns, range: Range<usize>) -> Self {
        let [lo, hi] = bounding_box::<V>(points, range.clone());
        // Halved before they are added: the sum of two large corners would overflow.
        let mut centre = [0.0; 3];
        for axis in 0..3 {
            centre[axis] = 0.5 * lo[axis] + 0.5 * hi[axis];
        }
        let reach2 = reach2::<V>(points, range, centre);
        let largest = lo.iter().chain(&hi).fold(0f32, |largest, v| largest.max(v.abs()));
        let slack = COORDINATE_MARGIN * largest + MIN_MARGIN;
        Self { lo, hi, centre, reach: reach2.sqrt(), slack }
    }

    /// Longest edge of the box.
    #[inline]
    pub fn length(&self) -> f32 {
        (0..3).fold(0f32, |length, axis| length.max(self.hi[axis] - self.lo[axis]))
    }

    /// Whether bounds mean anything: coordinates are finite and their squares do not overflow.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.reach.is_finite() && self.slack.is_finite()
    }

    /// How far from its box the neighbours of its points can be, given how far those of the centre
    /// are.
    #[inline(always)]
    pub fn reach_of(&self, nearest: f32) -> f32 {
        (nearest + self.reach) * RELATIVE_MARGIN + self.slack
    }

    /// How far from its box what lies within `reach` of one of its points can be.
    #[inline(always)]
    pub fn radius_of(&self, reach: f32) -> f32 {
        reach * RELATIVE_MARGIN + self.slack
    }

    /// How far from the centre the nearest entries of its points can be, given how far those of
    /// the centre are; `None` where squares might overflow.
    #[inline(always)]
    pub fn limit(&self, nearest2: f32) -> Option<f32> {
        // Once from a point to the centre, whose neighbours bound the point's, and once to see
        // those from the centre again.
        let limit = (nearest2.sqrt() + 2.0 * self.reach) * RELATIVE_MARGIN + self.slack;
        // A point stands up to `reach` off the centre, and the kernel needs finite squares of its
        // distances.
        (self.is_finite() && limit + self.reach < MAX_RADIUS).then_some(limit)
    }
}
