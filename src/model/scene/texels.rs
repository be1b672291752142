//! Sums of a component's texture over the pixels of photographs (`textures.md`).

use crate::model::splat::splats::Splat;
use crate::model::splat::texture::{
    ABSENT, Lattice, LearnedTextures, MAX_LEVEL, PATCH, Sample, TEXELS, Texel, Texture, corners,
    four_texels,
};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use std::sync::Arc;

/// Weight of one whole pixel in the unit of [`TexelSums::weight`].
pub const WEIGHT_ONE: f32 = 256.0;
/// Colour 1 in the unit of [`Observed::color`].
pub const COLOR_ONE: f32 = 1024.0;
/// Largest magnitude of an observed colour.
pub const MAX_COLOR: f32 = 2.0;
/// Squared colour 1 in the unit of [`Products`].
pub const PRODUCT_ONE: f32 = (1 << 20) as f32;
// Weight from which a texel no longer changes: 1,024 pixels.
const FULL: u32 = 1 << 18;
/// Largest weight of a texel. Merged texels may exceed the weight from which pixels change nothing.
// Its colour sums take 30 bits and a sign.
pub const MAX_TEXEL_WEIGHT: u32 = 2 * FULL;
/// Largest magnitude of a texel's colour sum, per unit of weight.
pub const MOST_PER_WEIGHT: u32 = (MAX_COLOR * COLOR_ONE) as u32;

/// Weights of the prior of a texel, in pixels, between which a component chooses.
pub const DOUBTS: [f32; 2] = [0.5, 4.0];
// Prior of the sums of predictions: an exact prediction of this squared colour.
const BELIEF: f64 = 0.05 * PRODUCT_ONE as f64;
// A photograph takes this part of the weight of earlier ones.
const FADING: i64 = 8;

/// Largest number of former lattices that a texture remembers.
pub const MOST_FORMER: usize = 64;

// Least cosine between the normals of a lattice and of its splat, and largest distance of the splat's mean
// from the lattice's anchor, in half sides; beyond, the lattice is laid anew.
const MIN_COSINE: f64 = 0.8;
const MAX_SHIFT: f64 = 0.4;

// Largest distance between equal lattices, in half sides, and largest difference of their axes. Moving a scene
// as a whole rounds both; a texel of the finest level is sixteen times larger.
const SAME: f32 = 1e-3;

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
    /// Number of the texel by [`Lattice::number_of`].
    pub texel: u16,
    /// Weight in units of 1/256 pixel, at most 256.
    pub weight: u16,
    /// Colour of the surface per channel, in units of 1/1024, at most [`MAX_COLOR`].
    pub color: [i16; 3],
}

/// Products of a pixel's predicted correction with its residual and with itself, for each of [`DOUBTS`]:
/// summed over channels, in units of 2⁻²⁰.
pub type Products = [[i32; 2]; 2];

/// Texture of a component with the sums it is learned from.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureSums {
    /// Lattice of the texels.
    pub lattice: Lattice,
    /// Earlier lattices, oldest first, each with the level at which the next one was laid; the latest
    /// [`MOST_FORMER`].
    pub former: Vec<Lattice>,
    /// For each of [`DOUBTS`]: sums of [`Products`] over pixels, in which later photographs count more.
    pub predicted: [[i64; 2]; 2],
    /// Index into `patches` of each patch of the lattice, row-major; [`ABSENT`] for patches without texels.
    pub index: Vec<u16>,
    /// Sums of the texels, by patch. Shared, so that a copy whose predictions alone change needs no memory for
    /// them.
    pub patches: Arc<Vec<[TexelSums; TEXELS]>>,
}

/// Texels of one texture while pixels are added.
// `Arc::make_mut` counts references atomically, which would take longer than adding a pixel.
pub struct OpenTexels<'a> {
    lattice: Lattice,
    index: &'a mut [u16],
    patches: &'a mut Vec<[TexelSums; TEXELS]>,
}

