//! A splat on its way to or from a file: f64, floored, normalised, turned to other axes.
//!
//! Conversions run in f64 and are narrowed once, at the file: a logit near 1 and a turned
//! quaternion would lose digits in f32. Turns only permute and negate coordinates, so positions
//! survive them exactly; a general rotation would not, and round trips are tested for equality.

use crate::model::splat::appearance::{Appearance, SplatView};
use crate::model::splat::splats::Splat;
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Smallest scale written, so that its logarithm is finite (`export.md`, From splat to file).
pub(super) const SCALE_FLOOR: f64 = 1e-7;
/// Where a world's unit makes all of a splat small, this share of its largest scale is written.
const FLATTEST: f64 = 1e-4;
/// Opacities are kept this far from 0 and 1 where their logit is written (`export.md`, From splat
/// to file).
// Logits then end at ±13.8.
const LOGIT_MARGIN: f64 = 1e-6;
/// Quaternions shorter than this have no direction.
const MIN_QUATERNION: f64 = 1e-12;
/// Colours this far outside `[0, 1]` are reported when clamped; less is rounding.
const COLOR_SLACK: f64 = 1e-4;

/// One splat in f64; fields as in [`Splat`] and [`Appearance`], the rotation a unit quaternion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gaussian {
    pub mean: DVec3,
    pub opacity: f64,
    pub color: DVec3,
    pub scale: DVec3,
    pub rotation: DQuat,
    /// Takes the unit direction from the camera to a change of colour.
    pub directional: DMat3,
}

/// Difference from the mean of observed directions within which a file's colour is to resemble the native
/// one: an orbit of 60° to either side.
const ORBIT: f64 = 1.0;

/// Splats that files can hold, with their positions in the list.
pub(super) fn drawable(view: SplatView) -> impl Iterator<Item = (usize, Gaussian)> + Clone {
    (0..view.splats().len()).filter_map(move |i| Some((i, drawable_at(view, i)?)))
}

/// The splat of that number, if files can hold it.
pub(super) fn drawable_at(view: SplatView, i: usize) -> Option<Gaussian> {
    let (splat, appearance) = (view.splats().get(i)?, view.appearance().get(i));
    let appearance = appearance.copied().unwrap_or_default();
    let is_sound = splat.is_finite() && appearance.is_valid();
    is_sound.then(|| Gaussian::of(splat, &appearance))
}

impl Gaussian {
    /// A splat that nobody sees.
    pub const NOTHING: Gaussian = Gaussian {
        mean: DVec3::ZERO,
        opacity: 0.0,
        color: DVec3::ZERO,
        scale: DVec3::splat(SCALE_FLOOR),
        rotation: DQuat::IDENTITY,
        directional: DMat3::ZERO,
    };

    /// A drawable splat with the floors every format needs; its gradient is left behind.
    pub fn of(splat: &Splat, appearance: &Appearance) -> Self {
        let wide = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let [w, x, y, z] = splat.rotation.map(f64::from);
        let slope = from_rows(appearance.directional);
        let (mean, fit) = (appearance.observed.mean(), appearance.observed.linear_fit(ORBIT));
        let raw = Self {
            mean: wide(splat.mean),
            opacity: f64::from(splat.opacity),
            color: wide(splat.color) + slope * (mean - fit * mean),
            // A logarithm of 0 is no number in a file.
            scale: wide(splat.scale).max(DVec3::splat(scale_floor(wide(splat.scale)))),
            // A splat of no direction is drawn unrotated, and its file must say what is seen.
            rotation: unit_quaternion([w, x, y, z]).unwrap_or(DQuat::IDENTITY),
            directional: slope * fit,
        };
        Self { color: raw.bounded_color(), ..raw }
    }

    /// The splat in turned axes: position, rotation and view dependence all turn.
    pub fn turned(self, turn: &Turn) -> Self {
        Self {
            mean: turn.vector(self.mean),
            rotation: turn.rotation(self.rotation),
            directional: self.directional * turn.matrix.transpose(),
            ..self
        }
    }

