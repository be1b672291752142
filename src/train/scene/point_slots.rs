//! Compact list of a frame's components, for a device that sums their points: it needs memory only for those.

use super::accumulate::AssignedPoints;
use super::grid::NONE;
use super::seed_positions::SeedPositions;
use super::sum_scalar::SumScalar;
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Marks a component with a point that the device cannot sum.
const LEFT: u32 = 1 << 31;
// Largest number, and pixels per point, for which the device rounds terms as the processor does: quanta stay
// below 2²², the limit of rounding by addition.
const MAX_NUMBER: f32 = 2.0;
const MAX_WEIGHT: u32 = 16;
/// Largest factor on a colour and largest shift of a point, so that products are finite.
const MAX_FACTOR: f32 = 65_536.0;

/// Slots of the components with points in a frame.
#[derive(Default)]
pub struct PointSlots {
    /// Per component, the pixels of its points, then its slot.
    of_components: Vec<AtomicU32>,
    /// Component of each slot, ascending.
    pub ids: Vec<u32>,
    /// Seed of each slot's sums, and a 0.
    pub seeds: Vec<[f32; 4]>,
    /// Per point, its slot ([`NONE`] if the device does not sum it) and the bits of its shift.
    pub points: Vec<[u32; 2]>,
    /// Per point, its component if the processor sums it, else [`NONE`]; empty if there are none.
    pub left: Vec<u32>,
    pub n_left: usize,
}

impl PointSlots {
    /// Assigns a slot to every component with points, except those that the processor must sum: with more
    /// points than a row holds, or with invalid or large numbers.
    pub fn fill<W: SumScalar>(
        &mut self,
        n_components: usize,
        seed_positions: SeedPositions<'_>,
        frame: AssignedPoints<'_>,
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
                count.fetch_or(LEFT, Ordering::Relaxed);
            }
        });
    }

    /// Lists the points with their slots, and those left to the processor.
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

/// True if all numbers of a point are within range.
fn is_plain(point: &SurfacePoint) -> bool {
    [&point.color, &point.normal, &point.direction].iter().all(|v| all_within(v, MAX_NUMBER))
}

fn all_within(numbers: &[f32; 3], most: f32) -> bool {
    // False for NaN.
    numbers.iter().all(|x| x.abs() <= most)
}
