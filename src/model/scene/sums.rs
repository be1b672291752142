//! Sufficient statistics of one component of a scene, about its seed.
//!
//! Offsets are relative to the seed, in structural scales. So terms stay within ±8, which both f32 and
//! 32-bit quanta represent, and no large squares cancel. The NIW and Dirichlet posteriors need only
//! `N`, `Σ d`, `Σ d dᵀ` and `Σ c`. The other sums improve the picture (`bench accuracy` on Lego: 1.9 dB
//! worse without colour over position and direction). `Σ c cᵀ` is left out: nothing that is drawn
//! depends on it.

use super::state::QUANTUM;
use crate::math::real::Real;
use crate::math::sym3::Sym3;
use crate::model::conjugate::statistics::Moments;
use crate::model::splat::observed_cone::ObservedCone;
use glam::{DMat3, DVec3};
use std::ops::Add;

/// Number of sums per component, each of terms within ±[`MAX_TERM`]. The offset of a point from the seed
/// in units of the structural scale `h` is `d`; `c` is its colour, `n` its normal and `v` its view
/// direction.
///
/// The sums are `N`, `Σ d` (3), `Σ d dᵀ` (6), `Σ c` (3), `Σ c dᵀ` (9, one row per channel), `Σ n` (3),
/// `Σ v` (3), `Σ v vᵀ` (5) and `Σ c vᵀ` (9). The last entry of `Σ v vᵀ` is left out: it is `N` minus the
/// other two of the diagonal.
pub const N_SUMS: usize = 42;

/// Maximum offset of a point from its component's seed in the sums, in units of the structural scale
/// `h`.
// Just below √8: 8,192 squares then stay below 2³¹ quanta of 2⁻¹⁵.
pub const MAX_OFFSET: f32 = 2.8;

/// Maximum term of a sum: the square of [`MAX_OFFSET`].
pub const MAX_TERM: f64 = 7.84;

/// Returns the terms that one point adds to each sum, given its colour, unit surface normal and unit
/// view direction. `d` is its offset from the seed in units of the structural scale; axes are the
/// world's.
#[inline(always)]
pub fn terms<R: Real>(d: [R; 3], c: [R; 3], normal: [f32; 3], direction: [f32; 3]) -> [R; N_SUMS] {
    // Entry by entry: `map` would not be inlined into the SIMD kernels, as it is compiled for the baseline.
    let real = |x: f32| R::of(x.into());
    let n = [real(normal[0]), real(normal[1]), real(normal[2])];
    let v = [real(direction[0]), real(direction[1]), real(direction[2])];
    [
        R::ONE,
        d[0],
        d[1],
        d[2],
        d[0] * d[0],
        d[0] * d[1],
        d[0] * d[2],
        d[1] * d[1],
        d[1] * d[2],
        d[2] * d[2],
        c[0],
        c[1],
        c[2],
        c[0] * d[0],
        c[0] * d[1],
        c[0] * d[2],
        c[1] * d[0],
        c[1] * d[1],
        c[1] * d[2],
        c[2] * d[0],
        c[2] * d[1],
        c[2] * d[2],
        n[0],
        n[1],
        n[2],
        v[0],
        v[1],
        v[2],
        v[0] * v[0],
        v[0] * v[1],
        v[0] * v[2],
        v[1] * v[1],
        v[1] * v[2],
        c[0] * v[0],
        c[0] * v[1],
        c[0] * v[2],
        c[1] * v[0],
        c[1] * v[1],
        c[1] * v[2],
        c[2] * v[0],
        c[2] * v[1],
        c[2] * v[2],
    ]
}

