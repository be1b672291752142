//! Conversion of single splats between the model and files: f64, lower bounds, normalisation, axes,
//! spherical harmonics.
//!
//! Conversions use f64 and round to f32 once, in the file: a logit near 1 and a rotated quaternion would lose
//! digits in f32. Rotations between world axes only permute and negate coordinates, so positions round-trip
//! exactly.
//!
//! Colours become real spherical harmonics of degrees 0 and 1, as in 3DGS files and `KHR_gaussian_splatting`.
//! The unit direction from the camera to the splat is `(x, y, z)`. With the Condon–Shortley phase,
//! `colour = ½ + C0·f₀ + C1·(−y·f₁ + z·f₂ − x·f₃)`.

use crate::model::splat::appearance::{Appearance, GRADIENT_LIMIT, SplatView};
use crate::model::splat::splats::Splat;
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Absolute lower bound on written standard deviations, so that their logarithms are finite
/// (`files.md`, From splat to file).
pub(super) const SCALE_FLOOR: f64 = 1e-7;
/// Lower bound on written standard deviations, relative to the splat's largest standard deviation. The
/// smaller of this bound and the absolute bound applies.
// In a world of large units all scales may be below the absolute minimum.
const FLATTEST: f64 = 1e-4;
/// Minimum distance of a written opacity from 0 and 1 where its logit is stored (`files.md`, From splat
/// to file).
// Limits logits to ±13.8.
const LOGIT_MARGIN: f64 = 1e-6;
/// Length below which a quaternion counts as zero.
const MIN_QUATERNION: f64 = 1e-12;
/// Tolerance for clamping a colour channel: a change up to this value counts as rounding.
const COLOR_SLACK: f64 = 1e-4;
/// Constant factor of degree 0, `1/(2√π)`.
const C0: f64 = 0.282_094_791_773_878_14;
/// Constant factor of degree 1, `√(3/(4π))`.
const C1: f64 = 0.488_602_511_902_919_9;

/// Splat in f64; fields as in [`Splat`] and [`Appearance`], with a unit quaternion as rotation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gaussian {
    pub mean: DVec3,
    pub opacity: f64,
    pub color: DVec3,
    pub scale: DVec3,
    pub rotation: DQuat,
    pub directional: DMat3,
    /// Mean direction from which the splat was observed, from the eye to the splat; zero if unknown.
    pub seen: DVec3,
}

/// Radius around the mean observed view direction within which the exported colour should match the
/// native one. Measured as the length of the difference between two unit vectors.
// 60° to either side.
const VIEW_RANGE: f64 = 1.0;

pub(super) fn drawable(view: SplatView) -> impl Iterator<Item = (usize, Gaussian)> + Clone {
    (0..view.splats().len()).filter_map(move |i| Some((i, drawable_at(view, i)?)))
}

pub(super) fn drawable_at(view: SplatView, i: usize) -> Option<Gaussian> {
    let (splat, appearance) = (view.splats().get(i)?, view.appearance().get(i));
    let appearance = appearance.copied().unwrap_or_default();
    let is_sound = splat.is_finite() && appearance.is_valid();
    is_sound.then(|| Gaussian::from_splat(splat, &appearance))
}

impl Gaussian {
    pub const INVISIBLE: Gaussian = Gaussian {
        mean: DVec3::ZERO,
        opacity: 0.0,
        color: DVec3::ZERO,
        scale: DVec3::splat(SCALE_FLOOR),
        rotation: DQuat::IDENTITY,
        directional: DMat3::ZERO,
        seen: DVec3::ZERO,
    };

    /// Converts a drawable splat, applies the lower bounds of all formats, and omits the colour
    /// gradient.
    pub fn from_splat(splat: &Splat, appearance: &Appearance) -> Self {
        let wide = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let [w, x, y, z] = splat.rotation.map(f64::from);
        let slope = from_rows(appearance.directional);
        let (mean, fit) = (appearance.observed.mean(), appearance.observed.linear_fit(VIEW_RANGE));
        let raw = Self {
            mean: wide(splat.mean),
            opacity: f64::from(splat.opacity),
            // At the mean observed direction, the exported colour equals the native one.
            color: wide(splat.color) + slope * (mean - fit * mean),
            // The logarithm of 0 is not finite.
            scale: wide(splat.scale).max(DVec3::splat(scale_floor(wide(splat.scale)))),
            // A splat with a zero quaternion is drawn unrotated, so the file stores the identity.
            rotation: unit_quaternion([w, x, y, z]).unwrap_or(DQuat::IDENTITY),
            directional: slope * fit,
            seen: mean,
        };
        Self { color: raw.bounded_color(), ..raw }
    }

