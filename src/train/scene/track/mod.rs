//! Tracking without recorded poses: the pose of a frame is found from the scene alone.
//!
//! The scene is the map: it is rendered from a likely pose with a wider view than a frame. The frame is
//! then aligned with the rendered picture and depth, coarse to fine. No images are stored. A frame that
//! returns to a known place is aligned with everything trained there, so loops close without a separate
//! method. The drift must be small enough for the alignment.
//!
//! | step | file |
//! |---|---|
//! | frame as a few points at several resolutions | `samples` |
//! | scene rendered from a pose | `reference` |
//! | search over rotations on a grid, for fast turns | `search` |
//! | Gauss–Newton over depth and brightness | `fit` |
//!
//! A frame is lost if too little of it is known or if it disagrees with the scene. It is also lost if it
//! does not determine the pose (a blank wall). Poses of earlier frames are then tried. A frame that
//! stays lost is left out rather than added at a wrong pose.

mod fit;
mod reference;
mod samples;
mod search;

use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use crate::model::scene::state::TrackedPose;
use crate::model::splat::appearance::SplatView;
use crate::observation::surface::Observation;
use crate::render::cpu::CpuRenderer;
use fit::{PoseFit, fit};
use rayon::prelude::*;
use samples::{FrameSamples, LEVELS};
use search::search;

pub(in crate::train::scene) use reference::{Reference, ReferenceLevel};
pub(in crate::train::scene) use samples::brightness;

/// Minimum number of samples of a frame.
const MIN_SAMPLES: usize = 100;
/// Minimum mean brightness of a frame.
const MIN_BRIGHTNESS: f64 = 0.02;
/// Minimum share of a frame that the scene must cover.
const MIN_OVERLAP: f64 = 0.2;
/// Minimum agreement of the covered samples with the scene, 0 to 1.
const MIN_AGREEMENT: f64 = 0.4;
/// Maximum standard deviation of the rotation, radians, and of the centre, relative to depth.
const MAX_DEVIATIONS: [f64; 2] = [0.01, 0.01];
/// Margins on each side of the rendered picture, relative to the size of a frame: for the search over
/// rotations, and for the final alignment.
const MARGINS: [f64; 2] = [0.4, 0.1];
/// Maximum number of poses that the search over rotations returns.
const CANDIDATES: usize = 6;
/// Maximum number of Gauss–Newton steps at each resolution level, finest level first.
const ROUNDS: [usize; LEVELS] = [6, 8, 10];
/// Maximum number of earlier poses that are tried after tracking is lost.
const MAX_PLACES: usize = 24;

/// Reason why the pose of a frame was not found.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TrackingLoss {
    /// Too few samples with depth; holds the number of samples.
    #[error(
        "expected depth in at least {MIN_SAMPLES} blocks of pixels, found {0}; check the depth unit and range"
    )]
    Depth(usize),
    /// Too dark a frame; holds the mean brightness.
    #[error(
        "expected a mean brightness of at least {MIN_BRIGHTNESS}, found {0:.3}; record with more light"
    )]
    Dark(f64),
    /// Insufficient overlap with the scene; holds the share of the frame that the scene covers.
    #[error("expected the scene to cover at least {:.0} % of the frame, found {:.0} %; move slower or return to a known view", 100.0 * MIN_OVERLAP, 100.0 * .0)]
    Overlap(f64),
    /// Insufficient agreement with the scene; holds the agreement at the best pose.
    #[error(
        "expected an agreement with the scene of at least {MIN_AGREEMENT}, found {0:.2} at the best pose; move slower or return to a known view"
    )]
    Agreement(f64),
    /// Pose not determined by the frame; holds the standard deviations of rotation (radians) and centre
    /// (world units).
    #[error("expected surfaces and colours that determine the pose, found uncertainties of {:.2} degrees and {:.3} world units; keep more than one plain wall in view", .0[0].to_degrees(), .0[1])]
    Undetermined([f64; 2]),
}

/// Starts tracking: returns the first frame's recorded pose as a tracked pose.
///
/// # Errors
/// [`TrackingLoss`] if the frame has too few samples or too little light.
pub fn begin(frame: &Observation) -> Result<TrackedPose, TrackingLoss> {
    check_samples(&FrameSamples::of(frame)).map(|()| TrackedPose::first(&frame.camera.pose))
}

/// Checks that a frame has enough samples and light.
fn check_samples(samples: &FrameSamples) -> Result<(), TrackingLoss> {
    let n = samples.levels[0].samples.len();
    if n < MIN_SAMPLES {
        Err(TrackingLoss::Depth(n))
    } else if samples.brightness < MIN_BRIGHTNESS {
        Err(TrackingLoss::Dark(samples.brightness))
    } else {
        Ok(())
    }
}