    /// The splat as many times as large, about the origin.
    pub fn scaled(self, factor: f64) -> Self {
        Self { mean: factor * self.mean, scale: factor * self.scale, ..self }
    }

    /// The same rotation by the quaternion of `w ≥ 0`: of the two that say it, the one that files
    /// promise.
    pub fn with_positive_w(self) -> Self {
        let rotation = if self.rotation.w < 0.0 { -self.rotation } else { self.rotation };
        Self { rotation, ..self }
    }

    /// The colour seen from a point.
    pub fn color_from(&self, eye: DVec3) -> DVec3 {
        self.color + self.directional * (self.mean - eye).normalize_or_zero()
    }

    /// As records, or `None` if a field is not finite in f32. Opacities end in `[0, 1]`, and so do
    /// colours that are the same from everywhere.
    pub fn to_splat(self) -> Option<(Splat, Appearance)> {
        let narrow = |v: DVec3| v.as_vec3().to_array();
        let splat = Splat {
            mean: narrow(self.mean),
            opacity: self.opacity.clamp(0.0, 1.0) as f32,
            color: narrow(self.bounded_color()),
            scale: narrow(self.scale),
            rotation: wxyz(self.rotation).map(|v| v as f32),
        };
        let directional = self.directional.transpose().to_cols_array_2d();
        let directional = directional.map(|row| row.map(|v| v as f32));
        let appearance = Appearance { directional, ..Appearance::default() };
        let fields = bytemuck::cast_ref::<Splat, [f32; 14]>(&splat);
        let is_finite = fields.iter().all(|v| v.is_finite()) && appearance.is_valid();
        is_finite.then_some((splat, appearance))
    }

    /// Whether the colour does not depend on the direction it is seen from.
    pub fn is_diffuse(&self) -> bool {
        self.directional == DMat3::ZERO
    }

    /// The colour within `[0, 1]`, unless it is only the constant term of what is seen.
    fn bounded_color(&self) -> DVec3 {
        match self.is_diffuse() {
            true => self.color.map(|c| c.clamp(0.0, 1.0)),
            false => self.color,
        }
    }

    /// Whether the colour was clamped by more than rounding.
    pub fn has_wild_color(&self) -> bool {
        (self.color - self.bounded_color()).abs().max_element() > COLOR_SLACK
    }
}

/// Smallest scale that is written of a splat with these scales.
pub(super) fn scale_floor(scales: DVec3) -> f64 {
    let largest = scales.max_element();
    if largest > 0.0 { SCALE_FLOOR.min(FLATTEST * largest) } else { SCALE_FLOOR }
}

/// `w x y z`, normalised; `None` if the quaternion has no direction. NaN stays NaN.
pub(super) fn unit_quaternion([w, x, y, z]: [f64; 4]) -> Option<DQuat> {
    let q = DQuat::from_xyzw(x, y, z, w);
    let length = q.length();
    // NaN is kept, so that the row is counted as broken and not as unrotated.
    (length.is_nan() || length >= MIN_QUATERNION).then(|| q / length)
}

/// The components in the order `w x y z`.
pub(super) fn wxyz(q: DQuat) -> [f64; 4] {
    [q.w, q.x, q.y, q.z]
}

/// A matrix from its rows.
pub(super) fn from_rows(rows: [[f32; 3]; 3]) -> DMat3 {
    DMat3::from_cols_array_2d(&rows.map(|row| row.map(f64::from))).transpose()
}

/// `ln(o / (1 − o))`, with `o` kept away from 0 and 1.
pub(super) fn logit(opacity: f64) -> f64 {
    let o = opacity.clamp(LOGIT_MARGIN, 1.0 - LOGIT_MARGIN);
    (o / (1.0 - o)).ln()
}

/// Inverse of [`logit`].
pub(super) fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// sRGB transfer function (IEC 61966-2-1), decoded value of an encoded channel in `[0, 1]`.
pub(super) fn srgb_to_linear(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Inverse of [`srgb_to_linear`].
pub(super) fn linear_to_srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// A change of axes: a rotation. Between axes of the world it only permutes and negates coordinates,
/// so positions stay exact.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    matrix: DMat3,
    quaternion: DQuat,
}

