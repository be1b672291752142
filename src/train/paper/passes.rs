//! Passes on the processor and on a device beside it (`train.md`, On a device).
//!
//! A device answers with scores and with records like the processor's own, and names the tiles that it
//! leaves to the processor; all of it goes where the processor's passes go, so nothing behind a pass
//! knows who ran it. A pass changes no shared state: one that fails on the device is run anew on the
//! processor, and the device is given up. So is one whose arithmetic differs: the first frame is fitted
//! by both and compared.

use super::config::UpdateWidth;
use super::index::Index;
use super::pass::{Output, Pass, PassInputs, fused_inputs, fused_rank};
use super::scalar::PaperScalar;
use crate::model::device_error::DeviceError;
use crate::model::paper::mixture::InitialModel;
use crate::model::paper::mixture_device::{
    MAX_DEVICE_CANDIDATES, MixtureDevice, PassRule, PointColumns,
};
use crate::observation::points::Points;
use crate::train::device_trial::{DIFFERING, DevicePolicy, DeviceTrial, Turn};
use crate::train::estep::Scoring;
use crate::train::pass_use::PassUse;
use crate::train::timing::{Lap, StageClock, Stopwatch};

/// By how many gaps of the hard assignment a component must lose for the device to decide: what it would
/// receive then, 10⁻³⁵ of a point, alters no bit of any sum.
const OPEN_GAPS: f64 = 2.0;

/// What a device reads.
#[derive(Clone, Copy)]
struct DeviceInputs<'a> {
    model: &'a InitialModel<f32>,
    points: &'a Points<f32>,
    candidates: usize,
}

/// Runs passes on whoever's turn it is.
#[derive(Default)]
pub struct Passes {
    /// The processor's pass, where every answer ends.
    pub processor: Pass,
    device: Option<PassDevice>,
    used: PassUse,
    tiles: u64,
    open_tiles: u64,
}

/// A device and what is known of it.
struct PassDevice {
    device: Box<dyn MixtureDevice>,
    trial: DeviceTrial,
    /// Whether its arithmetic was found to be the processor's.
    is_proved: bool,
    /// Whether the last fit was its own.
    is_chosen: bool,
    /// Whether its last pass left tiles to the processor: a frame is much like the next one.
    left_open: bool,
    /// State of the index whose means it has.
    revision: Option<u64>,
    /// Whether it has the points of the frame.
    has_points: bool,
}

impl Passes {
    /// Runs passes on a device too from now on, over the means of a model; not if that is kept in f64,
    /// which no device computes in.
    ///
    /// # Errors
    /// [`DeviceError`] if it has no room for the means; then it is not used.
    pub fn add_device<R: PaperScalar>(
        &mut self,
        mut device: Box<dyn MixtureDevice>,
        policy: DevicePolicy,
        index: &Index,
        model: &InitialModel<R>,
    ) -> Result<(), DeviceError> {
        let Some(model) = R::narrow_model(model) else { return Ok(()) };
        device.set_means(&index.cells(model, None))?;
        self.used = PassUse { device: Some(device.name()), ..PassUse::default() };
        (self.tiles, self.open_tiles) = (0, 0);
        self.device = Some(PassDevice {
            device,
            trial: DeviceTrial::new(policy),
            is_proved: false,
            is_chosen: false,
            left_open: false,
            revision: Some(index.revision()),
            has_points: false,
        });
        Ok(())
    }

    /// What passes ran on so far; `None` if none that ask for so much can run on a device.
    pub fn used<R: PaperScalar>(&self, inputs: &PassInputs<'_, R>) -> Option<PassUse> {
        let open_share = self.open_tiles as f64 / self.tiles.max(1) as f64;
        device_inputs(inputs, &Points::new()).map(|_| PassUse { open_share, ..self.used.clone() })
    }

    /// Whether the next pass is likely to be the device's, which sorts means by itself.
    pub fn is_devices(&self) -> bool {
        self.device.as_ref().is_some_and(|device| device.is_proved && device.is_chosen)
    }