    pub fn rotated(self, turn: &AxisRotation) -> Self {
        Self {
            mean: turn.rotate_vector(self.mean),
            rotation: turn.rotate_quaternion(self.rotation),
            // The slope takes world directions, so they are rotated back first.
            directional: self.directional * turn.matrix.transpose(),
            seen: turn.rotate_vector(self.seen),
            ..self
        }
    }

    /// Returns the middle one of the three standard deviations.
    pub fn middle_scale(&self) -> f64 {
        let [a, b, c] = self.scale.to_array();
        a.max(b).min(a.max(c)).min(b.max(c))
    }

    pub fn scaled(self, factor: f64) -> Self {
        Self { mean: factor * self.mean, scale: factor * self.scale, ..self }
    }

    /// Replaces the slope of the colour by one that a file can hold. The colour stays as it is from the mean direction
    /// from which the splat was observed.
    pub fn with_slope(self, directional: DMat3) -> Self {
        let color = self.color + (self.directional - directional) * self.seen;
        Self { color, directional, ..self }
    }

    pub fn shifted(self, shift: DVec3) -> Self {
        Self { mean: self.mean + shift, ..self }
    }

    /// Negates the quaternion if `w < 0`, which does not change the rotation.
    pub fn with_positive_w(self) -> Self {
        // Formats require `w ≥ 0` of the two quaternions that represent a rotation.
        let rotation = if self.rotation.w < 0.0 { -self.rotation } else { self.rotation };
        Self { rotation, ..self }
    }

    pub fn color_from(&self, eye: DVec3) -> DVec3 {
        self.color + self.directional * (self.mean - eye).normalize_or_zero()
    }

    /// Converts to the splat and the appearance of a model; `None` if a field is not finite in f32.
    /// Clamps opacities, and colours without view dependence, to `[0, 1]`.
    pub fn to_splat(self) -> Option<(Splat, Appearance)> {
        let narrow = |v: DVec3| v.as_vec3().to_array();
        let most = DVec3::splat(f32::MAX.into());
        // Files hold logarithms, and the rounding of the largest ones leads beyond f32.
        let is_rounded = self.scale.cmple(most * 1.001).all();
        let scale = if is_rounded { self.scale.min(most) } else { self.scale };
        let splat = Splat {
            mean: narrow(self.mean),
            opacity: self.opacity.clamp(0.0, 1.0) as f32,
            color: narrow(self.bounded_color()),
            scale: narrow(scale),
            rotation: wxyz(self.rotation).map(|v| v as f32),
        };
        let directional = self.directional.transpose().to_cols_array_2d();
        let directional = directional.map(|row| row.map(|v| v as f32));
        let appearance = Appearance { directional, ..Appearance::default() };
        let fields = bytemuck::cast_ref::<Splat, [f32; 14]>(&splat);
        let is_finite = fields.iter().all(|v| v.is_finite()) && appearance.is_valid();
        is_finite.then_some((splat, appearance))
    }

    pub fn is_diffuse(&self) -> bool {
        self.directional == DMat3::ZERO
    }

    /// Returns the colour, clamped to `[0, 1]` unless it depends on the view direction.
    fn bounded_color(&self) -> DVec3 {
        match self.is_diffuse() {
            true => self.color.map(|c| c.clamp(0.0, 1.0)),
            // Only the constant term: the other terms may bring the colour back into the range.
            false => self.color,
        }
    }

    /// True if clamping changes the colour by more than rounding.
    pub fn is_color_out_of_range(&self) -> bool {
        (self.color - self.bounded_color()).abs().max_element() > COLOR_SLACK
    }
}

/// Returns the smallest standard deviation written for a splat with standard deviations `scales`.
pub(super) fn scale_floor(scales: DVec3) -> f64 {
    let largest = scales.max_element();
    if largest > 0.0 { SCALE_FLOOR.min(FLATTEST * largest) } else { SCALE_FLOOR }
}

