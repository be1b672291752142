//! A pixel of a photograph with coverage and depth.

use bytemuck::{Pod, Zeroable};

/// Measurements of one pixel.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct MeasuredPixel {
    /// Red, green and blue, sRGB-encoded over black in `[0, 1]`.
    pub color: [f32; 3],
    /// Fraction of the pixel covered by surfaces; NaN if unknown.
    pub coverage: f32,
    /// Depth of the surface along the optical axis, world units; undefined if `per_tolerance` is 0.
    pub depth: f32,
    /// Reciprocal of the depth tolerance within which a surface counts as the measured one, per world
    /// unit; 0 if the depth is unknown.
    pub per_tolerance: f32,
}

impl MeasuredPixel {
    /// Creates a pixel with colour and coverage but no depth.
    pub fn without_depth([r, g, b, coverage]: [f32; 4]) -> Self {
        Self { color: [r, g, b], coverage, depth: 0.0, per_tolerance: 0.0 }
    }

    /// Adds a depth with tolerance `margin[0] + margin[1]·depth` (world units), if both are valid.
    pub fn with_depth(self, depth: f32, margin: [f32; 2]) -> Self {
        let per_tolerance = 1.0 / (margin[0] + margin[1] * depth);
        // Invalid depths and zero tolerances leave the depth unknown.
        match per_tolerance.is_finite() && per_tolerance > 0.0 && depth > 0.0 {
            true => Self { depth, per_tolerance, ..self },
            false => self,
        }
    }

    /// Black, with unknown coverage and depth.
    pub const UNKNOWN: Self =
        Self { color: [0.0; 3], coverage: f32::NAN, depth: 0.0, per_tolerance: 0.0 };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_that_are_none_say_nothing() {
        let flat = MeasuredPixel::without_depth([0.1, 0.2, 0.3, 1.0]);
        let found = flat.with_depth(2.0, [0.03, 0.02]);
        assert_eq!((found.depth, found.color), (2.0, flat.color));
        assert!((found.per_tolerance - 1.0 / 0.07).abs() < 1e-5);
        for depth in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(flat.with_depth(depth, [0.03, 0.02]), flat, "{depth}");
        }
        assert_eq!(flat.with_depth(2.0, [0.0; 2]), flat);
    }
}
