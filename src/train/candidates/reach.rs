//! Tests if any of several places lies within reach of a tile's points, which have individual radii.

use super::columns::Columns;
use super::extent::Extent;
use super::grid::MeanGrid;
use crate::math::simd::{Kernel, Vector};
use crate::train::estep::squared_distance;

/// Query: a tile's points with their radii, and the places to test.
pub(in crate::train) struct AnyWithin<'a> {
    pub places: &'a MeanGrid,
    /// Scratch memory for the places near the tile.
    pub near: &'a mut Columns,
    /// Scratch memory for the tile.
    pub tile: &'a mut Columns,
    /// Positions of the tile's points, at least one.
    pub points: [&'a [f32]; 3],
    /// Squared radius of each point.
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
mod tests {
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
