//! Real spherical harmonics of degrees 0 and 1, as in 3DGS files and `KHR_gaussian_splatting`. The unit
//! direction from the camera to the splat is `(x, y, z)`. With the Condon–Shortley phase,
//! `colour = ½ + C0·f₀ + C1·(−y·f₁ + z·f₂ − x·f₃)`.

use glam::{DMat3, DVec3};

/// Constant factor of degree 0, `1/(2√π)`.
const C0: f64 = 0.282_094_791_773_878_14;
/// Constant factor of degree 1, `√(3/(4π))`.
const C1: f64 = 0.488_602_511_902_919_9;

pub(super) fn from_color(color: DVec3) -> DVec3 {
    (color - 0.5) / C0
}

pub(super) fn to_color(coefficient: DVec3) -> DVec3 {
    coefficient * C0 + 0.5
}

/// Converts the matrix `w` of a directional colour to the three coefficients of degree 1, each with
/// three channels. The directional colour in direction `d` is `w·d`.
pub(super) fn from_directional(w: DMat3) -> [DVec3; 3] {
    // Adding zero turns −0 into 0.
    [-w.y_axis, w.z_axis, -w.x_axis].map(|change| change / C1 + DVec3::ZERO)
}

/// Inverse of [`from_directional`]: converts three coefficients of degree 1 to the matrix of a
/// directional colour.
pub(super) fn to_directional([y, z, x]: [DVec3; 3]) -> DMat3 {
    DMat3::from_cols(-x, -y, z) * C1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degree_1_is_linear_in_the_direction() {
        let w = DMat3::from_cols_array(&[0.3, -0.2, 0.1, 0.5, 0.7, -0.4, -0.6, 0.25, 0.9]);
        let d = DVec3::new(2.0, -3.0, 6.0) / 7.0;
        let [f1, f2, f3] = from_directional(w);
        let change = C1 * (-d.y * f1 + d.z * f2 - d.x * f3);
        assert!((change - w * d).length() < 1e-15);
        let back = to_directional([f1, f2, f3]) - w;
        assert!(back.to_cols_array().iter().all(|v| v.abs() < 1e-15), "{back}");
    }
}
