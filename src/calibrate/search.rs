//! Coarse-to-fine search over all unknowns.
//!
//! Wrong depth separates the surfaces of different views, and colour gradients hold only near the solution,
//! so components and pixels begin eight times as large. Gains are re-estimated in between, because exposure
//! differences would bias the camera.

use super::evidence::Evidence;
use super::input::CalibrationInput;
use super::pyramid::Pyramid;
use super::unknowns::{CAMERA, Estimate, SensorPrior, Unknowns};
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;

/// Pyramid levels; a pixel of the coarsest covers 8 × 8.
pub(super) const LEVELS: usize = 4;
/// Levels after the coarsest. The last repeats level 0, because aligned surfaces must be matched again.
const ORDER: [usize; 4] = [2, 1, 0, 0];
/// Progress steps of one search.
pub(super) const STEPS: usize = 1 + ORDER.len();
/// Maximum number of fits per level, with gains and weights updated in between.
const MAX_ROUNDS: usize = 12;
/// Shift, pixels of the level's images, at which a level has converged.
const SETTLED: f64 = 0.03;

#[derive(Clone, Copy)]
pub(super) struct Views<'a> {
    pub frames: &'a [Frame],
    pub images: &'a [Pyramid],
}

impl<'a> Views<'a> {
    pub fn split_at(self, middle: usize) -> [Self; 2] {
        let (frames, others) = self.frames.split_at(middle);
        let (images, their_images) = self.images.split_at(middle);
        [Self { frames, images }, Self { frames: others, images: their_images }]
    }

    /// Matches the views at an estimate and pyramid level, and estimates gains. If no camera unknown is in
    /// `free`, the input's colour camera is used.
    pub fn match_views(
        self,
        input: &CalibrationInput,
        at: &Estimate,
        free: &[usize],
        level: usize,
    ) -> Result<Evidence<'a>, FrameError> {
        let is_free = free.iter().any(|&i| i >= CAMERA);
        let camera = if is_free {
            Some(at.unknowns.camera.camera())
        } else {
            input.calibration.color_camera
        };
        // Components keep their size relative to a pixel of the smaller image.
        let growth = f64::from(1u32 << level);
        let matches = input.match_frames(self.frames, at.unknowns.depth, camera, growth)?;
        let gains = vec![[1.0; 3]; self.frames.len()];
        let mut evidence = Evidence::new(matches, self.images, gains, level);
        evidence.update_gains(at);
        Ok(evidence)
    }
}

/// Returns the best values of the `free` unknowns, and the evidence around them.
pub(super) fn search<'a>(
    input: &CalibrationInput,
    views: Views<'a>,
    prior: &SensorPrior,
    start: &Unknowns,
    free: &[usize],
    mut tick: impl FnMut(),
) -> Result<(Estimate, Evidence<'a>), FrameError> {
    let mut best = Estimate::as_recorded(*start, views.frames.len());
    let mut evidence = views.match_views(input, &best, free, LEVELS - 1)?;
    refine(&mut evidence, prior, &mut best, free);
    tick();
    for level in ORDER {
        evidence = views.match_views(input, &best, free, level)?;
        refine(&mut evidence, prior, &mut best, free);
        tick();
    }
    Ok((best, evidence))
}

/// Alternates fits of unknowns and gains: gains are linear in logarithms, the unknowns are not.
pub(super) fn refine(
    evidence: &mut Evidence,
    prior: &SensorPrior,
    at: &mut Estimate,
    free: &[usize],
) {
    for _ in 0..MAX_ROUNDS {
        evidence.update_weights(at);
        let before = at.unknowns;
        evidence.fit(prior, at, free);
        evidence.update_gains(at);
        if evidence.change_in_pixels(&before, &at.unknowns) < SETTLED {
            break;
        }
    }
    evidence.update_weights(at);
}
