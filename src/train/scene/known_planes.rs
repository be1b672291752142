//! Planes of the components, computed once for all rounds of a frame's alignment.

use super::component_sums::ComponentSums;
use super::grid::NONE;
use super::seed_positions::SeedPositions;
use super::sum_scalar::SumScalar;
use crate::model::scene::sums::{SceneSums, outer};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Minimum number of points of a component that serves as a plane.
const MIN_POINTS: f64 = 20.0;
/// Minimum length of the mean normal.
const MIN_AGREEMENT: f64 = 0.8;

/// Component as a plane with a linear colour.
#[derive(Clone, Copy)]
pub struct ColoredPlane {
    /// Seed to which the component's sums refer, world units from the origin.
    pub seed: DVec3,
    /// Mean of its points, world units from the origin.
    pub mean: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// Variance of its points along the normal, world units².
    pub variance: f64,
    /// Mean colour.
    pub color: DVec3,
    /// Colour gradient within the plane, one row per channel, per world unit.
    pub gradient: DMat3,
}

impl ColoredPlane {
    /// Fits a plane to sums about `seed`; `None` with few points or diverging normals.
    pub fn new(sums: &SceneSums, seed: DVec3, ridge: f64) -> Option<Self> {
        let normal = sums.normal / sums.count;
        if sums.count < MIN_POINTS || normal.length() < MIN_AGREEMENT {
            return None;
        }
        let normal = normal.normalize();
        let covariance = sums.covariance();
        let gradient = sums.gradient(covariance, ridge);
        Some(Self {
            seed,
            mean: seed + sums.mean_offset(),
            normal,
            variance: covariance.quadratic_form(normal).max(0.0),
            color: sums.color / sums.count,
            // The points give no information on the colour across the plane, so that part is removed.
            gradient: gradient - outer(gradient * normal, normal),
        })
    }
}

/// Cache of the planes requested so far.
pub struct KnownPlanes<'a, W> {
    component_sums: &'a ComponentSums<W>,
    seed_positions: SeedPositions<'a>,
    /// Structural scale, world units.
    h: f64,
    /// Ridge of the regression of colour on position, world units².
    ridge: f64,
    /// Index of each component's plane in `planes`.
    places: Vec<u32>,
    planes: Vec<Option<ColoredPlane>>,
}

impl<'a, W: SumScalar> KnownPlanes<'a, W> {
    pub fn new(
        component_sums: &'a ComponentSums<W>,
        seed_positions: SeedPositions<'a>,
        h: f64,
        ridge: f64,
    ) -> Self {
        let places = vec![NONE; component_sums.len()];
        Self { component_sums, seed_positions, h, ridge, places, planes: Vec::new() }
    }

    /// Computes the missing planes of the given owners, as far as they existed before the frame.
    pub fn compute_missing(&mut self, owners: &[u32]) {
        let mut new = Vec::new();
        for &id in owners {
            if let Some(place) = self.places.get_mut(id as usize).filter(|place| **place == NONE) {
                *place = (self.planes.len() + new.len()) as u32;
                new.push(id);
            }
        }
        let plane = |&id: &u32| {
            let sums = SceneSums::new(&self.component_sums.sums(id as usize), self.h);
            let seed = DVec3::from_array(self.seed_positions.of(id as usize).map(f64::from));
            ColoredPlane::new(&sums, seed, self.ridge)
        };
        self.planes.par_extend(new.par_iter().with_min_len(64).map(plane));
    }

    /// Number of components requested so far.
    pub fn len(&self) -> usize {
        self.planes.len()
    }

    /// Returns the plane of a requested component and its index; `None` if it has no plane.
    #[inline]
    pub fn plane_of(&self, component: u32) -> Option<(usize, &ColoredPlane)> {
        let place = *self.places.get(component as usize)? as usize;
        Some((place, self.planes.get(place)?.as_ref()?))
    }
}
