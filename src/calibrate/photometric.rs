//! Variance of colour inside components, and how it changes with the colour camera.

use super::exposure::Patch;
use super::matches::{Matches, Sample};
use super::pinhole::{N, Projector, Unknowns};
use super::pyramid::Pyramid;
use rayon::prelude::*;

/// Components of one partial sum: sums do not depend on the number of threads.
const CHUNK: usize = 1024;

/// What colours are judged by.
pub(super) struct Scene<'a> {
    pub matches: &'a Matches,
    pub images: &'a [Pyramid],
    /// By view.
    pub gains: &'a [[f64; 3]],
    /// Size of the images, 0 the whole.
    pub level: usize,
}

/// Normal equations of `Σ |c − c̄|²`, half its gradient and Gauss-Newton's half of its curvature.
#[derive(Clone, Copy)]
pub(super) struct Normal {
    pub cost: f64,
    pub n: f64,
    /// Lower triangle.
    pub curvature: [[f64; N]; N],
    pub gradient: [f64; N],
}

/// A point's colour as some view shows it.
struct Ray {
    view: usize,
    color: [f64; 3],
    slope: [[f64; N]; 3],
}

impl Normal {
    const ZERO: Self = Self { cost: 0.0, n: 0.0, curvature: [[0.0; N]; N], gradient: [0.0; N] };

    fn add(&mut self, other: &Self) {
        self.cost += other.cost;
        self.n += other.n;
        for i in 0..N {
            self.gradient[i] += other.gradient[i];
            for j in 0..=i {
                self.curvature[i][j] += other.curvature[i][j];
            }
        }
    }

    /// Over all views.
    pub fn total(views: &[Self]) -> Self {
        views.iter().fold(Self::ZERO, |mut sum, view| {
            sum.add(view);
            sum
        })
    }

    /// Variance of a point, the sum of the three channels'.
    pub fn variance(&self) -> f64 {
        self.cost / self.n
    }

    /// Curvature of the `free` unknowns, row by row.
    pub fn curvature_of(&self, free: &[usize]) -> Vec<f64> {
        free.iter().flat_map(|&i| free.iter().map(move |&j| self.curvature_at(i, j))).collect()
    }

    /// Curvature of a pair of unknowns.
    pub fn curvature_at(&self, i: usize, j: usize) -> f64 {
        self.curvature[i.max(j)][i.min(j)]
    }
}

impl Scene<'_> {
    /// Of every view by itself, about the means over all of them.
    pub fn normals(&self, unknowns: &Unknowns) -> Vec<Normal> {
        let projector = Projector::new(unknowns);
        let parts: Vec<Vec<Normal>> = (0..self.matches.len())
            .into_par_iter()
            .chunks(CHUNK)
            .map(|components| {
                let mut views = vec![Normal::ZERO; self.matches.stands.len()];
                let mut rays = Vec::new();
                for component in components {
                    let samples = self.matches.of(component);
                    rays.clear();
                    rays.extend(samples.iter().filter_map(|s| self.ray(&projector, s)));
                    add_component(&rays, &mut views);
                }
                views
            })
            .collect();
        let mut views = vec![Normal::ZERO; self.matches.stands.len()];
        for part in parts {
            views.iter_mut().zip(&part).for_each(|(view, part)| view.add(part));
        }
        views
    }

    fn ray(&self, projector: &Projector, sample: &Sample) -> Option<Ray> {
        let view = sample.view as usize;
        let shot = projector.shoot(sample.local)?;
        let look = self.images[view].look(self.level, shot.at)?;
        let gain = self.gains[view];
        let color = std::array::from_fn(|i| gain[i] * look.color[i]);
        let slope = std::array::from_fn(|i| {
            let [across, down] = look.slope[i];
            std::array::from_fn(|j| gain[i] * (across * shot.slope[0][j] + down * shot.slope[1][j]))
        });
        Some(Ray { view, color, slope })
    }

    /// Mean colours of components by view, before gains; sorted by component.
    pub fn patches(&self, unknowns: &Unknowns) -> Vec<Patch> {
        let projector = Projector::new(unknowns);
        let mut patches = Vec::new();
        for component in 0..self.matches.len() {
            for run in self.matches.of(component).chunk_by(|a, b| a.view == b.view) {
                let view = run[0].view;
                let image = &self.images[view as usize];
                let mut patch = Patch::new(component as u32, view);
                let shots = run.iter().filter_map(|s| projector.shoot(s.local));
                shots
                    .filter_map(|shot| image.look(self.level, shot.at))
                    .for_each(|look| patch.add(look.color));
                patches.push(patch);
            }
        }
        patches
    }

    /// Root mean square of the shift in the image, pixels, that a unit of every unknown makes.
    pub fn shifts(&self, unknowns: &Unknowns) -> [f64; N] {
        let projector = Projector::new(unknowns);
        let (mut sum, mut n) = ([0.0; N], 0.0);
        for shot in self.matches.samples().iter().filter_map(|s| projector.shoot(s.local)) {
            n += 1.0;
            for (sum, (u, v)) in sum.iter_mut().zip(shot.slope[0].iter().zip(&shot.slope[1])) {
                *sum += u * u + v * v;
            }
        }
        sum.map(|sum| (sum / n).sqrt())
    }

    /// Root mean square of the distance, pixels, between where two cameras see the points.
    pub fn distance(&self, a: &Unknowns, b: &Unknowns) -> f64 {
        let (a, b) = (Projector::new(a), Projector::new(b));
        let (mut sum, mut n) = (0.0, 0.0);
        for sample in self.matches.samples() {
            if let (Some(a), Some(b)) = (a.shoot(sample.local), b.shoot(sample.local)) {
                sum += (a.at[0] - b.at[0]).powi(2) + (a.at[1] - b.at[1]).powi(2);
                n += 1.0;
            }
        }
        f64::sqrt(sum / n)
    }
}

