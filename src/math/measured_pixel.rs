//! Pixels of a photograph with coverage and depth, and the normalisation of positions and colours.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Red, green, blue and opacity of a photograph's pixel that a mask leaves out. No other pixel is bright
/// and nearly transparent.
pub const MASKED: [u8; 4] = [255, 0, 255, 1];

/// Measurements of one pixel.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct MeasuredPixel {
    /// Red, green and blue in `[0, 1]`, sRGB-encoded and composited over black.
    pub color: [f32; 3],
    /// Fraction of the pixel covered by surfaces; NaN if unknown, −1 if the pixel is left out.
    pub coverage: f32,
    /// Depth of the surface along the optical axis, world units; undefined if `per_tolerance` is 0.
    pub depth: f32,
    /// Reciprocal of the depth tolerance, per world unit; 0 if the depth is unknown. A surface within
    /// the tolerance counts as the measured one.
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

    /// Pixel that is left out of every comparison.
    pub const LEFT_OUT: Self = Self { coverage: -1.0, ..Self::UNKNOWN };

    /// Black pixel with unknown coverage and depth.
    pub const UNKNOWN: Self =
        Self { color: [0.0; 3], coverage: f32::NAN, depth: 0.0, per_tolerance: 0.0 };
}

/// Affine map from world positions and colours in `[0, 1]` to the model's coordinates. Offset and scale
/// are mean and standard deviation of a uniform distribution on the range of the values (`model.md`,
/// Normalisation).
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::math::measured_pixel::Normalization;
///
/// let world = Normalization::from_range(DVec3::NEG_ONE, DVec3::ONE);
/// let corner = world.normalize(DVec3::ONE);
/// assert!((corner.x - 3f64.sqrt()).abs() < 1e-12);
/// assert!((world.denormalize(corner) - DVec3::ONE).length() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Normalization {
    /// World position of the normalised origin.
    pub offset: [f64; 3],
    /// World units per normalised unit, per axis; positive.
    pub scale: [f64; 3],
}

/// Offset of the colour normalisation: mean of a uniform distribution on `[0, 1]`.
pub const COLOR_OFFSET: f64 = 0.5;

/// Scale of the colour normalisation, `1/√12`: standard deviation of the same distribution as for
/// [`COLOR_OFFSET`].
pub const COLOR_SCALE: f64 = 0.288_675_134_594_812_9;

impl Normalization {
    /// Identity map.
    pub const IDENTITY: Self = Self { offset: [0.0; 3], scale: [1.0; 3] };

    /// Builds the map from the range of positions, `lo < hi` on every axis.
    pub fn from_range(lo: DVec3, hi: DVec3) -> Self {
        // √12: a uniform distribution of width 1 has variance 1/12.
        let scale = (hi - lo) / 12f64.sqrt();
        Self { offset: ((lo + hi) * 0.5).to_array(), scale: scale.to_array() }
    }

    /// Converts a world point to normalised coordinates.
    #[inline]
    pub fn normalize(&self, world: DVec3) -> DVec3 {
        (world - DVec3::from_array(self.offset)) / DVec3::from_array(self.scale)
    }

    /// Converts a normalised point to world coordinates.
    #[inline]
    pub fn denormalize(&self, normalized: DVec3) -> DVec3 {
        normalized * DVec3::from_array(self.scale) + DVec3::from_array(self.offset)
    }

    /// Normalises a colour channel in `[0, 1]`.
    #[inline]
    pub fn normalize_channel(channel: f64) -> f64 {
        (channel - COLOR_OFFSET) / COLOR_SCALE
    }

    /// Converts a normalised colour to `[0, 1]`, without clamping.
    #[inline]
    pub fn denormalize_color(color: DVec3) -> DVec3 {
        color * COLOR_SCALE + DVec3::splat(COLOR_OFFSET)
    }
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

    #[test]
    fn normalization_matches_the_published_constants() {
        let n = Normalization::from_range(DVec3::splat(-1.0), DVec3::ONE);
        assert!((n.scale[0] - 0.577350269).abs() < 1e-9);
        assert!((COLOR_SCALE - 1.0 / 12f64.sqrt()).abs() < 1e-16);
        let p = DVec3::new(0.3, -2.0, 0.7);
        assert!((n.denormalize(n.normalize(p)) - p).length() < 1e-15);
        // A uniform distribution ends √3 deviations from its mean.
        let (end, hi) = (3f64.sqrt(), DVec3::new(3.0, 1.0, 4.0));
        let n = Normalization::from_range(DVec3::new(-1.0, 0.0, 2.0), hi);
        assert_eq!(n.offset, [1.0, 0.5, 3.0]);
        assert!((n.normalize(hi) - DVec3::splat(end)).length() < 1e-14);
        assert!((n.denormalize(DVec3::splat(end)) - hi).length() < 1e-14);
        let channels = [0.5, 1.0, 0.0].map(Normalization::normalize_channel);
        assert!((DVec3::from_array(channels) - DVec3::new(0.0, end, -end)).length() < 1e-14);
        let color = Normalization::denormalize_color(DVec3::new(0.0, end, -end));
        assert!((color - DVec3::new(0.5, 1.0, 0.0)).length() < 1e-14);
    }
}
