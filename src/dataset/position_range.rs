//! A box of world positions.

use crate::math::normalization::Normalization;
use glam::DVec3;

/// A box of world positions; points outside are allowed.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionRange {
    lo: DVec3,
    hi: DVec3,
    /// Origin of the range, for reports.
    pub source: String,
}

impl PositionRange {
    /// Creates a range; `None` unless finite with `lo < hi` on every axis.
    pub fn new(lo: DVec3, hi: DVec3, source: &str) -> Option<Self> {
        let sound = lo.is_finite() && hi.is_finite() && lo.cmplt(hi).all();
        sound.then(|| Self { lo, hi, source: source.to_owned() })
    }

    /// The cube `[−1, 1]³`.
    pub fn nerf_synthetic() -> Self {
        let source = "the [-1, 1] cube of NeRF-synthetic scenes".to_owned();
        Self { lo: DVec3::NEG_ONE, hi: DVec3::ONE, source }
    }

    /// The same box relative to another origin.
    pub fn relative_to(self, origin: DVec3) -> Self {
        Self { lo: self.lo - origin, hi: self.hi - origin, ..self }
    }

    /// Low corner of the box, world units.
    pub fn lo(&self) -> DVec3 {
        self.lo
    }

    /// High corner of the box, world units.
    pub fn hi(&self) -> DVec3 {
        self.hi
    }

    /// Affine map that gives a uniform distribution on the box mean 0 and variance 1 on every axis.
    pub fn normalization(&self) -> Normalization {
        Normalization::from_range(self.lo, self.hi)
    }
}
