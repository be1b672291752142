//! Symmetric 3×3 matrices in f64, with factorisations that tolerate ill-conditioned matrices.
//!
//! Covariances of a few points on a surface are ill-conditioned. Determinants and inverses use a Cholesky
//! factor, because the errors of cofactors are up to 10⁴ times larger there. Eigenvalues use Jacobi
//! rotations, which are accurate to rounding for any condition number.

use glam::{DMat3, DQuat, DVec3};

/// Symmetric 3×3 matrix, stored as its upper triangle.
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::math::sym3::Sym3;
///
/// let needle = Sym3::outer(DVec3::new(3.0, 4.0, 0.0)).add_scaled(0.01, Sym3::diagonal(1.0));
/// let eigen = needle.eigen();
/// assert!((eigen.values.x - 25.01).abs() < 1e-12);
/// assert!((eigen.vectors.x_axis.y.abs() - 0.8).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sym3 {
    /// Entry (0,0).
    pub xx: f64,
    /// Entry (0,1).
    pub xy: f64,
    /// Entry (0,2).
    pub xz: f64,
    /// Entry (1,1).
    pub yy: f64,
    /// Entry (1,2).
    pub yz: f64,
    /// Entry (2,2).
    pub zz: f64,
}

/// Eigenvalues in descending order with their unit eigenvectors.
#[derive(Clone, Copy, Debug)]
pub struct Eigen3 {
    /// Eigenvalues in descending order.
    pub values: DVec3,
    /// Eigenvectors as columns in the order of `values`; a rotation matrix with determinant +1.
    pub vectors: DMat3,
}

impl Sym3 {
    /// Returns `value` times the identity.
    pub fn diagonal(value: f64) -> Self {
        Self { xx: value, yy: value, zz: value, ..Self::default() }
    }