/// The two factors of each term of [`terms`], as indices into 13 numbers: 1, offset, colour, normal and
/// direction. Used by code that computes terms one by one.
pub const TERM_FACTORS: [[u32; 2]; N_SUMS] = {
    const D: u32 = 1;
    const C: u32 = 4;
    const N: u32 = 7;
    const V: u32 = 10;
    let upper = [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]];
    let mut factors = [[0; 2]; N_SUMS];
    let mut i = 0;
    while i < 9 {
        let [row, column] = [i / 3, i % 3];
        factors[13 + i as usize] = [C + row, D + column];
        factors[33 + i as usize] = [C + row, V + column];
        if i < 6 {
            let [a, b] = upper[i as usize];
            factors[4 + i as usize] = [D + a, D + b];
            // All but the last square of the view directions.
            if i < 5 {
                factors[28 + i as usize] = [V + a, V + b];
            }
        }
        if i < 3 {
            factors[1 + i as usize] = [0, D + i];
            factors[10 + i as usize] = [0, C + i];
            factors[22 + i as usize] = [0, N + i];
            factors[25 + i as usize] = [0, V + i];
        }
        i += 1;
    }
    factors
};

/// Returns the outer product `a bᵀ`, one row per entry of `a`.
pub fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Sums of one component as named fields, in world units relative to its seed. `D` is the offset of a
/// point from the seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneSums {
    /// Number of points `N`.
    pub count: f64,
    /// `Σ D`, world units.
    pub first: DVec3,
    /// `Σ D Dᵀ`, world units².
    pub second: Sym3,
    /// `Σ c`, red, green and blue in `[0, 1]`.
    pub color: DVec3,
    /// Colour times offset, `Σ c Dᵀ`: `color_offset.transpose().col(i)` belongs to channel `i`.
    pub color_offset: DMat3,
    /// `Σ n` of the unit normals of the points' surfaces, world axes.
    pub normal: DVec3,
    /// `Σ v` of the unit view directions from the camera to the points.
    pub view: DVec3,
    /// `Σ v vᵀ`.
    pub view_second: Sym3,
    /// `Σ c vᵀ`, one row per channel.
    pub color_view: DMat3,
}

impl SceneSums {
    /// Creates the sums from an array in the order listed at [`N_SUMS`], with offsets in units of `h`.
    pub fn new(sums: &[f64; N_SUMS], h: f64) -> Self {
        let vector = |at: usize| DVec3::new(sums[at], sums[at + 1], sums[at + 2]);
        let rows =
            |at: usize| DMat3::from_cols(vector(at), vector(at + 3), vector(at + 6)).transpose();
        let second = [sums[4], sums[5], sums[6], sums[7], sums[8], sums[9]];
        // Directions are unit vectors, so their squares add up to the count.
        let last = sums[0] - sums[28] - sums[31];
        let view_second = [sums[28], sums[29], sums[30], sums[31], sums[32], last];
        Self {
            count: sums[0],
            first: vector(1) * h,
            second: Sym3::from_array(second).scaled(h * h),
            color: vector(10),
            color_offset: rows(13) * h,
            normal: vector(22),
            view: vector(25),
            view_second: Sym3::from_array(view_second),
            color_view: rows(33),
        }
    }

    /// Returns the sums as an array, in the order listed at [`N_SUMS`]. The unit of offsets is not
    /// converted.
    pub fn to_array(&self) -> [f64; N_SUMS] {
        let mut sums = [0.0; N_SUMS];
        let mut put =
            |at: usize, values: &[f64]| sums[at..at + values.len()].copy_from_slice(values);
        put(0, &[self.count]);
        put(1, &self.first.to_array());
        put(4, &self.second.to_array());
        put(10, &self.color.to_array());
        put(13, &self.color_offset.transpose().to_cols_array());
        put(22, &self.normal.to_array());
        put(25, &self.view.to_array());
        put(28, &self.view_second.to_array()[..5]);
        put(33, &self.color_view.transpose().to_cols_array());
        sums
    }

    /// Returns the mean position of the points relative to the seed. Requires at least one point.
    pub fn mean_offset(&self) -> DVec3 {
        self.first / self.count
    }

    /// Returns the covariance of the points' positions. Requires at least one point.
    pub fn covariance(&self) -> Sym3 {
        self.second.scaled(1.0 / self.count).add_scaled(-1.0, Sym3::outer(self.mean_offset()))
    }

    /// Returns mean and covariance of the view directions. Requires at least one point.
    pub fn view_moments(&self) -> (DVec3, Sym3) {
        let mean = self.view / self.count;
        let second = self.view_second.scaled(1.0 / self.count);
        (mean, second.add_scaled(-1.0, Sym3::outer(mean)))
    }

