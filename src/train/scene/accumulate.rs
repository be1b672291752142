//! Adds a frame's points to the sums of their components.
//!
//! Each thread takes a range of consecutive components with their points, so no two threads write the
//! same row. Neither atomics nor private copies are needed, and rows are updated in the order of the
//! points. Consecutive points belong to few components, whose rows stay in the cache.

use super::component_sums::{ComponentSums, FULL, SumRow, term_quanta, value};
use super::components::Seeds;
use super::grid::NONE;
use crate::math::simd::{Isa, Kernel, Vector};
use crate::model::scene::sums::{MAX_OFFSET, N_SUMS, terms};
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;

#[derive(Clone, Copy)]
pub struct AssignedPoints<'a> {
    pub seeds: &'a Seeds,
    /// Structural scale, world units.
    pub h: f64,
    /// Points of the frame, world units from the scene's origin.
    pub points: &'a [SurfacePoint],
    /// Component of each point. A value beyond the last component means that the point has none.
    pub owners: &'a [u32],
    /// Shift of each point along its ray, world units.
    pub shifts: &'a [f32],
    pub gain: [f32; 3],
    pub weight: u32,
}

impl AssignedPoints<'_> {
    #[inline(always)]
    fn terms(&self, i: usize, seed: [f32; 3]) -> [f32; N_SUMS] {
        let (point, shift) = (&self.points[i], self.shifts[i]);
        let per_h = (1.0 / self.h) as f32;
        // Merged components own points beyond `h`, and refinement moves points: without the clamp their terms
        // could overflow a row.
        let offset = |axis: usize| {
            let offset = point.position[axis] - seed[axis] + shift * point.direction[axis];
            clamp(offset * per_h, MAX_OFFSET)
        };
        let offset = [offset(0), offset(1), offset(2)];
        // A gain above 1 must not lift a colour beyond the bound of terms.
        let color = |i: usize| (point.color[i] * self.gain[i]).min(1.0);
        let color = [color(0), color(1), color(2)];
        // A power of two, so multiplication is exact.
        let weight = self.weight as f32;
        let mut terms = terms(offset, color, point.normal, point.direction);
        for term in &mut terms {
            *term *= weight;
        }
        terms
    }
}

/// Adds every point that has a component to the sums of that component. Replaces `touched` by the
/// components with points, ascending. Sums are exact, so the order of the points has no effect.
pub fn accumulate(
    component_sums: &mut ComponentSums,
    frame: AssignedPoints<'_>,
    touched: &mut Vec<u32>,
) {
    // Threads finish in any order: results are sorted by their first component afterwards.
    let received = std::sync::Mutex::new(Vec::with_capacity(PARTS));
    let parts = PointParts::new(frame.owners, component_sums.len());
    component_sums.for_each_run(parts.firsts(), |first, rows, _| {
        let part = Isa::best().run(Part { first, rows, points: parts.of(first), frame });
        // A poisoned lock means that another thread panicked, and rayon passes its panic on.
        if let Ok(mut received) = received.lock() {
            received.push((first, part));
        }
    });
    let mut received = received.into_inner().unwrap_or_default();
    received.sort_unstable_by_key(|(first, _)| *first);
    touched.clear();
    received.iter().for_each(|(_, part)| touched.extend(&part.ids));
    for (id, sums) in received.into_iter().flat_map(|(_, part)| part.wide) {
        // Wide rows are shared, so they are updated after all threads have finished.
        component_sums.add_wide(id, sums);
    }
}

#[derive(Default)]
struct PartResult {
    /// Components with points, ascending.
    ids: Vec<u32>,
    /// Index and sums of each component with more points than an integer row of sums can hold.
    wide: Vec<(u32, [f64; N_SUMS])>,
}

struct Part<'a, P> {
    first: usize,
    rows: &'a mut [SumRow],
    /// Points of the components in `rows`, in ascending order.
    points: P,
    frame: AssignedPoints<'a>,
}

/// Component that receives points of this frame.
struct Receiver {
    row: u32,
    n: u32,
    seed: [f32; 3],
    /// Index in [`PartResult::wide`], if an integer row of sums cannot hold the component's points.
    wide: Option<usize>,
}