    /// Creates a matrix from its entries xx, xy, xz, yy, yz, zz.
    pub fn from_array([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Self {
        Self { xx, xy, xz, yy, yz, zz }
    }

    /// Returns the entries xx, xy, xz, yy, yz, zz.
    pub fn to_array(self) -> [f64; 6] {
        [self.xx, self.xy, self.xz, self.yy, self.yz, self.zz]
    }

    /// Returns the symmetric part of a full matrix.
    pub fn from_mat3(m: DMat3) -> Self {
        Self {
            xx: m.x_axis.x,
            xy: 0.5 * (m.x_axis.y + m.y_axis.x),
            xz: 0.5 * (m.x_axis.z + m.z_axis.x),
            yy: m.y_axis.y,
            yz: 0.5 * (m.y_axis.z + m.z_axis.y),
            zz: m.z_axis.z,
        }
    }

    /// Returns the full matrix.
    pub fn to_mat3(self) -> DMat3 {
        DMat3::from_cols(
            DVec3::new(self.xx, self.xy, self.xz),
            DVec3::new(self.xy, self.yy, self.yz),
            DVec3::new(self.xz, self.yz, self.zz),
        )
    }

    /// Returns the outer product `v vᵀ`.
    pub fn outer(v: DVec3) -> Self {
        Self {
            xx: v.x * v.x,
            xy: v.x * v.y,
            xz: v.x * v.z,
            yy: v.y * v.y,
            yz: v.y * v.z,
            zz: v.z * v.z,
        }
    }

    /// Returns `self + factor · other`.
    pub fn add_scaled(self, factor: f64, other: Self) -> Self {
        let (a, b) = (self.to_array(), other.to_array());
        Self::from_array(std::array::from_fn(|i| a[i] + factor * b[i]))
    }

    /// Multiplies every entry by `factor`.
    pub fn scaled(self, factor: f64) -> Self {
        Self::from_array(self.to_array().map(|v| factor * v))
    }

    /// Returns `A self A` for a diagonal matrix `A`: the covariance after scaling the axes.
    pub fn scaled_axes(self, a: DVec3) -> Self {
        Self {
            xx: self.xx * a.x * a.x,
            xy: self.xy * a.x * a.y,
            xz: self.xz * a.x * a.z,
            yy: self.yy * a.y * a.y,
            yz: self.yz * a.y * a.z,
            zz: self.zz * a.z * a.z,
        }
    }

    /// Returns the quadratic form `vᵀ self v`.
    pub fn quadratic_form(self, v: DVec3) -> f64 {
        v.dot(self.to_mat3() * v)
    }

    /// Returns the trace.
    pub fn trace(self) -> f64 {
        self.xx + self.yy + self.zz
    }

    /// Returns the lower Cholesky factor, or `None` if the matrix is not numerically positive definite.
    pub fn cholesky(self) -> Option<DMat3> {
        let l00 = positive_sqrt(self.xx)?;
        let (l10, l20) = (self.xy / l00, self.xz / l00);
        let l11 = positive_sqrt(self.yy - l10 * l10)?;
        let l21 = (self.yz - l20 * l10) / l11;
        let l22 = positive_sqrt(self.zz - l20 * l20 - l21 * l21)?;
        Some(DMat3::from_cols(
            DVec3::new(l00, l10, l20),
            DVec3::new(0.0, l11, l21),
            DVec3::new(0.0, 0.0, l22),
        ))
    }

    /// Returns the logarithm of the determinant, or `None` if the matrix is not positive definite. Uses
    /// a Cholesky factor: on ill-conditioned matrices, the errors of cofactors are up to 10⁴ times
    /// larger.
    pub fn ln_det(self) -> Option<f64> {
        let l = self.cholesky()?;
        Some(2.0 * (l.x_axis.x.ln() + l.y_axis.y.ln() + l.z_axis.z.ln()))
    }

    /// Returns the inverse, or `None` if the matrix is not positive definite. Uses a Cholesky factor.
    pub fn inverse(self) -> Option<Self> {
        let l = self.cholesky()?;
        // The inverse factor times its transpose is symmetric by construction.
        let i00 = 1.0 / l.x_axis.x;
        let i11 = 1.0 / l.y_axis.y;
        let i22 = 1.0 / l.z_axis.z;
        let i10 = -l.x_axis.y * i00 * i11;
        let i21 = -l.y_axis.z * i11 * i22;
        let i20 = -(l.x_axis.z * i00 + l.y_axis.z * i10) * i22;
        Some(Self {
            xx: i00 * i00 + i10 * i10 + i20 * i20,
            xy: i10 * i11 + i20 * i21,
            xz: i20 * i22,
            yy: i11 * i11 + i21 * i21,
            yz: i21 * i22,
            zz: i22 * i22,
        })
    }

    /// Computes the eigendecomposition by cyclic Jacobi rotations. Eigenvalues are accurate to 1e-15 of
    /// the largest one for any condition number (backward stability).
    pub fn eigen(self) -> Eigen3 {
        let mut a =
            [[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]];
        let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for _ in 0..JACOBI_SWEEPS {
            let off = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
            let diagonal = a[0][0].abs() + a[1][1].abs() + a[2][2].abs();
            // Relative to the diagonal, since covariances may have any unit.
            if off <= f64::EPSILON * 1e-3 * diagonal {
                break;
            }
            for (p, q) in [(0, 1), (0, 2), (1, 2)] {
                jacobi_rotate(&mut a, &mut v, p, q);
            }
        }
        sorted_descending(a, v)
    }
}

// Three sweeps reach full precision for 3×3; the rest is margin for extreme scaling.
const JACOBI_SWEEPS: usize = 12;

fn positive_sqrt(value: f64) -> Option<f64> {
    (value > 0.0 && value.is_finite()).then(|| value.sqrt())
}

fn jacobi_rotate(a: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) {
    // θ would be NaN for equal diagonal entries.
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    // θ² would overflow; 1/(2θ) equals the root to rounding here.
    let t = if theta.abs() > 1e150 {
        0.5 / theta
    } else {
        // The smaller root rotates by at most 45 degrees, which makes the sweeps converge.
        theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt())
    };
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    let (app, aqq, apq) = (a[p][p], a[q][q], a[p][q]);
    // Adding the change avoids the cancellation of the full formula for small eigenvalues.
    a[p][p] = app - t * apq;
    a[q][q] = aqq + t * apq;
    a[p][q] = 0.0;
    a[q][p] = 0.0;
    let r = 3 - p - q;
    let (arp, arq) = (a[r][p], a[r][q]);
    a[r][p] = c * arp - s * arq;
    a[p][r] = a[r][p];
    a[r][q] = s * arp + c * arq;
    a[q][r] = a[r][q];
    for row in v {
        let (vp, vq) = (row[p], row[q]);
        row[p] = c * vp - s * vq;
        row[q] = s * vp + c * vq;
    }
}

fn sorted_descending(a: [[f64; 3]; 3], v: [[f64; 3]; 3]) -> Eigen3 {
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[j][j].total_cmp(&a[i][i]));
    let column = |i: usize| DVec3::new(v[0][i], v[1][i], v[2][i]);
    let mut vectors = DMat3::from_cols(column(order[0]), column(order[1]), column(order[2]));
    // The sign of an eigenvector is arbitrary; flipping one makes the matrix a proper rotation.
    if vectors.determinant() < 0.0 {
        vectors.z_axis = -vectors.z_axis;
    }
    let values = DVec3::new(a[order[0]][order[0]], a[order[1]][order[1]], a[order[2]][order[2]]);
    Eigen3 { values, vectors }
}