    /// Returns the cone of observed view directions; the unknown cone if there are no points.
    pub fn observed_cone(&self) -> ObservedCone {
        if self.count < 1.0 {
            return ObservedCone::default();
        }
        let (mean, covariance) = self.view_moments();
        ObservedCone::new(mean, covariance)
    }

    /// Returns the covariance of colour and position, one row per channel. Requires at least one point.
    pub fn color_covariance(&self) -> DMat3 {
        self.color_offset * (1.0 / self.count) - outer(self.color / self.count, self.mean_offset())
    }

    /// Returns the gradient of colour with respect to position, one row per channel. Requires at least
    /// one point. It follows from the conditional mean of the joint Gaussian of both: `G = cov(c, s) (Σ
    /// + l I)⁻¹`. `Σ` is the covariance of [`Self::covariance`], `l` the ridge in world units².
    pub fn gradient(&self, covariance: Sym3, ridge: f64) -> DMat3 {
        match covariance.add_scaled(1.0, Sym3::diagonal(ridge)).inverse() {
            Some(inverse) => self.color_covariance() * inverse.to_mat3(),
            None => DMat3::ZERO,
        }
    }

    /// Returns the sums of the same points about a seed displaced by `−shift`. `shift` has the same
    /// unit as the offsets.
    pub fn about_shifted_seed(&self, shift: DVec3) -> Self {
        let crossed = outer(self.first, shift);
        let second = self
            .second
            .add_scaled(1.0, Sym3::from_mat3(crossed + crossed.transpose()))
            .add_scaled(self.count, Sym3::outer(shift));
        Self {
            first: self.first + shift * self.count,
            second,
            color_offset: self.color_offset + outer(self.color, shift),
            // Normals, directions and their products with colours are independent of the seed.
            ..*self
        }
    }

    /// Returns the sums in axes rotated by `turn`, about the same seed.
    pub fn rotated(&self, turn: DMat3) -> Self {
        let back = turn.transpose();
        let both = |second: Sym3| Sym3::from_mat3(turn * second.to_mat3() * back);
        Self {
            first: turn * self.first,
            second: both(self.second),
            color_offset: self.color_offset * back,
            normal: turn * self.normal,
            view: turn * self.view,
            view_second: both(self.view_second),
            color_view: self.color_view * back,
            ..*self
        }
    }

    /// Returns the moments required by the NIW and Dirichlet posteriors, with colours normalised as in
    /// [`crate::math::measured_pixel::Normalization`].
    pub fn moments(&self) -> Moments {
        use crate::math::measured_pixel::{COLOR_OFFSET, COLOR_SCALE};
        Moments {
            count: self.count,
            first: self.first,
            second: self.second,
            color: (self.color - DVec3::splat(self.count * COLOR_OFFSET)) / COLOR_SCALE,
        }
    }
}

/// Adds sums about the same seed.
impl Add for SceneSums {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self {
            count: self.count + other.count,
            first: self.first + other.first,
            second: self.second.add_scaled(1.0, other.second),
            color: self.color + other.color,
            color_offset: self.color_offset + other.color_offset,
            normal: self.normal + other.normal,
            view: self.view + other.view,
            view_second: self.view_second.add_scaled(1.0, other.view_second),
            color_view: self.color_view + other.color_view,
        }
    }
}

/// Indices of the sums of squares: the diagonals of `Σ d dᵀ` and `Σ v vᵀ`.
pub const SQUARES: [usize; 5] = [4, 7, 9, 28, 31];

/// Tolerance of moments for rounding, relative to a sum. It is needed because view directions are unit
/// vectors in f32.
pub const RELATIVE_SLACK: f64 = 1e-6;
/// Tolerance of moments for rounding, per point. It is needed because every term is rounded to half a
/// quantum.
pub const SLACK_PER_POINT: f64 = 3.0 * QUANTUM;

