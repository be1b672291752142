//! When images were taken, told by what they show: a clock that stamps them late shows where the camera
//! turns.
//!
//! A camera that turns evenly says nothing, since a delay moves both images of a pair alike: pairs are chosen
//! between which it turns otherwise (`pairs.rs`). Of delays in steps the one of the least mean distance is
//! taken, and refined by a parabola, if two halves of the pairs agree about it.

use rayon::prelude::*;

/// The fewest pairs of images that say anything.
const FEWEST: usize = 6;
/// Seconds between the delays that are tried, and how many to either side.
const STEP: f64 = 0.005;
const N_STEPS: usize = 8;
/// By what share the mean distance must fall, seconds by which two halves of the pairs may differ, and the least
/// delay that is told.
const FALL: f64 = 0.05;
const AGREED: f64 = 0.008;
const LEAST: f64 = 0.004;

/// The delay at which what pairs say, given one, is least on average; `None` where they do not determine it, or
/// determine that there is none.
pub(super) fn lowest_of<P: Sync>(
    pairs: &[P],
    distance: impl Fn(&P, f64) -> f64 + Sync,
) -> Option<f64> {
    if pairs.len() < FEWEST {
        return None;
    }
    let table: Vec<Distances> = pairs
        .par_iter()
        .map(|pair| std::array::from_fn(|i| distance(pair, delay_of(i as f64))))
        .collect();
    let half = |first: usize| sum(table.iter().skip(first).step_by(2));
    let all = sum(table.iter());
    let (delay, least) = lowest(&all)?;
    let halves = [lowest(&half(0))?.0, lowest(&half(1))?.0];
    let is_determined =
        least < (1.0 - FALL) * all[N_STEPS] && (halves[0] - halves[1]).abs() < AGREED;
    (is_determined && delay.abs() >= LEAST).then_some(delay)
}

/// By delay: see [`delay_of`].
type Distances = [f64; 2 * N_STEPS + 1];

/// Seconds of a place among the distances.
fn delay_of(place: f64) -> f64 {
    (place - N_STEPS as f64) * STEP
}

fn sum<'a>(rows: impl Iterator<Item = &'a Distances>) -> Distances {
    rows.fold([0.0; _], |mut sums, row| {
        sums.iter_mut().zip(row).for_each(|(sum, distance)| *sum += distance);
        sums
    })
}

/// The delay of the least distance and that distance; `None` at either end, where less may lie beyond.
fn lowest(distances: &Distances) -> Option<(f64, f64)> {
    let triples = distances.array_windows().enumerate();
    let (before, [left, here, right]) = triples.min_by(|(_, a), (_, b)| a[1].total_cmp(&b[1]))?;
    if left < here || right < here {
        return None;
    }
    let bend = left - 2.0 * here + right;
    let off = if bend > 0.0 { 0.5 * (left - right) / bend } else { 0.0 };
    Some((delay_of(before as f64 + 1.0 + off), *here))
}
