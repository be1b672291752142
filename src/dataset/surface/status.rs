//! Status of every pixel of a frame: kept as a point, or the reason why not.

/// Status of a pixel: kept as a point, or the reason why not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum PixelStatus {
    /// No surface was measured.
    #[default]
    Hole,
    /// The pixel became a point.
    Kept,
    /// Skipped by the sampling; a neighbouring point represents it.
    LeftOut,
    /// Partially transparent: colour and depth mix several surfaces.
    Alpha,
    /// Outside the trusted depth, or behind the camera after correction.
    Range,
    /// No accepted plane: too few inliers, too large residuals, or the pixel lies off the plane.
    Flying,
    /// Seen at a slant: the normal deviates too far from the direction to the camera.
    Slant,
    /// Not finite, or too far from the origin for f32.
    Far,
    /// Not visible in the colour camera: outside its image, or occluded.
    NoColor,
}

/// Pixels of one frame by status; the fields add up to width × height.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SurfaceCounts {
    /// Pixels that became points.
    pub kept: usize,
    /// Pixels of [`PixelStatus::LeftOut`].
    pub left_out: usize,
    /// Pixels of [`PixelStatus::Hole`].
    pub holes: usize,
    /// Pixels of [`PixelStatus::Alpha`].
    pub dropped_alpha: usize,
    /// Pixels of [`PixelStatus::Range`].
    pub dropped_range: usize,
    /// Pixels of [`PixelStatus::Flying`].
    pub dropped_flying: usize,
    /// Pixels of [`PixelStatus::Slant`].
    pub dropped_slant: usize,
    /// Pixels of [`PixelStatus::Far`].
    pub dropped_far: usize,
    /// Pixels of [`PixelStatus::NoColor`].
    pub dropped_no_color: usize,
}

/// Lists the pixels that became no points.
impl std::fmt::Display for SurfaceCounts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} holes, {} flying, {} at a slant, {} out of range, {} transparent, {} outside the colour image",
            self.holes,
            self.dropped_flying,
            self.dropped_slant,
            self.dropped_range,
            self.dropped_alpha,
            self.dropped_no_color
        )
    }
}

impl SurfaceCounts {
    /// Counts the pixels of a frame.
    pub fn of(statuses: &[PixelStatus]) -> Self {
        // One pass per status with sums of bytes vectorises; a histogram does not.
        let of = |status: PixelStatus| {
            let count =
                |run: &[PixelStatus]| run.iter().map(|f| u8::from(*f == status)).sum::<u8>();
            statuses.chunks(usize::from(u8::MAX)).map(|run| usize::from(count(run))).sum()
        };
        Self {
            kept: of(PixelStatus::Kept),
            left_out: of(PixelStatus::LeftOut),
            holes: of(PixelStatus::Hole),
            dropped_alpha: of(PixelStatus::Alpha),
            dropped_range: of(PixelStatus::Range),
            dropped_flying: of(PixelStatus::Flying),
            dropped_slant: of(PixelStatus::Slant),
            dropped_far: of(PixelStatus::Far),
            dropped_no_color: of(PixelStatus::NoColor),
        }
    }

    /// Number of measured pixels that became no point.
    pub fn dropped(&self) -> usize {
        self.dropped_alpha
            + self.dropped_range
            + self.dropped_flying
            + self.dropped_slant
            + self.dropped_far
            + self.dropped_no_color
    }
}