impl OpenTexels<'_> {
    /// Adds a pixel.
    pub fn add(&mut self, observed: &Observed) {
        let (number, weight) = (usize::from(observed.texel), i32::from(observed.weight));
        let [r, g, b] = observed.color;
        let color = [weight * i32::from(r), weight * i32::from(g), weight * i32::from(b)];
        let texel = self.numbered_mut(number / TEXELS, number % TEXELS);
        texel.add(&TexelSums { weight: observed.weight.into(), color });
    }

    fn texel_mut(&mut self, at: [usize; 2]) -> &mut TexelSums {
        let (patch, within) = self.lattice.patch_of(at);
        self.numbered_mut(patch, within)
    }

    /// Returns a texel of a patch that exists.
    fn known_mut(&mut self, at: [usize; 2]) -> Option<&mut TexelSums> {
        let (patch, within) = self.lattice.patch_of(at);
        Some(&mut self.patches.get_mut(usize::from(self.index[patch]))?[within])
    }

    /// Returns texel `within` of a patch of the lattice.
    #[inline(always)]
    fn numbered_mut(&mut self, patch: usize, within: usize) -> &mut TexelSums {
        if self.index[patch] == ABSENT {
            self.index[patch] = self.patches.len() as u16;
            if self.patches.len() == self.patches.capacity() {
                // A vector would double its memory, of which scenes with textures have hundreds of megabytes.
                self.patches.reserve_exact(self.patches.len() / 4 + 1);
            }
            self.patches.push([TexelSums::default(); TEXELS]);
        }
        &mut self.patches[usize::from(self.index[patch])][within]
    }
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
        let (former, predicted) = (Vec::new(), [[0; 2]; 2]);
        Self { lattice, former, predicted, index: vec![ABSENT], patches: Arc::default() }
    }

    /// Returns the memory used, in bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>()
            + size_of_val(&self.former[..])
            + size_of_val(&self.index[..])
            + size_of_val(&self.patches[..])
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

    fn relevel_to(&mut self, level: u8) {
        self.refine(level);
        while self.lattice.level > level {
            self.coarsen();
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
        let mut texels = self.open();
        old.for_each(|at, sums| {
            let part = sums.scaled_to(sums.weight / parts);
            // A patch without any weight would only take memory.
            if part.weight > 0 {
                into(at).for_each(|to| texels.texel_mut(to).join(&part));
            }
        });
    }

    /// Lays the lattice in the plane of a splat that has moved. Texels keep their place in the world as far
    /// as the new lattice covers it.
    pub fn lay_anew(&mut self, splat: &Splat, half: f32) {
        if self.former.len() == MOST_FORMER {
            self.former.remove(0);
        }
        self.former.push(self.lattice);
        self.lay_on(&Self::new(splat, half).lattice);
    }

    /// Moves the texels to another lattice of the same level, as far as it covers them.
    fn lay_on(&mut self, place: &Lattice) {
        let lattice = Lattice { level: self.lattice.level, ..*place };
        let old = std::mem::replace(self, self.emptied(lattice));
        self.join_texels(&old);
    }

    /// Adds the texels of another lattice at their places in the world, as far as this one covers them.
    fn join_texels(&mut self, other: &Self) {
        let (lattice, side) = (self.lattice, self.lattice.side() as f64);
        let mut texels = self.open();
        other.for_each(|[x, y], sums| {
            let place = lattice.place_of(other.lattice.point_at([x as f64 + 0.5, y as f64 + 0.5]));
            if place.iter().all(|v| (0.0..side).contains(v)) {
                texels.texel_mut(place.map(|v| v as usize)).join(sums);
            }
        });
    }

    /// Returns a texture without texels and with the same predictions and former lattices.
    fn emptied(&self, lattice: Lattice) -> Self {
        let index = vec![ABSENT; (lattice.side() / PATCH).pow(2)];
        let (former, predicted) = (self.former.clone(), self.predicted);
        Self { lattice, former, predicted, index, patches: Arc::default() }
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
        self.patch(patch).map(|patch| &patch[within])
    }

    /// Returns the texels for adding to them.
    pub fn open(&mut self) -> OpenTexels<'_> {
        let Self { lattice, index, patches, .. } = self;
        OpenTexels { lattice: *lattice, index, patches: Arc::make_mut(patches) }
    }

    /// Adds a pixel's products.
    pub fn add_products(&mut self, products: &Products) {
        let sums = self.predicted.as_flattened_mut().iter_mut();
        for (sum, product) in sums.zip(products.as_flattened()) {
            *sum += i64::from(*product);
        }
    }

    /// Lets earlier photographs count less in the products: splats have learned since.
    pub fn fade(&mut self) {
        self.predicted.as_flattened_mut().iter_mut().for_each(|sum| *sum -= *sum / FADING);
    }

    /// Adds the sums of the same component of another part of a recording.
    pub fn merge(&mut self, other: &Self) {
        self.refine(other.lattice.level);
        let mut other = other.clone();
        other.refine(self.lattice.level);
        let sums = self.predicted.as_flattened_mut().iter_mut();
        for (sum, more) in sums.zip(other.predicted.as_flattened()) {
            *sum += more;
        }
        self.join_texels(&other);
    }

    /// True if the lattice was laid anew since an earlier version of the texture.
    pub fn is_laid_anew_since(&self, earlier: &Self) -> bool {
        self.former.iter().any(|former| is_same_place(former, &earlier.lattice))
    }

    /// Returns what a texture has gained since an earlier version of it. All, if that was dropped since, and this
    /// one begun instead.
    pub fn gained_since(&self, earlier: &Self) -> Self {
        let is_its = |lattice: &Lattice| is_same_place(lattice, &earlier.lattice);
        // The earlier texels take the way that they took in this texture.
        let way = match self.former.iter().position(is_its) {
            Some(first) => &self.former[first..],
            None if is_its(&self.lattice) => &[],
            None => return self.clone(),
        };
        let (mut gained, mut earlier) = (self.clone(), earlier.clone());
        for (former, next) in way.iter().zip(way.iter().skip(1).chain([&self.lattice])) {
            earlier.relevel_to(former.level);
            earlier.lay_on(next);
        }
        earlier.relevel_to(self.lattice.level);
        let sums = gained.predicted.as_flattened_mut().iter_mut();
        for (sum, before) in sums.zip(earlier.predicted.as_flattened()) {
            *sum -= before;
        }
        // Sums of squares stay such even if the textures are not versions of one.
        gained.predicted.iter_mut().for_each(|[_, power]| *power = (*power).max(0));
        let mut texels = gained.open();
        earlier.for_each(|at, before| {
            if let Some(texel) = texels.known_mut(at) {
                texel.subtract(before);
            }
        });
        gained
    }

    /// Returns the posterior mean at a place for each of [`DOUBTS`], as it would be without the pixel `own`.
    pub fn samples_without(&self, place: [f32; 2], own: &Observed) -> [Sample; 2] {
        let mut samples = [Sample::default(); 2];
        let Some(corners) = corners(place, self.lattice.side()) else { return samples };
        for (at, part) in corners {
            let Some(mut texel) = self.texel(at).copied() else { continue };
            if self.lattice.number_of(at) == own.texel {
                texel.remove(own);
            }
            for (sample, doubt) in samples.iter_mut().zip(DOUBTS) {
                let (color, share) = texel.posterior(doubt);
                sample.add(color, part * share);
            }
        }
        samples
    }

    /// Returns the prior weight of [`DOUBTS`] that predicted photographs best, and the factor on its corrections
    /// that would have predicted them best, 0 to 1: the regression of the residuals on the predicted
    /// corrections.
    pub fn trust(&self) -> (f32, f32) {
        let [first, second] = self.predicted.map(|sums| {
            let [cross, power] = sums.map(|sum| sum as f64 + BELIEF);
            (cross.max(0.0) * cross / power, (cross / power).clamp(0.0, 1.0) as f32)
        });
        // Of equal predictions the one that keeps more detail.
        if second.0 > first.0 { (DOUBTS[1], second.1) } else { (DOUBTS[0], first.1) }
    }

    /// Returns the texture to draw.
    pub fn drawn(&self) -> Texture {
        let trust = self.trust();
        let texel = |sums: &TexelSums| sums.drawn(trust);
        Texture {
            lattice: self.lattice,
            index: self.index.clone(),
            patches: self.patches.iter().map(|patch| patch.each_ref().map(texel)).collect(),
        }
    }

    fn patch(&self, number: usize) -> Option<&[TexelSums; TEXELS]> {
        self.patches.get(usize::from(self.index[number]))
    }
}

