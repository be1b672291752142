//! What is taken of that which is found.
//!
//! A minimum always exists, so finding one proves nothing. Frames are in two halves that see the same
//! places; each half's best must explain the *other* half better than the start does, else it explains
//! that half's own errors. That holds for the colour camera as a whole, and then for every value against
//! keeping the start's with the others fitted again. A value must besides lie [`SIGNIFICANT`] standard errors from
//! the start.

use super::color::{distance, shifts};
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
/// More components born, relative, at which surfaces have come apart instead of together.
const MORE_BIRTHS: f64 = 0.002;

/// A half of the frames with its own best.
struct Half<'a> {
    evidence: Evidence<'a>,
    best: Estimate,
}

/// What both halves say of each other.
pub(super) struct Judge<'a> {
    input: &'a CalibrationInput,
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
        Ok(Self { input, prior, start, halves: [half(first)?, half(second)?] })
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
    /// value of one of the `free` unknowns.
    fn rises(&mut self, i: usize, free: &[usize]) -> [f64; 2] {
        let kind = if DEPTH.contains(&i) { Kind::Thickness } else { Kind::Color };
        let rest: Vec<usize> = free.iter().copied().filter(|&other| other != i).collect();
        let held = (i, self.start.get(i));
        let prior = self.prior;
        [(0, 1), (1, 0)].map(|(own, other)| {
            let Half { evidence, best } = &mut self.halves[own];
            let mut kept = evidence.fit_without(prior, best, free, held);
            refine(evidence, prior, &mut kept, &rest);
            let best = best.unknowns;
            let other = &mut self.halves[other].evidence;
            let without = other.loss(prior, &kept.unknowns, kind);
            without / other.loss(prior, &best, kind) - 1.0
        })
    }

    /// Gives the start's value back to one that is not taken, in both halves.
    fn give_back(&mut self, i: usize, free: &[usize]) {
        let held = (i, self.start.get(i));
        let rest: Vec<usize> = free.iter().copied().filter(|&other| other != i).collect();
        for Half { evidence, best } in &mut self.halves {
            *best = evidence.fit_without(self.prior, best, free, held);
            refine(evidence, self.prior, best, &rest);
        }
    }

    /// Gives back the start's value to what the data does not determine, one at a time and the least certain
    /// first: the others take over what it explained. What there is to say of every value.
    pub fn settle(
        &mut self,
        evidence: &mut Evidence,
        best: &mut Estimate,
        free: &mut Vec<usize>,
    ) -> Result<Vec<CalibratedValue>, FrameError> {
        let shifts = shifts(&evidence.matches, &best.unknowns);
        let mut values: Vec<Option<CalibratedValue>> = vec![None; N];
        loop {
            let errors = evidence.errors(self.prior, best, free);
            for (&i, error) in free.iter().zip(&errors) {
                values[i] = Some(self.value(i, &best.unknowns, *error));
            }
            let parted = self.parted(&best.unknowns, free)?;
            let mut certain: Vec<(f64, usize)> = free
                .iter()
                .zip(&errors)
                .map(|(&i, error)| ((best.unknowns.get(i) - self.start.get(i)).abs() / error, i))
                .collect();
            certain.sort_by(|a, b| a.0.total_cmp(&b.0));
            let doubted = certain.into_iter().find_map(|(certainty, i)| {
                let doubt = match &parted {
                    Some(parted) if DEPTH.contains(&i) => Some(parted.clone()),
                    _ => self.doubt(i, certainty, free),
                };
                doubt.map(|doubt| (i, doubt))
            });
            let Some((weak, doubt)) = doubted else { break };
            let pixels = shifts[weak]
                * (best.unknowns.get(weak) - self.start.get(weak))
                    .abs()
                    .max(error_of(&errors, free, weak));
            if let Some(value) = &mut values[weak] {
                value.keep(doubt);
                if weak >= CAMERA && pixels <= SAME {
                    value.confirm("the best is the same to a pixel".to_owned());
                }
            }
            *best = evidence.fit_without(self.prior, best, free, (weak, self.start.get(weak)));
            self.give_back(weak, free);
            free.retain(|&i| i != weak);
            refine(evidence, self.prior, best, free);
        }
        Ok(values.into_iter().flatten().collect())
    }

    /// Why a value is not taken, if so.
    fn doubt(&mut self, i: usize, certainty: f64, free: &[usize]) -> Option<String> {
        if certainty < SIGNIFICANT {
            return Some(format!("the best is only {certainty:.1} standard errors away"));
        }
        let [a, b] = self.rises(i, free);
        let of = if DEPTH.contains(&i) { "thickness" } else { "colour variance" };
        (a.min(b) < 0.5 * MIN_RISE || a + b < 2.0 * MIN_RISE).then(|| {
            format!(
                "frames that it was not fitted to hardly need it: without it their {of} changes by {:+.1} % and {:+.1} %",
                100.0 * a,
                100.0 * b
            )
        })
    }

    /// Why no depth is taken, where surfaces come apart by it.
    fn parted(&self, best: &Unknowns, free: &[usize]) -> Result<Option<String>, FrameError> {
        if !free.iter().any(|i| DEPTH.contains(i)) {
            return Ok(None);
        }
        // Of the area: what lies farther away is larger and bears more.
        let births = |depth: [f64; 2]| -> Result<f64, FrameError> {
            let camera = self.input.calibration.color_camera;
            let matches = self.input.matched(&self.input.frames, depth, camera, 1.0)?;
            let squares: f64 =
                matches.samples().iter().map(|s| f64::from(s.point.range).powi(2)).sum();
            Ok(matches.births as f64 * matches.samples().len() as f64 / squares)
        };
        let rise = births(best.depth)? / births(self.start.depth)? - 1.0;
        Ok((rise > MORE_BIRTHS)
            .then(|| format!("surfaces come apart by it: {:.1} % more components", 100.0 * rise)))
    }

    /// An unknown as people know it.
    pub fn value(&self, i: usize, best: &Unknowns, error: f64) -> CalibratedValue {
        let error = error * best.natural_slope(i);
        CalibratedValue::determined(NAMES[i], self.start.natural(i), best.natural(i), error)
    }

    /// What there is to say of a colour camera that stays as it was.
    pub fn staying_camera(&self, evidence: &Evidence, best: &Estimate) -> Vec<CalibratedValue> {
        let all: Vec<usize> = (0..N).collect();
        let errors = evidence.errors(self.prior, best, &all);
        let best = &best.unknowns;
        let shifts = shifts(&evidence.matches, best);
        let value = |i: usize| {
            let apart = (best.get(i) - self.start.get(i)).abs() * shifts[i];
            let mut value = self.value(i, best, errors[i]);
            value.keep(format!("the best shifts by {apart:.1} pixels, which the others undo"));
            if apart.max(errors[i] * shifts[i]) <= SAME {
                value.confirm("the best is the same to a pixel".to_owned());
            }
            value
        };
        (CAMERA..N).map(value).collect()
    }
}

fn error_of(errors: &[f64], free: &[usize], i: usize) -> f64 {
    free.iter().position(|&other| other == i).map_or(f64::INFINITY, |place| errors[place])
}
