//! Decides which calibration estimates are significant.
//!
//! A minimum always exists, so finding one proves nothing. Frames are split into two halves that see
//! the same places. Each half's optimum must explain the *other* half better than the initial estimate
//! does. Otherwise it fits only that half's errors. The test applies to the whole colour camera, to
//! depth, and to each value. For a single value, the optimum is compared with a refit that holds the
//! value at its initial value. Values are correlated: jointly they may be certain where none is
//! individually, and reverting one shifts the others. So depth and camera are accepted or rejected as a
//! whole, except values on which no other depends.

use super::color::{rms_pixel_distance, rms_shift_per_unit};
use super::covariance::Covariance;
use super::evidence::{Evidence, ResidualKind};
use super::pyramid::Pyramid;
use super::unknowns::{CAMERA, CalibratedValue, DEPTH, Estimate, N, NAMES, SensorPrior, Unknowns};
use crate::calibrate::CalibrationInput;
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;

/// Minimum relative decrease of the colour loss, in held-out frames, for accepting another camera. On
/// the 7-Scenes Kinect, whose camera is known, errors of poses and depth favour a wrong camera by 3 %.
/// On Lego, with registered colours, the decrease is 1.4 %.
const MIN_FALL: f64 = 0.05;
/// Minimum mean image shift, in pixels, for accepting another camera. On Lego, with registered colours,
/// the shift is 0.4.
const MIN_SHIFT: f64 = 1.0;
/// Minimum evidence for changing a value: the relative increase of the other half's loss if the value is
/// held at its initial value. Pose errors shift the minimum. On the 7-Scenes Kinect, a wrong roll
/// decreases the loss by 0.8 % but makes held-out views worse.
const MIN_RISE: f64 = 0.02;
/// Minimum difference from the initial value, in standard errors, for changing a value. Poses are often
/// fitted to the same depth and share its errors, which the views cannot reveal.
const SIGNIFICANT: f64 = 4.0;
/// Maximum image shift, in pixels, at which an estimate counts as confirmation of the initial value.
const SAME: f64 = 1.0;
/// Maximum shift of any other value, in its standard errors, at which a value may be reverted alone.
const LEANING: f64 = 1.0;

struct Half<'a> {
    evidence: Evidence<'a>,
    best: Estimate,
}

pub(super) struct CrossValidation<'a> {
    prior: &'a SensorPrior,
    start: Unknowns,
    halves: [Half<'a>; 2],
}

impl<'a> CrossValidation<'a> {
    /// Fits each half by itself, starting from the optimum of all frames.
    pub fn new(
        input: &'a CalibrationInput,
        views: Views<'a>,
        prior: &'a SensorPrior,
        (start, best): (Unknowns, Unknowns),
        free: &[usize],
    ) -> Result<Self, FrameError> {
        // The first half holds the even-numbered frames (`survey`).
        let [first, second] = views.split_at(views.frames.len().div_ceil(2));
        let half = |views: Views<'a>| -> Result<Half<'a>, FrameError> {
            let mut own = Estimate::as_recorded(best, views.frames.len());
            let mut evidence = views.match_views(input, &own, free, 0)?;
            refine(&mut evidence, prior, &mut own, free);
            Ok(Half { evidence, best: own })
        };
        Ok(Self { prior, start, halves: [half(first)?, half(second)?] })
    }

    /// Scales down the evidence if the halves differ by more than their equations predict, and refits
    /// the unknowns. Consecutive views share pose errors, which the equations do not include.
    pub fn scale_evidence(
        &mut self,
        evidence: &mut Evidence<'a>,
        best: &mut Estimate,
        free: &[usize],
    ) {
        let [a, b] = [0, 1].map(|i| self.halves[i].best.unknowns);
        // Only downwards: two halves may agree by chance.
        let times = evidence.normalised_disagreement(self.prior, best, free, [&a, &b]).max(1.0);
        let prior = self.prior;
        let halves = self.halves.iter_mut().map(|half| (&mut half.evidence, &mut half.best));
        for (evidence, best) in halves.chain([(evidence, best)]) {
            evidence.scale_down(times);
            evidence.fit(prior, best, free);
        }
    }

