//! Estimates errors of timestamps: a wrong time is visible where the camera's rotation rate changes.
//!
//! With uniform rotation a delay moves both images of a pair alike, so pairs with different rotation rates
//! are used (`pairs.rs`). The delay with the least mean distance is found on a grid and refined by a
//! parabola. It is accepted if both halves of the pairs agree.

use rayon::prelude::*;

/// Least number of image pairs.
const FEWEST: usize = 6;
/// Step between the delays that are tried, seconds, and number of steps to either side.
const STEP: f64 = 0.005;
const N_STEPS: usize = 8;
/// Least relative decrease of the mean distance, largest difference between both halves of the pairs,
/// seconds, and least delay that is reported, seconds.
const FALL: f64 = 0.05;
const AGREED: f64 = 0.008;
const LEAST: f64 = 0.004;

/// Delay with the least mean `distance` over all pairs; `None` if it is undetermined or negligible.
pub(super) fn estimate_delay<P: Sync>(
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

/// Distances by index of the delay, see [`delay_of`].
type Distances = [f64; 2 * N_STEPS + 1];

/// Delay in seconds at an index of the distances.
fn delay_of(place: f64) -> f64 {
    (place - N_STEPS as f64) * STEP
}

fn sum<'a>(rows: impl Iterator<Item = &'a Distances>) -> Distances {
    rows.fold([0.0; _], |mut sums, row| {
        sums.iter_mut().zip(row).for_each(|(sum, distance)| *sum += distance);
        sums
    })
}

/// Delay of the least distance, and that distance; `None` at either end, where the minimum may lie outside.
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
