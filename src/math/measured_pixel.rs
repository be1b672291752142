//! A pixel of a photograph with what depth cameras know of it.

use bytemuck::{Pod, Zeroable};

/// What was measured of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct MeasuredPixel {
    /// Red, green and blue, sRGB-encoded over black in `[0, 1]`.
    pub color: [f32; 3],
    /// How much of it surfaces cover; NaN where that is not known.
    pub coverage: f32,
    /// Depth of the surface along the camera's axis, world units; says nothing where `per_tolerance` is 0.
    pub depth: f32,
    /// One over how far a surface may lie from that depth and still be the measured one, per world unit;
    /// 0 where no depth is known.
    pub per_tolerance: f32,
}

impl MeasuredPixel {
    /// Colour and coverage, of a pixel without a depth.
    pub fn flat([r, g, b, coverage]: [f32; 4]) -> Self {
        Self { color: [r, g, b], coverage, depth: 0.0, per_tolerance: 0.0 }
    }

    /// With a depth; surfaces within `margin[0] + margin[1]·depth` are the measured one, world units.
    pub fn at_depth(self, depth: f32, margin: [f32; 2]) -> Self {
        let per_tolerance = 1.0 / (margin[0] + margin[1] * depth);
        // Nothing is known of a depth that is none, nor by a margin that is none.
        match per_tolerance.is_finite() && per_tolerance > 0.0 && depth > 0.0 {
            true => Self { depth, per_tolerance, ..self },
            false => self,
        }
    }

    /// Black, of which nothing else is known.
    pub const UNKNOWN: Self =
        Self { color: [0.0; 3], coverage: f32::NAN, depth: 0.0, per_tolerance: 0.0 };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_that_are_none_say_nothing() {
        let flat = MeasuredPixel::flat([0.1, 0.2, 0.3, 1.0]);
        let found = flat.at_depth(2.0, [0.03, 0.02]);
        assert_eq!((found.depth, found.color), (2.0, flat.color));
        assert!((found.per_tolerance - 1.0 / 0.07).abs() < 1e-5);
        for depth in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(flat.at_depth(depth, [0.03, 0.02]), flat, "{depth}");
        }
        assert_eq!(flat.at_depth(2.0, [0.0; 2]), flat);
    }
}