impl<'p, P: Iterator<Item = &'p [u32]> + Clone> Part<'_, P> {
    /// Returns, for each row, the index of its [`Receiver`], and the receivers in the order of their
    /// first point.
    fn receivers(&self) -> (Vec<u32>, Vec<Receiver>) {
        let Self { first, rows, points, frame } = self;
        let (mut places, mut receivers) = (vec![NONE; rows.len()], Vec::<Receiver>::new());
        for &point in points.clone().flatten() {
            let id = frame.owners[point as usize] as usize;
            let place = &mut places[id - first];
            if *place == NONE {
                *place = receivers.len() as u32;
                let (row, seed) = ((id - first) as u32, frame.seeds.of(id));
                receivers.push(Receiver { row, n: 0, seed, wide: None });
            }
            receivers[*place as usize].n += 1;
        }
        (places, receivers)
    }
}

impl<'p, P: Iterator<Item = &'p [u32]> + Clone> Kernel for Part<'_, P> {
    type Output = PartResult;

    #[inline(always)]
    fn run<V: Vector>(self) -> PartResult {
        let (places, mut receivers) = self.receivers();
        let Self { first, rows, points, frame } = self;
        let mut result = PartResult::default();
        for receiver in &mut receivers {
            // A wall close to the camera can put a whole frame into one component.
            if f64::from(receiver.n) * f64::from(frame.weight) > FULL {
                receiver.wide = Some(result.wide.len());
                result.wide.push(((first as u32) + receiver.row, [0.0; N_SUMS]));
            }
        }
        // Nested loops, since `next` of a flattened iterator is not inlined.
        for points in points {
            for &point in points {
                let point = point as usize;
                let row = frame.owners[point] as usize - first;
                let receiver = &receivers[places[row] as usize];
                let terms = frame.terms(point, receiver.seed);
                match receiver.wide {
                    None => rows[row].add(&terms),
                    Some(wide) => add_rounded(&mut result.wide[wide].1, &terms),
                }
            }
        }
        result.ids.extend(receivers.iter().map(|receiver| first as u32 + receiver.row));
        result.ids.sort_unstable();
        result
    }
}

fn add_rounded(sums: &mut [f64; N_SUMS], terms: &[f32; N_SUMS]) {
    let rounded = terms.iter().map(|&term| value(term_quanta(term)));
    sums.iter_mut().zip(rounded).for_each(|(sum, term)| *sum += term);
}

#[inline(always)]
fn clamp(value: f32, most: f32) -> f32 {
    // Two separate selections compile to branch-free code.
    let value = if value > most { most } else { value };
    if value < -most { -most } else { value }
}

/// Maximum number of parts into which the components are divided, each for one thread.
pub const PARTS: usize = 32;
/// Approximate number of points sampled to choose the boundaries of the parts.
// 32 per part suffice to keep every part below twice the mean size.
const SAMPLED: usize = 1024;
const CHUNK: usize = 2048;

/// Partition of the components into ranges of consecutive ones, each for one thread.
#[derive(Default)]
pub struct ComponentParts {
    firsts: Vec<usize>,
    // Bytes, since the table has an entry for every component of the scene.
    part_of: Vec<u8>,
}

impl ComponentParts {
    /// Partitions components so that parts have similar numbers of `owners`. An owner beyond the last component is
    /// ignored.
    pub fn new(owners: &[u32], n_components: usize) -> Self {
        let firsts = firsts(owners, n_components);
        let mut part_of = vec![0u8; n_components];
        for (part, &first) in (0..).zip(&firsts) {
            part_of[first.min(n_components)..].fill(part);
        }
        Self { firsts, part_of }
    }

    /// Returns the part of a component, at most [`PARTS`]; `None` beyond the last component.
    #[inline(always)]
    pub fn part_of(&self, component: u32) -> Option<usize> {
        self.part_of.get(component as usize).map(|&part| part as usize)
    }

    /// Returns the first component of every part, ascending, beginning with 0.
    pub fn firsts(&self) -> &[usize] {
        &self.firsts
    }

    /// Returns the number of components of every part.
    pub fn sizes(&self) -> impl Iterator<Item = usize> {
        let ends = self.firsts.iter().skip(1).copied().chain([self.part_of.len()]);
        ends.zip(&self.firsts).map(|(end, first)| end - first)
    }
}

/// A frame's points, partitioned by ranges of consecutive components.
pub struct PointParts {
    components: ComponentParts,
    chunks: Vec<Chunk>,
}

