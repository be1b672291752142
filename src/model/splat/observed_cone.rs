//! Range of directions from which a splat was observed (`rendering.md`, Observed directions).

use crate::math::sym3::Sym3;
use glam::{DMat3, DVec3};

// Edge of the cone in standard deviations of the observed directions. A uniform distribution along the
// camera path ends at √3.
const EDGE: f64 = 2.0;
// Standard deviation added across the cone: one viewpoint determines a splat's colour within about 2°.
const LEAST: f64 = 0.02;

/// Mean and spread of the unit directions from cameras to a splat, world axes. If all numbers are zero,
/// the directions are unknown and any direction counts as observed.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct ObservedCone {
    /// Mean `m` of the directions.
    pub mean: [f32; 3],
    /// Symmetric matrix `P` with `(d − m)ᵀ P (d − m) ≤ 1` inside the cone: upper triangle, row by row.
    pub inverse: [f32; 6],
}

impl ObservedCone {
    /// Creates the cone of directions with the given mean and covariance.
    pub fn new(mean: DVec3, covariance: Sym3) -> Self {
        // Along the mean, directions differ only by the square of their angle, which must not bound anything.
        let along = Sym3::outer(mean.normalize_or_zero());
        let spread =
            covariance.add_scaled(1.0, along).add_scaled(LEAST * LEAST, Sym3::diagonal(1.0));
        // Zero means unknown: then no direction is out of bounds.
        let inverse = spread.scaled(EDGE * EDGE).inverse().unwrap_or(Sym3::diagonal(0.0));
        Self {
            mean: mean.as_vec3().to_array(),
            inverse: inverse.to_array().map(|entry| entry as f32),
        }
    }

    /// True if every number is finite.
    pub fn is_valid(&self) -> bool {
        self.mean.iter().chain(&self.inverse).all(|x| x.is_finite())
    }

    /// Returns the mean of the directions.
    pub fn mean(&self) -> DVec3 {
        DVec3::from_array(self.mean.map(f64::from))
    }

    /// Returns the unit direction `d` if it is inside the cone, else its projection onto the edge. A
    /// splat's colour is evaluated for the returned direction.
    pub fn clamp_direction(&self, d: DVec3) -> DVec3 {
        let offset = d - self.mean();
        let squared = self.inverse().quadratic_form(offset);
        self.mean() + offset / squared.max(1.0).sqrt()
    }

    /// Returns the matrix `M` for which `M (d − m)` best fits `clamp_direction(d) − m`, for differences
    /// `d − m` of length up to `reach`. The fit is made separately for each axis of the cone. If a
    /// colour slope is multiplied by `M`, directions need not be clamped.
    pub fn linear_fit(&self, reach: f64) -> DMat3 {
        let eigen = self.inverse().eigen();
        // Rounding to f32 can make an eigenvalue negative.
        let share = |value: f64| linear_share(1.0 / (value.max(0.0).sqrt() * reach));
        let shares = DMat3::from_diagonal(eigen.values.map(share));
        eigen.vectors * shares * eigen.vectors.transpose()
    }

    /// Rotates the cone by `turn`.
    pub fn rotated(&self, turn: DMat3) -> Self {
        let inverse = Sym3::from_mat3(turn * self.inverse().to_mat3() * turn.transpose());
        Self {
            mean: (turn * self.mean()).as_vec3().to_array(),
            inverse: inverse.to_array().map(|entry| entry as f32),
        }
    }

    fn inverse(&self) -> Sym3 {
        Sym3::from_array(self.inverse.map(f64::from))
    }
}

/// Returns the factor `s` for which `s·ρ` is the least-squares fit to `min(ρ, r)` over a disc of radius
/// 1. `ρ` is the distance from the disc's centre and `r` is `radius`.
fn linear_share(radius: f64) -> f64 {
    let r = radius.min(1.0);
    r.powi(4) + 4.0 / 3.0 * r * (1.0 - r.powi(3))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn direction(degrees: f64) -> DVec3 {
        let (sin, cos) = degrees.to_radians().sin_cos();
        DVec3::new(sin, 0.0, cos)
    }

    #[test]
    fn colour_follows_directions_within_the_cone_alone() {
        // Twice as wide along x as along y.
        let mean = DVec3::Z * 0.97;
        let cone = ObservedCone::new(mean, Sym3::from_array([0.04, 0.0, 0.0, 0.01, 0.0, 1e-4]));
        for degrees in [0.0, 10.0, 20.0] {
            let d = direction(degrees);
            assert!((cone.clamp_direction(d) - d).length() < 1e-6, "{degrees}");
        }
        for degrees in [30.0, 60.0, 90.0, 180.0] {
            let held = cone.clamp_direction(direction(degrees)) - mean;
            assert!(held.x < 0.41, "{degrees}: {held}");
        }
        let across = cone.clamp_direction(DVec3::new(0.0, 0.8, 0.6)) - mean;
        assert!(across.y < 0.21, "{across}");
    }

    #[test]
    fn unknown_observations_bound_nothing_and_one_bounds_to_the_least_cone() {
        let d = DVec3::new(0.6, 0.0, -0.8);
        assert!((ObservedCone::default().clamp_direction(d) - d).length() < 1e-12);
        assert_eq!(ObservedCone::default().linear_fit(1.0), DMat3::IDENTITY);
        let once = ObservedCone::new(DVec3::Z, Sym3::diagonal(0.0));
        assert!(once.clamp_direction(direction(90.0)).x < 1.01 * EDGE * LEAST);
        assert_eq!(once.clamp_direction(DVec3::Z), DVec3::Z);
    }

    #[test]
    fn the_cone_turns_with_the_world() {
        let turn = DMat3::from_rotation_x(0.7) * DMat3::from_rotation_y(-0.4);
        let covariance = Sym3::from_array([0.04, 0.01, 0.0, 0.02, 0.0, 1e-3]);
        let cone = ObservedCone::new(DVec3::new(0.1, -0.2, 0.9), covariance);
        let d = direction(70.0);
        let difference =
            cone.rotated(turn).clamp_direction(turn * d) - turn * cone.clamp_direction(d);
        assert!(difference.length() < 1e-6, "{difference}");
    }

    /// Compares the closed-form factor of [`linear_share`] with a numerical integral over the radii of
    /// the disc.
    #[test]
    fn a_line_fits_a_slope_that_ends() {
        for radius in [0.03, 0.3, 0.8, 1.0, 1.5] {
            let radii = (0..20_000).map(|i| (f64::from(i) + 0.5) / 20_000.0);
            let (mut crossed, mut squared) = (0.0, 0.0);
            for at in radii {
                // Rings are weighted by their circumference.
                crossed += at * at * f64::min(at, radius);
                squared += at.powi(3);
            }
            let share = linear_share(radius);
            assert!((share - crossed / squared).abs() < 1e-6, "{radius}: {share}");
        }
    }
}