impl Turn {
    /// No turn: the file has the model's own axes.
    pub const NONE: Turn = Turn { matrix: DMat3::IDENTITY, quaternion: DQuat::IDENTITY };

    /// z-up to the y-up of glTF: `(x, y, z)` becomes `(x, z, −y)`.
    pub const Z_UP_TO_Y_UP: Turn = Turn {
        matrix: DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
        quaternion: DQuat::from_xyzw(-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2),
    };

    /// The y-up of glTF to z-up.
    pub const Y_UP_TO_Z_UP: Turn = Turn {
        matrix: DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
        quaternion: DQuat::from_xyzw(FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2),
    };

    /// z-up to the y-down world of splat viewers: `(x, y, z)` becomes `(−x, −z, −y)`.
    pub const Z_UP_TO_Y_DOWN: Turn = Turn {
        matrix: DMat3::from_cols(DVec3::NEG_X, DVec3::NEG_Z, DVec3::NEG_Y),
        quaternion: DQuat::from_xyzw(0.0, FRAC_1_SQRT_2, -FRAC_1_SQRT_2, 0.0),
    };

    /// Turns `up`, a unit vector, to z by the shortest way.
    pub fn to_z_up(up: DVec3) -> Turn {
        let quaternion = DQuat::from_rotation_arc(up, DVec3::Z);
        // Half turns have many axes; x keeps it where it is.
        let quaternion = if up == DVec3::NEG_Z { DQuat::from_rotation_x(PI) } else { quaternion };
        let matrix = DMat3::from_quat(quaternion);
        // Rounding must not make 1e-17 of what is a permutation of axes.
        let is_axis = up.abs().max_element() == 1.0;
        let exact = |v: DVec3| if is_axis { v.round() } else { v };
        let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(exact);
        if up == DVec3::Z {
            return Turn::NONE;
        }
        Turn { matrix: DMat3::from_cols(columns[0], columns[1], columns[2]), quaternion }
    }

    /// This turn and then another.
    pub fn then(self, next: Turn) -> Turn {
        Turn { matrix: next.matrix * self.matrix, quaternion: next.quaternion * self.quaternion }
    }

    /// The turn back.
    pub fn inverse(self) -> Turn {
        Turn { matrix: self.matrix.transpose(), quaternion: self.quaternion.conjugate() }
    }

    /// Whether nothing turns.
    pub fn is_none(&self) -> bool {
        self.matrix == DMat3::IDENTITY
    }

    /// A position or direction in the new axes.
    pub fn vector(&self, v: DVec3) -> DVec3 {
        // Adding zero turns −0 into 0, which some JSON readers print differently.
        self.matrix * v + DVec3::ZERO
    }

    /// An orientation in the new axes.
    pub fn rotation(&self, q: DQuat) -> DQuat {
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
            let turn = Turn::to_z_up(up);
            assert!((turn.vector(up) - DVec3::Z).length() < 1e-15, "{up}");
            [turn, turn.then(Turn::Z_UP_TO_Y_UP)]
        });
        let named = [Turn::NONE, Turn::Z_UP_TO_Y_UP, Turn::Y_UP_TO_Z_UP, Turn::Z_UP_TO_Y_DOWN];
        for turn in named.into_iter().chain(arcs) {
            let difference = DMat3::from_quat(turn.quaternion) - turn.matrix;
            assert!(difference.to_cols_array().iter().all(|v| v.abs() < 1e-15), "{turn:?}");
            assert!((turn.matrix.determinant() - 1.0).abs() < 1e-15, "{turn:?}");
        }
        let there_and_back = Turn::Y_UP_TO_Z_UP.matrix * Turn::Z_UP_TO_Y_UP.matrix;
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
    fn a_quaternion_without_direction_is_none_and_nan_is_kept() {
        assert!(unit_quaternion([0.0; 4]).is_none());
        assert!(unit_quaternion([f64::NAN, 0.0, 0.0, 0.0]).unwrap().is_nan());
        assert_eq!(unit_quaternion([2.0, 0.0, 0.0, 0.0]).unwrap(), DQuat::IDENTITY);
    }
}