/// Consecutive points of a frame, sorted by the part to which their component belongs.
struct Chunk {
    points: Vec<u32>,
    /// Index in `points` at which each part ends. Points without a component follow the last part.
    ends: [usize; PARTS],
}

impl PointParts {
    /// Partitions points by their components, `owners`. A value beyond the last component means that the
    /// point has none.
    pub fn new(owners: &[u32], n_components: usize) -> Self {
        let components = ComponentParts::new(owners, n_components);
        let chunks = owners.par_chunks(CHUNK).enumerate();
        let chunks = chunks.map(|(i, owners)| Chunk::new((i * CHUNK) as u32, owners, &components));
        Self { chunks: chunks.collect(), components }
    }

    /// Returns the first component of every part, ascending, beginning with 0.
    pub fn firsts(&self) -> &[usize] {
        self.components.firsts()
    }

    /// Returns the points of the part that begins at component `first`, in ascending order.
    pub fn of(&self, first: usize) -> impl Iterator<Item = &[u32]> + Clone {
        let part = self.firsts().partition_point(|&other| other < first);
        self.chunks.iter().map(move |chunk| {
            let start = part.checked_sub(1).map_or(0, |before| chunk.ends[before]);
            &chunk.points[start..chunk.ends[part]]
        })
    }
}

impl Chunk {
    fn new(first: u32, owners: &[u32], components: &ComponentParts) -> Self {
        // Points without a component sort behind all parts.
        let part = |owner: u32| components.part_of(owner).unwrap_or(PARTS);
        // Counts are stored one index late: their prefix sums are the starts of the parts, which filling
        // turns into ends.
        let mut ends = [0; PARTS + 2];
        owners.iter().for_each(|&owner| ends[part(owner) + 1] += 1);
        (1..=PARTS).for_each(|part| ends[part] += ends[part - 1]);
        let mut points = vec![0; owners.len()];
        for (point, &owner) in (first..).zip(owners) {
            let end = &mut ends[part(owner)];
            points[*end] = point;
            *end += 1;
        }
        Self { points, ends: std::array::from_fn(|part| ends[part]) }
    }
}

