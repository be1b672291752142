//! Rigid camera poses, validated once on input.
//!
//! A [`Pose`] always has an orthonormal rotation and a finite position, so later code needs no checks.
//! Rounded matrices are replaced by the nearest rotation. Larger deviations are errors: scale or a
//! mirror image means a wrong axis convention, not rounding.

use super::sym3::Sym3;
use glam::{DMat3, DMat4, DQuat, DVec3};

/// Largest entry of `|RᵀR − I|` that is accepted as rounding in a rotation matrix `R`. Files round poses
/// to 4–7 digits; sensor logs deviate by up to 1e-4. A tolerance of 1e-2 exceeds both deviations and
/// still rejects scaled matrices.
pub const ORTHONORMALITY_TOLERANCE: f64 = 1e-2;

/// Reason why a matrix is not a camera pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// An entry is NaN or infinite: its value, row and column.
    #[error("expected 16 finite numbers, found {0} at row {1}, column {2}")]
    NotFinite(f64, usize, usize),
    /// The last row is not 0 0 0 1.
    #[error("expected the last row 0 0 0 1, found {0:?}: is the matrix transposed?")]
    LastRow([f64; 4]),
    /// The columns are not orthonormal (singular, scaled or sheared), or the matrix mirrors space.
    #[error(
        "expected a rotation (orthonormal columns, determinant 1), found determinant {determinant:.6} and |RᵀR − I| = {deviation:.2e}"
    )]
    NotRigid {
        /// Determinant of the 3×3 part.
        determinant: f64,
        /// Largest entry of `|RᵀR − I|`.
        deviation: f64,
    },
}

// Largest deviation of a quaternion's length from 1 accepted as rounding.
const UNIT: f64 = 1e-6;

/// Converts a unit quaternion x, y, z, w to a rotation; `None` if its length is not 1.
pub fn unit_rotation(quaternion: [f64; 4]) -> Option<DQuat> {
    let rotation = DQuat::from_array(quaternion);
    // NaN fails this comparison, too.
    ((rotation.length() - 1.0).abs() < UNIT).then(|| rotation.normalize())
}

/// Rigid transform `world_from_camera` in OpenCV axes: x right, y down, z forward.
///
/// ```
/// use glam::{DMat4, DVec3};
/// use vbgs_studio::math::pose::Pose;
///
/// let eye = DVec3::new(0.0, -2.0, 1.0);
/// let pose = Pose::look_at(eye, DVec3::Z, DVec3::Z).ok_or("view direction parallel to up")?;
/// // The target lies two units ahead of the camera.
/// assert!((pose.transform_point(2.0 * DVec3::Z) - DVec3::Z).length() < 1e-12);
/// assert!(Pose::from_opencv(DMat4::from_scale(DVec3::splat(2.0))).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    rotation: DMat3,
    translation: DVec3,
}

impl Pose {
    /// A camera at the origin facing +z.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// Validates an OpenCV camera-to-world matrix and re-orthonormalises its rotation.
    pub fn from_opencv(world_from_camera: DMat4) -> Result<Self, PoseError> {
        let columns = world_from_camera.to_cols_array_2d();
        for (column, values) in columns.iter().enumerate() {
            if let Some(row) = values.iter().position(|v| !v.is_finite()) {
                return Err(PoseError::NotFinite(values[row], row, column));
            }
        }
        // Checked first: a transposed matrix has its translation here, and this error hints at that.
        let last_row = [columns[0][3], columns[1][3], columns[2][3], columns[3][3]];
        if (0..4).any(|i| (last_row[i] - if i == 3 { 1.0 } else { 0.0 }).abs() > 1e-6) {
            return Err(PoseError::LastRow(last_row));
        }
        let rotation = DMat3::from_mat4(world_from_camera);
        let gram = rotation.transpose() * rotation - DMat3::IDENTITY;
        let deviation = gram.to_cols_array().iter().fold(0.0f64, |a, v| a.max(v.abs()));
        let determinant = rotation.determinant();
        // A mirror image is orthonormal; its determinant is −1.
        if deviation > ORTHONORMALITY_TOLERANCE || determinant <= 0.0 {
            return Err(PoseError::NotRigid { determinant, deviation });
        }
        Ok(Self {
            rotation: nearest_rotation(rotation),
            translation: world_from_camera.w_axis.truncate(),
        })
    }

