//! Decides which calibration estimates are significant.
//!
//! A minimum always exists, so finding one proves nothing. Frames are split into two halves that see the
//! same places. Each half's optimum must explain the *other* half better than the start does; otherwise it
//! fits only that half's errors. The test applies to the whole colour camera, to depth, and to each value.
//! A value is compared with a refit that holds it at the start. Values are correlated: jointly they may be
//! certain where none is individually, and reverting one shifts the others. So depth and camera are
//! accepted or rejected as a whole, except values on which no other depends.

use super::color::{distance, shifts};
use super::covariance::Covariance;
use super::evidence::{Evidence, Kind};
use super::input::CalibrationInput;
use super::search::{Views, refine};
use super::unknowns::{CAMERA, DEPTH, Estimate, N, NAMES, SensorPrior, Unknowns};
use super::value::CalibratedValue;
use crate::dataset::error::FrameError;

/// Minimum relative decrease of the colour loss, in held-out frames, for accepting another camera. On the
/// 7-Scenes Kinect, whose camera is known, wrong poses and depths yield 3 %, with worse held-out views; on
/// Lego, with registered colours, 1.4 %.
const MIN_FALL: f64 = 0.05;
/// Minimum mean image shift, pixels, for accepting another camera; on Lego it is 0.4.
const MIN_SHIFT: f64 = 1.0;
/// Minimum relative increase of the other half's loss when a value is held at the start. Pose errors shift
/// the minimum: on the 7-Scenes Kinect to a roll that gains 0.8 % but makes held-out views worse.
const MIN_RISE: f64 = 0.02;
/// Minimum difference from the initial value in standard errors. Poses are often fitted to the same depth
/// and share its errors, which is invisible in the views.
const SIGNIFICANT: f64 = 4.0;
/// Image shift, pixels, up to which a value counts as confirmed rather than changed.
const SAME: f64 = 1.0;
/// Shift of another value, in standard errors, up to which a value may revert alone.
const LEANING: f64 = 1.0;

/// Half of the frames with its own optimum.
struct Half<'a> {
    evidence: Evidence<'a>,
    best: Estimate,
}

/// Cross-validation of both halves.
pub(super) struct Judge<'a> {
    prior: &'a SensorPrior,
    start: Unknowns,
    halves: [Half<'a>; 2],
}

/// Decision on another colour camera.
pub(super) struct CameraVerdict {
    pub is_other: bool,
    /// Shift and decrease as text.
    pub found: String,
}

impl<'a> Judge<'a> {
    /// Fits each half by itself, starting from the optimum of all frames.
    pub fn new(
        input: &'a CalibrationInput,
        views: Views<'a>,
        prior: &'a SensorPrior,
        (start, best): (Unknowns, Unknowns),
        free: &[usize],
    ) -> Result<Self, FrameError> {
        let [first, second] = views.split_at(views.frames.len().div_ceil(2));
        let half = |views: Views<'a>| -> Result<Half<'a>, FrameError> {
            let mut own = Estimate::as_recorded(best, views.frames.len());
            let mut evidence = views.evidence(input, &own, free, 0)?;
            refine(&mut evidence, prior, &mut own, free);
            Ok(Half { evidence, best: own })
        };
        Ok(Self { prior, start, halves: [half(first)?, half(second)?] })
    }

    /// Scales down the evidence where the halves differ by more than their equations predict: consecutive
    /// views share pose errors.
    pub fn temper(&mut self, evidence: &mut Evidence<'a>, best: &mut Estimate, free: &[usize]) {
        let [a, b] = [0, 1].map(|i| self.halves[i].best.unknowns);
        let times = evidence.disagreement(self.prior, best, free, [&a, &b]).max(1.0);
        let prior = self.prior;
        let halves = self.halves.iter_mut().map(|half| (&mut half.evidence, &mut half.best));
        for (evidence, best) in halves.chain([(evidence, best)]) {
            evidence.doubt(times);
            evidence.fit(prior, best, free);
        }
    }

    /// Tests each half's camera on the other half.
    pub fn camera(&mut self, best: &Unknowns) -> CameraVerdict {
        let mut falls = [0.0; 2];
        for (own, other) in [(0, 1), (1, 0)] {
            let found = self.halves[own].best.unknowns;
            let before = Unknowns { camera: self.start.camera, ..found };
            let evidence = &mut self.halves[other].evidence;
            let start = evidence.loss(self.prior, &before, Kind::Color);
            falls[other] = 1.0 - evidence.loss(self.prior, &found, Kind::Color) / start;
        }
        let fall = falls[0].min(falls[1]);
        // In pixels, because correlated values may differ much with little effect.
        let shift = distance(&self.halves[0].evidence.matches, &self.start, best);
        let found = format!(
            "the best other camera shifts colours by {shift:.1} pixels and lowers their variance by {:.1} % in frames that it was not fitted to, an effect that errors of poses and depth can also cause",
            100.0 * fall.max(0.0)
        );
        CameraVerdict { is_other: fall >= MIN_FALL && shift >= MIN_SHIFT, found }
    }

