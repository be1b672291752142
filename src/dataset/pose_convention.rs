//! Conventions of a recording's 4×4 pose matrices: camera axes and direction of the transform.
//!
//! Every layout has one convention, and exporters get it wrong: a recording with OpenGL axes in an OpenCV
//! layout loads without an error and yields a useless model. All conventions are rigid and invertible, so a
//! pose read by one can be converted to another without its file.

use crate::math::pose::{Pose, PoseError};
use glam::{DMat4, DVec4};
use serde::{Deserialize, Serialize};

/// Convention of a recording's pose matrices.
///
/// ```
/// use vbgs_studio::dataset::PoseConvention;
/// use vbgs_studio::math::pose::Pose;
///
/// let opengl = PoseConvention::Opengl.matrix(&Pose::IDENTITY);
/// assert_eq!(PoseConvention::Opengl.pose(opengl), Ok(Pose::IDENTITY));
/// assert_ne!(PoseConvention::Opencv.pose(opengl), Ok(Pose::IDENTITY));
/// ```
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, strum::EnumIter, strum::IntoStaticStr,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum PoseConvention {
    /// Camera to world, x right, y down, z forward.
    Opencv,
    /// Camera to world, x right, y up, viewing along −z.
    Opengl,
    /// World to camera, x right, y down, z forward.
    OpencvWorldToCamera,
    /// World to camera, x right, y up, viewing along −z.
    OpenglWorldToCamera,
    /// Camera to world, x forward, y left, z up, as for the body of a robot.
    Robot,
}

impl PoseConvention {
    /// Name in options and messages, such as `opencv-world-to-camera`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Converts a matrix of this convention to a pose.
    ///
    /// # Errors
    /// A matrix that is not a rigid motion.
    pub fn pose(self, matrix: DMat4) -> Result<Pose, PoseError> {
        let axes = self.axes();
        match self.is_world_to_camera() {
            false => Pose::from_opencv(matrix * axes),
            // Checked before the inversion, so that the error reports the numbers of the file.
            true => Pose::from_opencv(inverse(&Pose::from_opencv(matrix)?) * axes),
        }
    }

    /// Converts a pose to a matrix of this convention.
    pub fn matrix(self, pose: &Pose) -> DMat4 {
        let world_from_camera = pose.to_opencv() * self.axes().transpose();
        match self.is_world_to_camera() {
            false => world_from_camera,
            true => world_from_camera.inverse(),
        }
    }

    fn is_world_to_camera(self) -> bool {
        matches!(self, Self::OpencvWorldToCamera | Self::OpenglWorldToCamera)
    }

    /// Transform from OpenCV camera axes to those of this convention.
    fn axes(self) -> DMat4 {
        match self {
            Self::Opencv | Self::OpencvWorldToCamera => DMat4::IDENTITY,
            Self::Opengl | Self::OpenglWorldToCamera => {
                DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0))
            }
            Self::Robot => DMat4::from_cols(-DVec4::Y, -DVec4::Z, DVec4::X, DVec4::W),
        }
    }
}

fn inverse(pose: &Pose) -> DMat4 {
    let (rotation, translation) = pose.inverse();
    let mut m = DMat4::from_mat3(rotation);
    m.w_axis = translation.extend(1.0);
    m
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use strum::IntoEnumIterator;

    #[test]
    fn every_convention_reads_back_what_it_writes() {
        let pose = Pose::look_at(DVec3::new(3.0, 0.5, 1.0), DVec3::ZERO, DVec3::Z).unwrap();
        for convention in PoseConvention::iter() {
            let back = convention.pose(convention.matrix(&pose)).unwrap();
            let error = back.to_opencv() - pose.to_opencv();
            let largest = error.to_cols_array().iter().fold(0.0f64, |a, v| a.max(v.abs()));
            assert!(largest < 1e-12, "{}: {largest}", convention.name());
        }
        assert_eq!(PoseConvention::OpencvWorldToCamera.name(), "opencv-world-to-camera");
    }
}
