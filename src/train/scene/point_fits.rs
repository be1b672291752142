//! Seeds and sums of points on the processor and on a device beside it (`scene.md`, On a device).
//!
//! A device answers with the seed of every point, and with sums in whole quanta of the components that
//! points come to. Neither changes anything: a frame at which it fails is fitted by the processor, and the
//! device is given up. So is one whose arithmetic differs: the first frame is fitted by both and compared.

use super::accumulate::{Matched, accumulate};
use super::assign::{assign, assign_known};
use super::component_sums::ComponentSums;
use super::components::Components;
use super::config::VisibilityRule;
use super::grid::SeedGrid;
use super::point_parts::PARTS;
use super::point_slots::PointSlots;
use super::seed_positions::SeedPositions;
use super::spacing::Spacing;
use super::sum_scalar::SumScalar;
use crate::model::device_error::DeviceError;
use crate::model::scene::kept::Taught;
use crate::model::scene::points_device::{OPEN, PointsDevice, SlotSums};
use crate::model::scene::sums::N_SUMS;
use crate::observation::surface::SurfacePoint;
use crate::train::device_trial::{DIFFERING, DevicePolicy, DeviceTrial, Turn};
use crate::train::pass_use::PassUse;
use crate::train::timing::Stopwatch;
use rayon::prelude::*;

/// Structural scales whose squares, and those of places within their reach, are numbers of full precision.
const SCALES: std::ops::RangeInclusive<f64> = 1e-12..=1e12;

/// Fits points on whoever's turn it is.
#[derive(Default)]
pub struct PointFits {
    device: Option<PointFitter>,
    used: PassUse,
    /// Points that were searched for, or summed, by the device, and those of them that it left open.
    points: u64,
    open_points: u64,
    slots: PointSlots,
}

/// A device and what is known of it.
struct PointFitter {
    device: Box<dyn PointsDevice>,
    trial: DeviceTrial,
    /// Whether its arithmetic was found to be the processor's.
    is_proved: bool,
    /// Whether it has seeds of the grid; not if that was made anew.
    has_seeds: bool,
    /// Whether it has the points of the frame.
    has_points: bool,
    /// Whose turn the frame is.
    turn: Turn,
    /// Milliseconds of the frame on the processor and on the device, while both are tried.
    ms: [f64; 2],
    owners: Vec<u32>,
}

impl PointFits {
    /// Fits points on a device too from now on.
    pub fn add_device(&mut self, device: Box<dyn PointsDevice>, policy: DevicePolicy) {
        self.used = PassUse { device: Some(device.name()), ..PassUse::default() };
        (self.points, self.open_points) = (0, 0);
        self.device = Some(PointFitter {
            device,
            trial: DeviceTrial::new(policy),
            is_proved: false,
            has_seeds: false,
            has_points: false,
            turn: Turn::Processor,
            ms: [0.0; 2],
            owners: Vec::new(),
        });
    }

    /// What points were fitted on so far.
    pub fn used(&self) -> PassUse {
        let open_share = self.open_points as f64 / self.points.max(1) as f64;
        PassUse { open_share, ..self.used.clone() }
    }

    /// Begins a frame of so many points that are fitted at the structural scale `h`.
    pub fn begin_frame(&mut self, n_points: usize, h: f64) {
        let Some(fitter) = &mut self.device else { return };
        fitter.has_points = false;
        fitter.ms = [0.0; 2];
        fitter.turn = match fitter.trial.turn(n_points) {
            _ if !SCALES.contains(&h) => Turn::Processor,
            Turn::Device if !fitter.is_proved => Turn::Both,
            turn => turn,
        };
    }

    /// Says that the frame to come is only looked at, which is the processor's.
    pub fn begin_look(&mut self) {
        if let Some(fitter) = &mut self.device {
            fitter.turn = Turn::Processor;
        }
    }

    /// Says that the grid was made anew.
    pub fn forget_seeds(&mut self) {
        if let Some(fitter) = &mut self.device {
            fitter.has_seeds = false;
        }
    }

    /// Finds the component of every point, as [`assign`] does.
    pub fn assign(
        &mut self,
        grid: &SeedGrid,
        components: &Components,
        spacing: Spacing,
        points: &[SurfacePoint],
        owners: &mut Vec<u32>,
    ) {
        let mut clock = Stopwatch::start();
        let is_found = self.assign_on_device(grid, components, spacing, points);
        let device_ms = clock.lap_ms();
        if let Some(fitter) = self.device.as_mut().filter(|_| is_found) {
            fitter.ms[1] += device_ms;
            if fitter.turn == Turn::Device {
                return std::mem::swap(owners, &mut fitter.owners);
            }
        }
        assign(grid, components, spacing, points, owners);
        let Some(fitter) = self.device.as_mut().filter(|_| is_found) else { return };
        fitter.ms[0] += clock.lap_ms();
        if fitter.owners != *owners {
            self.give_up(DIFFERING.to_owned());
        }
    }

