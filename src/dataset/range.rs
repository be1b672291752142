//! Position range by which a dataset is normalised (`dataset.md`, Position range).

use super::entry::FrameEntry;
use super::error::FrameError;
use super::opened::{Dataset, with_retry};
use super::unproject::{CameraConvention, camera_point};
use super::wild_poses::outlier_poses;
use crate::math::camera::Camera;
use crate::math::measured_pixel::Normalization;
use glam::DVec3;
use rayon::prelude::*;

const MAX_FRAMES: usize = 12;
/// Step between sampled columns and rows.
const STRIDE: usize = 8;
/// Share of points cut off at each end of each axis.
const TAIL: f64 = 0.01;
/// Margin added to the half-width of the range, as a share of the half-width.
const MARGIN: f64 = 0.05;

/// Returns the position range of a split, by which its points are normalised. It is the range known from
/// the layout, else an estimate from up to 12 evenly spaced frames. The estimate takes the 1 % and 99 %
/// quantiles of depth points on every axis. Depth points are from every eighth column and row, where
/// depth is trusted. The range is a cube around the centre between these quantiles, so that no axis is
/// stretched. Its half-width is the largest half-distance of the quantiles plus 5 %. Frames that fail to
/// load are skipped as long as another frame loads.
///
/// # Errors
/// No sampled frame loads, or none has trusted depth.
pub fn estimate(dataset: &Dataset, split: usize) -> Result<PositionRange, RangeError> {
    if let Some(range) = &dataset.known_range {
        return Ok(range.clone());
    }
    let wild = dataset.splits.get(split).map_or_else(Vec::new, outlier_poses);
    let n_frames = dataset.splits.get(split).map_or(0, |s| s.frames.len());
    // One of twelve frames has more points than the quantiles cut off, so outlier poses are excluded.
    let is_sound = |i: &usize| wild.iter().all(|wild| wild.index != *i);
    let sound: Vec<usize> = (0..n_frames).filter(is_sound).collect();
    let n_sampled = sound.len().min(MAX_FRAMES);
    let chosen: Vec<usize> =
        (0..n_sampled).filter_map(|i| sound.get(i * sound.len() / n_sampled).copied()).collect();
    let frames = dataset.splits.get(split).map_or(&[][..], |split| &split.frames);
    let samples = chosen.par_iter().filter_map(|&at| frames.get(at)).map(sample);
    let mut axes: [Vec<f64>; 3] = Default::default();
    let mut failure = None;
    for sample in samples.collect::<Vec<_>>() {
        match sample {
            Ok(points) => {
                for (i, axis) in axes.iter_mut().enumerate() {
                    axis.extend(points.iter().map(|point| point[i]));
                }
            }
            // A damaged frame must not prevent training: other frames yield a range too.
            Err(error) => failure = Some(error),
        }
    }
    let mut range = from_samples(&mut axes);
    if let (Some(range), [first, ..]) = (&mut range, &wild[..]) {
        let others = match wild.len() {
            1 => String::new(),
            n => format!(" and {} more frames", n - 1),
        };
        range.source.push_str(&format!(", outlier poses left out: {}{others}", first.frame));
    }
    match (range, failure) {
        (Some(range), _) => Ok(range),
        (None, Some(last)) => Err(RangeError::Frames { n_sampled, last: Box::new(last) }),
        (None, None) => Err(RangeError::NoPoints),
    }
}

/// Reason why no range can be estimated.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum RangeError {
    /// No sampled frame loads.
    #[error(
        "expected at least one usable frame, found none among {n_sampled} sampled; the last one's problem: {last}"
    )]
    Frames {
        n_sampled: usize,
        #[source]
        last: Box<FrameError>,
    },
    /// The frames load but contain no trusted depth, or depth at one point only.
    #[error(
        "depth: expected surfaces within the trusted depth range, found none in the sampled frames; widen the depth range or choose another split"
    )]
    NoPoints,
}

