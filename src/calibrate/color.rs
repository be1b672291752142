//! How colours differ inside components, and how that changes with the colour camera and depth.
//!
//! A component's points are projected into the colour image of their own view; how their colours differ
//! from the component's mean is what a wrong camera causes. The mean moves with the unknowns too, so its
//! slope is taken off every point's slope.

use super::camera::Projector;
use super::exposure::Patch;
use super::matches::{MatchedPoint, Matches};
use super::normal_equations::NormalEquations;
use super::pyramid::Pyramid;
use super::unknowns::{CAMERA, Estimate, N, Unknowns, WITH_POSE, parts};
use glam::DVec3;

/// The photographs of views at one size.
#[derive(Clone, Copy)]
pub(super) struct Photos<'a> {
    pub images: &'a [Pyramid],
    /// Factors of red, green and blue, by view.
    pub gains: &'a [[f64; 3]],
    /// Size of the images, 0 the whole.
    pub level: usize,
}

/// A point's colour as its own view shows it, about its component's mean.
#[derive(Clone, Copy)]
pub(super) struct ColorOffset {
    /// Place of the point in its component.
    pub index: usize,
    pub view: usize,
    pub color: [f64; 3],
    /// With the unknowns about their component's mean, with its view's pose against the others.
    slope: [[f64; WITH_POSE]; 3],
}

/// Where the colour of a matched point is, in the frame of its depth camera, and how that changes with offset
/// and scale. A point that its view's pose moves has the colour of where the others see that place: the
/// other way.
fn placed(matches: &Matches, sample: &MatchedPoint, at: &Estimate) -> (DVec3, [DVec3; 2]) {
    let depth = &matches.depth;
    let [offset, scale] = depth.values;
    let local = sample.local;
    let measured = if depth.along_z { local.z } else { local.length() };
    let by_offset = local / measured;
    let by_scale = (local - offset * by_offset) / scale;
    let [nearer, larger] = at.unknowns.depth;
    let measured_anew = local + by_offset * (nearer - offset) + by_scale * (larger - scale);
    let [shift, turn] = parts(&at.poses[sample.view as usize]);
    (measured_anew - shift - turn.cross(local), [by_offset, by_scale])
}

fn point(
    matches: &Matches,
    photos: &Photos,
    projector: &Projector,
    at: &Estimate,
    (index, sample): (usize, &MatchedPoint),
) -> Option<ColorOffset> {
    let view = sample.view as usize;
    let (place, by_depth) = placed(matches, sample, at);
    let projected = projector.project(place)?;
    let texel = photos.images[view].sample(photos.level, projected.at)?;
    // How the pixel moves, by all unknowns.
    let pixel: [[f64; WITH_POSE]; 2] = std::array::from_fn(|axis| {
        let by_place = projected.by_place[axis];
        let mut slope = [0.0; WITH_POSE];
        slope[..CAMERA].copy_from_slice(&by_depth.map(|by| by_place.dot(by)));
        slope[CAMERA..N].copy_from_slice(&projected.slope[axis]);
        slope[N..N + 3].copy_from_slice(&(-by_place).to_array());
        slope[N + 3..].copy_from_slice(&(-sample.local.cross(by_place)).to_array());
        slope
    });
    // A gain scales slopes as it scales colours.
    let gain = photos.gains[view];
    let color = std::array::from_fn(|i| gain[i] * texel.color[i]);
    let slope = std::array::from_fn(|i| {
        let [across, down] = texel.slope[i];
        std::array::from_fn(|j| gain[i] * (across * pixel[0][j] + down * pixel[1][j]))
    });
    Some(ColorOffset { index, view, color, slope })
}

/// Adds the colours of a component, unless one view alone sees it. `weight` is that of a point by its
/// place in the run.
pub(super) fn color_offsets(
    matches: &Matches,
    photos: &Photos,
    run: &[MatchedPoint],
    at: (&Projector, &Estimate),
    weight: impl Fn(usize) -> f64,
    out: &mut Vec<ColorOffset>,
) {
    let (projector, estimate) = at;
    out.clear();
    let seen = run.iter().enumerate();
    out.extend(seen.filter_map(|s| point(matches, photos, projector, estimate, s)));
    // Sorted by view: the ends differ if any two do.
    if out.len() < 2 || out[0].view == out[out.len() - 1].view {
        out.clear();
        return;
    }
    // The mean moves with the unknowns as its points do.
    let (color, slope) = means(out, weight);
    for point in out {
        for i in 0..3 {
            point.color[i] -= color[i];
            point.slope[i].iter_mut().zip(slope[i]).for_each(|(s, mean): (_, f64)| *s -= mean);
        }
    }
}

fn means(points: &[ColorOffset], weight: impl Fn(usize) -> f64) -> ([f64; 3], [[f64; N]; 3]) {
    let sum: f64 = points.iter().map(|point| weight(point.index)).sum();
    let (mut color, mut slope) = ([0.0; 3], [[0.0; N]; 3]);
    for point in points {
        let share = weight(point.index) / sum;
        for i in 0..3 {
            color[i] += share * point.color[i];
            slope[i].iter_mut().zip(point.slope[i]).for_each(|(mean, s)| *mean += share * s);
        }
    }
    (color, slope)
}

impl ColorOffset {
    /// Square of the distance from the mean.
    pub fn square(&self) -> f64 {
        self.color.iter().map(|c| c * c).sum()
    }

    /// Adds it to its view's equations.
    pub fn add(&self, weight: f64, equations: &mut NormalEquations<WITH_POSE>) {
        equations.n += weight;
        for i in 0..3 {
            equations.add_residual(self.color[i], &self.slope[i], weight);
        }
    }
}

/// Mean colours of components by view, before gains; sorted by component.
pub(super) fn patches(matches: &Matches, photos: &Photos, at: &Estimate) -> Vec<Patch> {
    let projector = Projector::new(&at.unknowns.camera);
    let mut patches = Vec::new();
    for component in 0..matches.len() {
        for run in matches.of(component).chunk_by(|a, b| a.view == b.view) {
            let view = run[0].view;
            let image = &photos.images[view as usize];
            let mut patch = Patch::new(component as u32, view);
            run.iter()
                .filter_map(|s| projector.project(placed(matches, s, at).0))
                .filter_map(|projected| image.sample(photos.level, projected.at))
                .for_each(|texel| patch.add(texel.color));
            patches.push(patch);
        }
    }
    patches
}

/// Root mean square of the shift in the image, pixels, that a unit of every unknown of the camera makes.
pub(super) fn shifts(matches: &Matches, at: &Unknowns) -> [f64; N] {
    let projector = Projector::new(&at.camera);
    let (mut sum, mut n) = ([0.0; N], 0.0);
    for projected in matches.samples().iter().filter_map(|s| projector.project(s.local)) {
        n += 1.0;
        let [u, v] = projected.slope;
        for (i, (u, v)) in u.iter().zip(v).enumerate() {
            sum[CAMERA + i] += u * u + v * v;
        }
    }
    sum.map(|sum: f64| (sum / n).sqrt())
}

/// Root mean square of the distance, pixels, between where two cameras see the points.
pub(super) fn distance(matches: &Matches, a: &Unknowns, b: &Unknowns) -> f64 {
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
