//! Where a frame's camera stood, told by the scene alone: tracking without recorded poses.
//!
//! The scene itself is the map: it is drawn from where the camera may be, wider than a frame, and the
//! frame is aligned with that picture and its depth, coarse to fine. No images are kept, and a frame
//! that comes back to where others were meets what all of them taught, so that loops close by
//! themselves as far as tracking has not drifted beyond its reach.
//!
//! | step | file |
//! |---|---|
//! | the frame as few points at several resolutions | `samples` |
//! | the scene as it looks from a place | `reference` |
//! | turns on a grid, for cameras that turn fast | `search` |
//! | Gauss–Newton over depth and brightness | `fit` |
//!
//! A frame is lost if too little of it is known, if what is known disagrees, or if it does not
//! determine the pose (a blank wall). Then the places of earlier frames are tried, and what is lost
//! all the same is left out rather than learnt where it was not taken.

mod fit;
mod reference;
mod samples;
mod search;

use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use crate::model::scene::trajectory::TrackedPose;
use crate::model::splat::appearance::SplatView;
use crate::observation::surface::Observation;
use crate::render::cpu::CpuRenderer;
use fit::{PoseFit, fit};
use rayon::prelude::*;
use reference::Reference;
use samples::{FrameSamples, LEVELS};
use search::search;

/// Fewest samples of a frame that can be placed.
const MIN_SAMPLES: usize = 100;
/// Least mean brightness of a frame that shows anything.
const MIN_BRIGHTNESS: f64 = 0.02;
/// Least share of a frame that the scene must show.
const MIN_OVERLAP: f64 = 0.2;
/// Least agreement of that share.
const MIN_AGREEMENT: f64 = 0.4;
/// Largest deviation of the turn, radians, and of the centre, as a share of depth.
const MAX_DEVIATIONS: [f64; 2] = [0.01, 0.01];
/// Widening of the picture that turns are searched in, and of the one that is aligned with last.
const MARGINS: [f64; 2] = [0.4, 0.1];
/// Poses that the search hands on.
const CANDIDATES: usize = 6;
/// Steps of Gauss–Newton by level, the finest first.
const ROUNDS: [usize; LEVELS] = [6, 8, 10];
/// Places that are tried when tracking is lost, at most.
const MAX_PLACES: usize = 24;

/// Why a frame could not be placed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TrackingLoss {
    /// Too few samples with depth.
    #[error(
        "expected depth in at least {MIN_SAMPLES} blocks of pixels, found {0}; check the depth unit and range"
    )]
    Depth(usize),
    /// Too dark: mean brightness.
    #[error(
        "expected a mean brightness of at least {MIN_BRIGHTNESS}, found {0:.3}; record with more light"
    )]
    Dark(f64),
    /// The share of it that is known.
    #[error("expected the scene to show at least {:.0} % of it, found {:.0} %; move slower, or back to what was seen", 100.0 * MIN_OVERLAP, 100.0 * .0)]
    Overlap(f64),
    /// How well it agrees with what is known.
    #[error(
        "expected it to agree with the scene by at least {MIN_AGREEMENT}, found {0:.2} at the best place; move slower, or back to what was seen"
    )]
    Agreement(f64),
    /// Deviations of turn, radians, and centre, world units.
    #[error("expected surfaces and colours that determine its pose, found them to leave {:.2} degrees and {:.3} world units open; keep more than one plain wall in view", .0[0].to_degrees(), .0[1])]
    Undetermined([f64; 2]),
}

/// Where the first frame is taken to stand: where it says, if tracking can go on from it.
///
/// # Errors
/// [`TrackingLoss`] of a frame that shows nothing to go by.
pub fn begin(frame: &Observation) -> Result<TrackedPose, TrackingLoss> {
    check(&FrameSamples::of(frame)).map(|()| TrackedPose::first(&frame.camera.pose))
}

/// Whether a frame shows anything to go by.
fn check(samples: &FrameSamples) -> Result<(), TrackingLoss> {
    let n = samples.levels[0].samples.len();
    if n < MIN_SAMPLES {
        Err(TrackingLoss::Depth(n))
    } else if samples.brightness < MIN_BRIGHTNESS {
        Err(TrackingLoss::Dark(samples.brightness))
    } else {
        Ok(())
    }
}

/// Finds where a frame was taken from, given poses near which it may be, the likeliest first, and
/// the poses of earlier frames, which are tried where that fails.
///
/// # Errors
/// [`TrackingLoss`] of the best pose that was found.
pub fn place(
    scene: SplatView<'_>,
    frame: &Observation,
    guesses: &[Pose],
    known: &[Pose],
) -> Result<TrackedPose, TrackingLoss> {
    let samples = FrameSamples::of(frame);
    check(&samples)?;
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
    // Spread over the whole run: where it was last is no likelier than anywhere else by now.
    let every = known.len().div_ceil(MAX_PLACES).max(1);
    let places: Vec<Pose> = known.iter().rev().step_by(every).copied().collect();
    tracker.track(&places).or(near)
}

/// One frame beside the scene.
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

    /// The pose found from the best of some guesses.
    fn track(&mut self, guesses: &[Pose]) -> Result<TrackedPose, TrackingLoss> {
        let mut best: Option<PoseFit> = None;
        for guess in guesses {
            let found = self.near(guess);
            best = better(best, found);
        }
        let found = best.ok_or(TrackingLoss::Overlap(0.0))?;
        let settled = self.settle(&found).ok_or(TrackingLoss::Overlap(0.0))?;
        self.judge(&settled)
    }

    /// The best pose that is a turn or a small motion away.
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
        aligned.collect::<Vec<_>>().into_iter().fold(None, better)
    }

    /// Aligns with what the scene shows from the pose found itself: nothing is hidden from there that
    /// the frame sees.
    fn settle(&mut self, found: &PoseFit) -> Option<PoseFit> {
        let mut settled = *found;
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

    fn judge(&self, fit: &PoseFit) -> Result<TrackedPose, TrackingLoss> {
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