    /// Validates a camera-to-world matrix in OpenGL/Blender axes (x right, y up, −z forward) and
    /// re-orthonormalises its rotation.
    pub fn from_opengl(world_from_camera: DMat4) -> Result<Self, PoseError> {
        let flip = DMat4::from_diagonal(glam::DVec4::new(1.0, -1.0, -1.0, 1.0));
        Self::from_opencv(world_from_camera * flip)
    }

    /// Places a camera at `eye` facing `target`, with `up` pointing up in the image.
    ///
    /// Returns `None` if the view direction is zero or parallel to `up`.
    pub fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> Option<Self> {
        let forward = (target - eye).try_normalize()?;
        let right = forward.cross(up).try_normalize()?;
        let down = forward.cross(right);
        Some(Self { rotation: DMat3::from_cols(right, down, forward), translation: eye })
    }

    /// Returns the rotation; its columns are the camera's right, down and forward axes in the world.
    pub fn rotation(&self) -> DMat3 {
        self.rotation
    }

    /// Returns the camera centre in the world.
    pub fn centre(&self) -> DVec3 {
        self.translation
    }

    /// Returns the pose of the same camera in a world whose origin is moved to `origin`.
    pub fn with_origin(&self, origin: DVec3) -> Self {
        Self { translation: self.translation - origin, ..*self }
    }

    /// Returns the viewing direction in the world.
    pub fn forward(&self) -> DVec3 {
        self.rotation.z_axis
    }

    /// Returns the pose of a camera rigidly attached to this one: its centre is at `offset` in this
    /// camera's frame (world units), its axes are rotated by `turn`.
    pub fn attached_camera(&self, offset: DVec3, turn: DQuat) -> Self {
        let rotation = self.rotation * DMat3::from_quat(turn.normalize());
        Self { rotation, translation: self.transform_point(offset) }
    }

    /// Returns the pose after a rigid motion of the world. `motion` maps old world coordinates to new
    /// ones.
    pub fn transformed_by(&self, motion: &Self) -> Self {
        let rotation = motion.rotation * self.rotation;
        Self { rotation, translation: motion.transform_point(self.translation) }
    }

    /// Inverse of [`Self::attached_camera`]: returns the centre of `other` in this camera's frame (world
    /// units), and its rotation relative to this camera.
    pub fn offset_to(&self, other: &Self) -> (DVec3, DQuat) {
        let back = self.rotation.transpose();
        let turn = DQuat::from_mat3(&(back * other.rotation)).normalize();
        (back * (other.translation - self.translation), turn)
    }

    /// Transforms camera coordinates to world coordinates.
    pub fn transform_point(&self, camera_point: DVec3) -> DVec3 {
        self.rotation * camera_point + self.translation
    }

    /// Returns the inverse transform, from world to camera coordinates, as rotation and translation.
    pub fn inverse(&self) -> (DMat3, DVec3) {
        let rotation = self.rotation.transpose();
        (rotation, -(rotation * self.translation))
    }

    /// Returns the OpenCV camera-to-world matrix.
    pub fn to_opencv(&self) -> DMat4 {
        let mut m = DMat4::from_mat3(self.rotation);
        m.w_axis = self.translation.extend(1.0);
        m
    }

    /// Returns the OpenGL camera-to-world matrix, as used by NeRF-synthetic files.
    pub fn to_opengl(&self) -> DMat4 {
        self.to_opencv() * DMat4::from_diagonal(glam::DVec4::new(1.0, -1.0, -1.0, 1.0))
    }
}

// One Newton step of the polar decomposition squares the (already small) deviation; the
// quaternion then makes the result orthonormal to the last bit.
fn nearest_rotation(m: DMat3) -> DMat3 {
    let polar = (m + m.inverse().transpose()) * 0.5;
    DMat3::from_quat(DQuat::from_mat3(&polar).normalize())
}