/// Returns the first component of each part, chosen so that parts have similar numbers of points. The
/// components in a frame have mostly consecutive numbers. Parts of equal numbers of components would
/// therefore leave most threads idle.
fn firsts(owners: &[u32], n_components: usize) -> Vec<usize> {
    // A sample suffices, since parts need only similar sizes.
    let some = owners.iter().step_by(owners.len() / SAMPLED + 1).map(|&owner| owner as usize);
    let mut some: Vec<usize> = some.filter(|&owner| owner < n_components).collect();
    some.sort_unstable();
    let cut = |part: usize| some.get(part * some.len() / PARTS).copied();
    let mut firsts: Vec<usize> = (1..PARTS).filter_map(cut).collect();
    firsts.insert(0, 0);
    // A component with many points may fill several parts: their cuts are equal.
    firsts.dedup();
    firsts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    fn points(n: usize) -> Vec<SurfacePoint> {
        let mut rng = Rng::new(4, Purpose::Synthetic, 0);
        let mut numbers = |lo: f64| [0; 3].map(|_| rng.range(lo, 1.0) as f32);
        (0..n)
            .map(|_| SurfacePoint {
                position: numbers(-1.0),
                color: numbers(0.0),
                normal: numbers(-1.0),
                direction: numbers(-1.0),
                footprint: 0.01,
                ..SurfacePoint::default()
            })
            .collect()
    }

    /// Calls `of` with each frame of points, all of which belong to one component at the origin.
    fn for_each_frame(
        frames: &[&[SurfacePoint]],
        weight: u32,
        mut of: impl FnMut(AssignedPoints<'_>),
    ) {
        let mut seeds = Seeds::new(1.0);
        seeds.add([0.0; 3]);
        for points in frames {
            let (owners, shifts) = (vec![0; points.len()], vec![0.0; points.len()]);
            let (seeds, owners, shifts) = (&seeds, &owners, &shifts);
            let gain = [1.0; 3];
            of(AssignedPoints { seeds, h: 1.0, points, owners, shifts, gain, weight });
        }
    }

    fn summed(frames: &[&[SurfacePoint]], weight: u32) -> ComponentSums {
        let mut component_sums = ComponentSums::default();
        component_sums.grow(1);
        for_each_frame(frames, weight, |frame| {
            let mut touched = Vec::new();
            accumulate(&mut component_sums, frame, &mut touched);
            assert_eq!(touched, [0]);
            component_sums.spill_to_wide_rows(&touched);
        });
        component_sums
    }

    #[test]
    fn all_points_of_a_large_frame_may_fall_into_one_component() {
        let points = points(100_000);
        let mut expected = [0i64; N_SUMS];
        for_each_frame(&[&points], 1, |frame| {
            for i in 0..points.len() {
                let quanta = frame.terms(i, [0.0; 3]).map(|term| i64::from(term_quanta(term)));
                expected.iter_mut().zip(quanta).for_each(|(sum, term)| *sum += term);
            }
        });
        let expected = expected.map(|quanta| quanta as f64 / 32768.0);
        let (start, rest) = points.split_at(4095);
        let (most, end) = rest.split_at(90_000);
        for frames in [&[&points[..]][..], &[start, most, end], &[end, start, most]] {
            let component_sums = summed(frames, 1);
            assert_eq!(component_sums.sums(0), expected);
            assert_eq!(component_sums.state(), summed(&[&points], 1).state());
        }
    }

    #[test]
    fn a_point_of_weight_counts_for_as_many_points() {
        let points = points(1500);
        // 1,500 points of weight 4 exceed the range of a row; 1,000 do not.
        for n in [1000, 1500] {
            let four: Vec<SurfacePoint> = points[..n].iter().flat_map(|p| [*p; 4]).collect();
            let (weighted, repeated) =
                (summed(&[&points[..n]], 4).sums(0), summed(&[&four], 1).sums(0));
            assert_eq!(weighted[0], 4.0 * n as f64);
            // Terms are rounded to quanta of 2⁻¹⁵ before they are added.
            for (weighted, repeated) in weighted.iter().zip(repeated) {
                assert!((weighted - repeated).abs() <= 2.5 * n as f64 / 32768.0);
            }
        }
    }

    #[test]
    fn rows_hold_a_frame_more_than_makes_them_full() {
        let largest = |n| {
            let (ones, twos) = ([1.0; 3], [2.0; 3]);
            let point = SurfacePoint { position: twos, color: ones, ..SurfacePoint::default() };
            vec![SurfacePoint { footprint: 1.0, ..point }; n]
        };
        let component_sums = summed(&[&largest(4095), &largest(4096), &largest(4097)], 1);
        assert_eq!(component_sums.sums(0)[4], 4.0 * 12_288.0);
    }
}

#[cfg(test)]
mod point_parts_tests {
    use super::*;

    /// Returns the components of points, most of which belong to the last hundredth of the components.
    fn owners() -> Vec<u32> {
        let owner = |i: u32| match i % 50 {
            0 => u32::MAX,
            1 => i / 2,
            _ => 99_000 + i % 1000,
        };
        (0..50_000).map(owner).collect()
    }

    #[test]
    fn parts_have_about_as_many_points() {
        let owners = owners();
        let parts = PointParts::new(&owners, 100_000);
        let firsts = parts.firsts();
        assert!(firsts[0] == 0 && firsts.len() > PARTS / 2 && firsts.is_sorted_by(|a, b| a < b));
        let n_points = |first: usize| parts.of(first).map(<[u32]>::len).sum::<usize>();
        let most = firsts.iter().map(|&first| n_points(first)).max().unwrap();
        assert!(most < 2 * owners.len() / PARTS, "{most}");
        assert_eq!(super::firsts(&[], 10), [0]);
    }

    #[test]
    fn every_point_with_a_component_is_in_its_part_in_order() {
        let owners = owners();
        for n_components in [0, 1, 25, 99_500, 100_000] {
            let parts = PointParts::new(&owners, n_components);
            let ends = parts.firsts()[1..].iter().copied().chain([n_components]);
            for (&first, end) in parts.firsts().iter().zip(ends) {
                let found: Vec<u32> = parts.of(first).flatten().copied().collect();
                let mine = (0..).zip(&owners);
                let mine = mine.filter(|(_, owner)| (first..end).contains(&(**owner as usize)));
                let expected: Vec<u32> = mine.map(|(point, _)| point).collect();
                assert!(found == expected, "{first} of {n_components}");
            }
        }
    }
}
