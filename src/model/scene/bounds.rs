//! What the sums of one component can be: moments of real points, as far as rounding lets them.
//!
//! Files are refused whose sums are none, so whatever changes sums otherwise than by adding points
//! has to keep to the same bounds. Moving sums to another seed is the one such thing: it subtracts
//! numbers that rounding has already moved, and what is left of a second moment that was nearly 0
//! may be a quantum below it. A wall along an axis shows it first: its thickness is nothing but
//! rounding.

use super::state::QUANTUM;
use super::sums::N_SUMS;
use crate::math::sym3::Sym3;
use glam::DVec3;

/// Positions of sums of squares.
pub const SQUARES: [usize; 5] = [4, 7, 9, 28, 31];

/// How far rounding may take sums: relative to them, and per point.
#[derive(Clone, Copy, Debug)]
pub struct Slack {
    /// Share of the sum.
    pub relative: f64,
    /// Absolute, times the number of points.
    pub per_point: f64,
}

/// Every term is rounded by half a quantum, and view directions are unit vectors in f32.
pub const MIXED: Slack = Slack { relative: 1e-6, per_point: 3.0 * QUANTUM };
/// Sums in f32 stand still from 2²⁴ points on; up to there rounding may double them.
pub const F32: Slack = Slack { relative: 1.0, per_point: 0.0 };
/// Sums in f64 of terms made in f64.
pub const F64: Slack = Slack { relative: 1e-6, per_point: 1e-6 };

/// The first mixed moment that is larger than its axes' second moments allow, and what they allow
/// in place of it. The last second moment of view directions is what is left of their count.
pub fn first_unbounded(row: &[f64; N_SUMS], slack: Slack) -> Option<(usize, f64)> {
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

/// Brings moments that moving left outside their bounds back to the nearest whole quantum inside;
/// says whether there were any. Sums that are bounded stay as they are, to the bit.
pub fn restrain(row: &mut [f64; N_SUMS], slack: Slack) -> bool {
    let mut changed = false;
    for i in SQUARES {
        if row[i] < 0.0 {
            row[i] = 0.0;
            changed = true;
        }
    }
    // Every pair of axes at most once.
    for _ in 0..6 {
        let Some((i, most)) = first_unbounded(row, slack) else { break };
        let quanta = (row[i].abs().min(most) / QUANTUM).floor();
        row[i] = (quanta * QUANTUM).copysign(row[i]);
        changed = true;
    }
    changed
}

/// Rounding of sums in f64, relative to the trace of a second moment.
const ARITHMETIC: f64 = 1e-14;
/// Minors of a scatter that is definite beyond all doubt of arithmetic, relative to powers of its trace.
const NO_DOUBT: f64 = 1e-12;

/// Makes moments that moving left without points that could have them those of some: adds to the
/// second moment along every axis as many whole quanta as its scatter about the mean is short of
/// being positive semidefinite. Bounded rows stay bounded; definite ones stay as they are, to the bit.
pub fn make_definite(row: &mut [f64; N_SUMS]) -> bool {
    if row[0] <= 0.0 {
        return false;
    }
    let first = DVec3::new(row[1], row[2], row[3]);
    let second = Sym3::from_array([row[4], row[5], row[6], row[7], row[8], row[9]]);
    let scatter = second.add_scaled(-1.0 / row[0], Sym3::outer(first));
    if is_clearly_definite(&scatter) {
        return false;
    }
    // What arithmetic may hide counts as missing: a scatter that is singular gains one quantum, which
    // is a thickness of .006 structural scales at most.
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

/// Whether the leading minors of a scatter leave no doubt that it is definite: a tenth of the time that its
/// eigenvalues take. The smallest of these is then at least [`NO_DOUBT`] of the trace.
fn is_clearly_definite(scatter: &Sym3) -> bool {
    let [xx, xy, xz, yy, yz, zz] = scatter.to_array();
    let trace = scatter.trace();
    let minor = xx * yy - xy * xy;
    let determinant = zz * minor - xx * yz * yz - yy * xz * xz + 2.0 * xy * xz * yz;
    xx > 0.0 && minor > NO_DOUBT * trace.powi(2) && determinant > NO_DOUBT * trace.powi(3)
}
