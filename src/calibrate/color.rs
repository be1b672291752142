//! Colour residuals between views, with their derivatives with respect to colour camera and depth.
//!
//! A component's points are projected into the colour images of their own view and of another view of
//! the component. An inaccurate camera causes a colour difference.

use super::camera::Projector;
use super::gains::Patch;
use super::matches::{MatchedPoint, Matches};
use super::pyramid::Pyramid;
use super::unknowns::{CAMERA, Estimate, N, Unknowns, WITH_POSE, split_twist};
use crate::math::least_squares::NormalEquations;
use glam::DVec3;

#[derive(Clone, Copy)]
pub(super) struct Photos<'a> {
    pub images: &'a [Pyramid],
    pub gains: &'a [[f64; 3]],
    /// Pyramid level; 0 is full resolution.
    pub level: usize,
}

/// Colour difference of a point between its own view and another view.
#[derive(Clone, Copy)]
pub(super) struct ColorResidual {
    pub index: usize,
    pub view: usize,
    pub color: [f64; 3],
    /// Derivatives with respect to the unknowns and the pose of the point's own view. The other view's
    /// pose is fixed.
    slope: [[f64; WITH_POSE]; 3],
}

struct SampledColor {
    color: [f64; 3],
    slope: [[f64; WITH_POSE]; 3],
}

/// Returns the measured position of a matched point in its depth camera's frame under the current depth
/// calibration. Also returns its derivatives with respect to depth offset and depth scale.
fn measured_position(
    matches: &Matches,
    sample: &MatchedPoint,
    at: &Estimate,
) -> (DVec3, [DVec3; 2]) {
    let depth = &matches.depth;
    let [offset, scale] = depth.values;
    let local = sample.local;
    let range = if depth.along_z { local.z } else { local.length() };
    let by_offset = local / range;
    let by_scale = (local - offset * by_offset) / scale;
    let [nearer, larger] = at.unknowns.depth;
    (local + by_offset * (nearer - offset) + by_scale * (larger - scale), [by_offset, by_scale])
}

/// Transforms a position in a view's camera frame by the pose correction of the view. A motion of the
/// camera moves points the opposite way in its frame.
fn pose_corrected(place: DVec3, view: usize, at: &Estimate) -> DVec3 {
    let [shift, turn] = split_twist(&at.poses[view]);
    place - shift - turn.cross(place)
}

/// Samples a view's photograph at a position in the frame of its depth camera. `by_depth` holds the
/// derivatives of the position with respect to depth offset and depth scale.
fn sample_color(
    photos: &Photos,
    at: (&Projector, &Estimate),
    view: usize,
    (place, by_depth): (DVec3, [DVec3; 2]),
) -> Option<SampledColor> {
    let (projector, estimate) = at;
    let [_, turn] = split_twist(&estimate.poses[view]);
    // The pose correction turns derivatives as well.
    let by_depth = by_depth.map(|by| by - turn.cross(by));
    let projected = projector.project(pose_corrected(place, view, estimate))?;
    let texel = photos.images[view].sample(photos.level, projected.at)?;
    // A gain scales derivatives like colours.
    let gain = photos.gains[view];
    let (mut color, mut slope) = ([0.0; 3], [[0.0; WITH_POSE]; 3]);
    let [across, down] = [0, 1].map(|axis| {
        // Derivative of the pixel position with respect to all unknowns.
        let by_place = projected.position_jacobian[axis];
        let mut slope = [0.0; WITH_POSE];
        slope[..CAMERA].copy_from_slice(&by_depth.map(|by| by_place.dot(by)));
        slope[CAMERA..N].copy_from_slice(&projected.jacobian[axis]);
        slope[N..N + 3].copy_from_slice(&(-by_place).to_array());
        slope[N + 3..].copy_from_slice(&(-place.cross(by_place)).to_array());
        slope
    });
    for i in 0..3 {
        color[i] = gain[i] * texel.color[i];
        let [by_column, by_row] = texel.slope[i];
        for j in 0..WITH_POSE {
            slope[i][j] = gain[i] * (by_column * across[j] + by_row * down[j]);
        }
    }
    Some(SampledColor { color, slope })
}

