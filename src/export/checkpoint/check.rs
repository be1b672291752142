//! Values no model has are refused: a checkpoint with a right checksum may still be wrong.

use super::error::{Defect, tag_text};
use super::tag;
use crate::math::points::Normalization;
use crate::math::real::Real;
use crate::model::state::{Carry, Means, ModelState, Totals};
use crate::model::statistics::N_SUMS;

const AXES: [&str; 3] = ["x", "y", "z"];
const CHANNELS: [&str; 3] = ["red", "green", "blue"];

/// Section and axis of every sum.
const SUMS: [([u8; 4], &str); N_SUMS] = [
    (tag::COUNTS, "N"),
    (tag::FIRST, "x"),
    (tag::FIRST, "y"),
    (tag::FIRST, "z"),
    (tag::SECOND, "xx"),
    (tag::SECOND, "xy"),
    (tag::SECOND, "xz"),
    (tag::SECOND, "yy"),
    (tag::SECOND, "yz"),
    (tag::SECOND, "zz"),
    (tag::FIRST, "red"),
    (tag::FIRST, "green"),
    (tag::FIRST, "blue"),
];

/// Positions of `xx yy zz` among the sums.
const DIAGONAL: [usize; 3] = [4, 7, 9];
/// Positions of `xy xz yz`, each with the two of the diagonal that bound it.
const MIXED: [(usize, usize, usize); 3] = [(5, 4, 7), (6, 4, 9), (8, 7, 9)];

/// How far rounding may take `2|B_ij|` beyond `B_ii + B_jj`: the f32 sums of a tile are right to
/// 1e-5, totals kept in f32 drift further, and a total in quanta is off by half a quantum per tile.
const SLACK: f64 = 1e-3;
const SLACK_F32_TOTALS: f64 = 1e-1;
const SLACK_QUANTA: f64 = (1u64 << 24) as f64;

/// Weights, means and statistics.
pub(super) fn model(model: &ModelState) -> Result<(), Defect> {
    if let Some(k) = model.alpha_init.iter().position(|a| !(a.is_finite() && *a > 0.0)) {
        let expected = "a positive number";
        return Err(value(tag::ALPHA, k, "alpha", expected, model.alpha_init[k]));
    }
    match &model.means {
        Means::F32 { space, color } => means(space, color)?,
        Means::F64 { space, color } => means(space, color)?,
    }
    match &model.totals {
        Totals::Fixed64 { rows, carries } => {
            check_carries(carries, rows.len())?;
            let mut carries = carries.iter().peekable();
            rows.iter().enumerate().try_for_each(|(k, row)| {
                let limbs = carries.next_if(|carry| carry.id as usize == k).map(|c| c.limbs);
                let limbs = limbs.unwrap_or([0; N_SUMS]);
                let sum = |i: usize| f64::from(limbs[i]) * 2f64.powi(64) + row[i] as f64;
                sums(k, std::array::from_fn(sum), SLACK, SLACK_QUANTA)
            })
        }
        Totals::Fixed128(rows) => rows
            .iter()
            .enumerate()
            .try_for_each(|(k, row)| sums(k, row.map(|v| v as f64), SLACK, SLACK_QUANTA)),
        Totals::F32(rows) => rows
            .iter()
            .enumerate()
            .try_for_each(|(k, row)| sums(k, row.map(f64::from), SLACK_F32_TOTALS, 0.0)),
    }
}

fn means<T: Real>(space: &[[T; 3]], color: &[[T; 3]]) -> Result<(), Defect> {
    for (rows, axes) in [(space, AXES), (color, CHANNELS)] {
        let wild = |v: &T| !v.to_f64().is_finite();
        if let Some(at) = rows.as_flattened().iter().position(wild) {
            let found = rows[at / 3][at % 3].to_f64();
            return Err(value(tag::MEANS, at / 3, axes[at % 3], "a finite number", found));
        }
    }
    Ok(())
}

