//! What is taken of that which is found.
//!
//! A minimum always exists, so finding one proves nothing. Frames are in two halves that see the same
//! places; each half's best must explain the *other* half better than the start does, else it explains
//! that half's own errors. That holds for the colour camera as a whole, for depth as a whole, and for every
//! value against keeping the start's with the others fitted again. Values make up for one another: alone none
//! may be certain where all together are, and one that goes back to the start takes the others along. So depth
//! and camera are taken whole or not at all, but for values that the others do not lean on.

use super::color::{distance, shifts};
use super::covariance::Covariance;
use super::evidence::{Evidence, Kind};
use super::input::CalibrationInput;
use super::search::{Views, refine};
use super::unknowns::{CAMERA, DEPTH, Estimate, N, NAMES, SensorPrior, Unknowns};
use super::value::CalibratedValue;
use crate::dataset::error::FrameError;

/// Fall of the variance of colour, relative, that another camera must bring in frames it was not fitted to.
/// On the 7-Scenes Kinect, whose camera is known, wrong poses and depths bring 3 %, and views held out
/// are worse for it; on Lego, whose colours are registered, 1.4 %.
const MIN_FALL: f64 = 0.05;
/// Mean shift, pixels, that another camera must bring; on Lego they bring 0.4.
const MIN_SHIFT: f64 = 1.0;
/// Rise of the other half's squares, relative, that keeping a value must cost. Errors of poses shift the
/// minimum: on the 7-Scenes Kinect to a roll that spares 0.8 % and makes held-out views worse.
const MIN_RISE: f64 = 0.02;
/// Standard errors by which a value must differ from the one before. Poses are often fitted to the same
/// depth and share its errors, which views do not tell of.
const SIGNIFICANT: f64 = 4.0;
/// Shift, pixels, up to which a value counts as confirmed rather than changed.
const SAME: f64 = 1.0;
/// Standard errors that another value may move by where one goes back to the start.
const LEANING: f64 = 1.0;

/// A half of the frames with its own best.
struct Half<'a> {
    evidence: Evidence<'a>,
    best: Estimate,
}

/// What both halves say of each other.
pub(super) struct Judge<'a> {
    prior: &'a SensorPrior,
    start: Unknowns,
    halves: [Half<'a>; 2],
}

/// Whether another colour camera is taken.
pub(super) struct CameraVerdict {
    pub is_other: bool,
    /// Shift and fall, as people read them.
    pub found: String,
}

impl<'a> Judge<'a> {
    /// Fits each half by itself, from what all frames say.
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

    /// Counts all views less where the halves are farther apart than their equations say: views that follow
    /// each other share errors of their poses.
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

    /// Whether the camera of either half explains the other half.
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
        // In pixels, because values that make up for one another may differ much and show little.
        let shift = distance(&self.halves[0].evidence.matches, &self.start, best);
        let found = format!(
            "the best other camera shifts colours by {shift:.1} pixels and lowers their variance by {:.1} % in frames that it was not fitted to, which errors of poses and depth do too",
            100.0 * fall.max(0.0)
        );
        CameraVerdict { is_other: fall >= MIN_FALL && shift >= MIN_SHIFT, found }
    }

    /// By how much each half's squares rise, relatively, if the other half's best has to keep the start's
    /// values of some of the `free` unknowns.
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

    /// Gives the start's values back to some of the `free` unknowns, in both halves too; those that are left.
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

    /// Takes of the `free` unknowns what the data determines, depth first. What there is to say of every value.
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

    /// Why depth stays, if so.
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

    /// Why a value is not certain by itself, if so.
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

    /// An unknown as people know it.
    pub fn value(&self, i: usize, best: &Unknowns, error: f64) -> CalibratedValue {
        let error = error * best.natural_slope(i);
        CalibratedValue::determined(NAMES[i], self.start.natural(i), best.natural(i), error)
    }

    /// What there is to say of a colour camera that stays as it was.
    pub fn staying_camera(&self, evidence: &Evidence, best: &Estimate) -> Vec<CalibratedValue> {
        let all: Vec<usize> = (0..N).collect();
        let covariance = evidence.covariance(self.prior, best, &all);
        let best = &best.unknowns;
        let shifts = shifts(&evidence.matches, best);
        let value = |i: usize| {
            let apart = (best.get(i) - self.start.get(i)).abs() * shifts[i];
            let error = covariance.error(i);
            let mut value = self.value(i, best, error);
            value.keep(format!("the best shifts by {apart:.1} pixels, which the others undo"));
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

/// Why a value is not taken that the other halves do not miss.
fn hardly_needed([a, b]: [f64; 2], of: &str) -> Option<String> {
    (a.min(b) < 0.5 * MIN_RISE || a + b < 2.0 * MIN_RISE).then(|| {
        format!(
            "frames that it was not fitted to hardly need it: without it their {of} changes by {:+.1} % and {:+.1} %",
            100.0 * a,
            100.0 * b
        )
    })
}
