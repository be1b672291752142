//! Fixed lattices: where components are born when nothing may depend on the order of frames.

use super::grid::squared_distance;

/// Centre of the cell of the cubic lattice of side `a` that a place falls into.
#[inline(always)]
pub fn cubic(position: [f32; 3], a: f32) -> [f32; 3] {
    position.map(|x| ((x / a).floor() + 0.5) * a)
}

/// Nearest point of the body-centred lattice whose cubes have sides `a`: corners and centres of the
/// cubes. Its cells hold half a cube, so the same density as [`cubic`] takes `a` ∛2 times as large.
#[inline(always)]
pub fn body_centred(position: [f32; 3], a: f32) -> [f32; 3] {
    let centre = cubic(position, a);
    // Without the sum, which point comes first would tell whether zeros have a sign.
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
