//! Validation of mixtures.

use super::super::error::Defect;
use super::super::sections;
use super::{AXES, check_ascending, value_defect};
use crate::math::real::Real;
use crate::model::conjugate::statistics::N_SUMS;
use crate::model::paper::state::{InitialMeans, ModelState, Totals};

const CHANNELS: [&str; 3] = ["red", "green", "blue"];

const SUMS: [([u8; 4], &str); N_SUMS] = [
    (sections::COUNTS, "N"),
    (sections::FIRST, "x"),
    (sections::FIRST, "y"),
    (sections::FIRST, "z"),
    (sections::SECOND, "xx"),
    (sections::SECOND, "xy"),
    (sections::SECOND, "xz"),
    (sections::SECOND, "yy"),
    (sections::SECOND, "yz"),
    (sections::SECOND, "zz"),
    (sections::FIRST, "red"),
    (sections::FIRST, "green"),
    (sections::FIRST, "blue"),
];

/// Indices of the second moments `xx yy zz` among the sums of a component.
const DIAGONAL: [usize; 3] = [4, 7, 9];
/// Indices of the second moments `xy xz yz`, each with the indices of the two diagonal moments that
/// bound it.
const MIXED: [(usize, usize, usize); 3] = [(5, 4, 7), (6, 4, 9), (8, 7, 9)];

/// Relative rounding tolerance for the check `2|B_ij| <= B_ii + B_jj` of the second moments `B`.
// The f32 sums of a tile are accurate to 1e-5; older files hold f32 totals that drift further.
const SLACK: f64 = 1e-3;
/// Absolute rounding tolerance for the check of second moments, in fixed-point steps.
// Fixed-point totals are off by half a quantum per tile, in this inequality by two (two halves, and twice a
// half): enough for 8·10⁶ tiles.
const SLACK_QUANTA: f64 = (1u64 << 24) as f64;

pub(in super::super) fn check_mixture(model: &ModelState) -> Result<(), Defect> {
    // Negated, so that NaN is refused as well.
    let is_wild = |(_, a): &(usize, &f64)| !(a.is_finite() && **a > 0.0);
    if let Some((k, &alpha)) = model.alpha_init.iter().enumerate().find(is_wild) {
        return Err(value_defect(sections::ALPHA, k, "alpha", "a positive number", alpha));
    }
    match &model.means {
        InitialMeans::F32 { space, color } => check_means(space, color)?,
        InitialMeans::F64 { space, color } => check_means(space, color)?,
    }
    match &model.totals {
        Totals::Fixed64 { rows, carries } => {
            check_ascending(sections::CARRY_IDS, carries.iter().map(|carry| carry.id), rows.len())?;
            let mut carries = carries.iter().peekable();
            rows.iter().enumerate().try_for_each(|(k, row)| {
                let limbs = carries.next_if(|carry| carry.id as usize == k).map(|c| c.limbs);
                let mut of_row = row.map(|v| v as f64);
                for (sum, limb) in of_row.iter_mut().zip(limbs.unwrap_or([0; N_SUMS])) {
                    // A carry counts 2⁶⁴ quanta.
                    *sum += f64::from(limb) * 2f64.powi(64);
                }
                check_sums(k, of_row)
            })
        }
        Totals::Fixed128(rows) => {
            rows.iter().enumerate().try_for_each(|(k, row)| check_sums(k, row.map(|v| v as f64)))
        }
    }
}

fn check_means<T: Real>(space: &[[T; 3]], color: &[[T; 3]]) -> Result<(), Defect> {
    for (rows, axes) in [(space, AXES), (color, CHANNELS)] {
        let numbers = rows.as_flattened().iter().map(|v| v.to_f64()).enumerate();
        let mut wild = numbers.zip(axes.into_iter().cycle()).filter(|((_, v), _)| !v.is_finite());
        if let Some(((at, found), axis)) = wild.next() {
            return Err(value_defect(sections::MEANS, at / 3, axis, "a finite number", found));
        }
    }
    Ok(())
}

/// Checks that the sums of component `k` are finite, with no negative count or diagonal moment. The
/// magnitude of each mixed second moment must be at most the mean of the two axes' diagonal moments.
#[expect(clippy::indexing_slicing, reason = "indices from the tables, or found among the sums")]
fn check_sums(k: usize, row: [f64; N_SUMS]) -> Result<(), Defect> {
    let refuse = |i: usize, expected| Err(value_defect(SUMS[i].0, k, SUMS[i].1, expected, row[i]));
    if let Some(i) = row.iter().position(|v| !v.is_finite()) {
        return refuse(i, "a finite number");
    }
    if let Some(&i) = [0].iter().chain(&DIAGONAL).find(|&&i| row[i] < 0.0) {
        return refuse(i, "0 or more");
    }
    // Only pairs: an eigenvalue test would refuse matrices that rounding leaves indefinite where points are
    // few (`model.md`, Posterior).
    let is_unbounded = |&&(i, a, b): &&(usize, usize, usize)| {
        2.0 * row[i].abs() > (row[a] + row[b]) * (1.0 + SLACK) + SLACK_QUANTA
    };
    if let Some(&(i, ..)) = MIXED.iter().find(is_unbounded) {
        return refuse(i, "at most the mean of the two axes' second moments");
    }
    // Finite sums of several components may still overflow together.
    if !row.iter().sum::<f64>().is_finite() {
        return refuse(0, "sums of a finite total");
    }
    Ok(())
}