/// Normalises the quaternion `w x y z`; returns `None` for a zero quaternion. NaN stays NaN.
pub(super) fn unit_quaternion([w, x, y, z]: [f64; 4]) -> Option<DQuat> {
    let q = DQuat::from_xyzw(x, y, z, w);
    let length = q.length();
    // NaN is retained, so that the row counts as broken instead of unrotated.
    (length.is_nan() || length >= MIN_QUATERNION).then(|| q / length)
}

pub(super) fn wxyz(q: DQuat) -> [f64; 4] {
    [q.w, q.x, q.y, q.z]
}

pub(super) fn from_rows(rows: [[f32; 3]; 3]) -> DMat3 {
    DMat3::from_cols_array_2d(&rows.map(|row| row.map(f64::from))).transpose()
}

/// Returns the change of a splat's colour at `offset` from its mean (world units), limited as by renderers.
pub(super) fn color_change(gradient: DMat3, offset: DVec3) -> DVec3 {
    let limit = DVec3::splat(GRADIENT_LIMIT);
    (gradient * offset).clamp(-limit, limit)
}

pub(super) fn logit(opacity: f64) -> f64 {
    // Away from 0 and 1, where the logarithm is not finite.
    let o = opacity.clamp(LOGIT_MARGIN, 1.0 - LOGIT_MARGIN);
    (o / (1.0 - o)).ln()
}

pub(super) fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

