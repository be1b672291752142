//! Splats: the renderable form of a mixture, read by every renderer, exporter and viewport.
//!
//! They are f32 in world units, as GPUs need them. A covariance is decomposed into scales and a
//! rotation by its eigenvectors, or as in the reference exporter. The latter does not yield a rotation
//! matrix unless the covariance is diagonal; it is used to reproduce the reference's figures.

use crate::math::sym3::{Sym3, rotation_quaternion};
use glam::{DMat3, DQuat, DVec3};

/// One Gaussian splat in world units.
///
/// ```
/// use vbgs_studio::model::splat::splats::Splat;
///
/// let disc = Splat { opacity: 0.9, scale: [0.2, 0.1, 0.01], ..Splat::default() };
/// assert!(disc.is_drawable());
/// assert!((disc.covariance().xx - 0.04).abs() < 1e-8);
/// assert!(!Splat::default().is_drawable(), "an empty slot");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Splat {
    /// Centre, world units.
    pub mean: [f32; 3],
    /// Peak opacity: in `[0, 1]`, or up to 3 for a flat top (`rendering.md`, Native appearance). 0 marks an
    /// empty slot, which is not drawn.
    pub opacity: f32,
    /// sRGB-encoded colour in `[0, 1]`.
    pub color: [f32; 3],
    /// Standard deviations along the splat's own axes, world units (linear, not logarithms).
    pub scale: [f32; 3],
    /// Unit quaternion `w x y z`; the columns of its matrix are the axes of `scale`.
    pub rotation: [f32; 4],
}

/// Decomposition of a covariance into scales and a rotation (`model.md`, From posterior to splat). A second name is
/// that of the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CovarianceForm {
    /// Eigen-decomposition, which represents the covariance exactly.
    #[serde(alias = "right")]
    Eigen,
    /// Cholesky rows interpreted as a rotation, as in the reference exporter. Correct for diagonal
    /// covariances only; used to reproduce the reference's figures.
    #[serde(alias = "legacy-cov")]
    LegacyCholesky,
}

/// Maximum coordinate or standard deviation of a valid splat, world units. The fourth power of this
/// value still fits an f32.
pub const MAX_LENGTH: f32 = 1e9;
/// Tolerance of the squared norm of a rotation, wide enough for quaternions in half precision.
const UNIT_TOLERANCE: f32 = 4e-3;

/// Value that the reference adds to the diagonal before its Cholesky factorisation.
const LEGACY_JITTER: f64 = 1e-10;
/// Maximum number of factorisation attempts in the reference; each multiplies the jitter by ten.
const LEGACY_TRIES: i32 = 5;

impl Default for Splat {
    /// Returns an empty slot: a sphere with opacity 0.
    fn default() -> Self {
        Self {
            mean: [0.0; 3],
            opacity: 0.0,
            color: [0.0; 3],
            scale: [1.0; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
        }
    }
}

impl Splat {
    /// True if the slot holds a splat whose fields are all finite. Files can store such a splat;
    /// renderers clamp or normalise all other defects.
    pub fn is_finite(&self) -> bool {
        let finite = |v: &[f32]| v.iter().all(|x| x.is_finite());
        self.opacity > 0.0
            && self.opacity.is_finite()
            && finite(&self.mean)
            && finite(&self.color)
            && finite(&self.scale)
            && finite(&self.rotation)
    }

    /// True if the slot holds a splat that can be drawn.
    pub fn is_drawable(&self) -> bool {
        self.opacity > 0.0 && self.is_valid()
    }

    /// True if renderers can handle every field: finite, a unit rotation, no negative scale, at least one
    /// positive scale, nothing beyond [`MAX_LENGTH`].
    pub fn is_valid(&self) -> bool {
        // One scale may be 0, a disc, but not all.
        let largest = self.scale.iter().fold(0.0f32, |a, &s| a.max(s));
        let norm2: f32 = self.rotation.iter().map(|q| q * q).sum();
        self.opacity.is_finite()
            && self.mean.iter().all(|x| x.abs() <= MAX_LENGTH)
            && self.color.iter().all(|c| c.is_finite())
            && self.scale.iter().all(|s| (0.0..=MAX_LENGTH).contains(s))
            && largest > 0.0
            && (norm2 - 1.0).abs() <= UNIT_TOLERANCE
    }

    /// Returns the rotation as stored. If the splat is valid ([`Splat::is_valid`]), the quaternion has
    /// length 1 within a tolerance.
    pub fn quaternion(&self) -> DQuat {
        let [w, x, y, z] = self.rotation.map(f64::from);
        DQuat::from_xyzw(x, y, z, w)
    }

    /// Returns the number of the shortest axis, along which a flat splat has its surface normal.
    pub fn thinnest_axis(&self) -> usize {
        let [x, y, z] = self.scale;
        if x <= y && x <= z {
            0
        } else if y <= z {
            1
        } else {
            2
        }
    }

