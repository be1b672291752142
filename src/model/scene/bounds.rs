//! Bounds of the sums of one component: moments of real points, up to rounding.
//!
//! Checkpoints that violate them are rejected, so every operation on sums other than adding points must
//! respect them. Moving sums to another seed is the only one: it subtracts numbers that were rounded, so a
//! second moment near 0 may end up a quantum below 0. A wall along an axis shows it first, as its thickness
//! consists of rounding alone.

use super::state::QUANTUM;
use super::sums::N_SUMS;
use crate::math::sym3::Sym3;
use glam::DVec3;

/// Indices of the sums of squares.
pub const SQUARES: [usize; 5] = [4, 7, 9, 28, 31];

/// Tolerance for rounding: relative to a sum, and per point.
#[derive(Clone, Copy, Debug)]
pub struct Slack {
    /// Relative to the sum.
    pub relative: f64,
    /// Absolute, multiplied by the number of points.
    pub per_point: f64,
}

/// Tolerance of mixed precision: every term is rounded to half a quantum, and view directions are unit
/// vectors in f32.
pub const MIXED: Slack = Slack { relative: 1e-6, per_point: 3.0 * QUANTUM };
/// Tolerance of f32: sums stagnate from 2²⁴ points on; rounding may double them up to there.
pub const F32: Slack = Slack { relative: 1.0, per_point: 0.0 };
/// Tolerance of f64 sums with f64 terms.
pub const F64: Slack = Slack { relative: 1e-6, per_point: 1e-6 };

/// Returns the index of the first mixed moment whose magnitude exceeds half the sum of its axes' second
/// moments, and the largest value allowed, `√(ab)`. The missing second moment of view directions is the count
/// less the other two.
pub fn first_violated_moment(row: &[f64; N_SUMS], slack: Slack) -> Option<(usize, f64)> {
    let [xx, yy, zz] = [row[4], row[7], row[9]];
    let [view_xx, view_yy] = [row[28], row[31]];
    let view_zz = row[0] * (1.0 + slack.relative) - view_xx - view_yy;
    let pairs = [
        (5, [xx, yy]),
        (6, [xx, zz]),
        (8, [yy, zz]),
        (29, [view_xx, view_yy]),
        (30, [view_xx, view_zz]),
        (32, [view_yy, view_zz]),
    ];
    let rounding = slack.per_point * row[0];
    let bounded = |i: usize, [a, b]: [f64; 2]| {
        2.0 * row[i].abs() <= (a + b) * (1.0 + slack.relative) + rounding
    };
    let (i, [a, b]) = pairs.into_iter().find(|&(i, squares)| !bounded(i, squares))?;
    Some((i, (a.max(0.0) * b.max(0.0)).sqrt()))
}

/// Clamps moments that moving left out of bounds to the nearest whole quantum inside; returns true if any
/// changed. Sums within bounds stay unchanged to the bit.
pub fn clamp_moments(row: &mut [f64; N_SUMS], slack: Slack) -> bool {
    let mut changed = false;
    for i in SQUARES {
        if row[i] < 0.0 {
            row[i] = 0.0;
            changed = true;
        }
    }
    // Each of the six pairs of axes is clamped at most once.
    for _ in 0..6 {
        let Some((i, most)) = first_violated_moment(row, slack) else { break };
        let quanta = (row[i].abs().min(most) / QUANTUM).floor();
        row[i] = (quanta * QUANTUM).copysign(row[i]);
        changed = true;
    }
    changed
}

/// Relative rounding error of f64 sums, as a share of the trace of a second moment.
const ARITHMETIC: f64 = 1e-14;
/// Minors above this share of powers of the trace prove a scatter to be definite despite rounding.
const NO_DOUBT: f64 = 1e-12;

/// Repairs moments that no set of points could have after moving: adds the least number of whole quanta to
/// the second moment along every axis that makes the scatter about the mean positive semidefinite. Rows
/// within bounds stay within; definite ones stay unchanged to the bit.
pub fn repair_scatter(row: &mut [f64; N_SUMS]) -> bool {
    if row[0] <= 0.0 {
        return false;
    }
    let first = DVec3::new(row[1], row[2], row[3]);
    let second = Sym3::from_array([row[4], row[5], row[6], row[7], row[8], row[9]]);
    let scatter = second.add_scaled(-1.0 / row[0], Sym3::outer(first));
    if is_clearly_definite(&scatter) {
        return false;
    }
    // Rounding may hide a deficit, so it counts as one: a singular scatter gains one quantum, a thickness of
    // at most .006 structural scales.
    let hidden = ARITHMETIC * second.trace();
    let least = scatter.eigen().values.min_element();
    if least > hidden {
        return false;
    }
    let quanta = ((2.0 * hidden - least) / QUANTUM).ceil().max(1.0);
    for i in [4, 7, 9] {
        row[i] += quanta * QUANTUM;
    }
    true
}

/// True if the leading minors prove a scatter to be definite; takes a tenth of the time of its eigenvalues.
/// The smallest eigenvalue is then at least [`NO_DOUBT`] of the trace.
fn is_clearly_definite(scatter: &Sym3) -> bool {
    let [xx, xy, xz, yy, yz, zz] = scatter.to_array();
    let trace = scatter.trace();
    let minor = xx * yy - xy * xy;
    let determinant = zz * minor - xx * yz * yz - yy * xz * xz + 2.0 * xy * xz * yz;
    xx > 0.0 && minor > NO_DOUBT * trace.powi(2) && determinant > NO_DOUBT * trace.powi(3)
}