/// Returns the unit quaternion of a rotation, with `w ≥ 0`.
pub fn rotation_quaternion(rotation: DMat3) -> DQuat {
    let q = DQuat::from_mat3(&rotation).normalize();
    if q.w < 0.0 { -q } else { q }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spd() -> impl Strategy<Value = Sym3> {
        (proptest::array::uniform9(-1.0f64..1.0), -9.0f64..0.0).prop_map(|(m, floor)| {
            let m = DMat3::from_cols_array(&m);
            Sym3::from_mat3(m * m.transpose()).add_scaled(10f64.powf(floor), Sym3::diagonal(1.0))
        })
    }

    proptest! {
        #[test]
        fn eigen_rebuilds_the_matrix(m in spd()) {
            let e = m.eigen();
            let back = e.vectors * DMat3::from_diagonal(e.values) * e.vectors.transpose();
            let error = (back - m.to_mat3()).to_cols_array().iter().fold(0.0f64, |a, v| a.max(v.abs()));
            prop_assert!(error < 1e-14 * e.values.x.max(1e-300) * 10.0, "{error}");
            prop_assert!((e.vectors.determinant() - 1.0).abs() < 1e-12);
            prop_assert!(e.values.x >= e.values.y && e.values.y >= e.values.z);
        }

        #[test]
        fn inverse_and_determinant_agree_with_eigenvalues(m in spd()) {
            let e = m.eigen();
            let condition = e.values.x / e.values.z;
            let product = m.inverse().unwrap().to_mat3() * m.to_mat3();
            let error = (product - DMat3::IDENTITY).to_cols_array().iter().fold(0.0f64, |a, v| a.max(v.abs()));
            prop_assert!(error < 1e-14 * condition * 10.0, "{error} at condition {condition}");
            let ln_det = e.values.x.ln() + e.values.y.ln() + e.values.z.ln();
            prop_assert!((m.ln_det().unwrap() - ln_det).abs() < 1e-14 * condition + 1e-12);
        }
    }

    #[test]
    fn off_diagonal_entries_may_be_tiny() {
        let m = Sym3 { xx: 1.0, xy: 1e-160, xz: 0.5, yy: 2.0, yz: 0.0, zz: 3.0 };
        let (e, root) = (m.eigen(), 1.25f64.sqrt());
        let expected = DVec3::new(2.0 + root, 2.0, 2.0 - root);
        assert!((e.values - expected).abs().max_element() < 1e-14, "{}", e.values);
        assert!((e.vectors.y_axis.abs() - DVec3::Y).abs().max_element() < 1e-14);
    }

    #[test]
    fn axes_are_scaled_on_both_sides() {
        let m = Sym3::from_array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let scaled = m.scaled_axes(DVec3::new(3.0, 5.0, 7.0)).to_array();
        assert_eq!(scaled, [9.0, 30.0, 63.0, 100.0, 175.0, 294.0]);
        assert_eq!((m.trace(), m.quadratic_form(DVec3::ONE)), (11.0, 31.0));
    }

    #[test]
    fn indefinite_matrices_have_no_factor() {
        assert!(
            Sym3 { xx: 1.0, xy: 2.0, yy: 1.0, zz: 1.0, ..Default::default() }.cholesky().is_none()
        );
        assert!(Sym3::diagonal(f64::NAN).cholesky().is_none());
        assert!(Sym3::diagonal(f64::INFINITY).cholesky().is_none());
        assert!(Sym3::default().ln_det().is_none());
    }

    #[test]
    fn quaternion_has_positive_w() {
        let q = rotation_quaternion(DMat3::from_rotation_z(3.5));
        assert!(q.w >= 0.0 && (q.length() - 1.0).abs() < 1e-15);
    }
}