    /// Returns the covariance `Q diag(s²) Qᵀ` in f64, world units².
    pub fn covariance(&self) -> Sym3 {
        let q = DMat3::from_quat(self.quaternion().normalize());
        let s = DVec3::from_array(self.scale.map(f64::from));
        Sym3::from_mat3(q * DMat3::from_diagonal(s * s) * q.transpose())
    }
}

/// Converts a quaternion to the order of [`Splat::rotation`].
pub fn rotation_array(q: DQuat) -> [f32; 4] {
    [q.w, q.x, q.y, q.z].map(|q| q as f32)
}

/// Returns the standard deviations (before any factor) and the unit quaternion (`w ≥ 0`) of a
/// covariance. Eigenvalues that are negative due to rounding count as zero.
pub fn decompose(covariance: Sym3, form: CovarianceForm) -> (DVec3, DQuat) {
    match form {
        CovarianceForm::Eigen => eigen_form(covariance),
        CovarianceForm::LegacyCholesky => legacy_form(covariance),
    }
}

fn eigen_form(covariance: Sym3) -> (DVec3, DQuat) {
    let eigen = covariance.eigen();
    let scale = eigen.values.max(DVec3::ZERO).map(f64::sqrt);
    (scale, rotation_quaternion(eigen.vectors))
}

fn legacy_form(covariance: Sym3) -> (DVec3, DQuat) {
    let factor = (0..LEGACY_TRIES).find_map(|attempt| {
        let jitter = LEGACY_JITTER * 10f64.powi(attempt);
        covariance.add_scaled(jitter, Sym3::diagonal(1.0)).cholesky()
    });
    let l = factor.unwrap_or_else(|| {
        let eigen = covariance.eigen();
        eigen.vectors * DMat3::from_diagonal(eigen.values.max(DVec3::ZERO).map(f64::sqrt))
    });
    // As in the reference, although the rows of a Cholesky factor do not form a rotation: its figures
    // depend on it.
    let rows = l.transpose();
    let scale = DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
    let unit =
        DMat3::from_cols(rows.x_axis / scale.x, rows.y_axis / scale.y, rows.z_axis / scale.z)
            .transpose();
    (scale, trace_formula_quaternion(unit))
}

/// Converts a matrix to a quaternion by the usual trace or largest-diagonal formulas, and normalises
/// it. For a matrix that is not a rotation, the result differs from any projection onto rotations, but
/// equals that of the reference.
fn trace_formula_quaternion(m: DMat3) -> DQuat {
    let e = |row: usize, column: usize| m.col(column)[row];
    let (m00, m11, m22) = (e(0, 0), e(1, 1), e(2, 2));
    let trace = m00 + m11 + m22;
    let q = if trace > 0.0 {
        let s = 2.0 * (trace + 1.0).sqrt();
        DQuat::from_xyzw(
            (e(2, 1) - e(1, 2)) / s,
            (e(0, 2) - e(2, 0)) / s,
            (e(1, 0) - e(0, 1)) / s,
            0.25 * s,
        )
    } else if m00 > m11 && m00 > m22 {
        let s = 2.0 * (1.0 + m00 - m11 - m22).sqrt();
        DQuat::from_xyzw(
            0.25 * s,
            (e(0, 1) + e(1, 0)) / s,
            (e(0, 2) + e(2, 0)) / s,
            (e(2, 1) - e(1, 2)) / s,
        )
    } else if m11 > m22 {
        let s = 2.0 * (1.0 + m11 - m00 - m22).sqrt();
        DQuat::from_xyzw(
            (e(0, 1) + e(1, 0)) / s,
            0.25 * s,
            (e(1, 2) + e(2, 1)) / s,
            (e(0, 2) - e(2, 0)) / s,
        )
    } else {
        let s = 2.0 * (1.0 + m22 - m00 - m11).sqrt();
        DQuat::from_xyzw(
            (e(0, 2) + e(2, 0)) / s,
            (e(1, 2) + e(2, 1)) / s,
            0.25 * s,
            (e(1, 0) - e(0, 1)) / s,
        )
    };
    let q = q.normalize();
    if q.w < 0.0 { -q } else { q }
}

/// Returns the axis-aligned bounds of the centres of finite splats; `None` if there are none.
pub fn bounds(splats: &[Splat]) -> Option<(DVec3, DVec3)> {
    let mut centres =
        splats.iter().filter(|s| s.is_finite()).map(|s| DVec3::from_array(s.mean.map(f64::from)));
    let first = centres.next()?;
    Some(centres.fold((first, first), |(lo, hi), c| (lo.min(c), hi.max(c))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigen_form_rebuilds_the_covariance() {
        let cov = Sym3::from_array([0.02, -0.012, 0.006, 0.03, 0.011, 0.025]);
        let (scale, q) = decompose(cov, CovarianceForm::Eigen);
        let splat = Splat {
            scale: scale.as_vec3().to_array(),
            rotation: rotation_array(q),
            opacity: 1.0,
            ..Splat::default()
        };
        let back = splat.covariance().to_array();
        for (a, b) in back.iter().zip(cov.to_array()) {
            assert!((a - b).abs() < 1e-8, "{back:?}");
        }
    }

    #[test]
    fn bounds_ignore_empty_and_broken_slots() {
        let drawn = Splat { mean: [1.0, 2.0, 3.0], opacity: 0.5, ..Splat::default() };
        let broken = Splat { mean: [f32::NAN; 3], opacity: 0.5, ..Splat::default() };
        assert!(bounds(&[Splat::default(), broken]).is_none());
        let (lo, hi) = bounds(&[Splat::default(), drawn, broken]).unwrap();
        assert_eq!((lo, hi), (DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 2.0, 3.0)));
    }
}