/// Sums of one component: finite, no negative count, second moments of a positive semi-definite
/// matrix as far as pairs of axes tell.
#[inline]
fn sums(k: usize, row: [f64; N_SUMS], slack: f64, slack_abs: f64) -> Result<(), Defect> {
    let bounded = |&(i, a, b): &(usize, usize, usize)| {
        2.0 * row[i].abs() <= (row[a] + row[b]) * (1.0 + slack) + slack_abs
    };
    // One sum tells whether all are finite.
    let sound = row.iter().sum::<f64>().is_finite()
        && row[0] >= 0.0
        && DIAGONAL.iter().all(|&i| row[i] >= 0.0)
        && MIXED.iter().all(bounded);
    if sound { Ok(()) } else { Err(first_unsound(k, row, bounded)) }
}

#[cold]
fn first_unsound(
    k: usize,
    row: [f64; N_SUMS],
    bounded: impl Fn(&(usize, usize, usize)) -> bool,
) -> Defect {
    let refuse = |i: usize, expected| value(SUMS[i].0, k, SUMS[i].1, expected, row[i]);
    if let Some(i) = row.iter().position(|v| !v.is_finite()) {
        return refuse(i, "a finite number");
    }
    if let Some(&i) = [0].iter().chain(&DIAGONAL).find(|&&i| row[i] < 0.0) {
        return refuse(i, "0 or more");
    }
    match MIXED.iter().find(|pair| !bounded(pair)) {
        Some(&(i, ..)) => refuse(i, "at most the mean of the two axes' second moments"),
        None => refuse(0, "sums of a finite total"),
    }
}

fn check_carries(carries: &[Carry], components: usize) -> Result<(), Defect> {
    let place = || tag_text(tag::CARRY_IDS);
    if !carries.is_sorted_by(|a, b| a.id < b.id) {
        return Err(Defect::malformed(place(), "components in ascending order", "another order"));
    }
    match carries.last().filter(|carry| carry.id as usize >= components) {
        Some(carry) => {
            let expected = format!("components below {components}");
            Err(Defect::malformed(place(), expected, carry.id.to_string()))
        }
        None => Ok(()),
    }
}

/// Offset finite, scale positive.
pub(super) fn normalization(normalization: &Normalization) -> Result<(), Defect> {
    let Normalization { offset, scale } = normalization;
    let sound =
        offset.iter().all(|v| v.is_finite()) && scale.iter().all(|v| v.is_finite() && *v > 0.0);
    if sound {
        return Ok(());
    }
    let expected = "a finite offset and a positive scale";
    let found = format!("{offset:?} and {scale:?}");
    Err(Defect::malformed(tag_text(tag::NORMALIZATION), expected, found))
}

/// Hyper-parameters are positive.
pub(super) fn prior(numbers: &[f64]) -> Result<(), Defect> {
    match numbers.iter().find(|v| !(v.is_finite() && **v > 0.0)) {
        None => Ok(()),
        Some(found) => {
            Err(Defect::malformed(tag_text(tag::PRIOR), "positive numbers", found.to_string()))
        }
    }
}

/// Frames gone through, each once and at least as many as were learnt.
pub(super) fn visited(frames: &[u64], learnt: u64) -> Result<Vec<u32>, Defect> {
    let refuse = |expected: &str, found: String| {
        Err(Defect::malformed(tag_text(tag::CURSOR), expected, found))
    };
    if learnt > frames.len() as u64 {
        return refuse(&format!("{} frames learnt at most", frames.len()), learnt.to_string());
    }
    let ids: Option<Vec<u32>> = frames.iter().map(|&frame| u32::try_from(frame).ok()).collect();
    let Some(ids) = ids else {
        return refuse("frame numbers of 32 bits", "larger ones".to_owned());
    };
    let mut sorted = ids.clone();
    sorted.sort_unstable();
    match sorted.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => refuse("every frame once", format!("frame {} twice", pair[0])),
        None => Ok(ids),
    }
}

fn value(tag: [u8; 4], k: usize, axis: &str, expected: &str, found: f64) -> Defect {
    Defect::malformed(
        format!("{}[component {k}, {axis}]", tag_text(tag)),
        expected,
        found.to_string(),
    )
}
