//! Bounds on the distance from a group of points to their nearest means, by the triangle inequality.
//! Because of rounding margins, the bounds may admit extra candidates, but never exclude a valid one.

use super::grid::MeanGrid;
use super::kernel::{Columns, bounding_box, reach2};
use crate::math::simd::{Kernel, Vector};
use crate::train::estep::squared_distance;
use std::ops::Range;

// Relative margin of every radius: a hundred rounding errors.
pub(super) const RELATIVE_MARGIN: f32 = 1.0 + 1e-5;
// Margin of every radius per unit of the largest coordinate: ten rounding errors.
const COORDINATE_MARGIN: f32 = 1e-6;
// Margin of every radius against underflow of its square.
const MIN_MARGIN: f32 = 1e-18;
// Largest radius whose square is safely finite.
pub(super) const MAX_RADIUS: f32 = 1e18;

/// Bounding box and bounding sphere of the points of a group or chunk (part of a group).
#[derive(Clone, Copy)]
pub(super) struct Extent {
    pub lo: [f32; 3],
    pub hi: [f32; 3],
    /// Centre of the box.
    pub centre: [f32; 3],
    /// Largest distance of a point from the centre.
    reach: f32,
    /// Part of the rounding margin that is the same for all distances.
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

    /// True if all coordinates are finite and their squares do not overflow.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.reach.is_finite() && self.absolute_margin.is_finite()
    }

    /// Returns an upper bound on the distance from the box to the `n` nearest means of any of the
    /// points. `nearest` is the distance from the centre of the box to the centre's `n`-th nearest
    /// mean.
    #[inline(always)]
    pub fn neighbour_radius(&self, nearest: f32) -> f32 {
        (nearest + self.reach) * RELATIVE_MARGIN + self.absolute_margin
    }

    /// Returns an upper bound on the distance from the box to any place within `reach` of one of the
    /// points.
    #[inline(always)]
    pub fn radius_for_reach(&self, reach: f32) -> f32 {
        reach * RELATIVE_MARGIN + self.absolute_margin
    }

    /// Returns an upper bound on the distance from the centre to the `n` nearest means of any of the
    /// points. `nearest2` is the squared distance from the centre to its `n`-th nearest mean. `None` if
    /// squares might overflow.
    #[inline(always)]
    pub fn centre_radius(&self, nearest2: f32) -> Option<f32> {
        // Twice the reach: a point's neighbours are bounded from the centre's, then measured from the
        // centre again.
        let limit = (nearest2.sqrt() + 2.0 * self.reach) * RELATIVE_MARGIN + self.absolute_margin;
        // A point lies up to `reach` off the centre, and the kernel needs finite squared distances.
        (self.is_finite() && limit + self.reach < MAX_RADIUS).then_some(limit)
    }
}

/// Kernel that tests whether any of `places` is near a point of a tile. Each point has its own search
/// radius.
pub(in crate::train) struct AnyWithin<'a> {
    pub places: &'a MeanGrid,
    /// Scratch memory for the entries of `places` near the tile.
    pub near: &'a mut Columns,
    /// Scratch memory for the points of the tile.
    pub tile: &'a mut Columns,
    /// Positions of the tile's points, at least one.
    pub points: [&'a [f32]; 3],
    /// Squared search radius around each point.
    pub reach2: &'a [f32],
}

impl Kernel for AnyWithin<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<V: Vector>(self) -> bool {
        let Self { places, near, tile, points: [x, y, z], reach2 } = self;
        tile.load([x, y, z]);
        let extent = Extent::of_points::<V>(tile, 0..x.len());
        let farthest = reach2.iter().fold(0f32, |farthest, &r| farthest.max(r));
        let radius = extent.radius_for_reach(farthest.sqrt());
        // No box holds such points; running the tile again is correct in any case.
        if !(extent.is_finite() && radius.is_finite()) {
            return true;
        }
        places.gather(extent.lo, extent.hi, radius, near);
        (0..near.len).any(|i| {
            let place = near.position(i);
            let points = x.iter().zip(y).zip(z).zip(reach2);
            // No short circuit, so that the loop is vectorised.
            points.fold(false, |any, (((&x, &y), &z), &reach2)| {
                any | (squared_distance([x, y, z], place) <= reach2)
            })
        })
    }
}

#[cfg(test)]
mod reach_tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};
    use crate::math::simd::Isa;

    #[test]
    fn places_are_within_reach_where_any_point_says_so() {
        let mut rng = Rng::new(3, Purpose::Init, 0);
        let mut at = |n: usize| -> Vec<[f32; 3]> {
            (0..n).map(|_| std::array::from_fn(|_| rng.range(-1.0, 1.0) as f32)).collect()
        };
        let (places, points) = (at(300), at(600));
        let grid = MeanGrid::new(&places).unwrap();
        let [mut near, mut tile] = [Columns::default(), Columns::default()];
        let mut found = [0; 2];
        for (i, points) in points.chunks(20).enumerate() {
            // One point of the tile has a larger radius than the others, from 0 to a third of the cube.
            let reach2: Vec<f32> = (0..20)
                .map(|k| if k == i % 20 { (0.02 * i as f32).powi(2) } else { 1e-9 })
                .collect();
            let [x, y, z] =
                [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).collect::<Vec<_>>());
            let is_within = Isa::best().run(AnyWithin {
                places: &grid,
                near: &mut near,
                tile: &mut tile,
                points: [&x, &y, &z],
                reach2: &reach2,
            });
            let expected = points.iter().zip(&reach2).any(|(&point, &reach2)| {
                places.iter().any(|&place| squared_distance(point, place) <= reach2)
            });
            assert_eq!(is_within, expected, "{i}");
            found[usize::from(expected)] += 1;
        }
        assert!(found.iter().all(|n| *n > 5), "{found:?}");
    }
}
