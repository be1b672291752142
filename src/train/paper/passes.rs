//! Runs passes on the CPU or on a device (`training.md`, On a device).
//!
//! A device returns scores and records in the CPU's format and lists the tiles it leaves to the CPU.
//! Results are merged, so later code does not depend on where a pass ran. A pass changes no shared
//! state: if it fails on the device, it is repeated on the CPU and the device is no longer used. The same
//! applies if its arithmetic differs: both fit the first frame and the results are compared.

use super::config::UpdateWidth;
use super::index::{Index, PaperScalar, narrow};
use super::pass::{Mixture, Output, Pass, PassInputs};
use crate::model::conjugate::statistics::{N_SUMS, RECORD_WORDS, TileRecord};
use crate::model::inspection::DeviceError;
use crate::model::paper::mixture_device::{
    DevicePass, MAX_DEVICE_CANDIDATES, MixtureDevice, PassRule, PointColumns,
};
use crate::model::paper::state::InitialModel;
use crate::observation::points::Points;
use crate::train::device_trial::{DIFFERING, DeviceChoice, DevicePolicy, DeviceTrial, PassUse};
use crate::train::estep::Scoring;
use crate::train::timing::{PaperStage, StageClock, Stopwatch};
use rayon::prelude::*;
use std::sync::PoisonError;

// A device decides a point if all other components lose by this many hard gaps. They would receive at
// most 10⁻³⁵ of the point, which changes no bit of any sum.
const OPEN_GAPS: f64 = 2.0;

#[derive(Clone, Copy)]
struct DeviceInputs<'a> {
    model: &'a InitialModel<f32>,
    points: &'a Points<f32>,
    candidates: usize,
}

/// Runs passes over frames on the CPU or on a device.
#[derive(Default)]
pub struct Passes {
    /// Buffers of passes on the CPU, which also collect the device's results.
    pub processor: Pass,
    device: Option<PassDevice>,
    used: PassUse,
    tiles: u64,
    open_tiles: u64,
}

struct PassDevice {
    device: Box<dyn MixtureDevice>,
    trial: DeviceTrial,
    is_chosen: bool,
    /// True if the device's last pass left tiles to the CPU; consecutive frames are similar.
    had_open_tiles: bool,
    revision: Option<u64>,
    has_points: bool,
}

impl Passes {
    /// Adds a device for passes. Ignored for models in f64, which no device supports.
    ///
    /// # Errors
    /// [`DeviceError`] if the means do not fit in the device's memory; it is then not used.
    pub fn add_device<R: PaperScalar>(
        &mut self,
        mut device: Box<dyn MixtureDevice>,
        policy: DevicePolicy,
        Mixture { model, index, .. }: &Mixture<R>,
    ) -> Result<(), DeviceError> {
        let Some(model) = narrow(model) else { return Ok(()) };
        // Uploaded before the device counts as added: without room for the means it is not used.
        device.set_means(&index.means_for_device(model, None))?;
        self.used = PassUse { device: Some(device.name()), ..PassUse::default() };
        // The share of open tiles is that of the new device.
        (self.tiles, self.open_tiles) = (0, 0);
        self.device = Some(PassDevice {
            device,
            trial: DeviceTrial::unverified(policy),
            is_chosen: false,
            had_open_tiles: false,
            revision: Some(index.revision()),
            has_points: false,
        });
        Ok(())
    }

    /// Returns the devices used for passes; `None` if the settings do not allow a device.
    pub fn usage<R: PaperScalar>(&self, inputs: &PassInputs<'_, R>) -> Option<PassUse> {
        let open_share = self.open_tiles as f64 / self.tiles.max(1) as f64;
        device_inputs(inputs, &Points::new()).map(|_| PassUse { open_share, ..self.used.clone() })
    }

    /// True if the next pass will probably run on the device. The device then sorts the means itself.
    pub fn is_next_on_device(&self) -> bool {
        self.device.as_ref().is_some_and(|device| device.is_chosen)
    }

    /// Begins a frame: marks the points on the device as outdated.
    pub fn begin_frame(&mut self) {
        if let Some(device) = &mut self.device {
            device.has_points = false;
        }
    }

    /// True if the results of the scoring pass can be reused for the fit. Then only tiles reached by
    /// moved means are run again. False if the next pass runs on a device, for which two full passes
    /// are faster.
    pub fn can_run_again<R: PaperScalar>(&self, inputs: &PassInputs<'_, R>) -> bool {
        !self.is_next_on_device() && inputs.fused_rank().is_some()
    }