    /// Relative increase of each half's loss if the other half's optimum is refitted with some of the
    /// `free` unknowns held at the start.
    fn rises(&mut self, held: &[usize], free: &[usize]) -> [f64; 2] {
        let kind = if DEPTH.contains(&held[0]) { Kind::Thickness } else { Kind::Color };
        let rest = without(free, held);
        let (prior, start) = (self.prior, self.start);
        [(0, 1), (1, 0)].map(|(own, other)| {
            let Half { evidence, best } = &mut self.halves[own];
            let mut kept = evidence.fit_without(prior, best, &rest, (held, &start));
            refine(evidence, prior, &mut kept, &rest);
            let best = best.unknowns;
            let other = &mut self.halves[other].evidence;
            let without = other.loss(prior, &kept.unknowns, kind);
            without / other.loss(prior, &best, kind) - 1.0
        })
    }

    /// Reverts some of the `free` unknowns to the start in all fits; returns the remaining free ones.
    fn give_back(
        &mut self,
        held: &[usize],
        free: &[usize],
        evidence: &mut Evidence,
        best: &mut Estimate,
    ) -> Vec<usize> {
        let rest = without(free, held);
        let (prior, start) = (self.prior, self.start);
        let halves = self.halves.iter_mut();
        for half in halves {
            half.best = half.evidence.fit_without(prior, &half.best, &rest, (held, &start));
            refine(&mut half.evidence, prior, &mut half.best, &rest);
        }
        *best = evidence.fit_without(prior, best, &rest, (held, &start));
        refine(evidence, prior, best, &rest);
        rest
    }

    /// Accepts those of the `free` unknowns that the data determines, depth first. Returns the result for
    /// every value.
    pub fn settle(
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
        if let Some(doubt) = self.doubt_of_depth(&best.unknowns, &free, &covariance) {
            DEPTH.iter().for_each(|&i| values[i].keep(doubt.clone()));
            free = self.give_back(&DEPTH, &free, evidence, best);
        }
        let covariance = evidence.covariance(self.prior, best, &free);
        let mut back = Vec::new();
        for (place, &i) in free.iter().enumerate() {
            let error = covariance.error(place);
            let apart = best.unknowns.get(i) - self.start.get(i);
            let certainty = apart.abs() / error;
            let Some(doubt) = self.doubt(i, certainty, &free) else { continue };
            if covariance.leaning(place, apart) < LEANING {
                back.push(i);
                values[i].keep(doubt);
            } else {
                values[i].lean(doubt);
            }
        }
        if !back.is_empty() {
            free = self.give_back(&back, &free, evidence, best);
        }
        let shifts = shifts(&evidence.matches, &best.unknowns);
        for &i in &free {
            values[i].settle_at(best.unknowns.natural(i));
        }
        for &i in back.iter().filter(|&&i| i >= CAMERA) {
            let apart = values[i].apart() / best.unknowns.natural_slope(i);
            if shifts[i] * apart <= SAME {
                values[i].confirm("the best is the same to a pixel".to_owned());
            }
        }
        values
    }

    /// Reason to reject the depth estimate, if any.
    fn doubt_of_depth(
        &mut self,
        best: &Unknowns,
        free: &[usize],
        covariance: &Covariance,
    ) -> Option<String> {
        let apart = DEPTH.map(|i| best.get(i) - self.start.get(i));
        let certainty = covariance.distance(&apart);
        if certainty < SIGNIFICANT {
            return Some(format!("both are only {certainty:.1} standard errors away"));
        }
        let rises = self.rises(&DEPTH, free);
        hardly_needed(rises, "thickness")
    }

    /// Reason why a value is not determined by itself, if any.
    fn doubt(&mut self, i: usize, certainty: f64, free: &[usize]) -> Option<String> {
        if certainty < SIGNIFICANT {
            return Some(format!("the best is only {certainty:.1} standard errors away"));
        }
        if DEPTH.contains(&i) {
            return None;
        }
        let rises = self.rises(&[i], free);
        hardly_needed(rises, "colour variance")
    }

    /// Result of an unknown in its natural parameterisation.
    pub fn value(&self, i: usize, best: &Unknowns, error: f64) -> CalibratedValue {
        let error = error * best.natural_slope(i);
        CalibratedValue::determined(NAMES[i], self.start.natural(i), best.natural(i), error)
    }

    /// Results for a colour camera that is not changed.
    pub fn staying_camera(&self, evidence: &Evidence, best: &Estimate) -> Vec<CalibratedValue> {
        let all: Vec<usize> = (0..N).collect();
        let covariance = evidence.covariance(self.prior, best, &all);
        let best = &best.unknowns;
        let shifts = shifts(&evidence.matches, best);
        let value = |i: usize| {
            let apart = (best.get(i) - self.start.get(i)).abs() * shifts[i];
            let error = covariance.error(i);
            let mut value = self.value(i, best, error);
            value.keep(format!("the best shifts by {apart:.1} pixels, compensated by the others"));
            if apart.max(error * shifts[i]) <= SAME {
                value.confirm("the best is the same to a pixel".to_owned());
            }
            value
        };
        (CAMERA..N).map(value).collect()
    }
}

fn without(free: &[usize], held: &[usize]) -> Vec<usize> {
    free.iter().copied().filter(|i| !held.contains(i)).collect()
}

/// Reason to reject a value that hardly improves the other half.
fn hardly_needed([a, b]: [f64; 2], of: &str) -> Option<String> {
    (a.min(b) < 0.5 * MIN_RISE || a + b < 2.0 * MIN_RISE).then(|| {
        format!(
            "held-out frames hardly need it: without it their {of} changes by {:+.1} % and {:+.1} %",
            100.0 * a,
            100.0 * b
        )
    })
}