    /// Tests each half's camera on the other half. Returns whether the camera is accepted, and a
    /// description of the result.
    pub fn test_camera(&mut self, best: &Unknowns) -> (bool, String) {
        let mut falls = [0.0; 2];
        for (own, other) in [(0, 1), (1, 0)] {
            let found = self.halves[own].best.unknowns;
            // The same depth in both, so that only the camera differs.
            let before = Unknowns { camera: self.start.camera, ..found };
            let evidence = &mut self.halves[other].evidence;
            let start = evidence.loss(self.prior, &before, ResidualKind::Color);
            falls[other] = 1.0 - evidence.loss(self.prior, &found, ResidualKind::Color) / start;
        }
        // Both halves must confirm the camera.
        let fall = falls[0].min(falls[1]);
        // In pixels, because correlated values may differ much with little effect.
        let shift = rms_pixel_distance(&self.halves[0].evidence.matches, &self.start, best);
        let found = format!(
            "the best other camera shifts colours by {shift:.1} pixels and lowers their variance by {:.1} % in frames that it was not fitted to, an effect that errors of poses and depth can also cause",
            100.0 * fall.max(0.0)
        );
        (fall >= MIN_FALL && shift >= MIN_SHIFT, found)
    }

    /// Refits each half's optimum with the `held` unknowns fixed to their initial values. Returns the
    /// relative increases of the loss in the respective other half.
    fn loss_increases(&mut self, held: &[usize], free: &[usize]) -> [f64; 2] {
        let kind =
            if DEPTH.contains(&held[0]) { ResidualKind::Thickness } else { ResidualKind::Color };
        let rest = excluding(free, held);
        let (prior, start) = (self.prior, self.start);
        [(0, 1), (1, 0)].map(|(own, other)| {
            let Half { evidence, best } = &mut self.halves[own];
            let mut kept = evidence.fit_with_held(prior, best, &rest, (held, &start));
            refine(evidence, prior, &mut kept, &rest);
            let best = best.unknowns;
            let other = &mut self.halves[other].evidence;
            let without = other.loss(prior, &kept.unknowns, kind);
            without / other.loss(prior, &best, kind) - 1.0
        })
    }

    /// Reverts the `held` unknowns to their initial values in all fits, and fits the other `free`
    /// unknowns again. Returns these other unknowns.
    fn revert_values(
        &mut self,
        held: &[usize],
        free: &[usize],
        evidence: &mut Evidence,
        best: &mut Estimate,
    ) -> Vec<usize> {
        let rest = excluding(free, held);
        let (prior, start) = (self.prior, self.start);
        let halves = self.halves.iter_mut();
        for half in halves {
            half.best = half.evidence.fit_with_held(prior, &half.best, &rest, (held, &start));
            refine(&mut half.evidence, prior, &mut half.best, &rest);
        }
        *best = evidence.fit_with_held(prior, best, &rest, (held, &start));
        refine(evidence, prior, best, &rest);
        rest
    }

    /// Accepts those `free` unknowns that the data determines, depth before camera. Returns the result
    /// for every value.
    pub fn accept_values(
        &mut self,
        evidence: &mut Evidence,
        best: &mut Estimate,
        free: &[usize],
    ) -> Vec<CalibratedValue> {
        let covariance = evidence.covariance(self.prior, best, free);
        let mut values: Vec<CalibratedValue> = free
            .iter()
            .enumerate()
            .map(|(place, &i)| self.value(i, &best.unknowns, covariance.error(place)))
            .collect();
        let mut free = free.to_vec();
        // Depth first: without it, the camera values tested below shift.
        if let Some(doubt) = self.depth_rejection(&best.unknowns, &free, &covariance) {
            DEPTH.iter().for_each(|&i| values[i].revert(doubt.clone()));
            free = self.revert_values(&DEPTH, &free, evidence, best);
        }
        let covariance = evidence.covariance(self.prior, best, &free);
        let mut back = Vec::new();
        for (place, &i) in free.iter().enumerate() {
            let error = covariance.error(place);
            let apart = best.unknowns.get(i) - self.start.get(i);
            let certainty = apart.abs() / error;
            let Some(doubt) = self.value_rejection(i, certainty, &free) else { continue };
            if covariance.largest_induced_shift(place, apart) < LEANING {
                back.push(i);
                values[i].revert(doubt);
            } else {
                values[i].accept_as_correlated(doubt);
            }
        }
        if !back.is_empty() {
            free = self.revert_values(&back, &free, evidence, best);
        }
        let shifts = rms_shift_per_unit(&evidence.matches, &best.unknowns);
        for &i in &free {
            // Reverting some values shifts the others.
            values[i].best = best.unknowns.natural_value(i);
            values[i].after = values[i].best;
        }
        // Only values of the camera shift the image.
        for &i in back.iter().filter(|&&i| i >= CAMERA) {
            let apart = (values[i].best - values[i].before).abs() / best.unknowns.natural_slope(i);
            if shifts[i] * apart <= SAME {
                values[i].confirm_initial("the best is the same to a pixel".to_owned());
            }
        }
        values
    }

