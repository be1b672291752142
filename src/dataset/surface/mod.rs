//! Frames to observations (`accuracy.md` 2): a robust plane is fitted around every pixel in inverse
//! depth, pixels that no plane explains are dropped, the others take its depth and normal.

pub mod oracle;
pub mod sensor;
pub mod settings;

use super::error::FrameError;
use super::frame::Frame;
use crate::math::image::Image;
use crate::math::observation::Observation;
pub use sensor::Sensor;
pub use settings::SurfaceSettings;

/// Pixels from the centre of the window to its side.
const RADIUS: usize = 2;
/// Least-squares rounds; from the second on only inliers take part.
const ROUNDS: usize = 3;
/// Neighbours that a round needs, the pixel itself included.
const MIN_INLIERS: usize = 5;
/// Share of the window that must be inliers in the end.
const MIN_SHARE: f64 = 0.3;
/// Pixels on a side of a tile.
const TILE: usize = 8;

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
    /// Outside the trusted depth.
    Range,
    /// No plane explains it: too few neighbours agree, they scatter, or it lies off their plane.
    Flying,
    /// Its surface is seen at a slant.
    Slant,
    /// Not finite, or too far from the origin for f32.
    Far,
    /// Outside the colour image.
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

impl SurfaceCounts {
    fn of(fates: &[PixelFate]) -> Self {
        let mut tally = [0; 8];
        for fate in fates {
            tally[*fate as usize] += 1;
        }
        let of = |fate: PixelFate| tally[fate as usize];
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

/// Turns frames into observations; keeps its scratch memory between frames.
#[derive(Clone, Debug)]
pub struct Preparer {
    fates: Image<PixelFate>,
}

impl Preparer {
    /// No memory yet.
    pub fn new() -> Self {
        Self { fates: Image::filled(0, 0, PixelFate::Hole) }
    }

    /// Replaces `out` by what a frame says.
    ///
    /// # Errors
    /// A frame without depth.
    pub fn prepare(
        &mut self,
        frame: &Frame,
        settings: &SurfaceSettings,
        out: &mut Observation,
    ) -> Result<SurfaceCounts, FrameError> {
        (*out, self.fates) = oracle::prepare(frame, settings)?;
        Ok(SurfaceCounts::of(&self.fates.data))
    }

    /// What became of the pixels of the last frame.
    pub fn fates(&self) -> &Image<PixelFate> {
        &self.fates
    }
}

impl Default for Preparer {
    fn default() -> Self {
        Self::new()
    }
}
