//! Sums of a component's texture over the pixels of photographs (`textures.md`).

use crate::model::splat::splats::Splat;
use crate::model::splat::texture::{
    ABSENT, Lattice, MAX_LEVEL, PATCH, Sample, TEXELS, Texel, Texture, corners,
};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Weight of one whole pixel in the unit of [`TexelSums::weight`].
pub const WEIGHT_ONE: f32 = 256.0;
/// Colour 1 in the unit of [`Observed::color`].
pub const COLOR_ONE: f32 = 1024.0;
/// Largest magnitude of an observed colour.
pub const MAX_COLOR: f32 = 2.0;
/// Squared colour 1 in the unit of [`Predictions`].
pub const PRODUCT_ONE: f32 = (1 << 20) as f32;
// Weight from which a texel no longer changes: 1,024 pixels. Below it no sum overflows.
const FULL: u32 = 1 << 18;

/// Weights of the prior of a texel, in pixels, between which a component chooses.
pub const DOUBTS: [f32; 2] = [0.5, 4.0];
// Prior of the sums of predictions: an exact prediction of this squared colour.
const BELIEF: f64 = 0.05 * PRODUCT_ONE as f64;
// A photograph takes this part of the earlier ones' weight.
const FADING: i64 = 8;

// Least cosine between the normals of a lattice and of its splat, and largest distance of the splat's mean
// from the lattice's anchor, in half sides; beyond, the lattice is laid anew.
const MIN_COSINE: f64 = 0.8;
const MAX_SHIFT: f64 = 0.4;

/// Sums over the pixels that showed one texel, in fixed point: any order of additions gives the same bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct TexelSums {
    /// Sum of the weights, in units of 1/256 pixel.
    pub weight: u32,
    /// Sum of weight times colour per channel, in units of `1/(256·1024)`.
    pub color: [i32; 3],
}

/// What one pixel adds to a texture.
#[derive(Clone, Copy, Debug)]
pub struct Observed {
    /// Number of the texel, row-major in the lattice.
    pub texel: u16,
    /// Weight in units of 1/256 pixel, at most 256.
    pub weight: u16,
    /// Colour of the surface per channel, in units of 1/1024, at most [`MAX_COLOR`].
    pub color: [i16; 3],
}

/// How well a component's texture predicted photographs that were not part of it. For each of [`DOUBTS`]: sums
/// over pixels and channels of the predicted correction times the residual and of its square, in units of
/// 2⁻²⁰.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Predictions(pub [[i64; 2]; 2]);

impl Predictions {
    /// Adds a pixel's products.
    pub fn add(&mut self, products: &[[i32; 2]; 2]) {
        for (sum, product) in self.0.as_flattened_mut().iter_mut().zip(products.as_flattened()) {
            *sum += i64::from(*product);
        }
    }

    /// Adds the sums of the same component of another part of a recording.
    pub fn merge(&mut self, other: &Self) {
        for (sum, more) in self.0.as_flattened_mut().iter_mut().zip(other.0.as_flattened()) {
            *sum += more;
        }
    }

    /// Lets earlier photographs count less: splats have learned since.
    pub fn fade(&mut self) {
        self.0.as_flattened_mut().iter_mut().for_each(|sum| *sum -= *sum / FADING);
    }

    /// Returns the prior weight of [`DOUBTS`] that predicted photographs best, and the factor on its
    /// corrections that would have predicted them best, 0 to 1: the regression of the residuals on the
    /// predicted corrections.
    pub fn trust(&self) -> (f32, f32) {
        let [first, second] = self.0.map(|sums| {
            let [cross, power] = sums.map(|sum| sum as f64 + BELIEF);
            (cross.max(0.0) * cross / power, (cross / power).clamp(0.0, 1.0) as f32)
        });
        // Of equal predictions the one that keeps more detail.
        if second.0 > first.0 { (DOUBTS[1], second.1) } else { (DOUBTS[0], first.1) }
    }
}

/// Texture of a component with the sums it is learned from.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureSums {
    /// Lattice of the texels.
    pub lattice: Lattice,
    /// Index into `patches` of each patch of the lattice, row-major; [`ABSENT`] for patches without texels.
    pub index: Vec<u16>,
    /// Sums of the texels, by patch.
    pub patches: Vec<[TexelSums; TEXELS]>,
}

