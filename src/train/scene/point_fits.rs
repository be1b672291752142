//! Finds the seeds of points and sums the points, on the CPU or on a device (`scene.md`, On a device).
//!
//! A device returns the seed of every point, and sums in whole quanta of the components with points. If
//! the device fails on a frame, the CPU computes that frame and the device is not used again. The same
//! applies if its arithmetic differs: both compute the first frame and the results are compared.

use super::accumulate::{AssignedPoints, PARTS, accumulate};
use super::assign::{assign, assign_known};
use super::component_sums::{ComponentSums, FULL};
use super::components::Seeds;
use super::grid::{NONE, SeedGrid};
use super::seed_groups::Reach;
use crate::model::inspection::DeviceError;
use crate::model::scene::points_device::{LEFT_TO_PROCESSOR, PointsDevice, SlotSums};
use crate::model::scene::sums::N_SUMS;
use crate::observation::surface::SurfacePoint;
use crate::train::device_trial::{DIFFERING, DeviceChoice, DevicePolicy, DeviceTrial, PassUse};
use crate::train::timing::Stopwatch;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Structural scales, world units, at which squared distances between points and seeds are normal f32
/// numbers.
const SCALES: std::ops::RangeInclusive<f64> = 1e-12..=1e12;

#[derive(Default)]
pub struct PointFits {
    device: Option<PointFitter>,
    used: PassUse,
    /// Number of points passed to the device for search or summation. Of these, `open_points` were left
    /// to the CPU.
    points: u64,
    open_points: u64,
    slots: PointSlots,
}

struct PointFitter {
    device: Box<dyn PointsDevice>,
    trial: DeviceTrial,
    /// True if the device has the seeds of the current grid.
    has_seeds: bool,
    /// True if the device has the points of the current frame.
    has_points: bool,
    turn: DeviceChoice,
    /// Times of the current frame on CPU and device, milliseconds, during a trial.
    ms: [f64; 2],
    owners: Vec<u32>,
}

impl PointFits {
    pub fn add_device(&mut self, device: Box<dyn PointsDevice>, policy: DevicePolicy) {
        self.used = PassUse { device: Some(device.name()), ..PassUse::default() };
        (self.points, self.open_points) = (0, 0);
        self.device = Some(PointFitter {
            device,
            trial: DeviceTrial::unverified(policy),
            has_seeds: false,
            has_points: false,
            turn: DeviceChoice::Processor,
            ms: [0.0; 2],
            owners: Vec::new(),
        });
    }

    pub fn used(&self) -> PassUse {
        let open_share = self.open_points as f64 / self.points.max(1) as f64;
        PassUse { open_share, ..self.used.clone() }
    }

    /// Begins a frame of `n_points` points and chooses its device. `h` is the structural scale, world
    /// units.
    pub fn begin_frame(&mut self, n_points: usize, h: f64) {
        let Some(fitter) = &mut self.device else { return };
        fitter.has_points = false;
        fitter.ms = [0.0; 2];
        fitter.turn = match SCALES.contains(&h) {
            true => fitter.trial.choose(n_points),
            // GPUs may flush subnormal numbers to zero, which changes the nearest seed.
            false => DeviceChoice::Processor,
        };
    }

    /// Begins a frame whose points are assigned but not summed. The points are assigned on the CPU.
    pub fn begin_untimed_frame(&mut self) {
        if let Some(fitter) = &mut self.device {
            fitter.turn = DeviceChoice::Processor;
        }
    }

    /// Marks the device's copy of the seeds as outdated, so that all seeds are uploaded again. Called
    /// after the seed grid has been rebuilt.
    pub fn forget_seeds(&mut self) {
        if let Some(fitter) = &mut self.device {
            fitter.has_seeds = false;
        }
    }

    /// Finds the component of every point on the chosen device, with the same result as [`assign`].
    pub fn assign(
        &mut self,
        seeds: &Seeds,
        reach: Reach,
        points: &[SurfacePoint],
        owners: &mut Vec<u32>,
    ) {
        let mut clock = Stopwatch::start();
        let is_found = self.assign_on_device(seeds, reach, points);
        let device_ms = clock.lap_ms();
        if let Some(fitter) = self.device.as_mut().filter(|_| is_found) {
            fitter.ms[1] += device_ms;
            // Otherwise the CPU repeats the search, for comparison.
            if fitter.turn == DeviceChoice::Device {
                // Swapped instead of copied: both buffers keep their memory.
                return std::mem::swap(owners, &mut fitter.owners);
            }
        }
        assign(seeds, reach, points, owners);
        let Some(fitter) = self.device.as_mut().filter(|_| is_found) else { return };
        fitter.ms[0] += clock.lap_ms();
        if fitter.owners != *owners {
            self.drop_device(DIFFERING.to_owned());
        }
    }