/// Returns trusted depth points of a frame. Its photograph is not decoded.
fn sample(entry: &FrameEntry) -> Result<Vec<DVec3>, FrameError> {
    let Some(depth) = with_retry(|| entry.load_depth())? else { return Ok(Vec::new()) };
    let (width, height) = depth.size();
    let Camera { intrinsics: k, pose } = &entry.camera;
    let mut points = Vec::new();
    // From the middle of the first stride: no sample lies on the border of the image.
    for row in (STRIDE / 2..height).step_by(STRIDE) {
        for column in (STRIDE / 2..width).step_by(STRIDE) {
            let value = depth.value_at(column, row).filter(|v| depth.is_trusted(*v));
            let Some(value) = value else { continue };
            // Always exact: the published convention applies to Blender layouts only, whose range is known
            // and never estimated.
            let local = camera_point(k, CameraConvention::Exact, depth.kind, [column, row], value);
            points.push(pose.transform_point(local));
        }
    }
    Ok(points)
}

fn from_samples(axes: &mut [Vec<f64>; 3]) -> Option<PositionRange> {
    let mut centre = [0.0; 3];
    let mut half_width = 0.0f64;
    for (axis, centre) in axes.iter_mut().zip(&mut centre) {
        let last = axis.len().checked_sub(1)?;
        axis.sort_unstable_by(f64::total_cmp);
        // Quantiles, not extremes: a few wrong depths would determine the box.
        let cut = (last as f64 * TAIL) as usize;
        let (low, high) = (axis.get(cut)?, axis.get(last.checked_sub(cut)?)?);
        *centre = 0.5 * (low + high);
        // One width for all axes: a Gaussian that is isotropic in the world stays isotropic.
        half_width = half_width.max(0.5 * (high - low));
    }
    let half = DVec3::splat(half_width * (1.0 + MARGIN));
    let centre = DVec3::from_array(centre);
    PositionRange::new(centre - half, centre + half, "1 % to 99 % of the depth points")
}

/// Returns the median; of an even number of values, the upper of the two middle values. `None` for an
/// empty list.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    // Selecting an element of an empty list would panic.
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Axis-aligned box in the world by which positions are normalised; points outside are allowed.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionRange {
    lo: DVec3,
    hi: DVec3,
    /// Description of how the range was obtained, for reports.
    pub source: String,
}

impl PositionRange {
    /// Creates a range; `None` unless both corners are finite and `lo < hi` on every axis.
    pub fn new(lo: DVec3, hi: DVec3, source: &str) -> Option<Self> {
        let sound = lo.is_finite() && hi.is_finite() && lo.cmplt(hi).all();
        sound.then(|| Self { lo, hi, source: source.to_owned() })
    }

    /// Returns the cube `[−1, 1]³`, the range of NeRF-synthetic scenes.
    pub fn nerf_synthetic() -> Self {
        let source = "the [-1, 1] cube of NeRF-synthetic scenes".to_owned();
        Self { lo: DVec3::NEG_ONE, hi: DVec3::ONE, source }
    }

    /// Returns the box in coordinates relative to another origin.
    pub fn relative_to(self, origin: DVec3) -> Self {
        Self { lo: self.lo - origin, hi: self.hi - origin, ..self }
    }

    /// Returns the low corner of the box, world units.
    pub fn lo(&self) -> DVec3 {
        self.lo
    }

    /// Returns the high corner of the box, world units.
    pub fn hi(&self) -> DVec3 {
        self.hi
    }

    /// Returns the affine map that normalises positions. A uniform distribution in the box is mapped to
    /// mean 0 and variance 1 on every axis.
    pub fn normalization(&self) -> Normalization {
        Normalization::from_range(self.lo, self.hi)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_make_a_cube_with_a_margin() {
        let ramp = |scale: f64| (0..=1000).map(|i| i as f64 * scale).collect::<Vec<f64>>();
        let mut axes = [ramp(1.0), ramp(0.1), ramp(0.01)];
        let range = from_samples(&mut axes).map(|r| (r.lo(), r.hi()));
        let half = 490.0 * 1.05;
        let (lo, hi) = range.unwrap_or_default();
        assert!((lo - DVec3::new(500.0 - half, 50.0 - half, 5.0 - half)).length() < 1e-9, "{lo}");
        assert!((hi - lo - 2.0 * half).length() < 1e-9);
        assert!(from_samples(&mut Default::default()).is_none());
        assert!(from_samples(&mut [vec![1.0], vec![1.0], vec![1.0]]).is_none());
    }
}