pub(super) fn srgb_to_linear(encoded: f64) -> f64 {
    // Constants of IEC 61966-2-1, here and below.
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

pub(super) fn linear_to_srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

pub(super) fn color_to_harmonic(color: DVec3) -> DVec3 {
    (color - 0.5) / C0
}

pub(super) fn harmonic_to_color(coefficient: DVec3) -> DVec3 {
    coefficient * C0 + 0.5
}

/// Converts the matrix `w` of a directional colour to the three coefficients of degree 1, each with
/// three channels. The directional colour in direction `d` is `w·d`.
pub(super) fn directional_to_harmonics(w: DMat3) -> [DVec3; 3] {
    // Adding zero turns −0 into 0.
    [-w.y_axis, w.z_axis, -w.x_axis].map(|change| change / C1 + DVec3::ZERO)
}

/// Inverse of [`directional_to_harmonics`]: converts three coefficients of degree 1 to the matrix of a
/// directional colour.
pub(super) fn harmonics_to_directional([y, z, x]: [DVec3; 3]) -> DMat3 {
    DMat3::from_cols(-x, -y, z) * C1
}

/// Rotation between coordinate systems, or a mirroring. Between world axes it only permutes and negates
/// coordinates, so positions stay exact.
#[derive(Clone, Copy, Debug)]
pub(super) struct AxisRotation {
    matrix: DMat3,
    quaternion: DQuat,
}

impl AxisRotation {
    pub const IDENTITY: AxisRotation =
        AxisRotation { matrix: DMat3::IDENTITY, quaternion: DQuat::IDENTITY };

    /// Rotation from z-up axes to the y-up axes of glTF: `(x, y, z)` becomes `(x, z, −y)`.
    pub const Z_UP_TO_Y_UP: AxisRotation = AxisRotation {
        matrix: DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
        quaternion: DQuat::from_xyzw(-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2),
    };

    pub const Y_UP_TO_Z_UP: AxisRotation = AxisRotation {
        matrix: DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
        quaternion: DQuat::from_xyzw(FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2),
    };

    /// Rotation from z-up axes to the y-down axes of splat viewers: `(x, y, z)` becomes `(−x, −z, −y)`.
    pub const Z_UP_TO_Y_DOWN: AxisRotation = AxisRotation {
        matrix: DMat3::from_cols(DVec3::NEG_X, DVec3::NEG_Z, DVec3::NEG_Y),
        quaternion: DQuat::from_xyzw(0.0, FRAC_1_SQRT_2, -FRAC_1_SQRT_2, 0.0),
    };

    /// Maps x, y and z to the given directions, which are perpendicular unit vectors and may be left-handed.
    pub fn from_axes([x, y, z]: [DVec3; 3]) -> AxisRotation {
        let matrix = DMat3::from_cols(x, y, z);
        // A Gaussian equals its point reflection, so a mirroring turns it like the rotation `−matrix`.
        let quaternion = DQuat::from_mat3(&(matrix.determinant() * matrix));
        AxisRotation { matrix, quaternion }
    }

    pub fn from_quaternion(quaternion: DQuat) -> AxisRotation {
        AxisRotation { matrix: DMat3::from_quat(quaternion), quaternion }
    }

    pub fn to_z_up(up: DVec3) -> AxisRotation {
        let quaternion = DQuat::from_rotation_arc(up, DVec3::Z);
        // A half turn has many possible axes; x is chosen because it keeps x unchanged.
        let quaternion = if up == DVec3::NEG_Z { DQuat::from_rotation_x(PI) } else { quaternion };
        let matrix = DMat3::from_quat(quaternion);
        // Rounding errors such as 1e-17 must not spoil an exact permutation of axes.
        let is_axis = up.abs().max_element() == 1.0;
        let exact = |v: DVec3| if is_axis { v.round() } else { v };
        let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(exact);
        if up == DVec3::Z {
            return AxisRotation::IDENTITY;
        }
        AxisRotation { matrix: DMat3::from_cols(columns[0], columns[1], columns[2]), quaternion }
    }

    pub fn then(self, next: AxisRotation) -> AxisRotation {
        AxisRotation {
            matrix: next.matrix * self.matrix,
            quaternion: next.quaternion * self.quaternion,
        }
    }

    pub fn inverse(self) -> AxisRotation {
        AxisRotation { matrix: self.matrix.transpose(), quaternion: self.quaternion.conjugate() }
    }

    pub fn is_identity(&self) -> bool {
        self.matrix == DMat3::IDENTITY
    }

    pub fn rotate_vector(&self, v: DVec3) -> DVec3 {
        // Adding zero turns −0 into 0, which some JSON readers print differently.
        self.matrix * v + DVec3::ZERO
    }

    pub fn rotate_quaternion(&self, q: DQuat) -> DQuat {
        self.quaternion * q
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_rotations_whose_quaternions_agree_with_their_matrices() {
        let ups = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
        let ups = ups.chain([DVec3::new(2.0, -3.0, 6.0) / 7.0]);
        let arcs = ups.flat_map(|up| {
            let turn = AxisRotation::to_z_up(up);
            assert!((turn.rotate_vector(up) - DVec3::Z).length() < 1e-15, "{up}");
            [turn, turn.then(AxisRotation::Z_UP_TO_Y_UP)]
        });
        let named = [
            AxisRotation::IDENTITY,
            AxisRotation::Z_UP_TO_Y_UP,
            AxisRotation::Y_UP_TO_Z_UP,
            AxisRotation::Z_UP_TO_Y_DOWN,
        ];
        for turn in named.into_iter().chain(arcs) {
            let difference = DMat3::from_quat(turn.quaternion) - turn.matrix;
            assert!(difference.to_cols_array().iter().all(|v| v.abs() < 1e-15), "{turn:?}");
            assert!((turn.matrix.determinant() - 1.0).abs() < 1e-15, "{turn:?}");
        }
        let there_and_back = AxisRotation::Y_UP_TO_Z_UP.matrix * AxisRotation::Z_UP_TO_Y_UP.matrix;
        assert_eq!(there_and_back, DMat3::IDENTITY);
    }

    #[test]
    fn transfer_functions_invert_each_other() {
        for i in 0..=1000 {
            let v = f64::from(i) / 1000.0;
            assert!((linear_to_srgb(srgb_to_linear(v)) - v).abs() < 1e-7, "{v}");
        }
    }

    #[test]
    fn degree_1_is_linear_in_the_direction() {
        let w = DMat3::from_cols_array(&[0.3, -0.2, 0.1, 0.5, 0.7, -0.4, -0.6, 0.25, 0.9]);
        let d = DVec3::new(2.0, -3.0, 6.0) / 7.0;
        let [f1, f2, f3] = directional_to_harmonics(w);
        let change = C1 * (-d.y * f1 + d.z * f2 - d.x * f3);
        assert!((change - w * d).length() < 1e-15);
        let back = harmonics_to_directional([f1, f2, f3]) - w;
        assert!(back.to_cols_array().iter().all(|v| v.abs() < 1e-15), "{back}");
    }
}