    /// Lets the device find the components, if it is its turn; whether it did.
    fn assign_on_device(
        &mut self,
        grid: &SeedGrid,
        components: &Components,
        spacing: Spacing,
        points: &[SurfacePoint],
    ) -> bool {
        let Some(fitter) = self.device.as_mut().filter(|fitter| fitter.turn != Turn::Processor)
        else {
            return false;
        };
        match fitter.find_seeds(grid, points) {
            Ok(n_open) => {
                assign_known(grid, components, spacing, points, &mut fitter.owners);
                self.points += points.len() as u64;
                self.open_points += n_open as u64;
                true
            }
            Err(error) => {
                self.give_up(error.reason);
                false
            }
        }
    }

    /// Adds the points to the sums of their components, as [`accumulate`] does where components are looked
    /// at by their projection, and gives what that gives.
    pub fn accumulate<W: SumScalar>(
        &mut self,
        component_sums: &mut ComponentSums<W>,
        seed_positions: SeedPositions<'_>,
        frame: Matched<'_>,
        h: f64,
        rule: VisibilityRule,
        touched: &mut Vec<u32>,
    ) -> Option<Taught> {
        let Self { device, slots, .. } = self;
        let mut clock = Stopwatch::start();
        let mut on_trial = None;
        if let Some(fitter) = device.as_mut().filter(|fitter| fitter.turn != Turn::Processor) {
            slots.fill::<W>(component_sums.len(), seed_positions, frame);
            let is_alone = fitter.turn == Turn::Device;
            match fitter.sums(slots, frame, h) {
                Ok(sums) if is_alone => {
                    component_sums.add_quanta(&slots.ids, sums, PARTS);
                    let mut taught = frame.is_noted.then(Taught::default);
                    touched.clear();
                    if !slots.left.is_empty() {
                        let frame = Matched { owners: &slots.left, ..frame };
                        taught =
                            accumulate(component_sums, seed_positions, frame, h, rule, touched);
                    }
                    taught.iter_mut().for_each(|taught| taught.append(&slots.ids, sums));
                    touched.extend_from_slice(&slots.ids);
                    touched.sort_unstable();
                    self.count(frame.points.len());
                    return taught.map(Taught::in_order);
                }
                Ok(sums) => on_trial = Some(component_sums.rows_with(&slots.ids, sums)),
                Err(error) => self.give_up(error.reason),
            }
        }
        let device_ms = clock.lap_ms();
        self.used.processor_frames += 1;
        let taught = accumulate(component_sums, seed_positions, frame, h, rule, touched);
        if let Some(expected) = on_trial {
            let found = self.slots.ids.iter().map(|&id| component_sums.row(id as usize).sums);
            self.judge(found.eq(expected), [clock.lap_ms(), device_ms]);
        }
        taught
    }

    /// Counts a frame of so many points that was the device's.
    fn count(&mut self, n_points: usize) {
        self.points += n_points as u64;
        self.open_points += self.slots.n_left as u64;
        self.used.device_frames += 1;
    }

    /// Keeps or gives up a device that was tried, by milliseconds of the sums on processor and device.
    fn judge(&mut self, is_equal: bool, [processor, on_device]: [f64; 2]) {
        if !is_equal {
            return self.give_up(DIFFERING.to_owned());
        }
        let Some(fitter) = &mut self.device else { return };
        fitter.is_proved = true;
        let [of_processor, of_device] = fitter.ms;
        fitter.trial.measured(of_processor + processor, of_device + on_device);
        self.used.trial = fitter.trial.medians;
    }

    /// Goes on without the device, which is said once.
    fn give_up(&mut self, reason: String) {
        self.used.give_up(reason);
        self.device = None;
    }
}

impl PointFitter {
    /// Puts into `owners` the nearest seed of every point; of how many the processor has to look.
    fn find_seeds(
        &mut self,
        grid: &SeedGrid,
        points: &[SurfacePoint],
    ) -> Result<usize, DeviceError> {
        self.device.set_seeds(&grid.seeds(!self.has_seeds))?;
        self.has_seeds = true;
        if !self.has_points {
            self.device.set_points(bytemuck::cast_slice(points))?;
            self.has_points = true;
        }
        let found = self.device.nearest()?;
        self.owners.clear();
        self.owners.extend_from_slice(found);
        Ok(found.par_iter().filter(|seed| **seed == OPEN).count())
    }

    /// Sums of the points by slot, in whole quanta.
    fn sums(
        &mut self,
        slots: &PointSlots,
        frame: Matched<'_>,
        h: f64,
    ) -> Result<&[[i32; N_SUMS]], DeviceError> {
        self.device.sums(&SlotSums {
            points: &slots.points,
            seeds: &slots.seeds,
            // As the processor rounds it.
            per_h: (1.0 / h) as f32,
            gain: frame.gain,
            weight: frame.weight as f32,
        })
    }
}
