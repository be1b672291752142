//! Look-up of textures in a drawn picture (`textures.md`, Drawing).
//!
//! Drawing records, for every pixel, the two splats with the largest weights. Afterwards the pixel's ray is
//! intersected with the planes of both, and their textures are read there: two look-ups a pixel, however many
//! splats overlap.

use super::shade;
use super::tile::{GROUPS, Plane};
use super::view::{CameraSplat, CpuView};
use crate::math::simd::{LANES, Vector};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use crate::model::splat::texture::{Lattice, Textures};
use crate::render::options::TILE;
use glam::{DVec3, Vec3};

/// Least cosine between ray and normal for a look-up: near grazing angles the intersection is unstable.
pub(in crate::render) const MIN_COSINE: f64 = 0.1;

/// Function that returns the lattice of a splat's texture, if it has one.
pub(super) type LatticeOf<'a> = &'a (dyn Fn(usize) -> Option<Lattice> + Sync);

/// Plane of a textured splat in camera axes, for intersections with pixel rays.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfacePlane {
    /// Normal over the plane's distance: a ray `r` meets the plane at `r/(n·r)`.
    normal: Vec3,
    /// Least `|n·r|/|r|` of a look-up.
    least: f32,
    /// Directions of the lattice's columns and rows, texels per world unit.
    axes: [Vec3; 2],
    /// Position of the camera in the lattice, texels.
    offset: [f32; 2],
    /// Colour of the splat in this view minus its colour seen from the mean of the observed directions.
    pub shift: [f32; 3],
    /// Number of the splat; `u32::MAX` without a texture.
    pub splat: u32,
}

impl Default for SurfacePlane {
    /// Returns the plane of a splat without texture, which no ray meets.
    fn default() -> Self {
        Self {
            normal: Vec3::ZERO,
            least: f32::INFINITY,
            axes: [Vec3::ZERO; 2],
            offset: [0.0; 2],
            shift: [0.0; 3],
            splat: u32::MAX,
        }
    }
}

impl SurfacePlane {
    pub(super) fn new(
        view: &CpuView,
        number: usize,
        splat: &Splat,
        placed: &CameraSplat,
        appearance: Option<&Appearance>,
        lattice: &Lattice,
    ) -> Self {
        let normal = placed.axes.col(splat.thinnest_axis());
        let distance = normal.dot(placed.m);
        let world = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let axes = lattice.axes.map(|axis| view.camera_from_world * world(axis));
        Self {
            normal: (normal / distance).as_vec3(),
            least: (MIN_COSINE / distance.abs()) as f32,
            axes: axes.map(|axis| (axis * lattice.per_unit()).as_vec3()),
            offset: lattice.place_of(view.centre).map(|v| v as f32),
            shift: shade::directional_shift(view, splat, placed, appearance),
            splat: number as u32,
        }
    }

    pub(super) fn has_texture(&self) -> bool {
        self.splat != u32::MAX
    }

    /// Returns where a ray in camera axes meets the plane: position in the lattice, in texels, and
    /// depth along the optical axis. `None` at grazing angles and behind the camera.
    #[inline(always)]
    pub(super) fn meet(&self, ray: Vec3) -> Option<([f32; 2], f32)> {
        let per_depth = self.normal.dot(ray);
        // The values of a plane through the camera are infinite or undefined.
        if per_depth.is_nan() || per_depth < self.least * ray.length() {
            return None;
        }
        let point = ray / per_depth;
        let place = [0, 1].map(|i| self.axes[i].dot(point) + self.offset[i]);
        Some((place, point.z))
    }
}

/// The two splats with the largest weights in every pixel of a tile.
pub(super) struct Owners {
    weights: [Plane; 2],
    /// Record numbers as bits.
    numbers: [Plane; 2],
}

impl Owners {
    pub(super) fn new() -> Box<Self> {
        let empty = [[0.0; LANES]; TILE * GROUPS];
        Box::new(Self { weights: [empty; 2], numbers: [empty; 2] })
    }

    /// Offers a splat to eight pixels in which it has `weight`.
    #[inline(always)]
    pub(super) fn offer<V: Vector>(&mut self, group: usize, weight: V, number: u32) {
        let number = V::splat(f32::from_bits(number));
        let [first, second] = &mut self.weights;
        let (w1, w2) = (V::load(&first[group]), V::load(&second[group]));
        // One bit per lane: set in all lanes if nothing changes.
        if weight.at_most(w2) == (1 << LANES) - 1 {
            return;
        }
        let [to_first, to_second] = &mut self.numbers;
        let (n1, n2) = (V::load(&to_first[group]), V::load(&to_second[group]));
        let leads = w1.mask_at_most(weight);
        let follows = w2.mask_at_most(weight);
        let other = (V::select(follows, weight, w2), V::select(follows, number, n2));
        V::select(leads, w1, other.0).store(&mut second[group]);
        V::select(leads, n1, other.1).store(&mut to_second[group]);
        V::select(leads, weight, w1).store(&mut first[group]);
        V::select(leads, number, n1).store(&mut to_first[group]);
    }

    /// Returns record number and weight of a pixel's splat; `which` is 0 for the one with the largest weight.
    #[inline(always)]
    pub(super) fn of(&self, row: usize, column: usize, which: usize) -> (u32, f32) {
        let (group, lane) = (row * GROUPS + column / LANES, column % LANES);
        (self.numbers[which][group][lane].to_bits(), self.weights[which][group][lane])
    }
}

/// Adds the textures of a pixel's owners to its premultiplied colour. `coverage` is the sum of all weights,
/// `ray` the pixel's ray in camera axes.
pub(super) fn add_textures(
    color: [f32; 3],
    coverage: f32,
    owners: [(u32, f32); 2],
    ray: Vec3,
    planes: &[SurfacePlane],
    textures: &Textures,
) -> [f32; 3] {
    let mut textured = color;
    let per = 1.0 / coverage.max(f32::MIN_POSITIVE);
    for (number, weight) in owners {
        // Number and weight are 0 where no splat was offered.
        if weight <= 0.0 {
            continue;
        }
        let plane = &planes[number as usize];
        let Some((place, _)) = plane.meet(ray) else { continue };
        let Some(texture) = textures.get(plane.splat as usize).and_then(Option::as_ref) else {
            continue;
        };
        let sample = texture.sample(place);
        for channel in 0..3 {
            let drawn = color[channel] * per - plane.shift[channel];
            textured[channel] += weight * (sample.color[channel] - sample.share * drawn);
        }
    }
    textured.map(|channel| channel.max(0.0))
}
