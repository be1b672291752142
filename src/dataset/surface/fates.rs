//! What became of the pixels of a frame.

/// What became of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum PixelFate {
    /// No surface measured.
    #[default]
    Hole,
    /// A point.
    Kept,
    /// Partially transparent: colour and depth mix what lies behind each other.
    Alpha,
    /// Outside the trusted depth, or behind the camera once corrected.
    Range,
    /// No plane explains it: too few neighbours agree, they scatter, or it lies off their plane.
    Flying,
    /// Its surface is seen at a slant.
    Slant,
    /// Not finite, or too far from the origin for f32.
    Far,
    /// Not seen by the colour camera: outside its image, or behind something nearer to it.
    NoColor,
}

/// Pixels of one frame by fate; the fields add up to width × height.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SurfaceCounts {
    /// Points made.
    pub kept: usize,
    /// See [`PixelFate::Hole`].
    pub holes: usize,
    /// See [`PixelFate::Alpha`].
    pub dropped_alpha: usize,
    /// See [`PixelFate::Range`].
    pub dropped_range: usize,
    /// See [`PixelFate::Flying`].
    pub dropped_flying: usize,
    /// See [`PixelFate::Slant`].
    pub dropped_slant: usize,
    /// See [`PixelFate::Far`].
    pub dropped_far: usize,
    /// See [`PixelFate::NoColor`].
    pub dropped_no_color: usize,
}

/// In words, without those that made points.
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
    pub fn of(fates: &[PixelFate]) -> Self {
        // A pass for each fate, in sums of bytes: that is vector code, a histogram is not.
        let of = |fate: PixelFate| {
            let count = |run: &[PixelFate]| run.iter().map(|f| u8::from(*f == fate)).sum::<u8>();
            fates.chunks(usize::from(u8::MAX)).map(|run| usize::from(count(run))).sum()
        };
        Self {
            kept: of(PixelFate::Kept),
            holes: of(PixelFate::Hole),
            dropped_alpha: of(PixelFate::Alpha),
            dropped_range: of(PixelFate::Range),
            dropped_flying: of(PixelFate::Flying),
            dropped_slant: of(PixelFate::Slant),
            dropped_far: of(PixelFate::Far),
            dropped_no_color: of(PixelFate::NoColor),
        }
    }

    /// Measured pixels that made no point.
    pub fn dropped(&self) -> usize {
        self.dropped_alpha
            + self.dropped_range
            + self.dropped_flying
            + self.dropped_slant
            + self.dropped_far
            + self.dropped_no_color
    }
}