    /// Runs some tiles of the last fit again: those within reach of `places`, the positions that means
    /// left or moved to.
    pub fn run_reached<R: PaperScalar>(
        &mut self,
        inputs: &PassInputs<'_, R>,
        points: &Points<R>,
        places: &[[f32; 3]],
        q: &mut [f64],
        owners: Option<&mut Vec<u32>>,
    ) {
        if let Some(inputs) = inputs.fused(points) {
            self.processor.run_reached(&inputs, places, q, owners);
        }
    }

    /// Runs a pass over all points; see [`Pass::run`].
    pub fn run<R: PaperScalar>(
        &mut self,
        inputs: &PassInputs<'_, R>,
        points: &Points<R>,
        output: Output,
        q: &mut Vec<f64>,
        owners: Option<&mut Vec<u32>>,
    ) {
        // Only the CPU computes owners; they are requested for display, where speed matters less.
        let asked = device_inputs(inputs, points).filter(|_| owners.is_none());
        let turn = match (&mut self.device, asked) {
            (Some(device), Some(_)) => device.turn(output, points.len()),
            _ => DeviceChoice::Processor,
        };
        let device_ms = asked
            .filter(|_| turn != DeviceChoice::Processor)
            .and_then(|asked| self.run_on_device(inputs, points, asked, output, q));
        let is_devices = turn == DeviceChoice::Device && device_ms.is_some();
        // A frame counts once, by its fit: scoring passes precede it.
        if output == Output::ElboAndSums {
            let PassUse { device_frames, processor_frames, .. } = &mut self.used;
            *(if is_devices { device_frames } else { processor_frames }) += 1;
        }
        if is_devices {
            return;
        }
        // During a trial, `q` and the records are still the device's.
        let found = device_ms.map(|ms| (ms, q.clone(), self.processor.effective_records()));
        let mut clock = Stopwatch::start();
        self.processor.run(inputs, points, output, q, owners);
        let processor_ms = clock.lap_ms();
        if let Some((device_ms, found_q, records)) = found {
            // NaN marks points left out, and differs from itself.
            let is_equal = |(a, b): (&f64, &f64)| a == b || a.is_nan() && b.is_nan();
            let is_proved = found_q.iter().zip(&*q).all(is_equal)
                && records == self.processor.effective_records();
            self.evaluate_trial(is_proved, [processor_ms, device_ms]);
        }
    }

    /// Runs a pass on the device; tiles that the device leaves out are run on the CPU. Returns the time
    /// in milliseconds, or `None` after a fallback to the CPU.
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
        let Mixture { index, scoring, statistics, .. } = inputs.mixture;
        processor.begin_device_pass(statistics);
        let mut clock = StageClock::default();
        clock.begin_tile(true);
        let is_fit = output == Output::ElboAndSums;
        let rule = rule(scoring, asked.candidates);
        let handed_over = device.upload_changes(&asked, index);
        let PassDevice { device, had_open_tiles: left_open, .. } = device;
        let answer = || handed_over.and_then(|()| device.pass(&rule, is_fit));
        let answer = match *left_open {
            false => answer(),
            // Open tiles need the CPU's index, which is built while the device works.
            true => rayon::join(answer, || inputs.mixture.sorted()).0,
        };
        match answer {
            Ok(found) => {
                processor.adopt_device_pass(statistics.shard_bits(), &found, q);
                // The device's stages are one step; nearly all of its time is the search.
                clock.lap(PaperStage::Candidates);
                *left_open = !found.open.is_empty();
                let fused = if *left_open { inputs.fused(points) } else { None };
                if let Some(fused) = fused {
                    let mut open = found.open.to_vec();
                    // `run_some` needs ascending tiles; a device lists them in any order.
                    open.sort_unstable();
                    processor.run_some(&fused, &open, output, q, &mut []);
                }
                processor.add_clock(clock);
                self.tiles += points.n_tiles() as u64;
                self.open_tiles += found.open.len() as u64;
                Some(watch.lap_ms())
            }
            Err(error) => {
                self.fall_back(error.reason);
                None
            }
        }
    }

    /// Evaluates a trial on CPU and device: records both times. Falls back to the CPU if the device's
    /// results differ (`is_proved` is false).
    fn evaluate_trial(&mut self, is_proved: bool, [processor, device_ms]: [f64; 2]) {
        let Some(device) = &mut self.device else { return };
        if !is_proved {
            return self.fall_back(DIFFERING.to_owned());
        }
        device.trial.record_times(processor, device_ms);
        self.used.trial = device.trial.medians;
    }

    fn fall_back(&mut self, reason: String) {
        self.used.record_fallback(reason);
        self.device = None;
    }
}