    /// Says that the passes to come are over other points than those before.
    pub fn begin_frame(&mut self) {
        if let Some(device) = &mut self.device {
            device.has_points = false;
        }
    }

    /// Whether a fit can be made ahead of moves, and only what these reach be run again: not where a
    /// device does both passes sooner, and not where totals keep shares that are too small for fixed
    /// point.
    pub fn can_run_again<R: PaperScalar>(&self, inputs: &PassInputs<'_, R>) -> bool {
        let keeps_all = inputs.config.operations.update == UpdateWidth::F32;
        !self.is_devices() && !keeps_all && fused_rank(inputs).is_some()
    }

    /// Runs those tiles of the last fit again that are within reach of places that means have left or
    /// come to.
    pub fn run_reached<R: PaperScalar>(
        &mut self,
        inputs: &PassInputs<'_, R>,
        points: &Points<R>,
        places: &[[f32; 3]],
        q: &mut [f64],
        owners: Option<&mut Vec<u32>>,
    ) {
        if let Some(inputs) = fused_inputs(inputs, points) {
            self.processor.run_reached(&inputs, places, q, owners);
        }
    }

    /// Runs a pass over all points, as [`Pass::run`] does.
    pub fn run<R: PaperScalar>(
        &mut self,
        inputs: &PassInputs<'_, R>,
        points: &Points<R>,
        output: Output,
        q: &mut Vec<f64>,
        owners: Option<&mut Vec<u32>>,
    ) {
        // Owners are the processor's: whoever asks for them looks on, and is in no hurry.
        let asked = device_inputs(inputs, points).filter(|_| owners.is_none());
        let turn = match (&mut self.device, asked) {
            (Some(device), Some(_)) => device.turn(output, points.len()),
            _ => Turn::Processor,
        };
        let device_ms = asked
            .filter(|_| turn != Turn::Processor)
            .and_then(|asked| self.run_on_device(inputs, points, asked, output, q));
        let is_devices = turn == Turn::Device && device_ms.is_some();
        if output == Output::ElboAndSums {
            let PassUse { device_frames, processor_frames, .. } = &mut self.used;
            *(if is_devices { device_frames } else { processor_frames }) += 1;
        }
        if is_devices {
            return;
        }
        // On trial: what was found so far is the device's.
        let found = device_ms.map(|ms| (ms, q.clone(), self.processor.kept_records()));
        let mut clock = Stopwatch::start();
        self.processor.run(inputs, points, output, q, owners);
        let processor_ms = clock.lap_ms();
        if let Some((device_ms, found_q, records)) = found {
            let is_equal = |(a, b): (&f64, &f64)| a == b || a.is_nan() && b.is_nan();
            let is_proved =
                found_q.iter().zip(&*q).all(is_equal) && records == self.processor.kept_records();
            self.judge(is_proved, [processor_ms, device_ms]);
        }
    }

    /// Lets the device run a pass, and the processor the tiles that it leaves open; its milliseconds, or
    /// `None` if it failed and is given up.
    fn run_on_device<R: PaperScalar>(
        &mut self,
        inputs: &PassInputs<'_, R>,
        points: &Points<R>,
        asked: DeviceInputs<'_>,
        output: Output,
        q: &mut Vec<f64>,
    ) -> Option<f64> {
        let mut watch = Stopwatch::start();
        let Self { processor, device, .. } = self;
        let device = device.as_mut()?;
        q.resize(points.len(), 0.0);
        processor.begin_answer(inputs.statistics);
        let mut clock = StageClock::default();
        clock.begin_tile(true);
        let is_fit = output == Output::ElboAndSums;
        let rule = rule(inputs.scoring, asked.candidates);
        let handed_over = device.hand_over(&asked, inputs.index);
        let PassDevice { device, left_open, .. } = device;
        let answer = || handed_over.and_then(|()| device.pass(&rule, is_fit));
        let answer = match *left_open {
            false => answer(),
            // The processor's index is wanted too, for tiles left open: made while the device works.
            true => rayon::join(answer, || inputs.index.sorted(inputs.model)).0,
        };
        match answer {
            Ok(found) => {
                processor.take_over(inputs.statistics.shard_bits(), &found, q);
                // Its three stages are one step, whose time is the search's by far.
                clock.lap(Lap::Candidates);
                *left_open = !found.open.is_empty();
                let fused = if *left_open { fused_inputs(inputs, points) } else { None };
                if let Some(fused) = fused {
                    let mut open = found.open.to_vec();
                    open.sort_unstable();
                    processor.run_some(&fused, &open, output, q, &mut []);
                }
                processor.book(clock);
                self.tiles += points.n_tiles() as u64;
                self.open_tiles += found.open.len() as u64;
                Some(watch.lap_ms())
            }
            Err(error) => {
                self.give_up(error.reason);
                None
            }
        }
    }