impl LearnedTextures for Vec<Option<Arc<TextureSums>>> {
    fn lattice(&self, splat: usize) -> Option<&Lattice> {
        Some(&self.get(splat)?.as_ref()?.lattice)
    }

    fn four(&self, splat: usize, at: [usize; 2]) -> [Texel; 4] {
        let Some(Some(texture)) = self.get(splat) else { return [Texel::default(); 4] };
        let trust = texture.trust();
        four_texels(&texture.lattice, at, |number| texture.patch(number))
            .map(|sums| sums.drawn(trust))
    }
}

/// True if two lattices cover the same square with the same directions of columns and rows.
fn is_same_place(a: &Lattice, b: &Lattice) -> bool {
    let near =
        |a: &[f32], b: &[f32], most: f32| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= most);
    a.half == b.half
        && near(&a.anchor, &b.anchor, SAME * a.half)
        && near(a.axes.as_flattened(), b.axes.as_flattened(), SAME)
}

impl TexelSums {
    /// Adds a pixel, unless the texel has enough.
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

    /// Adds the sums of another texel. Beyond the largest weight all observations count less.
    fn join(&mut self, other: &Self) {
        let weight = self.weight + other.weight;
        let color = [0, 1, 2].map(|c| i64::from(self.color[c]) + i64::from(other.color[c]));
        let part = if weight > MAX_TEXEL_WEIGHT { FULL } else { weight };
        *self = Self::scaled(color, weight, part);
    }

