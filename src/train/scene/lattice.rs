//! Fixed lattices of seeds, for models that must not depend on the order of frames.

use super::grid::squared_distance;

/// Returns the centre of the cell that contains `position` in the cubic lattice of edge `a`.
#[inline(always)]
pub fn cubic(position: [f32; 3], a: f32) -> [f32; 3] {
    position.map(|x| ((x / a).floor() + 0.5) * a)
}

/// Returns the nearest point of the body-centred lattice with cubes of edge `a`: corners and centres of the
/// cubes. A cell has half the volume of a cube, so equal density to [`cubic`] requires an `a` larger by ∛2.
#[inline(always)]
pub fn body_centred(position: [f32; 3], a: f32) -> [f32; 3] {
    let centre = cubic(position, a);
    // Adding 0 removes the sign of negative zeros, which would depend on the first point of the cell.
    let corner = position.map(|x| (x / a).round() * a + 0.0);
    let nearer = squared_distance(position, centre) <= squared_distance(position, corner);
    if nearer { centre } else { corner }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lattice_points_are_the_nearest_ones() {
        assert_eq!(cubic([0.3, -0.1, 2.0], 1.0), [0.5, -0.5, 2.5]);
        assert_eq!(body_centred([0.4, 0.4, 0.4], 1.0), [0.5; 3]);
        assert_eq!(body_centred([0.1, 0.2, 0.1], 1.0), [0.0; 3]);
        let corner = body_centred([0.9, 1.1, -0.1], 1.0);
        assert_eq!(corner.map(f32::to_bits), [1.0f32, 1.0, 0.0].map(f32::to_bits));
    }
}