    /// Assigns the points on the device, if one was chosen for this frame. Returns true on success.
    fn assign_on_device(&mut self, seeds: &Seeds, reach: Reach, points: &[SurfacePoint]) -> bool {
        let Some(fitter) =
            self.device.as_mut().filter(|fitter| fitter.turn != DeviceChoice::Processor)
        else {
            return false;
        };
        match fitter.find_seeds(&seeds.grid, points) {
            Ok(n_open) => {
                assign_known(seeds, reach, points, &mut fitter.owners);
                self.points += points.len() as u64;
                self.open_points += n_open as u64;
                true
            }
            Err(error) => {
                self.drop_device(error.reason);
                false
            }
        }
    }

    /// Adds the points to the sums of their components, with the same result as [`accumulate`].
    pub fn accumulate(
        &mut self,
        component_sums: &mut ComponentSums,
        frame: AssignedPoints<'_>,
        touched: &mut Vec<u32>,
    ) {
        let Self { device, slots, .. } = self;
        let mut clock = Stopwatch::start();
        // Expected rows, taken before the CPU adds to them.
        let mut on_trial = None;
        if let Some(fitter) =
            device.as_mut().filter(|fitter| fitter.turn != DeviceChoice::Processor)
        {
            slots.fill(component_sums.len(), frame);
            let is_alone = fitter.turn == DeviceChoice::Device;
            match fitter.sums(slots, frame) {
                Ok(sums) if is_alone => {
                    component_sums.add_quanta(&slots.ids, sums, PARTS);
                    touched.clear();
                    if !slots.left.is_empty() {
                        let frame = AssignedPoints { owners: &slots.left, ..frame };
                        accumulate(component_sums, frame, touched);
                    }
                    touched.extend_from_slice(&slots.ids);
                    // Components of both lists, ascending, as the CPU lists them.
                    touched.sort_unstable();
                    self.count_device_frame(frame.points.len());
                    return;
                }
                Ok(sums) => on_trial = Some(component_sums.rows_with(&slots.ids, sums)),
                Err(error) => self.drop_device(error.reason),
            }
        }
        let device_ms = clock.lap_ms();
        self.used.processor_frames += 1;
        accumulate(component_sums, frame, touched);
        if let Some(expected) = on_trial {
            let found = self.slots.ids.iter().map(|&id| component_sums.row(id as usize).sums);
            self.conclude_trial(found.eq(expected), [clock.lap_ms(), device_ms]);
        }
    }

    fn count_device_frame(&mut self, n_points: usize) {
        self.points += n_points as u64;
        self.open_points += self.slots.n_left as u64;
        self.used.device_frames += 1;
    }

    /// Keeps the device after a trial if its sums equal those of the CPU, else drops the device.
    /// `processor` and `on_device` are the times of summation on each, milliseconds.
    fn conclude_trial(&mut self, is_equal: bool, [processor, on_device]: [f64; 2]) {
        if !is_equal {
            return self.drop_device(DIFFERING.to_owned());
        }
        let Some(fitter) = &mut self.device else { return };
        let [of_processor, of_device] = fitter.ms;
        fitter.trial.record_times(of_processor + processor, of_device + on_device);
        self.used.trial = fitter.trial.medians;
    }

    fn drop_device(&mut self, reason: String) {
        self.used.record_fallback(reason);
        self.device = None;
    }
}

impl PointFitter {
    /// Stores the nearest seed of every point in `owners`. Returns the number of points whose seeds the
    /// CPU has to find.
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
        Ok(found.par_iter().filter(|seed| **seed == LEFT_TO_PROCESSOR).count())
    }

    /// Returns the sums over the points of each slot (component with points in the frame), in whole
    /// quanta.
    fn sums(
        &mut self,
        slots: &PointSlots,
        frame: AssignedPoints<'_>,
    ) -> Result<&[[i32; N_SUMS]], DeviceError> {
        self.device.sums(&SlotSums {
            points: &slots.points,
            seeds: &slots.seeds,
            // Rounded as on the CPU.
            per_h: (1.0 / frame.h) as f32,
            gain: frame.gain,
            weight: frame.weight as f32,
        })
    }
}

