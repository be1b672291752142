//! Undistorts images when a frame is loaded: lens distortion and rolling shutter.
//!
//! Everything after loading assumes a pinhole camera. The image is resampled to the pinhole of the same
//! intrinsics: colours bilinearly, depth by nearest neighbour, since the mean of two surfaces is on
//! neither. Radial and tangential terms follow Brown and Conrady in OpenCV's form: `r² = x² + y²`,
//! `x' = x(1 + k₁r² + k₂r⁴ + k₃r⁶)/(1 + k₄r² + k₅r⁴ + k₆r⁶) + 2p₁xy + p₂(r² + 2x²)`.

use super::entry::FrameEntry;
use super::opened::{Dataset, open};
use super::options::LoadOptions;
use super::video::RollingShutter;
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use glam::{DVec2, Vec4};
use rayon::prelude::*;
use std::collections::BTreeMap;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Distortion {
    /// Radial coefficients `k₁` to `k₆` for normalised image coordinates (pixels over focal length).
    pub radial: [f64; 6],
    pub tangential: [f64; 2],
    pub color: RollingShutter,
    pub depth: RollingShutter,
}

/// Largest ratio, in either direction, between the distances of a pixel of the image's border from the
/// optical axis with and without distortion. Perspective lenses stay below 1.5.
const MOST_BENT: f64 = 2.0;

impl Distortion {
    /// Creates a lens from OpenCV's terms `k1 k2 p1 p2 k3 k4 k5 k6`; those at the end may be missing.
    pub fn of_opencv(terms: &[f64]) -> Self {
        let term = |i: usize| terms.get(i).copied().unwrap_or(0.0);
        let radial = [0, 1, 4, 5, 6, 7].map(term);
        Self { radial, tangential: [2, 3].map(term), ..Self::default() }
    }

    fn is_pinhole(&self) -> bool {
        (self.radial, self.tangential) == ([0.0; 6], [0.0; 2])
    }

    /// True if the lens maps the image of `k` to about itself: distances from the optical axis grow
    /// towards the corners and sides, and end near their undistorted values.
    pub fn is_plausible(&self, k: &Intrinsics) -> bool {
        const STEPS: i32 = 16;
        let ends =
            |c: f64, side: u32, focal: f64| [-c, 0.0, f64::from(side) - c].map(|d| d / focal);
        let (xs, ys) = (ends(k.cx, k.width, k.fx), ends(k.cy, k.height, k.fy));
        let mut border = xs.into_iter().flat_map(|x| ys.map(|y| DVec2::new(x, y)));
        self.is_pinhole()
            || border.all(|end| {
                let bent = |i: i32| self.distort(end * f64::from(i) / f64::from(STEPS)).dot(end);
                let (straight, reached) = (end.length_squared(), bent(STEPS));
                // Comparisons with NaN are false. The optical axis itself has no direction.
                straight == 0.0
                    || (0..STEPS).all(|i| bent(i) < bent(i + 1))
                        && reached < MOST_BENT * straight
                        && straight < MOST_BENT * reached
            })
    }

    pub fn distort(&self, slope: DVec2) -> DVec2 {
        let DVec2 { x, y } = slope;
        let ([k1, k2, k3, k4, k5, k6], [p1, p2]) = (self.radial, self.tangential);
        let r2 = slope.length_squared();
        let series = |a: f64, b: f64, c: f64| 1.0 + r2 * (a + r2 * (b + r2 * c));
        let radial = series(k1, k2, k3) / series(k4, k5, k6);
        slope * radial
            + DVec2::new(
                2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            )
    }

    /// Resamples a photograph to a pinhole camera with the intrinsics `k`; returns `None` if no
    /// correction is needed. Pixels that lens distortion moves outside the photograph become
    /// transparent. Without lens distortion, pixels that the rolling shutter moves outside repeat the
    /// photograph's edge.
    pub fn undistort_color(
        &self,
        k: &Intrinsics,
        image: &Image<[u8; 4]>,
    ) -> Option<Image<[u8; 4]>> {
        let beyond = !self.color.is_negligible(k) && self.is_pinhole();
        self.resample(k, (self.color, beyond), image, [0; 4], |at, _| {
            let last = DVec2::new(image.width as f64 - 1.0, image.height as f64 - 1.0);
            // Pixel centres are at +½; beyond the outer centres the edge is repeated.
            let corner = (at - 0.5).clamp(DVec2::ZERO, last);
            let (x, y) = (corner.x as usize, corner.y as usize);
            let t = (corner - corner.floor()).as_vec2();
            let (right, below) = ((x + 1).min(image.width - 1), (y + 1).min(image.height - 1));
            let (upper, lower) = (
                [image.at(x, y), image.at(right, y)],
                [image.at(x, below), image.at(right, below)],
            );
            let mix = |[left, right]: [&[u8; 4]; 2]| {
                let [left, right] = [left, right].map(|of| Vec4::from_array(of.map(f32::from)));
                left + t.x * (right - left)
            };
            let (upper, lower) = (mix(upper), mix(lower));
            // The cast truncates: half a step more rounds to nearest.
            (upper + t.y * (lower - upper) + 0.5).to_array().map(|channel| channel as u8)
        })
    }

    /// Resamples depth by nearest neighbour to a pinhole camera with the intrinsics `k`; returns `None`
    /// if no correction is needed. Pixels outside the recorded image become `hole`. The rolling shutter
    /// turns the optical axis between rows. `along_axis(value, factor)` converts depth along the axis
    /// of a pixel's row to depth along the axis of the middle row.
    pub fn undistort_depth<T: Copy + Send + Sync>(
        &self,
        k: &Intrinsics,
        image: &Image<T>,
        hole: T,
        along_axis: impl Fn(T, f64) -> T + Sync,
    ) -> Option<Image<T>> {
        self.resample(k, (self.depth, false), image, hole, |at, factor| {
            along_axis(*image.at(at.x as usize, at.y as usize), factor)
        })
    }

