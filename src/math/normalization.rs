//! Affine map between world coordinates and the mixture's normalised coordinates.

use glam::DVec3;

/// Affine map from world positions and colours in `[0, 1]` to the model's coordinates. Offset and
/// scale are mean and standard deviation of a uniform distribution on a range (`model.md`, Normalisation).
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::math::normalization::Normalization;
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

/// Scale of the colour normalisation, `1/√12`.
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
    fn normalization_matches_the_published_constants() {
        let n = Normalization::from_range(DVec3::splat(-1.0), DVec3::ONE);
        assert!((n.scale[0] - 0.577350269).abs() < 1e-9);
        assert!((COLOR_SCALE - 1.0 / 12f64.sqrt()).abs() < 1e-16);
        let p = DVec3::new(0.3, -2.0, 0.7);
        assert!((n.denormalize(n.normalize(p)) - p).length() < 1e-15);
    }
}