impl PassDevice {
    fn turn(&mut self, output: Output, n_points: usize) -> DeviceChoice {
        if output == Output::Elbo {
            // Scoring passes run where the last fit ran: only fits are measured.
            return if self.is_chosen { DeviceChoice::Device } else { DeviceChoice::Processor };
        }
        let turn = self.trial.choose(n_points);
        self.is_chosen = turn == DeviceChoice::Device;
        turn
    }

    fn upload_changes(
        &mut self,
        &DeviceInputs { model, points, .. }: &DeviceInputs<'_>,
        index: &Index,
    ) -> Result<(), DeviceError> {
        if self.revision != Some(index.revision()) {
            // Cleared first: after a failed upload, the means on the device are unknown.
            let known = self.revision.take();
            self.device.set_means(&index.means_for_device(model, known))?;
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

fn device_inputs<'a, R: PaperScalar>(
    inputs: &PassInputs<'a, R>,
    points: &'a Points<R>,
) -> Option<DeviceInputs<'a>> {
    // Devices drop shares too small for 64-bit totals; wider totals would retain them.
    let Mixture { config, model, .. } = inputs.mixture;
    let is_fixed = config.operations.update == UpdateWidth::Fixed64;
    let candidates = inputs.fused_rank().filter(|&n| is_fixed && n <= MAX_DEVICE_CANDIDATES)?;
    let (model, points) = (narrow(model)?, narrow(points)?);
    Some(DeviceInputs { model, points, candidates })
}

fn rule(scoring: &Scoring, candidates: usize) -> PassRule {
    // Computed with the CPU's exponential and logarithm.
    let of_equals = |n: usize| {
        let mut shares = [0.0; MAX_DEVICE_CANDIDATES];
        let q = scoring.responsibilities::<f32>(&mut shares[..n]);
        [shares[0] as f32, -q as f32]
    };
    PassRule {
        candidates,
        color_ratio: scoring.color_ratio as f32,
        certain_gap: (OPEN_GAPS * scoring.hard_gap()) as f32,
        equal_share: std::array::from_fn(|i| of_equals(i + 1)[0]),
        equal_gain: std::array::from_fn(|i| of_equals(i + 1)[1]),
    }
}

// Smaller counts are below a quantum of the totals, so their records are not compared.
const MIN_COUNT: f32 = 1e-11;

const WIDENED: usize = 1 << 13;

type RecordBits = (u32, u32, [u32; N_SUMS]);

impl Pass {
    /// Copies scores and records from the results of a device. Scores of tiles left to the CPU are
    /// computed later.
    pub fn adopt_device_pass(&self, shard_bits: u32, found: &DevicePass<'_>, q: &mut [f64]) {
        let scores = q.par_iter_mut().zip(found.q).with_min_len(WIDENED);
        // In parallel, because both are dominated by the time to wake threads.
        rayon::join(
            || scores.for_each(|(q, &found)| *q = found.into()),
            || self.adopt_records(shard_bits, found.records),
        );
    }

    fn adopt_records(&self, shard_bits: u32, records: &[[u32; RECORD_WORDS]]) {
        // Equal parts per worker, whichever thread runs them, so that warm buffers suffice.
        let each = records.len().div_ceil(self.workers.len()).max(1);
        self.workers.par_iter().zip(records.par_chunks(each)).for_each(|(worker, records)| {
            // A poisoned buffer is safe to use: every pass clears it first.
            let mut worker = worker.write().unwrap_or_else(PoisonError::into_inner);
            for words in records {
                let record = TileRecord::from_words(words);
                worker.narrow[record.id as usize >> shard_bits].push(record);
            }
        });
    }

    pub fn add_clock(&self, mut clock: StageClock) {
        self.worker().clock.add(clock.take_nanos());
    }

    /// Returns the records of the last pass that affect the totals, sorted for comparison.
    pub fn effective_records(&self) -> Vec<RecordBits> {
        let mut kept = Vec::new();
        for worker in self.read_workers() {
            let records = worker.narrow.iter().flatten().filter(|r| r.sums[0] >= MIN_COUNT);
            // Adding 0.0 unifies zeros of either sign.
            kept.extend(records.map(|r| (r.id, r.tile, r.sums.map(|sum| (sum + 0.0).to_bits()))));
        }
        // Workers receive tiles in any order.
        kept.sort_unstable();
        kept
    }
}