    /// Resamples an image to a pinhole camera with the intrinsics `k`; returns `None` if no correction
    /// is needed. `value` returns the resampled pixel from its position in the recorded image (pixels)
    /// and the factor by which its recorded depth is corrected for the rolling shutter.
    fn resample<T: Copy + Send + Sync>(
        &self,
        k: &Intrinsics,
        (shutter, beyond): (RollingShutter, bool),
        image: &Image<T>,
        hole: T,
        value: impl Fn(DVec2, f64) -> T + Sync,
    ) -> Option<Image<T>> {
        let is_still = shutter.is_negligible(k);
        if is_still && self.is_pinhole() {
            return None;
        }
        let (focal, principal) = (DVec2::new(k.fx, k.fy), DVec2::new(k.cx, k.cy));
        let size = DVec2::new(image.width as f64, image.height as f64);
        let mut out = Image::filled(image.width, image.height, hole);
        let (is_pinhole, lens) = (self.is_pinhole(), *self);
        out.data.par_chunks_mut(image.width.max(1)).enumerate().for_each(|(row, out)| {
            for (column, out) in out.iter_mut().enumerate() {
                let slope = k.ray(column, row).truncate();
                let (slope, factor) =
                    if is_still { (slope, 1.0) } else { shutter.source_direction(k, slope) };
                // The shutter first: it acts on the ray before the lens bends it.
                let slope = if is_pinhole { slope } else { lens.distort(slope) };
                let at = slope * focal + principal;
                // This form treats NaN as outside.
                if beyond || at.cmpge(DVec2::ZERO).all() && at.cmplt(size).all() {
                    *out = value(at, factor);
                }
            }
        });
        Some(out)
    }
}

impl Dataset {
    /// Opens the dataset again with the poses from its files; returns `None` if opening fails.
    pub fn with_recorded_poses(&self) -> Option<Self> {
        let options = LoadOptions { track: false, ..self.options };
        open(self.path.as_ref()?, &options).ok()
    }

    /// Returns a copy whose images are rectified for rolling shutter with the poses from the files. The
    /// poses of the copy are those of this dataset. Returns `None` if the copy would not differ.
    pub fn rectified(&self) -> Option<Self> {
        let recorded = self.options.track.then(|| self.with_recorded_poses()).flatten()?;
        let entries = recorded.splits.iter().flat_map(|split| &split.frames);
        let recorded: BTreeMap<&str, &FrameEntry> =
            entries.map(|entry| (entry.name.as_str(), entry)).collect();
        let mut rectified = self.clone();
        let mut changes = false;
        for entry in rectified.splits.iter_mut().flat_map(|split| &mut split.frames) {
            if let Some(other) = recorded.get(entry.name.as_str()) {
                changes |= entry.replace_images(other);
            }
        }
        changes.then_some(rectified)
    }
}

impl FrameEntry {
    fn replace_images(&mut self, other: &Self) -> bool {
        let lenses = |entry: &Self| entry.frame_files().map(|files| (files.lens, files.photo_lens));
        let changes = (lenses(self), &self.color_camera) != (lenses(other), &other.color_camera);
        self.source = other.source.clone();
        self.color_camera.clone_from(&other.color_camera);
        changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lens_without_terms_changes_nothing() {
        let k = Intrinsics::from_horizontal_fov(16, 12, 1.0);
        let pixels = (0..16 * 12).map(|i| [i as u8, 7, 9, 255]).collect();
        let image = Image::from_vec(16, 12, pixels);
        let none = Distortion::default();
        assert_eq!(none.undistort_color(&k, &image), None);
        assert_eq!(none.undistort_depth(&k, &image, [0; 4], |v, _| v), None);
        let hardly = Distortion { radial: [1e-12, 0.0, 0.0, 0.0, 0.0, 0.0], ..none };
        assert_eq!(hardly.undistort_color(&k, &image), Some(image));
    }

    /// Compares with the formula of OpenCV's documentation, computed by hand at (0.2, −0.1).
    #[test]
    fn terms_are_those_of_opencv() {
        let lens = Distortion {
            radial: [0.1, -0.02, 0.003, 0.01, 0.2, -0.3],
            tangential: [0.001, -0.002],
            ..Distortion::default()
        };
        let found = lens.distort(DVec2::new(0.2, -0.1));
        let radial = (1.0 + 0.1 * 0.05 - 0.02 * 0.0025 + 0.003 * 0.000125)
            / (1.0 + 0.01 * 0.05 + 0.2 * 0.0025 - 0.3 * 0.000125);
        let x = 0.2 * radial + 2.0 * 0.001 * -0.02 - 0.002 * (0.05 + 0.08);
        let y = -0.1 * radial + 0.001 * (0.05 + 0.02) + 2.0 * -0.002 * -0.02;
        assert!((found - DVec2::new(x, y)).length() < 1e-15);
    }
    #[test]
    fn only_lenses_that_map_an_image_to_itself_are_plausible() {
        let k = Intrinsics::from_horizontal_fov(640, 480, 1.3);
        let bends = |radial| Distortion { radial, ..Distortion::default() }.is_plausible(&k);
        // An Azure Kinect's photographs, and wide lenses of action cameras.
        assert!(
            bends([0.5, -2.7, 1.5, 0.37, -2.5, 1.4]) && bends([-0.28, 0.08, 0.0, 0.0, 0.0, 0.0])
        );
        for odd in [5.0, -1.0, f64::NAN, 1e300] {
            assert!(!bends([odd, 0.0, 0.0, 0.0, 0.0, 0.0]), "{odd}");
        }
    }
}