/// Returns the index of the first mixed moment that no set of points can have, and its largest valid
/// magnitude. `None` if all moments are possible.
///
/// For second moments `a` and `b` along two axes, the mixed moment is at most `√(ab)`. Only moments
/// above `(a + b)/2` are reported, with a tolerance for rounding. The missing second moment of view
/// directions is the count less the other two.
pub fn first_violated_moment(row: &[f64; N_SUMS]) -> Option<(usize, f64)> {
    let [xx, yy, zz] = [row[4], row[7], row[9]];
    let [view_xx, view_yy] = [row[28], row[31]];
    let view_zz = row[0] * (1.0 + RELATIVE_SLACK) - view_xx - view_yy;
    let pairs = [
        (5, [xx, yy]),
        (6, [xx, zz]),
        (8, [yy, zz]),
        (29, [view_xx, view_yy]),
        (30, [view_xx, view_zz]),
        (32, [view_yy, view_zz]),
    ];
    let rounding = SLACK_PER_POINT * row[0];
    let bounded = |i: usize, [a, b]: [f64; 2]| {
        // `2|ab| ≤ a² + b²` needs no root and holds for sums rounded term by term.
        2.0 * row[i].abs() <= (a + b) * (1.0 + RELATIVE_SLACK) + rounding
    };
    let (i, [a, b]) = pairs.into_iter().find(|&(i, squares)| !bounded(i, squares))?;
    Some((i, (a.max(0.0) * b.max(0.0)).sqrt()))
}

/// Clamps each moment that no set of points can have to the nearest whole quantum within its bounds.
/// Such moments result from rounding when sums are moved to another seed. Returns true if any moment
/// changed. Moments within their bounds stay bit-identical.
pub fn clamp_moments(row: &mut [f64; N_SUMS]) -> bool {
    let mut changed = false;
    // Rounding after a move can leave a square a quantum below 0.
    for i in SQUARES {
        if row[i] < 0.0 {
            row[i] = 0.0;
            changed = true;
        }
    }
    // Each of the six pairs of axes is clamped at most once.
    for _ in 0..6 {
        let Some((i, most)) = first_violated_moment(row) else { break };
        let quanta = (row[i].abs().min(most) / QUANTUM).floor();
        row[i] = (quanta * QUANTUM).copysign(row[i]);
        changed = true;
    }
    changed
}

// Relative rounding error of f64 sums, as a share of the trace of a second moment.
const ARITHMETIC: f64 = 1e-14;
/// Lower limit of a scatter matrix's leading minors, relative to powers of its trace. Above it, the
/// matrix is positive definite despite rounding.
const NO_DOUBT: f64 = 1e-12;

/// Repairs second moments that no set of points can have, as rounding after a motion of the scene can
/// cause. Returns true if the row was changed.
///
/// Adds the same number of whole quanta to the second moment along each axis. The number just suffices
/// for a positive semidefinite scatter about the mean. Rows with a positive definite scatter stay
/// bit-identical.
pub fn repair_scatter(row: &mut [f64; N_SUMS]) -> bool {
    // Without points there is no mean to subtract.
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
    // Twice the hidden error, so that a repaired row passes this test when repeated.
    let quanta = ((2.0 * hidden - least) / QUANTUM).ceil().max(1.0);
    for i in [4, 7, 9] {
        row[i] += quanta * QUANTUM;
    }
    true
}

/// True if the leading minors prove that a scatter matrix is positive definite. The smallest eigenvalue
/// is then at least [`NO_DOUBT`] of the trace. The test takes a tenth of the time of an
/// eigendecomposition.
fn is_clearly_definite(scatter: &Sym3) -> bool {
    let [xx, xy, xz, yy, yz, zz] = scatter.to_array();
    let trace = scatter.trace();
    let minor = xx * yy - xy * xy;
    let determinant = zz * minor - xx * yz * yz - yy * xz * xz + 2.0 * xy * xz * yz;
    xx > 0.0 && minor > NO_DOUBT * trace.powi(2) && determinant > NO_DOUBT * trace.powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terms_are_products_of_their_factors() {
        let vector = |first: f32| [first, first + 0.37, first * 1.7 - 3.0];
        let [d, c, n, v] = [0.3, 5.9, 1.1, -2.3].map(vector);
        let numbers = [&[1.0][..], &d, &c, &n, &v].concat();
        let products = TERM_FACTORS.map(|pair| pair.map(|i| numbers[i as usize]));
        assert_eq!(terms(d, c, n, v), products.map(|[a, b]| a * b));
    }
}