/// Bit that marks a component with a point that the device cannot sum.
const LEFT: u32 = 1 << 31;
// Largest number, and pixels per point, for which the device rounds terms as the CPU does: quanta stay
// below 2²², the limit of rounding by addition.
const MAX_NUMBER: f32 = 2.0;
const MAX_WEIGHT: u32 = 16;
/// Largest colour gain, and largest shift of a point (world units), for sums on a device. The limit
/// keeps products finite.
const MAX_FACTOR: f32 = 65_536.0;

/// Slots for sums on a device, one per component with points in a frame.
#[derive(Default)]
pub struct PointSlots {
    /// While points are counted: number of pixels of each component's points. Afterwards: slot of each
    /// component.
    of_components: Vec<AtomicU32>,
    /// Component of each slot, ascending.
    pub ids: Vec<u32>,
    /// Seed of each slot's component, world units from the scene's origin, followed by a 0.
    pub seeds: Vec<[f32; 4]>,
    /// Slot of each point ([`NONE`] if the device does not sum the point) and the bits of its shift
    /// (f32).
    pub points: Vec<[u32; 2]>,
    /// Component of each point that the CPU sums, [`NONE`] for the other points. Empty if the CPU sums
    /// no point.
    pub left: Vec<u32>,
    pub n_left: usize,
}

impl PointSlots {
    /// Assigns a slot to every component with points that the device can sum. The CPU sums components
    /// with more points than a row holds, or with invalid or large numbers.
    pub fn fill(&mut self, n_components: usize, frame: AssignedPoints<'_>) {
        self.count(n_components, frame);
        self.ids.clear();
        self.seeds.clear();
        let mut any_left = false;
        for (id, slot) in self.of_components.iter_mut().enumerate() {
            // The count becomes the slot in place, which saves a second table of all components.
            let pixels = std::mem::replace(slot.get_mut(), NONE);
            // The mark is the highest bit, above any number of pixels.
            if pixels >= LEFT || f64::from(pixels) > FULL {
                (*slot.get_mut(), any_left) = (LEFT, true);
            } else if pixels > 0 {
                *slot.get_mut() = self.ids.len() as u32;
                self.ids.push(id as u32);
                let [x, y, z] = frame.seeds.of(id);
                self.seeds.push([x, y, z, 0.0]);
            }
        }
        self.list(frame, any_left);
    }

    fn count(&mut self, n_components: usize, frame: AssignedPoints<'_>) {
        let counts = &mut self.of_components;
        counts.clear();
        counts.resize_with(n_components, AtomicU32::default);
        let is_frame_plain = frame.weight <= MAX_WEIGHT && all_within(&frame.gain, MAX_FACTOR);
        let points = frame.points.par_iter().zip(frame.owners).zip(frame.shifts);
        points.with_min_len(1024).for_each(|((point, &owner), shift)| {
            let Some(count) = counts.get(owner as usize) else { return };
            // Integer sums are independent of the order.
            if is_frame_plain && is_plain(point) && shift.abs() <= MAX_FACTOR {
                count.fetch_add(frame.weight, Ordering::Relaxed);
            } else {
                // `Relaxed` suffices: the counts are read after the parallel loop ends.
                count.fetch_or(LEFT, Ordering::Relaxed);
            }
        });
    }

    /// Lists the points with slots for the device, and the points left to the CPU.
    fn list(&mut self, frame: AssignedPoints<'_>, any_left: bool) {
        let slots = &self.of_components;
        let slot = |owner: u32| slots.get(owner as usize).map(|slot| slot.load(Ordering::Relaxed));
        let listed = frame.owners.par_iter().zip(frame.shifts).with_min_len(1024);
        let of_device = |(&owner, shift): (&u32, &f32)| {
            [slot(owner).filter(|&slot| slot != LEFT).unwrap_or(NONE), shift.to_bits()]
        };
        listed.map(of_device).collect_into_vec(&mut self.points);
        self.left.clear();
        self.n_left = 0;
        if any_left {
            let is_left = |owner: u32| slot(owner) == Some(LEFT);
            let left = |&owner: &u32| if is_left(owner) { owner } else { NONE };
            self.left.extend(frame.owners.iter().map(left));
            self.n_left = self.left.iter().filter(|owner| **owner != NONE).count();
        }
    }
}

fn is_plain(point: &SurfacePoint) -> bool {
    [&point.color, &point.normal, &point.direction].iter().all(|v| all_within(v, MAX_NUMBER))
}

fn all_within(numbers: &[f32; 3], most: f32) -> bool {
    // False for NaN.
    numbers.iter().all(|x| x.abs() <= most)
}
