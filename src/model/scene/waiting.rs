//! Photographs that a scene has still to learn from (`train/scene/photometric/photometric.md`, Order).

use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::{Pose, PoseError};
use bytemuck::{Pod, Zeroable};
use glam::DMat4;

/// Rows of which at most one is kept, and columns and rows of an image at most.
const MOST_EVERY: u32 = 16;
const MOST_SIDE: u32 = 1 << 16;
/// Level of a coverage that is not known; all others are 254ths.
pub const UNKNOWN_COVERAGE: u8 = u8::MAX;

/// Where a photograph was taken from, and which part of it is kept: numbers, as checkpoints hold them.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PhotographView {
    /// Frames that were learnt before the photograph's own.
    pub frame: f64,
    /// Columns and rows of the image.
    pub size: [f64; 2],
    /// Focal lengths and principal point, pixels.
    pub pinhole: [f64; 4],
    /// From the camera's OpenCV axes to the world's: a matrix by columns, world units.
    pub pose: [f64; 16],
    /// Factors of red, green and blue to the scene's exposure.
    pub gain: [f64; 3],
    /// What is nearer than so many world units is not compared.
    pub near: f64,
    /// Every how many rows one is kept, and the first.
    pub rows: [f64; 2],
}

impl PhotographView {
    /// Of a camera that took the photograph of the frame after so many.
    pub fn new(frame: u64, camera: &Camera, gain: [f32; 3], near: f64, rows: [u32; 2]) -> Self {
        let Intrinsics { width, height, fx, fy, cx, cy } = camera.intrinsics;
        Self {
            frame: frame as f64,
            size: [width.into(), height.into()],
            pinhole: [fx, fy, cx, cy],
            pose: camera.pose.to_opencv().to_cols_array(),
            gain: gain.map(f64::from),
            near,
            rows: rows.map(f64::from),
        }
    }

    /// The camera.
    ///
    /// # Errors
    /// [`PoseError`] for a matrix that is no pose.
    pub fn camera(&self) -> Result<Camera, PoseError> {
        let ([width, height], [fx, fy, cx, cy]) = (self.size.map(|n| n as u32), self.pinhole);
        let pose = Pose::from_opencv(DMat4::from_cols_array(&self.pose))?;
        Ok(Camera { intrinsics: Intrinsics { width, height, fx, fy, cx, cy }, pose })
    }

    /// Rows that are kept, from the top.
    pub fn kept_rows(&self) -> impl Iterator<Item = usize> + use<> {
        let [every, first] = self.rows.map(|n| n as usize);
        (first..self.size[1] as usize).step_by(every.max(1))
    }

    /// Pixels that are kept.
    pub fn n_pixels(&self) -> usize {
        let [every, first] = self.rows.map(|n| n as usize);
        let [width, height] = self.size.map(|n| n as usize);
        height.saturating_sub(first).div_ceil(every.max(1)).saturating_mul(width)
    }

    /// The first of its numbers that is none of a photograph's, by name, with what was expected.
    pub fn defect(&self) -> Option<(&'static str, String, f64)> {
        let [every, first] = self.rows;
        let is_whole = |x: f64, low: f64, high: f64| x.fract() == 0.0 && (low..=high).contains(&x);
        let is_positive = |x: f64| x > 0.0 && x.is_finite();
        let most = f64::from(MOST_EVERY);
        let whole = |high: f64| format!("a whole number up to {high}");
        let all = [
            ("frame", self.frame, is_whole(self.frame, 0.0, 2f64.powi(53)), whole(2f64.powi(53))),
            ("rows", every, is_whole(every, 1.0, most), whole(most)),
            ("first row", first, is_whole(first, 0.0, every - 1.0), whole(every - 1.0)),
            ("near", self.near, self.near >= 0.0 && self.near.is_finite(), "0 or more".to_owned()),
        ];
        let sides = self.size.map(|n| {
            let most = f64::from(MOST_SIDE);
            ("size", n, is_whole(n, 1.0, most), whole(most))
        });
        let gains = self.gain.map(|g| ("gain", g, is_positive(g), "a positive number".to_owned()));
        let [fx, fy, cx, cy] = self.pinhole;
        let focal =
            [fx, fy].map(|f| ("focal length", f, is_positive(f), "a positive number".to_owned()));
        let centre = [cx, cy].map(|c| ("centre", c, c.is_finite(), "a finite number".to_owned()));
        let numbers = all.into_iter().chain(sides).chain(gains).chain(focal).chain(centre);
        let no_pose = || {
            let expected = "a rotation and a place".to_owned();
            self.camera().is_err().then_some(("pose", expected, self.pose[0]))
        };
        let found = numbers.filter(|(_, _, is_sound, _)| !is_sound);
        found.map(|(name, found, _, expected)| (name, expected, found)).next().or_else(no_pose)
    }
}

/// A photograph that waits to be learnt.
#[derive(Clone, Debug, PartialEq)]
pub struct WaitingPhotograph {
    /// Where it was taken from.
    pub view: PhotographView,
    /// Red, green and blue, sRGB-encoded in 255ths, and coverage in 254ths or [`UNKNOWN_COVERAGE`], of
    /// the rows that are kept.
    pub pixels: Vec<[u8; 4]>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn view() -> PhotographView {
        let intrinsics = Intrinsics { cx: 7.25, ..Intrinsics::from_horizontal_fov(20, 13, 0.8) };
        let pose = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Z).unwrap();
        PhotographView::new(7, &Camera { intrinsics, pose }, [1.0, 1.1, 0.9], 0.2, [4, 3])
    }

    #[test]
    fn cameras_come_back() {
        let camera = view().camera().unwrap();
        assert_eq!((camera.intrinsics.cx, camera.intrinsics.height), (7.25, 13));
        assert!((camera.pose.centre() - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
        assert_eq!(view().kept_rows().collect::<Vec<_>>(), [3, 7, 11]);
        assert_eq!((view().n_pixels(), view().defect()), (60, None));
    }

    type Change = fn(&mut PhotographView);

    #[test]
    fn numbers_of_no_photograph_are_named() {
        let named = |change: Change| {
            let mut view = view();
            change(&mut view);
            view.defect().map(|(name, ..)| name)
        };
        let changes: [(&str, Change); 10] = [
            ("frame", |view| view.frame = 0.5),
            ("size", |view| view.size[1] = 0.0),
            ("size", |view| view.size[0] = 1e9),
            ("rows", |view| view.rows[0] = 17.0),
            ("first row", |view| view.rows[1] = 4.0),
            ("near", |view| view.near = f64::NAN),
            ("gain", |view| view.gain[2] = 0.0),
            ("focal length", |view| view.pinhole[0] = f64::INFINITY),
            ("centre", |view| view.pinhole[3] = f64::NAN),
            ("pose", |view| view.pose[0] = 3.0),
        ];
        for (name, change) in changes {
            assert_eq!(named(change), Some(name));
        }
    }
}