/// Returns the rotation `R` that maximises `tr(Rᵀ·M)`, from the right singular vectors of `M`: with
/// `M = Σ to·fromᵀ` it fits centred pairs of points best (Horn, Umeyama).
pub fn best_rotation(m: DMat3) -> DMat3 {
    let right = Sym3::from_mat3(m.transpose() * m).eigen().vectors;
    // From the two largest axes; the third follows, which excludes a reflection.
    let x = (m * right.x_axis).try_normalize().unwrap_or(DVec3::X);
    let across = m * right.y_axis;
    // Collinear points leave the rotation about their line open, so any serves.
    let y = (across - x * x.dot(across)).try_normalize().unwrap_or(x.any_orthonormal_vector());
    DMat3::from_cols(x, y, x.cross(y)) * right.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accepts_rounded_rotations_and_refuses_the_rest() {
        let mut m = DMat4::from_rotation_y(0.3);
        m.w_axis.x = 2.0;
        m.x_axis.x += 1e-4;
        let pose = Pose::from_opencv(m).unwrap();
        let gram = pose.rotation().transpose() * pose.rotation();
        assert!((gram - DMat3::IDENTITY).to_cols_array().iter().all(|v| v.abs() < 1e-14));
        assert_eq!(pose.centre(), DVec3::new(2.0, 0.0, 0.0));

        assert!(matches!(Pose::from_opencv(m * 2.0), Err(PoseError::LastRow(_))));
        let scaled = DMat4::from_scale(DVec3::splat(1.1));
        assert!(matches!(Pose::from_opencv(scaled), Err(PoseError::NotRigid { .. })));
        let mirrored = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        assert!(matches!(Pose::from_opencv(mirrored), Err(PoseError::NotRigid { .. })));
        let mut nan = m;
        nan.y_axis.z = f64::NAN;
        assert!(matches!(Pose::from_opencv(nan), Err(PoseError::NotFinite(_, 2, 1))));
        assert!(matches!(Pose::from_opencv(DMat4::ZERO), Err(PoseError::LastRow(_))));
    }

    #[test]
    fn look_at_faces_the_target_with_up_upwards() {
        let pose = Pose::look_at(DVec3::new(3.0, 0.0, 1.0), DVec3::ZERO, DVec3::Z).unwrap();
        let (r, t) = pose.inverse();
        let target = r * DVec3::ZERO + t;
        assert!(target.x.abs() < 1e-12 && target.y.abs() < 1e-12 && target.z > 0.0);
        let above = r * DVec3::new(0.0, 0.0, 0.5) + t;
        assert!(above.y < 0.0, "up in the world is negative y in the image");
        assert!((pose.rotation().determinant() - 1.0).abs() < 1e-12);
        assert!(Pose::look_at(DVec3::Z, DVec3::ZERO, DVec3::Z).is_none());
    }

    /// A point in the attached camera's frame transforms like the same point in the base camera's frame.
    #[test]
    fn an_attached_camera_rides_along() {
        let pose = Pose::look_at(DVec3::new(3.0, 0.0, 1.0), DVec3::ZERO, DVec3::Z).unwrap();
        let (offset, turn) = (DVec3::new(0.1, -0.2, 0.5), DQuat::from_rotation_y(0.3));
        let attached = pose.attached_camera(offset, turn);
        let point = DVec3::new(0.4, 0.5, -1.0);
        let expected = pose.transform_point(offset + turn * point);
        assert!((attached.transform_point(point) - expected).length() < 1e-14);
        assert_eq!(pose.attached_camera(DVec3::ZERO, DQuat::IDENTITY), pose);
        let moved = pose.with_origin(DVec3::new(1.0, -2.0, 0.5));
        assert_eq!(moved.centre(), DVec3::new(2.0, 2.0, 0.5));
        assert_eq!(moved.rotation(), pose.rotation());
    }

    #[test]
    fn axis_conventions_round_trip() {
        let gl = DMat4::from_rotation_x(0.4) * DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0));
        let pose = Pose::from_opengl(gl).unwrap();
        assert!((pose.to_opengl() - gl).to_cols_array().iter().all(|v| v.abs() < 1e-14));
        assert!((pose.forward() + gl.z_axis.truncate()).length() < 1e-14);
    }
}