impl TextureSums {
    /// Creates an empty texture of level 0 in the plane of a splat. `half` is half the length of its side,
    /// world units.
    pub fn new(splat: &Splat, half: f32) -> Self {
        let turn = splat.quaternion();
        let thin = splat.thinnest_axis();
        let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| (turn * axis).as_vec3().to_array());
        let axes = [axes[(thin + 1) % 3], axes[(thin + 2) % 3]];
        let lattice = Lattice { anchor: splat.mean, axes, half, level: 0 };
        Self { lattice, index: vec![ABSENT], patches: Vec::new() }
    }

    /// Returns the memory used, in bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(&self.index[..]) + size_of_val(&self.patches[..])
    }

    /// True if the lattice still lies about in the plane of the splat.
    pub fn fits(&self, splat: &Splat) -> bool {
        let world = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let normal = splat.quaternion() * DVec3::AXES[splat.thinnest_axis()];
        let [u, v] = self.lattice.axes.map(world);
        let shift = world(splat.mean).distance(world(self.lattice.anchor));
        u.cross(v).dot(normal).abs() >= MIN_COSINE
            && shift <= MAX_SHIFT * f64::from(self.lattice.half)
    }

    /// Halves the pitch until the lattice has `level`. The pixels of a texel are shared among its four
    /// parts.
    pub fn refine(&mut self, level: u8) {
        let level = level.min(MAX_LEVEL);
        if level > self.lattice.level {
            let steps = level - self.lattice.level;
            let parts = 1 << (2 * steps);
            self.relevel(
                level,
                |[x, y]| {
                    let (first, n) = ([x << steps, y << steps], 1usize << steps);
                    (0..n * n).map(move |i| [first[0] + i % n, first[1] + i / n])
                },
                parts,
            );
        }
    }

    /// Doubles the pitch: the sums of four texels become those of one. Does nothing at level 0.
    pub fn coarsen(&mut self) {
        if let Some(level) = self.lattice.level.checked_sub(1) {
            self.relevel(level, |[x, y]| std::iter::once([x / 2, y / 2]), 1);
        }
    }

    /// Divides the sums of every texel by `parts` and adds them to the texels that `into` lists.
    fn relevel<I: Iterator<Item = [usize; 2]>>(
        &mut self,
        level: u8,
        into: impl Fn([usize; 2]) -> I,
        parts: u32,
    ) {
        let old = std::mem::replace(self, self.emptied(Lattice { level, ..self.lattice }));
        old.for_each(|at, sums| {
            for to in into(at) {
                let texel = self.texel_mut(to);
                texel.weight += sums.weight / parts;
                for (sum, color) in texel.color.iter_mut().zip(sums.color) {
                    *sum += color / parts as i32;
                }
            }
        });
    }

    /// Lays the lattice in the plane of a splat that has moved. Texels keep their place in the world as far
    /// as the new lattice covers it.
    pub fn lay_anew(&mut self, splat: &Splat, half: f32) {
        let fresh = Self::new(splat, half);
        let lattice = Lattice { level: self.lattice.level, ..fresh.lattice };
        let old = std::mem::replace(self, self.emptied(lattice));
        let side = lattice.side() as f64;
        old.for_each(|[x, y], sums| {
            let place = lattice.place_of(old.lattice.point_at([x as f64 + 0.5, y as f64 + 0.5]));
            if place.iter().all(|v| (0.0..side).contains(v)) {
                self.texel_mut(place.map(|v| v as usize)).add(sums);
            }
        });
    }

    fn emptied(&self, lattice: Lattice) -> Self {
        let index = vec![ABSENT; (lattice.side() / PATCH).pow(2)];
        Self { lattice, index, patches: Vec::new() }
    }

    /// Calls `f` for all observed texels in row-major order of patches.
    fn for_each(&self, mut f: impl FnMut([usize; 2], &TexelSums)) {
        let per_row = self.lattice.side() / PATCH;
        for (number, &patch) in self.index.iter().enumerate() {
            let Some(patch) = self.patches.get(usize::from(patch)) else { continue };
            let first = [number % per_row * PATCH, number / per_row * PATCH];
            for (i, sums) in patch.iter().enumerate().filter(|(_, sums)| sums.weight > 0) {
                f([first[0] + i % PATCH, first[1] + i / PATCH], sums);
            }
        }
    }

    fn texel(&self, at: [usize; 2]) -> Option<&TexelSums> {
        let (patch, within) = self.lattice.patch_of(at);
        self.patches.get(usize::from(self.index[patch])).map(|patch| &patch[within])
    }

    fn texel_mut(&mut self, at: [usize; 2]) -> &mut TexelSums {
        let (patch, within) = self.lattice.patch_of(at);
        if self.index[patch] == ABSENT {
            self.index[patch] = self.patches.len() as u16;
            self.patches.push([TexelSums::default(); TEXELS]);
        }
        &mut self.patches[usize::from(self.index[patch])][within]
    }

    /// Adds a pixel.
    pub fn add(&mut self, observed: &Observed) {
        let side = self.lattice.side();
        let at = [usize::from(observed.texel) % side, usize::from(observed.texel) / side];
        let weight = i32::from(observed.weight);
        self.texel_mut(at).add(&TexelSums {
            weight: observed.weight.into(),
            color: observed.color.map(|color| weight * i32::from(color)),
        });
    }

    /// Adds the sums of the same component of another part of a recording.
    pub fn merge(&mut self, other: &Self) {
        self.refine(other.lattice.level);
        let mut other = other.clone();
        other.refine(self.lattice.level);
        let (lattice, side) = (self.lattice, self.lattice.side() as f64);
        other.for_each(|[x, y], sums| {
            let place = lattice.place_of(other.lattice.point_at([x as f64 + 0.5, y as f64 + 0.5]));
            if place.iter().all(|v| (0.0..side).contains(v)) {
                self.texel_mut(place.map(|v| v as usize)).add(sums);
            }
        });
    }

    /// Returns the posterior mean at a place for each of [`DOUBTS`], as it would be without the pixel `own`.
    pub fn samples_without(&self, place: [f32; 2], own: &Observed) -> [Sample; 2] {
        let side = self.lattice.side();
        let mut samples = [Sample::default(); 2];
        for (at, part) in corners(place, side).into_iter().flatten() {
            let Some(mut texel) = self.texel(at).copied() else { continue };
            if at[1] * side + at[0] == usize::from(own.texel) {
                texel.remove(own);
            }
            for (sample, doubt) in samples.iter_mut().zip(DOUBTS) {
                let (color, share) = texel.posterior(doubt);
                sample.share += part * share;
                for (sum, color) in sample.color.iter_mut().zip(color) {
                    *sum += part * share * color;
                }
            }
        }
        samples
    }

    /// Returns the texture to draw. `predictions` are those of its component.
    pub fn drawn(&self, predictions: &Predictions) -> Texture {
        let (doubt, trust) = predictions.trust();
        let texel = |sums: &TexelSums| {
            let (color, share) = sums.posterior(doubt);
            Texel::new(color, share * trust)
        };
        Texture {
            lattice: self.lattice,
            index: self.index.clone(),
            patches: self.patches.iter().map(|patch| patch.each_ref().map(texel)).collect(),
        }
    }
}

impl TexelSums {
    fn add(&mut self, other: &Self) {
        if self.weight >= FULL {
            return;
        }
        self.weight += other.weight;
        for (sum, color) in self.color.iter_mut().zip(other.color) {
            *sum += color;
        }
    }

    /// Takes away a pixel that was added before.
    fn remove(&mut self, own: &Observed) {
        // Its weight may have differed a little then.
        let weight = u32::from(own.weight).min(self.weight);
        self.weight -= weight;
        for (sum, color) in self.color.iter_mut().zip(own.color) {
            *sum -= weight as i32 * i32::from(color);
        }
    }

    /// Returns the mean colour and the share of the observations in the posterior mean, 0 to 1. `doubt` is the
    /// weight of the prior in pixels.
    fn posterior(&self, doubt: f32) -> ([f32; 3], f32) {
        if self.weight == 0 {
            return ([0.0; 3], 0.0);
        }
        let per = 1.0 / (self.weight as f32 * COLOR_ONE);
        let weight = self.weight as f32 / WEIGHT_ONE;
        (self.color.map(|color| color as f32 * per), weight / (weight + doubt))
    }
}