    /// Returns the sums of a part of the observations, with the same mean colour.
    fn scaled_to(&self, part: u32) -> Self {
        Self::scaled(self.color.map(i64::from), self.weight, part)
    }

    fn scaled(color: [i64; 3], weight: u32, part: u32) -> Self {
        let (part_of, whole) = (i64::from(part), i64::from(weight).max(1));
        Self { weight: part, color: color.map(|sum| (sum * part_of / whole) as i32) }
    }

    /// Subtracts the sums of a part of the observations. Rounding by a change of the pitch in between leaves
    /// at least 0, and no colour that no observation has.
    fn subtract(&mut self, part: &Self) {
        self.weight = self.weight.saturating_sub(part.weight);
        let most = i64::from(self.weight) * i64::from(MOST_PER_WEIGHT);
        for (sum, color) in self.color.iter_mut().zip(part.color) {
            *sum = (i64::from(*sum) - i64::from(color)).clamp(-most, most) as i32;
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

    /// Returns the texel to draw. `doubt` and `trust` are those of [`TextureSums::trust`].
    fn drawn(&self, (doubt, trust): (f32, f32)) -> Texel {
        let (color, share) = self.posterior(doubt);
        Texel::new(color, share * trust)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};
    use glam::DQuat;

    /// A flat splat in the plane z = 0.25.
    fn splat() -> Splat {
        let (mean, scale) = ([0.5, -1.0, 0.25], [0.1, 0.1, 0.01]);
        Splat { mean, scale, opacity: 1.0, ..Splat::default() }
    }

    fn empty(level: u8) -> TextureSums {
        let mut texture = TextureSums::new(&splat(), 0.5);
        texture.refine(level);
        texture
    }

    fn observations(n: usize, side: usize, stream: u64) -> Vec<Observed> {
        let mut rng = Rng::new(5, Purpose::Synthetic, stream);
        let mut one = || Observed {
            texel: rng.below(side * side) as u16,
            weight: 1 + rng.below(256) as u16,
            color: [0; 3].map(|_| rng.below(4097) as i16 - 2048),
        };
        (0..n).map(|_| one()).collect()
    }

    fn of<'a>(level: u8, observed: impl IntoIterator<Item = &'a Observed>) -> TextureSums {
        let mut texture = empty(level);
        let mut texels = texture.open();
        observed.into_iter().for_each(|observed| texels.add(observed));
        texture
    }

    /// Sums of all texels row by row, which do not depend on the order of the patches.
    fn sums(texture: &TextureSums) -> Vec<TexelSums> {
        let side = texture.lattice.side();
        let at = |i: usize| texture.texel([i % side, i / side]).copied().unwrap_or_default();
        (0..side * side).map(at).collect()
    }

    fn assert_equal(a: &TextureSums, b: &TextureSums) {
        assert_eq!((a.lattice, a.predicted), (b.lattice, b.predicted));
        assert_eq!(sums(a), sums(b));
    }

    #[test]
    fn the_order_of_pixels_does_not_matter() {
        let observed = observations(2000, 16, 0);
        let forward = of(2, &observed);
        assert_equal(&forward, &of(2, observed.iter().rev()));
        assert!(sums(&forward).iter().any(|texel| texel.weight > 256));
    }

    #[test]
    fn halves_merge_to_the_whole() {
        let observed = observations(2000, 16, 1);
        let (first, second) = observed.split_at(700);
        let mut merged = of(2, first);
        merged.merge(&of(2, second));
        assert_equal(&merged, &of(2, &observed));
        let mut finer = of(2, first);
        finer.merge(&{
            let mut coarse = of(2, second);
            coarse.coarsen();
            coarse
        });
        let all = sums(&of(2, &observed)).iter().map(|texel| texel.weight).sum::<u32>();
        let found = sums(&finer).iter().map(|texel| texel.weight).sum::<u32>();
        assert!(finer.lattice.level == 2 && all - found <= 3 * 64, "{found} of {all}");
    }

    #[test]
    fn refining_and_coarsening_keep_sums_within_rounding() {
        let before = of(1, &observations(3000, 8, 2));
        let mut after = before.clone();
        after.refine(3);
        assert_eq!(after.lattice.side(), 32);
        after.coarsen();
        after.coarsen();
        assert_eq!((after.lattice, after.predicted), (before.lattice, before.predicted));
        for (a, b) in sums(&before).iter().zip(sums(&after)) {
            assert!(a.weight - b.weight < 16, "{a:?} {b:?}");
            for (a, b) in a.scaled_to(b.weight).color.iter().zip(b.color) {
                assert!(a.abs_diff(b) <= 16, "{a} {b}");
            }
        }
        after.coarsen();
        after.coarsen();
        assert_eq!(after.lattice.level, 0);
        // Shares of a texel that are too small for a unit of weight leave no colour behind.
        let mut faint = of(0, &[Observed { weight: 3, ..observations(1, 4, 3)[0] }]);
        faint.refine(1);
        assert!(faint.patches.is_empty());
    }

    #[test]
    fn texels_keep_their_place_when_the_lattice_is_laid_anew() {
        let one = observations(1, 16, 4)[0];
        for at in [[6, 5], [9, 9], [8, 7]] {
            let mut texture = of(2, &[Observed { texel: empty(2).lattice.number_of(at), ..one }]);
            let world = texture.lattice.point_at(at.map(|v| v as f64 + 0.5));
            let expected = sums(&texture)[at[1] * 16 + at[0]];
            let [x, y, z] = splat().mean;
            let rotation = DQuat::from_rotation_z(0.7);
            let rotation = [rotation.w, rotation.x, rotation.y, rotation.z].map(|v| v as f32);
            let moved = Splat { mean: [x + 0.21, y - 0.1, z], rotation, ..splat() };
            assert!(!texture.fits(&moved) && texture.fits(&splat()));
            texture.lay_anew(&moved, 0.6);
            assert!(texture.fits(&moved));
            let place = texture.lattice.place_of(world).map(|v| v as usize);
            assert_eq!(texture.texel(place), Some(&expected));
        }
    }

    #[test]
    fn gains_are_what_was_added_since() {
        let (before, after) = (observations(800, 8, 5), observations(900, 16, 6));
        let mut start = of(1, &before);
        let mut later = start.clone();
        later.refine(2);
        after.iter().for_each(|observed| later.open().add(observed));
        let gained = later.gained_since(&start);
        assert_equal(&gained, &of(2, &after));
        start.merge(&gained);
        assert_eq!(sums(&start), sums(&later));
        // Coarser by the budget: sums of four texels.
        later.coarsen();
        later.coarsen();
        let gained = later.gained_since(&start);
        assert_eq!(gained.lattice.level, 0);
        let weight = sums(&gained).iter().map(|texel| texel.weight).sum::<u32>();
        assert!(weight < 16, "{weight}");
    }

    #[test]
    fn gains_do_not_hold_what_a_lattice_laid_anew_took_over() {
        let start = of(1, &observations(800, 8, 10));
        let mut later = start.clone();
        // Twice, at levels that the start does not have. The plane turns, too.
        for (turn, level) in [(0.3, 2), (-0.9, 3)] {
            later.refine(level);
            let [x, y, z] = later.lattice.anchor;
            let rotation = DQuat::from_rotation_z(turn) * DQuat::from_rotation_x(0.5 * turn);
            let rotation = [rotation.w, rotation.x, rotation.y, rotation.z].map(|v| v as f32);
            later.lay_anew(&Splat { mean: [x + 0.11, y - 0.07, z], rotation, ..splat() }, 0.5);
        }
        assert!(later.is_laid_anew_since(&start) && !start.is_laid_anew_since(&later));
        let (mut expected, more) = (later.emptied(later.lattice), observations(900, 32, 11));
        for observed in &more {
            later.open().add(observed);
            expected.open().add(observed);
        }
        let gained = later.gained_since(&start);
        assert_eq!(sums(&gained), sums(&expected));
        // The taken-over part is that of the latest lattice, too.
        assert!(sums(&later).iter().zip(sums(&gained)).any(|(all, own)| all.weight > own.weight));
        // A texture that began elsewhere holds nothing of the start.
        let other = TextureSums::new(&Splat { mean: [0.8, -1.0, 0.25], ..splat() }, 0.5);
        assert_eq!(later.gained_since(&other), later);
        (0..2 * MOST_FORMER).for_each(|_| later.lay_anew(&splat(), 0.5));
        assert_eq!(later.former.len(), MOST_FORMER);
    }

    #[test]
    fn full_texels_average_and_never_overflow() {
        let full = |color: i32| TexelSums { weight: MAX_TEXEL_WEIGHT, color: [color; 3] };
        let most = (MAX_TEXEL_WEIGHT * MOST_PER_WEIGHT) as i32;
        let mut texel = full(most);
        texel.join(&full(most));
        assert_eq!(texel, TexelSums { weight: FULL, color: [most / 2; 3] });
        texel.join(&TexelSums { weight: FULL, color: [-most / 2; 3] });
        assert_eq!(texel, TexelSums { weight: 2 * FULL, color: [0; 3] });
        let before = texel;
        texel.add(&TexelSums { weight: 256, color: [256 * 2048; 3] });
        assert_eq!(texel, before, "it has enough");
    }

    #[test]
    fn trust_follows_predictions() {
        let product = |value: f32| (value * PRODUCT_ONE) as i32;
        let trust = |predicted: [[f32; 2]; 2]| {
            let predicted = predicted.map(|row| row.map(product));
            let mut texture = empty(0);
            (0..1000).for_each(|_| texture.add_products(&predicted));
            texture.trust()
        };
        // Exact corrections under the small doubt, half of them under the large one.
        let (doubt, factor) = trust([[0.01, 0.01], [0.005, 0.0025]]);
        assert_eq!((doubt, factor), (DOUBTS[0], 1.0));
        // Noise under the small doubt, exact corrections under the large one.
        let (doubt, factor) = trust([[0.002, 0.02], [0.01, 0.01]]);
        assert_eq!((doubt, factor), (DOUBTS[1], 1.0));
        // Corrections twice too large: the regression slope is a half.
        let (_, factor) = trust([[0.02, 0.04], [0.02, 0.04]]);
        assert!((factor - 0.5).abs() < 0.01, "{factor}");
        assert_eq!(trust([[-0.01, 0.01]; 2]).1, 0.0, "worse than none");
        assert_eq!(empty(0).trust(), (DOUBTS[0], 1.0), "believed until tested");
    }

    #[test]
    fn a_pixel_is_judged_by_what_others_have_shown() {
        let all = observations(50, 4, 9);
        let (own, others) = (all[0], &all[1..]);
        let place =
            [usize::from(own.texel) % 4, usize::from(own.texel) / 4].map(|v| v as f32 + 0.5);
        let [found, expected] =
            [of(0, &all), of(0, others)].map(|t| t.samples_without(place, &own));
        let none = Observed { texel: u16::MAX, ..own };
        assert_eq!(found, of(0, others).samples_without(place, &none));
        assert_ne!(found, expected, "taken away twice");
    }

    #[test]
    fn copies_share_texels_until_pixels_are_added() {
        let stored = of(1, &observations(200, 8, 12));
        let mut judged = stored.clone();
        judged.fade();
        judged.add_products(&[[800, -80], [8, 0]]);
        assert!(Arc::ptr_eq(&stored.patches, &judged.patches) && stored != judged);
        let before = sums(&stored);
        judged.open().add(&observations(1, 8, 13)[0]);
        assert!(!Arc::ptr_eq(&stored.patches, &judged.patches));
        assert!(sums(&stored) == before && sums(&judged) != before);
    }

    #[test]
    fn earlier_photographs_fade() {
        let mut texture = empty(0);
        texture.add_products(&[[800, -80], [8, 0]]);
        texture.fade();
        assert_eq!(texture.predicted, [[700, -70], [7, 0]]);
    }

    #[test]
    fn texels_are_read_as_they_are_drawn() {
        // So few that patches are absent.
        let mut texture = of(2, &observations(12, 16, 8));
        texture.predicted = [[1 << 24, 1 << 25], [0, 1 << 25]];
        let (drawn, side) = (texture.drawn(), texture.lattice.side());
        assert!(texture.patches.len() < texture.index.len());
        let textures = vec![None, Some(Arc::new(texture))];
        for at in (0..side * side).map(|i| [i % side, i / side]) {
            assert_eq!(textures.four(1, at), drawn.four(at), "{at:?}");
        }
        assert!(drawn.patches.iter().flatten().any(|texel| texel.0 >> 27 > 0));
        assert_eq!([0, 2].map(|splat| textures.four(splat, [0, 0])), [[Texel::default(); 4]; 2]);
        assert_eq!(textures.lattice(1), Some(&drawn.lattice));
        assert_eq!([0, 2].map(|splat| textures.lattice(splat)), [None; 2]);
    }

    #[test]
    fn texels_are_drawn_as_their_posterior_mean() {
        let mut texture = of(1, &observations(200, 8, 7));
        // Exact predictions are trusted; only positive colours can be drawn.
        texture.predicted = [[1 << 30, 1 << 30], [0, 1 << 30]];
        for texel in Arc::make_mut(&mut texture.patches).iter_mut().flatten() {
            texel.color = texel.color.map(i32::abs);
        }
        let (drawn, side) = (texture.drawn(), texture.lattice.side());
        for (i, texel) in sums(&texture).iter().enumerate() {
            let place = [i % side, i / side].map(|v| v as f32 + 0.5);
            let weight = f64::from(texel.weight) / f64::from(WEIGHT_ONE);
            let share = weight / (weight + f64::from(DOUBTS[0]));
            let sample = drawn.sample(place);
            assert!((f64::from(sample.share) - share).abs() <= 0.5 / 31.0 + 1e-6);
            // Of another texel, so that nothing is taken away.
            let other = Observed { texel: u16::MAX, weight: 0, color: [0; 3] };
            let [exact, _] = texture.samples_without(place, &other);
            assert!((f64::from(exact.share) - share).abs() < 1e-6);
            for channel in 0..3 {
                let sum = f64::from(texel.color[channel]) / f64::from(COLOR_ONE * WEIGHT_ONE);
                let color = if weight > 0.0 { sum / weight } else { 0.0 };
                assert!((f64::from(exact.color[channel]) - color * share).abs() < 1e-5);
                let rounded = color.min(511.0 / 256.0) * f64::from(sample.share);
                let off = (f64::from(sample.color[channel]) - rounded).abs();
                assert!(off <= 0.5 / 256.0 + 1e-6, "{off}");
            }
        }
    }
}