/// Finds the pose of a frame by alignment to the scene from `guesses`. If that fails, starts from
/// `known`, the poses of earlier frames.
///
/// # Errors
/// [`TrackingLoss`] of the best pose from `guesses`, or if the frame has too few samples or is too dark.
pub fn find_pose(
    scene: SplatView<'_>,
    frame: &Observation,
    guesses: &[Pose],
    known: &[Pose],
) -> Result<TrackedPose, TrackingLoss> {
    let samples = FrameSamples::of(frame);
    check_samples(&samples)?;
    let mut tracker = Tracker {
        scene,
        intrinsics: frame.camera.intrinsics,
        samples: &samples,
        renderer: CpuRenderer::new(),
    };
    let near = tracker.track(guesses);
    if near.is_ok() {
        return near;
    }
    // Spread over the whole run: after a loss the last pose is no more likely than any other.
    let every = known.len().div_ceil(MAX_PLACES).max(1);
    let places: Vec<Pose> = known.iter().rev().step_by(every).copied().collect();
    tracker.track(&places).or(near)
}

/// Tracking state of one frame.
struct Tracker<'a> {
    scene: SplatView<'a>,
    intrinsics: Intrinsics,
    samples: &'a FrameSamples,
    renderer: CpuRenderer,
}

impl Tracker<'_> {
    fn draw(&mut self, pose: &Pose, margin: f64) -> Reference {
        let Self { scene, intrinsics, samples, renderer } = self;
        Reference::draw(renderer, *scene, pose, intrinsics, samples.block, margin)
    }

    /// Aligns the frame from each guess and returns the best pose.
    fn track(&mut self, guesses: &[Pose]) -> Result<TrackedPose, TrackingLoss> {
        let mut best: Option<PoseFit> = None;
        for guess in guesses {
            let found = self.near(guess);
            best = better(best, found);
        }
        let found = best.ok_or(TrackingLoss::Overlap(0.0))?;
        let settled = self.refine_pose(&found).ok_or(TrackingLoss::Overlap(0.0))?;
        self.check_fit(&settled)
    }

    /// Returns the best pose that alignment reaches from a guess and from rotations of that guess.
    fn near(&mut self, guess: &Pose) -> Option<PoseFit> {
        let reference = self.draw(guess, MARGINS[0]);
        let [_, middle, coarsest] = &self.samples.levels;
        let at = |level: usize| (&reference.levels[level], &reference.pose);
        let mut starts = search(&coarsest.samples, at(2), guess, CANDIDATES);
        starts.push(*guess);
        let depth = self.samples.depth;
        let aligned = starts.par_iter().with_max_len(1).map(|start| {
            let coarse = fit(coarsest, at(2), start, ROUNDS[2], depth)?;
            fit(middle, at(1), &coarse.pose, ROUNDS[1], depth)
        });
        // Compared in order: ties go to the first start, whatever thread ends first.
        aligned.collect::<Vec<_>>().into_iter().fold(None, better)
    }

    /// Refines a pose by alignment to the scene rendered from this pose. Then no surface that the frame
    /// shows is occluded in the rendered picture.
    fn refine_pose(&mut self, found: &PoseFit) -> Option<PoseFit> {
        let mut settled = *found;
        // The first picture is drawn from a pose that was aligned at coarse levels only.
        for _ in 0..2 {
            let reference = self.draw(&settled.pose, MARGINS[1]);
            for level in [1, 0] {
                let from = (&reference.levels[level], &reference.pose);
                let samples = &self.samples.levels[level];
                settled = fit(samples, from, &settled.pose, ROUNDS[level], self.samples.depth)?;
            }
        }
        Some(settled)
    }

    fn check_fit(&self, fit: &PoseFit) -> Result<TrackedPose, TrackingLoss> {
        let most = [MAX_DEVIATIONS[0], MAX_DEVIATIONS[1] * self.samples.depth];
        let PoseFit { pose, overlap, agreement, deviations, .. } = *fit;
        if overlap < MIN_OVERLAP {
            Err(TrackingLoss::Overlap(overlap))
        } else if agreement < MIN_AGREEMENT {
            Err(TrackingLoss::Agreement(agreement))
        } else if deviations.iter().zip(most).any(|(found, most)| *found > most) {
            Err(TrackingLoss::Undetermined(deviations))
        } else {
            Ok(TrackedPose::new(&pose, deviations, overlap, agreement))
        }
    }
}

fn better(best: Option<PoseFit>, other: Option<PoseFit>) -> Option<PoseFit> {
    match (best, other) {
        (Some(best), Some(other)) if other.score() <= best.score() => Some(best),
        (best, other) => other.or(best),
    }
}