    fn depth_rejection(
        &mut self,
        best: &Unknowns,
        free: &[usize],
        covariance: &Covariance,
    ) -> Option<String> {
        let apart = DEPTH.map(|i| best.get(i) - self.start.get(i));
        let certainty = covariance.mahalanobis_distance(&apart);
        if certainty < SIGNIFICANT {
            return Some(format!("both are only {certainty:.1} standard errors away"));
        }
        let rises = self.loss_increases(&DEPTH, free);
        insignificance(rises, "thickness")
    }

    fn value_rejection(&mut self, i: usize, certainty: f64, free: &[usize]) -> Option<String> {
        if certainty < SIGNIFICANT {
            return Some(format!("the best is only {certainty:.1} standard errors away"));
        }
        // Depth was tested jointly before.
        if DEPTH.contains(&i) {
            return None;
        }
        // Certainty alone does not suffice: errors common to all views are not in it.
        let rises = self.loss_increases(&[i], free);
        insignificance(rises, "colour variance")
    }

    pub fn value(&self, i: usize, best: &Unknowns, error: f64) -> CalibratedValue {
        let error = error * best.natural_slope(i);
        CalibratedValue::determined(
            NAMES[i],
            self.start.natural_value(i),
            best.natural_value(i),
            error,
        )
    }

    pub fn unchanged_camera_values(
        &self,
        evidence: &Evidence,
        best: &Estimate,
    ) -> Vec<CalibratedValue> {
        let all: Vec<usize> = (0..N).collect();
        let covariance = evidence.covariance(self.prior, best, &all);
        let best = &best.unknowns;
        let shifts = rms_shift_per_unit(&evidence.matches, best);
        let value = |i: usize| {
            let apart = (best.get(i) - self.start.get(i)).abs() * shifts[i];
            let error = covariance.error(i);
            let mut value = self.value(i, best, error);
            value
                .revert(format!("the best shifts by {apart:.1} pixels, compensated by the others"));
            if apart.max(error * shifts[i]) <= SAME {
                value.confirm_initial("the best is the same to a pixel".to_owned());
            }
            value
        };
        (CAMERA..N).map(value).collect()
    }
}

fn excluding(free: &[usize], held: &[usize]) -> Vec<usize> {
    free.iter().copied().filter(|i| !held.contains(i)).collect()
}

fn insignificance([a, b]: [f64; 2], of: &str) -> Option<String> {
    // The mean must reach the limit, and each half at least half of it.
    (a.min(b) < 0.5 * MIN_RISE || a + b < 2.0 * MIN_RISE).then(|| {
        format!(
            "held-out frames hardly need it: without it their {of} changes by {:+.1} % and {:+.1} %",
            100.0 * a,
            100.0 * b
        )
    })
}

/// Number of pyramid levels. A pixel of the coarsest level covers 8 × 8 pixels of the full resolution.
pub(super) const LEVELS: usize = 4;
/// Order in which the levels are fitted after the coarsest. Level 0 is repeated, because aligned
/// surfaces must be matched again.
const ORDER: [usize; 4] = [2, 1, 0, 0];
pub(super) const STEPS: usize = 1 + ORDER.len();
/// Maximum number of fits per level. Gains and weights are updated between fits.
const MAX_ROUNDS: usize = 12;
/// Change of the estimate, in pixels of the level's images, below which a level has converged.
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

    /// Matches the points of the views under an estimate, for a pyramid level, and estimates gains. If
    /// no camera unknown is in `free`, the input's colour camera is used.
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
        // Placeholders: gains are estimated from this evidence.
        let gains = vec![[1.0; 3]; self.frames.len()];
        let mut evidence = Evidence::new(matches, self.images, gains, level);
        evidence.update_gains(at);
        Ok(evidence)
    }
}

/// Fits the `free` unknowns level by level, from the coarsest. Returns the best estimate and its
/// evidence.
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
    // Matches change with depth, so each level matches anew.
    for level in ORDER {
        evidence = views.match_views(input, &best, free, level)?;
        refine(&mut evidence, prior, &mut best, free);
        tick();
    }
    Ok((best, evidence))
}

/// Alternates between fitting the `free` unknowns and fitting the gains until the estimate converges.
/// Gains have a linear solution in logarithms; the unknowns do not.
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
