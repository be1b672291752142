//! A frame's components in a row, for a device that sums their points: it needs room for those alone.

use super::accumulate::Matched;
use super::grid::NONE;
use super::seed_positions::SeedPositions;
use super::sum_scalar::SumScalar;
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Says of a component that a point of its cannot be a device's.
const LEFT: u32 = 1 << 31;
/// Largest numbers, and pixels of a point, whose terms a device rounds as the processor does: their quanta
/// stay below 2²², beyond which rounding by a sum is none.
const MAX_NUMBER: f32 = 2.0;
const MAX_WEIGHT: u32 = 16;
/// Largest factor on a colour, and shift of a point, whose products are numbers.
const MAX_FACTOR: f32 = 65_536.0;

/// Slots of the components that points come to.
#[derive(Default)]
pub struct PointSlots {
    /// By component pixels of its points, then its slot.
    of_components: Vec<AtomicU32>,
    /// By slot its component, ascending.
    pub ids: Vec<u32>,
    /// By slot the seed that its sums are about, and a 0.
    pub seeds: Vec<[f32; 4]>,
    /// By point its slot, [`NONE`] where a device sums nothing, and the bits of its shift.
    pub points: Vec<[u32; 2]>,
    /// By point its component if the processor sums it, [`NONE`] elsewhere; nothing if there are none.
    pub left: Vec<u32>,
    /// How many those are.
    pub n_left: usize,
}

impl PointSlots {
    /// Gives a slot to every component that points come to, of so many, but for those that the processor
    /// has to sum: with more points than a row holds, or a number that is none.
    pub fn fill<W: SumScalar>(
        &mut self,
        n_components: usize,
        seed_positions: SeedPositions<'_>,
        frame: Matched<'_>,
    ) {
        self.count(n_components, frame);
        self.ids.clear();
        self.seeds.clear();
        let mut any_left = false;
        for (id, slot) in self.of_components.iter_mut().enumerate() {
            let pixels = std::mem::replace(slot.get_mut(), NONE);
            if pixels >= LEFT || f64::from(pixels) > W::FULL {
                (*slot.get_mut(), any_left) = (LEFT, true);
            } else if pixels > 0 {
                *slot.get_mut() = self.ids.len() as u32;
                self.ids.push(id as u32);
                let [x, y, z] = seed_positions.of(id);
                self.seeds.push([x, y, z, 0.0]);
            }
        }
        self.list(frame, any_left);
    }

    /// Counts the pixels of every component.
    fn count(&mut self, n_components: usize, frame: Matched<'_>) {
        let counts = &mut self.of_components;
        counts.clear();
        counts.resize_with(n_components, AtomicU32::default);
        let is_frame_plain = frame.weight <= MAX_WEIGHT && all_within(&frame.gain, MAX_FACTOR);
        let points = frame.points.par_iter().zip(frame.owners).zip(frame.shifts);
        points.with_min_len(1024).for_each(|((point, &owner), shift)| {
            let Some(count) = counts.get(owner as usize) else { return };
            // Sums of integers: the same in any order.
            if is_frame_plain && is_plain(point) && shift.abs() <= MAX_FACTOR {
                count.fetch_add(frame.weight, Ordering::Relaxed);
            } else {
                count.fetch_or(LEFT, Ordering::Relaxed);
            }
        });
    }

    /// Lists the points with their slots, and those that are left.
    fn list(&mut self, frame: Matched<'_>, any_left: bool) {
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

/// Whether the terms of a point are numbers of the usual size.
fn is_plain(point: &SurfacePoint) -> bool {
    [&point.color, &point.normal, &point.direction].iter().all(|v| all_within(v, MAX_NUMBER))
}

fn all_within(numbers: &[f32; 3], most: f32) -> bool {
    // Not so of what is no number.
    numbers.iter().all(|x| x.abs() <= most)
}
