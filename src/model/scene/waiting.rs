//! Shuffle buffer of photographs for photometric training (`photographs.md`, Shuffle buffer).

use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::{Pose, PoseError};
use bytemuck::{Pod, Zeroable};
use glam::DMat4;
use std::fmt::{self, Display, Formatter};
use std::sync::Arc;

const MOST_EVERY: u32 = 16;
const MOST_SIDE: u32 = 1 << 16;
/// Maximum frame number: f64 represents all whole numbers up to this one.
const MOST_FRAMES: f64 = (1u64 << 53) as f64;
/// Minimum number of depth steps per margin, where the margin is the tolerance of a surface's depth.
const STEPS_PER_MARGIN: f64 = 16.0;
/// Coverage byte that marks unknown coverage; all other values are 254ths.
pub const UNKNOWN_COVERAGE: u8 = u8::MAX;

/// An invalid number: name, expected range, found value.
pub type NumberDefect = (&'static str, String, f64);

/// Camera of a buffered photograph and selection of its stored rows, as numbers in a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PhotographView {
    /// Number of frames trained on before the frame of the photograph.
    pub frame: f64,
    /// Columns and rows of the image.
    pub size: [f64; 2],
    /// Focal lengths and principal point, pixels.
    pub pinhole: [f64; 4],
    /// Transform from the camera's OpenCV axes to the world's: 4×4 matrix by columns, world units.
    pub pose: [f64; 16],
    /// Factors on red, green and blue that convert the photograph to the scene's exposure.
    pub gain: [f64; 3],
    /// Distance from the camera, world units, below which splats are left out of the comparison.
    pub near: f64,
    /// Row stride and first row of the stored rows.
    pub rows: [f64; 2],
    /// Number of pixels of the photograph per pixel of the depth image, at least 1.
    pub per_depth_pixel: f64,
}

impl PhotographView {
    /// Creates the view of a photograph with as many pixels as its depth image. `frame` is the number
    /// of frames trained on before this photograph.
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
            per_depth_pixel: 1.0,
        }
    }

    /// Returns the camera.
    ///
    /// # Errors
    /// [`PoseError`] if the matrix is not a pose.
    pub fn camera(&self) -> Result<Camera, PoseError> {
        // Casts saturate; loading has rejected sizes that are not whole numbers.
        let ([width, height], [fx, fy, cx, cy]) = (self.size.map(|n| n as u32), self.pinhole);
        let pose = Pose::from_opencv(DMat4::from_cols_array(&self.pose))?;
        Ok(Camera { intrinsics: Intrinsics { width, height, fx, fy, cx, cy }, pose })
    }

    /// Returns the view with a camera moved by `motion`, which maps old to new world coordinates.
    pub fn moved(&self, motion: &Pose) -> Self {
        let pose = motion.to_opencv() * DMat4::from_cols_array(&self.pose);
        Self { pose: pose.to_cols_array(), ..*self }
    }

    /// Iterates over the indices of the stored rows, from the top.
    pub fn stored_rows(&self) -> impl ExactSizeIterator<Item = usize> + use<> {
        let [every, first] = self.rows.map(|n| n as usize);
        // A file is read before it is checked, and a stride of 0 would panic.
        (first..self.size[1] as usize).step_by(every.max(1))
    }

    /// Returns the number of stored pixels.
    pub fn n_pixels(&self) -> usize {
        // Sizes of an unchecked file may overflow the product.
        self.stored_rows().len().saturating_mul(self.size[0] as usize)
    }

    /// Returns the first invalid number with its name and expected range, if any.
    pub fn first_invalid_number(&self) -> Option<NumberDefect> {
        use NumberRange::{Finite, NotNegative, Positive, PowerOfTwo, Whole};
        let ([every, first], [width, height]) = (self.rows, self.size);
        let ([red, green, blue], [fx, fy, cx, cy]) = (self.gain, self.pinhole);
        let side = Whole { low: 1.0, high: f64::from(MOST_SIDE) };
        let numbers = [
            ("frame", self.frame, Whole { low: 0.0, high: MOST_FRAMES }),
            // Any other stride would select rows of the next lower power of two, which are not those stored.
            ("rows", every, PowerOfTwo { high: MOST_EVERY }),
            ("first row", first, Whole { low: 0.0, high: every - 1.0 }),
            ("near", self.near, NotNegative),
            ("pixels for each of depth", self.per_depth_pixel, Positive),
            ("size", width, side),
            ("size", height, side),
            ("gain", red, Positive),
            ("gain", green, Positive),
            ("gain", blue, Positive),
            ("focal length", fx, Positive),
            ("focal length", fy, Positive),
            ("centre", cx, Finite),
            ("centre", cy, Finite),
        ];
        let mut wrong = numbers.into_iter().filter(|(_, number, range)| !range.holds(*number));
        if let Some((name, found, range)) = wrong.next() {
            return Some((name, range.to_string(), found));
        }
        // Last, since it is a property of all sixteen numbers.
        let is_posed = self.camera().is_ok();
        (!is_posed).then(|| ("pose", "a rotation and a place".to_owned(), self.pose[0]))
    }
}