/// Adds a component's rays, which are sorted by view, unless one view alone sees it.
fn add_component(rays: &[Ray], views: &mut [Normal]) {
    if rays.len() < 2 || rays[0].view == rays[rays.len() - 1].view {
        return;
    }
    let (color, slope) = means(rays);
    for ray in rays {
        let normal = &mut views[ray.view];
        normal.n += 1.0;
        for i in 0..3 {
            let residual = ray.color[i] - color[i];
            let row: [f64; N] = std::array::from_fn(|j| ray.slope[i][j] - slope[i][j]);
            normal.cost += residual * residual;
            for j in 0..N {
                normal.gradient[j] += residual * row[j];
                for k in 0..=j {
                    normal.curvature[j][k] += row[j] * row[k];
                }
            }
        }
    }
}

fn means(rays: &[Ray]) -> ([f64; 3], [[f64; N]; 3]) {
    let weight = 1.0 / rays.len() as f64;
    let (mut color, mut slope) = ([0.0; 3], [[0.0; N]; 3]);
    for ray in rays {
        for i in 0..3 {
            color[i] += weight * ray.color[i];
            slope[i].iter_mut().zip(ray.slope[i]).for_each(|(mean, s)| *mean += weight * s);
        }
    }
    (color, slope)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::matches::Stand;
    use crate::dataset::calibration::ColorCamera;
    use crate::math::image::Image;
    use crate::observation::surface::SurfacePoint;
    use glam::{DMat3, DVec3};

    const CAMERA: ColorCamera = ColorCamera {
        focal: [80.0, 80.0],
        principal: [40.0, 30.0],
        offset: [0.01, -0.02, 0.0],
        rotation: [0.0, 0.0, 0.02],
    };

    /// A wall before two cameras side by side, photographs of which are ramps.
    fn wall() -> (Matches, Vec<Pyramid>) {
        let (mut views, mut stands) = (Vec::new(), Vec::new());
        for view in 0..2 {
            let point = |i: u32| SurfacePoint {
                position: [0.03 * (i % 16) as f32 - 0.2, 0.03 * (i / 16) as f32 - 0.2, 2.0],
                normal: [0.0, 0.0, -1.0],
                ..SurfacePoint::default()
            };
            views.push((0..256).map(point).collect());
            let centre = DVec3::new(0.1 * f64::from(view), 0.0, 0.3 * f64::from(view));
            stands.push(Stand { rotation: DMat3::IDENTITY, centre });
        }
        let ramp = |i: usize| [(3 * (i % 80)) as u8, (4 * (i / 80)) as u8, 100, 255];
        let image = || Image::from_vec(80, 60, (0..80 * 60).map(ramp).collect());
        let images = (0..2).map(|_| Pyramid::new(image(), 1)).collect();
        (Matches::together(&views, stands, 0.1), images)
    }

    #[test]
    fn gradients_are_those_of_finite_differences() {
        let (matches, images) = wall();
        let gains = [[1.0; 3], [1.1, 0.9, 1.0]];
        let scene = Scene { matches: &matches, images: &images, gains: &gains, level: 0 };
        let unknowns = Unknowns::of(CAMERA);
        let total = Normal::total(&scene.normals(&unknowns));
        assert!(total.cost > 0.5 && total.n == 512.0, "{} {}", total.cost, total.n);
        for i in 0..N {
            let step = 1e-5;
            let cost = |sign: f64| {
                let mut moved = unknowns;
                moved.values[i] += sign * step;
                Normal::total(&scene.normals(&moved)).cost
            };
            let expected = (cost(1.0) - cost(-1.0)) / (4.0 * step);
            let error = (total.gradient[i] - expected).abs();
            assert!(
                error < 1e-4 * expected.abs().max(1.0),
                "{i}: {} {expected}",
                total.gradient[i]
            );
        }
    }

    #[test]
    fn distances_are_in_pixels() {
        let (matches, images) = wall();
        let gains = [[1.0; 3]; 2];
        let scene = Scene { matches: &matches, images: &images, gains: &gains, level: 0 };
        let unknowns = Unknowns::of(CAMERA);
        let mut moved = unknowns;
        moved.values[4] += 3.0;
        moved.values[5] -= 4.0;
        assert!((scene.distance(&unknowns, &moved) - 5.0).abs() < 1e-9);
        assert!((scene.shifts(&unknowns)[5] - 1.0).abs() < 1e-12);
    }
}