/// Computes the colour difference of each point of a component between its own view and the next view
/// that sees the component. Differences from the component's mean colour would include texture. Texture
/// is weakest where photographs are smoothest, which would bias the camera.
pub(super) fn color_residuals(
    matches: &Matches,
    photos: &Photos,
    run: &[MatchedPoint],
    at: (&Projector, &Estimate),
    out: &mut Vec<ColorResidual>,
) {
    out.clear();
    for (index, sample) in run.iter().enumerate() {
        let view = sample.view as usize;
        // Sorted by view; the last view is compared with the first.
        let other = run[index..].iter().find(|s| s.view != sample.view).unwrap_or(&run[0]).view;
        let (place, by_depth) = measured_position(matches, sample, at.1);
        let [own, its] = [view, other as usize].map(|view| matches.poses[view]);
        let across = |direction: DVec3| its.rotation * (own.rotation.transpose() * direction);
        // The same place in the other view's frame.
        let there = its.rotation * (own.rotation.transpose() * place + own.centre - its.centre);
        let here = sample_color(photos, at, view, (place, by_depth));
        let there = sample_color(photos, at, other as usize, (there, by_depth.map(across)));
        // Outside an image, or at a silhouette.
        let (Some(here), Some(there)) = (here, there) else { continue };
        let color = std::array::from_fn(|i| here.color[i] - there.color[i]);
        let mut slope = here.slope;
        // The other view's pose is fixed, so its derivatives are left out.
        for (slope, there) in slope.iter_mut().zip(there.slope) {
            slope.iter_mut().zip(&there[..N]).for_each(|(slope, there)| *slope -= there);
        }
        out.push(ColorResidual { index, view, color, slope });
    }
}

impl ColorResidual {
    pub fn square(&self) -> f64 {
        self.color.iter().map(|c| c * c).sum()
    }

    pub fn add(&self, weight: f64, equations: &mut NormalEquations<WITH_POSE>) {
        equations.n += weight;
        equations.add_residuals(self.color, self.slope.each_ref().map(|slope| &slope[..]), weight);
    }
}

/// Returns the mean colour of each component in each view, without gains, sorted by component.
pub(super) fn patches(matches: &Matches, photos: &Photos, at: &Estimate) -> Vec<Patch> {
    let projector = Projector::new(&at.unknowns.camera);
    let mut patches = Vec::new();
    for component in 0..matches.len() {
        for run in matches.points_of(component).chunk_by(|a, b| a.view == b.view) {
            let view = run[0].view;
            let image = &photos.images[view as usize];
            let mut patch = Patch::new(component as u32, view);
            for sample in run {
                let place = measured_position(matches, sample, at).0;
                let projected = projector.project(pose_corrected(place, view as usize, at));
                let texel = projected.and_then(|point| image.sample(photos.level, point.at));
                texel.into_iter().for_each(|texel| patch.add(texel.color));
            }
            patches.push(patch);
        }
    }
    patches
}

/// Returns the root mean square shift of the projected points, in pixels, per unit change of each camera
/// unknown.
pub(super) fn rms_shift_per_unit(matches: &Matches, at: &Unknowns) -> [f64; N] {
    let projector = Projector::new(&at.camera);
    let (mut sum, mut n) = ([0.0; N], 0.0);
    for projected in matches.samples().iter().filter_map(|s| projector.project(s.local)) {
        n += 1.0;
        let [u, v] = projected.jacobian;
        for (i, (u, v)) in u.iter().zip(v).enumerate() {
            sum[CAMERA + i] += u * u + v * v;
        }
    }
    sum.map(|sum: f64| (sum / n).sqrt())
}

pub(super) fn rms_pixel_distance(matches: &Matches, a: &Unknowns, b: &Unknowns) -> f64 {
    let (a, b) = (Projector::new(&a.camera), Projector::new(&b.camera));
    let (mut sum, mut n) = (0.0, 0.0);
    for sample in matches.samples() {
        if let (Some(a), Some(b)) = (a.project(sample.local), b.project(sample.local)) {
            sum += (a.at[0] - b.at[0]).powi(2) + (a.at[1] - b.at[1]).powi(2);
            n += 1.0;
        }
    }
    f64::sqrt(sum / n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::test_views::{begin, wall};

    #[test]
    fn distances_are_in_pixels() {
        let matches = wall(0.3);
        let mut moved = begin();
        moved.set(6, moved.get(6) + 3.0);
        moved.set(7, moved.get(7) - 4.0);
        assert!((rms_pixel_distance(&matches, &begin(), &moved) - 5.0).abs() < 1e-9);
        assert!((rms_shift_per_unit(&matches, &begin())[7] - 1.0).abs() < 1e-12);
    }
}