#[derive(Clone, Copy)]
enum NumberRange {
    Whole { low: f64, high: f64 },
    PowerOfTwo { high: u32 },
    NotNegative,
    Positive,
    Finite,
}

impl NumberRange {
    fn holds(self, x: f64) -> bool {
        match self {
            Self::Whole { low, high } => x.fract() == 0.0 && (low..=high).contains(&x),
            Self::PowerOfTwo { high } => {
                (0..=high.ilog2()).any(|power| x == f64::from(1u32 << power))
            }
            Self::NotNegative => x >= 0.0 && x.is_finite(),
            Self::Positive => x > 0.0 && x.is_finite(),
            Self::Finite => x.is_finite(),
        }
    }
}

impl Display for NumberRange {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole { high, .. } => write!(f, "a whole number up to {high}"),
            Self::PowerOfTwo { high } => write!(f, "a power of two up to {high}"),
            Self::NotNegative => f.write_str("0 or more"),
            Self::Positive => f.write_str("a positive number"),
            Self::Finite => f.write_str("a finite number"),
        }
    }
}

/// Depths of the stored pixels of a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct BufferedDepths {
    /// Size of a depth step, and the tolerance within which depths belong to one surface.
    pub scale: DepthScale,
    /// Depth along the optical axis, in steps; 0 if unknown. Copies of a scene share the values, as
    /// they share the pixels.
    pub steps: Arc<[u16]>,
}

/// Parameters of [`BufferedDepths`], stored as numbers in a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct DepthScale {
    /// World units per step.
    pub step: f64,
    /// A surface within `margin[0] + margin[1]·depth` world units of the measured depth is regarded as
    /// the measured surface.
    pub margin: [f64; 2],
}

impl DepthScale {
    /// Creates the scale for a margin, with steps that are small relative to the margin.
    pub fn new(margin: [f32; 2]) -> Self {
        let margin = margin.map(f64::from);
        Self { step: margin[0] / STEPS_PER_MARGIN, margin }
    }

    /// Converts a depth in world units to steps; 0 if the depth is invalid or out of range.
    pub fn steps(&self, depth: f32) -> u16 {
        let steps = (f64::from(depth) / self.step).round();
        // NaN becomes 0 as well.
        if steps >= 1.0 && steps <= f64::from(u16::MAX) { steps as u16 } else { 0 }
    }

    /// Converts steps to world units.
    pub fn depth(&self, steps: u16) -> f32 {
        (f64::from(steps) * self.step) as f32
    }

    /// Returns the first invalid number with its name and expected range, if any.
    pub fn defect(&self) -> Option<NumberDefect> {
        use NumberRange::{NotNegative, Positive};
        let [least, linear] = self.margin;
        let numbers = [
            ("step", self.step, Positive),
            ("margin", least, Positive),
            ("margin", linear, NotNegative),
        ];
        let wrong = numbers.into_iter().find(|(_, number, range)| !range.holds(*number));
        wrong.map(|(name, number, range)| (name, range.to_string(), number))
    }
}

/// A photograph in the shuffle buffer.
#[derive(Clone, Debug, PartialEq)]
pub struct BufferedPhotograph {
    /// Camera and stored rows.
    pub view: PhotographView,
    /// Red, green and blue (sRGB-encoded, in 255ths) and coverage (in 254ths, or [`UNKNOWN_COVERAGE`])
    /// of each pixel in the stored rows; [`MASKED`](crate::math::measured_pixel::MASKED) if left out.
    /// Copies of a scene share the pixels, which never change.
    pub pixels: Arc<[[u8; 4]]>,
    /// Depths of the pixels in the stored rows, if measured.
    pub depths: Option<BufferedDepths>,
}

impl BufferedPhotograph {
    /// Returns the memory used by pixels and depths, in bytes.
    pub fn bytes(&self) -> usize {
        let depths = self.depths.as_ref().map_or(0, |depths| size_of_val(&depths.steps[..]));
        size_of_val(&self.pixels[..]) + depths
    }
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
        assert_eq!(view().stored_rows().collect::<Vec<_>>(), [3, 7, 11]);
        assert_eq!((view().n_pixels(), view().first_invalid_number()), (60, None));
    }

    type Change = fn(&mut PhotographView);

    #[test]
    fn numbers_of_no_photograph_are_named() {
        let named = |change: Change| {
            let mut view = view();
            change(&mut view);
            view.first_invalid_number().map(|(name, ..)| name)
        };
        let changes: [(&str, Change); 12] = [
            ("frame", |view| view.frame = 0.5),
            ("size", |view| view.size[1] = 0.0),
            ("size", |view| view.size[0] = 1e9),
            ("rows", |view| view.rows = [17.0, 0.0]),
            ("rows", |view| view.rows = [32.0, 0.0]),
            ("rows", |view| view.rows = [3.0, 0.0]),
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