    /// Keeps or gives up a device that was tried, by milliseconds of processor and device.
    fn judge(&mut self, is_proved: bool, [processor, device_ms]: [f64; 2]) {
        let Some(device) = &mut self.device else { return };
        if !is_proved {
            return self.give_up(DIFFERING.to_owned());
        }
        device.is_proved = true;
        device.trial.measured(processor, device_ms);
        self.used.trial = device.trial.medians;
    }

    /// Goes on without the device, which is said once.
    fn give_up(&mut self, reason: String) {
        self.used.give_up(reason);
        self.device = None;
    }
}

impl PassDevice {
    /// Who runs a pass over so many points.
    fn turn(&mut self, output: Output, n_points: usize) -> Turn {
        if output == Output::Elbo {
            // Before the fit whoever fitted last: trials are of fits.
            return if self.is_chosen { Turn::Device } else { Turn::Processor };
        }
        let turn = match self.trial.turn(n_points) {
            Turn::Device if !self.is_proved => Turn::Both,
            turn => turn,
        };
        self.is_chosen = turn == Turn::Device;
        turn
    }

    /// Hands over what has changed since the last pass.
    fn hand_over(
        &mut self,
        &DeviceInputs { model, points, .. }: &DeviceInputs<'_>,
        index: &Index,
    ) -> Result<(), DeviceError> {
        if self.revision != Some(index.revision()) {
            let known = self.revision.take();
            self.device.set_means(&index.cells(model, known))?;
            self.revision = Some(index.revision());
        }
        if !self.has_points {
            let columns =
                [&points.x, &points.y, &points.z, &points.r, &points.g, &points.b].map(|c| &c[..]);
            self.device.set_points(&PointColumns { columns, tiles: &points.tiles })?;
            self.has_points = true;
        }
        Ok(())
    }
}

/// What a device reads, if it can do what is asked for.
fn device_inputs<'a, R: PaperScalar>(
    inputs: &PassInputs<'a, R>,
    points: &'a Points<R>,
) -> Option<DeviceInputs<'a>> {
    // A share that is too small for fixed point is none; other totals would keep it.
    let is_fixed = inputs.config.operations.update == UpdateWidth::Fixed64;
    let candidates = fused_rank(inputs).filter(|&n| is_fixed && n <= MAX_DEVICE_CANDIDATES)?;
    let (model, points) = (R::narrow_model(inputs.model)?, R::narrow_points(points)?);
    Some(DeviceInputs { model, points, candidates })
}

fn rule(scoring: &Scoring, candidates: usize) -> PassRule {
    // By the processor's own exponential and logarithm.
    let of_equals = |n: usize| {
        let mut shares = [0.0; MAX_DEVICE_CANDIDATES];
        let q = scoring.responsibilities::<f32>(&mut shares[..n]);
        [shares[0] as f32, -q as f32]
    };
    PassRule {
        candidates,
        color_ratio: scoring.color_ratio as f32,
        open_gap: (OPEN_GAPS * scoring.hard_gap()) as f32,
        equal_share: std::array::from_fn(|i| of_equals(i + 1)[0]),
        equal_gain: std::array::from_fn(|i| of_equals(i + 1)[1]),
    }
}
