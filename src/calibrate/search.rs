//! The search for all unknowns together, from coarse images and components to fine ones.
//!
//! Views of wrong depth part surfaces and slopes of colour hold only near the truth, so that components
//! and pixels begin eight times as large. Gains are estimated in between, because exposure that differs
//! between views looks like a wrong camera.

use super::evidence::Evidence;
use super::input::CalibrationInput;
use super::pyramid::Pyramid;
use super::unknowns::{CAMERA, Estimate, SensorPrior, Unknowns};
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;

/// Sizes of the images; at the smallest a pixel is eight.
pub(super) const LEVELS: usize = 4;
/// Levels after the coarsest, as they are gone through: at the last, surfaces that came together are matched
/// again.
const ORDER: [usize; 4] = [2, 1, 0, 0];
/// Steps that a search tells of.
pub(super) const STEPS: usize = 1 + ORDER.len();
/// Fits at every level at most, with gains estimated and points weighed in between.
const MAX_ROUNDS: usize = 12;
/// Shift, pixels of the level's images, at which a level is done.
const SETTLED: f64 = 0.03;

/// Some of the frames, with their photographs at all sizes.
#[derive(Clone, Copy)]
pub(super) struct Views<'a> {
    pub frames: &'a [Frame],
    pub images: &'a [Pyramid],
}

impl<'a> Views<'a> {
    /// Those before a place, and the others.
    pub fn split_at(self, middle: usize) -> [Self; 2] {
        let (frames, others) = self.frames.split_at(middle);
        let (images, their_images) = self.images.split_at(middle);
        [Self { frames, images }, Self { frames: others, images: their_images }]
    }

    /// What they say around some values, at a size of the images; `free` are weighed by. A colour camera that
    /// is not searched for is the one there is.
    pub fn evidence(
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
        // Components as large against a pixel of the smaller image as they are at full size.
        let growth = f64::from(1u32 << level);
        let matches = input.matched(self.frames, at.unknowns.depth, camera, growth)?;
        let gains = vec![[1.0; 3]; self.frames.len()];
        let mut evidence = Evidence::new(matches, self.images, gains, level);
        evidence.expose(at);
        Ok(evidence)
    }
}

/// The best values of the `free` unknowns, and what the views say around them.
pub(super) fn search<'a>(
    input: &CalibrationInput,
    views: Views<'a>,
    prior: &SensorPrior,
    start: &Unknowns,
    free: &[usize],
    mut tick: impl FnMut(),
) -> Result<(Estimate, Evidence<'a>), FrameError> {
    let mut best = Estimate::as_recorded(*start, views.frames.len());
    let mut evidence = views.evidence(input, &best, free, LEVELS - 1)?;
    refine(&mut evidence, prior, &mut best, free);
    tick();
    for level in ORDER {
        evidence = views.evidence(input, &best, free, level)?;
        refine(&mut evidence, prior, &mut best, free);
        tick();
    }
    Ok((best, evidence))
}

/// Fits unknowns and gains in turn: gains are linear in logarithms, the others are not.
pub(super) fn refine(
    evidence: &mut Evidence,
    prior: &SensorPrior,
    at: &mut Estimate,
    free: &[usize],
) {
    for _ in 0..MAX_ROUNDS {
        evidence.weigh(at);
        let before = at.unknowns;
        evidence.fit(prior, at, free);
        evidence.expose(at);
        if evidence.moved(&before, &at.unknowns) < SETTLED {
            break;
        }
    }
    evidence.weigh(at);
}
