//! Textures of splats as renderers read them (`textures.md`).
//!
//! A texture is a square lattice of texels, fixed in world space. It lies about in the plane of its splat. A
//! texel holds the colour of a surface and how far it replaces what the splats draw. Memory is held in
//! patches of 4 × 4 texels, because the lattice is square and the visible part of a surface is not.

use crate::math::pose::Pose;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use std::fmt::Debug;
use std::sync::Arc;

/// Texels per side of a patch.
pub const PATCH: usize = 4;
/// Texels per patch.
pub const TEXELS: usize = PATCH * PATCH;
/// Largest level of a lattice.
pub const MAX_LEVEL: u8 = 5;
/// Marks a patch of the lattice that has no texels.
pub const ABSENT: u16 = u16::MAX;

/// Lattice of texels in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// Centre, world units.
    pub anchor: [f32; 3],
    /// Unit directions of columns and rows, world axes.
    pub axes: [[f32; 3]; 2],
    /// Half the length of a side, world units.
    pub half: f32,
    /// The lattice has `4·2^level` texels per side.
    pub level: u8,
}

impl Lattice {
    /// Returns the number of texels per side.
    #[inline(always)]
    pub fn side(&self) -> usize {
        PATCH << self.level
    }

    /// Returns the number of texels per world unit.
    pub fn per_unit(&self) -> f64 {
        self.side() as f64 / (2.0 * f64::from(self.half))
    }

    /// Returns the position of a world point along columns and rows, in texels from the lattice's corner.
    /// It may lie outside.
    pub fn place_of(&self, point: DVec3) -> [f64; 2] {
        let from = point - DVec3::from_array(self.anchor.map(f64::from));
        self.axes.map(|axis| {
            let along = DVec3::from_array(axis.map(f64::from)).dot(from);
            along * self.per_unit() + 0.5 * self.side() as f64
        })
    }

    /// Returns the world position of a place in the lattice, in texels from its corner.
    pub fn point_at(&self, place: [f64; 2]) -> DVec3 {
        let anchor = DVec3::from_array(self.anchor.map(f64::from));
        let half = 0.5 * self.side() as f64;
        self.axes.iter().zip(place).fold(anchor, |point, (axis, at)| {
            point + DVec3::from_array(axis.map(f64::from)) * ((at - half) / self.per_unit())
        })
    }

    /// Moves the lattice with the world. `motion` maps old to new world coordinates.
    pub fn move_by(&mut self, motion: &Pose) {
        let world = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        self.anchor = motion.transform_point(world(self.anchor)).as_vec3().to_array();
        self.axes = self.axes.map(|axis| (motion.rotation() * world(axis)).as_vec3().to_array());
    }

    /// Returns the number of a texel: patch by patch, row-major in each.
    #[inline(always)]
    pub fn number_of(&self, at: [usize; 2]) -> u16 {
        let (patch, within) = self.patch_of(at);
        (patch * TEXELS + within) as u16
    }

    /// Returns the number of the patch of a texel, row-major, and of the texel in the patch.
    #[inline(always)]
    pub fn patch_of(&self, [x, y]: [usize; 2]) -> (usize, usize) {
        let patches = self.side() / PATCH;
        ((y / PATCH) * patches + x / PATCH, (y % PATCH) * PATCH + x % PATCH)
    }
}

/// Texel as it is drawn: from the lowest bit nine for each colour channel, in steps of 1/256, then five for its
/// share, in steps of 1/31.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Texel(pub u32);

impl Texel {
    /// Bits of a colour channel.
    pub const CHANNEL_BITS: u32 = 9;
    /// Largest value of a colour channel, and the mask of its bits.
    pub const CHANNEL_MAX: u32 = (1 << Self::CHANNEL_BITS) - 1;
    /// Value of a colour channel for colour 1.
    pub const COLOR_ONE: u32 = 256;
    /// Value of the share for share 1, its largest.
    pub const SHARE_ONE: u32 = (1 << (u32::BITS - 3 * Self::CHANNEL_BITS)) - 1;

    /// Rounds a texel. `color` is limited to 0 to 511/256, `share` to 0 to 1.
    pub fn new(color: [f32; 3], share: f32) -> Self {
        // As `round` would, which is a call of a function.
        let rounded = |value: f32, one: u32, most: u32| {
            let value = (value * one as f32).clamp(0.0, most as f32);
            let whole = value as u32;
            whole + u32::from(value - whole as f32 >= 0.5)
        };
        let [r, g, b] = color.map(|c| rounded(c, Self::COLOR_ONE, Self::CHANNEL_MAX));
        let share = rounded(share, Self::SHARE_ONE, Self::SHARE_ONE);
        Self([share, b, g, r].into_iter().fold(0, |bits, value| bits << Self::CHANNEL_BITS | value))
    }

    /// Returns the colour and the share.
    pub fn unpack(self) -> ([f32; 3], f32) {
        let channel = |i: u32| (self.0 >> (i * Self::CHANNEL_BITS)) & Self::CHANNEL_MAX;
        let color = [0, 1, 2].map(|i| channel(i) as f32 / Self::COLOR_ONE as f32);
        (color, self.share_steps() as f32 / Self::SHARE_ONE as f32)
    }

    /// Returns the bits of red and green, and those of blue and the share. Of both, the second value begins
    /// [`Self::CHANNEL_BITS`] bits above the first.
    #[inline(always)]
    pub fn halves(self) -> [u32; 2] {
        let bits = 2 * Self::CHANNEL_BITS;
        [self.0 & ((1 << bits) - 1), self.0 >> bits]
    }

    fn share_steps(self) -> u32 {
        self.0 >> (3 * Self::CHANNEL_BITS)
    }
}

/// Texture at one place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Share of the colour that the texture replaces, 0 to 1.
    pub share: f32,
    /// Colour of the surface times the share.
    pub color: [f32; 3],
}

impl Sample {
    /// Adds a texel, whose share is already multiplied by its weight in the interpolation.
    #[inline]
    pub fn add(&mut self, color: [f32; 3], share: f32) {
        self.share += share;
        for (sum, color) in self.color.iter_mut().zip(color) {
            *sum += share * color;
        }
    }
}

/// Texture of one splat.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Lattice of the texels.
    pub lattice: Lattice,
    /// Index into `patches` of each patch of the lattice, row-major; [`ABSENT`] for patches without texels.
    pub index: Vec<u16>,
    /// Texels by patch, row-major in each.
    pub patches: Vec<[Texel; TEXELS]>,
}

impl Texture {
    #[inline(always)]
    fn texel(&self, at: [usize; 2]) -> Texel {
        let (patch, within) = self.lattice.patch_of(at);
        match self.patch(patch) {
            Some(patch) => patch[within],
            None => Texel::default(),
        }
    }

    #[inline(always)]
    fn patch(&self, number: usize) -> Option<&[Texel; TEXELS]> {
        self.patches.get(usize::from(*self.index.get(number)?))
    }

    /// Returns [`four_texels`] about a place.
    #[inline(always)]
    pub fn four(&self, at: [usize; 2]) -> [Texel; 4] {
        four_texels(&self.lattice, at, |number| self.patch(number))
    }

    /// Returns the texture at a place, in texels from the lattice's corner, bilinearly interpolated. The
    /// share is 0 outside.
    pub fn sample(&self, place: [f32; 2]) -> Sample {
        let mut sample = Sample::default();
        for (at, part) in corners(place, self.lattice.side()).into_iter().flatten() {
            let (color, share) = self.texel(at).unpack();
            sample.add(color, part * share);
        }
        sample
    }

    /// Returns the memory used, in bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(&self.index[..]) + size_of_val(&self.patches[..])
    }
}

/// Returns the texels at columns `x` and `x + 1` of rows `y` and `y + 1` of a lattice, row by row. At the last column
/// and row they repeat. `patch` returns a patch by its number, `None` if it has no texels.
#[inline(always)]
pub fn four_texels<'a, T: Copy + Default + 'a>(
    lattice: &Lattice,
    [x, y]: [usize; 2],
    patch: impl Fn(usize) -> Option<&'a [T; TEXELS]>,
) -> [T; 4] {
    let (number, within) = lattice.patch_of([x, y]);
    if x % PATCH < PATCH - 1 && y % PATCH < PATCH - 1 {
        let Some(patch) = patch(number) else { return [T::default(); 4] };
        let [low, high] = [within, within + PATCH];
        return [patch[low], patch[low + 1], patch[high], patch[high + 1]];
    }
    let last = lattice.side() - 1;
    let (right, below) = ((x + 1).min(last), (y + 1).min(last));
    [[x, y], [right, y], [x, below], [right, below]].map(|at| {
        let (number, within) = lattice.patch_of(at);
        patch(number).map_or_else(T::default, |patch| patch[within])
    })
}

/// Returns the four texels about a place in a lattice of `side` texels a side, and the weight of each.
/// `None` outside of the lattice.
#[inline]
pub fn corners([x, y]: [f32; 2], side: usize) -> Option<[([usize; 2], f32); 4]> {
    let limit = side as f32;
    if !(x >= 0.0 && y >= 0.0 && x <= limit && y <= limit) {
        return None;
    }
    let last = side - 1;
    let (x, y) = ((x - 0.5).max(0.0), (y - 0.5).max(0.0));
    let (x0, y0) = ((x as usize).min(last), (y as usize).min(last));
    let (fx, fy) = ((x - x0 as f32).min(1.0), (y - y0 as f32).min(1.0));
    let (x1, y1) = ((x0 + 1).min(last), (y0 + 1).min(last));
    Some([
        ([x0, y0], (1.0 - fx) * (1.0 - fy)),
        ([x1, y0], fx * (1.0 - fy)),
        ([x0, y1], (1.0 - fx) * fy),
        ([x1, y1], fx * fy),
    ])
}

/// Textures by splat; `None` for splats without one. Snapshots share textures that have not changed.
pub type Textures = Vec<Option<Arc<Texture>>>;

/// Textures of splats whose texels are composed as they are read.
pub trait LearnedTextures: Debug + Sync {
    /// Returns the lattice of a splat's texture, if it has one.
    fn lattice(&self, splat: usize) -> Option<&Lattice>;

    /// Returns [`four_texels`] about a place in the texture of a splat.
    fn four(&self, splat: usize, at: [usize; 2]) -> [Texel; 4];
}

/// Textures that a picture shows.
#[derive(Clone, Copy, Debug)]
pub enum ShownTextures<'a> {
    /// For many pictures, or one of many pixels.
    Composed(&'a Textures),
    /// For one small picture, which reads few of the texels.
    Learned(&'a dyn LearnedTextures),
}

impl<'a> ShownTextures<'a> {
    /// Returns the lattice of a splat's texture, if it has one.
    #[inline(always)]
    pub fn lattice(self, splat: usize) -> Option<&'a Lattice> {
        match self {
            Self::Composed(textures) => Some(&textures.get(splat)?.as_ref()?.lattice),
            Self::Learned(textures) => textures.lattice(splat),
        }
    }

    /// Returns [`four_texels`] about a place in the texture of a splat.
    #[inline(always)]
    pub fn four(self, splat: usize, at: [usize; 2]) -> [Texel; 4] {
        match self {
            Self::Composed(textures) => match textures.get(splat) {
                Some(Some(texture)) => texture.four(at),
                _ => [Texel::default(); 4],
            },
            Self::Learned(textures) => textures.four(splat, at),
        }
    }
}

/// Returns textures of share 1, with `color` of the learned share as the colour of each texel. Textures that
/// are the same in `old` are taken from `painted`, the result for `old`.
pub fn painted_by_share(
    textures: &Textures,
    [old, painted]: [&Textures; 2],
    color: impl Fn(f32) -> [f32; 3],
) -> Textures {
    // A share has few values, and there are millions of texels.
    let texels: Vec<Texel> = (0..=Texel::SHARE_ONE)
        .map(|share| Texel::new(color(share as f32 / Texel::SHARE_ONE as f32), 1.0))
        .collect();
    let paint = |patch: &[Texel; TEXELS]| patch.map(|texel| texels[texel.share_steps() as usize]);
    let painted_of = |(splat, texture): (usize, &Option<Arc<Texture>>)| {
        let texture = texture.as_ref()?;
        match (old.get(splat), painted.get(splat)) {
            (Some(Some(old)), Some(painted)) if Arc::ptr_eq(old, texture) => painted.clone(),
            _ => Some(Arc::new(Texture {
                lattice: texture.lattice,
                index: texture.index.clone(),
                patches: texture.patches.iter().map(paint).collect(),
            })),
        }
    };
    textures.iter().enumerate().map(painted_of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice() -> Lattice {
        let axes = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Lattice { anchor: [1.0, 2.0, 3.0], axes, half: 0.5, level: 1 }
    }

    #[test]
    fn places_and_points_are_inverse() {
        let lattice = lattice();
        let point = lattice.point_at([1.5, 7.0]);
        assert_eq!(point.to_array(), [1.0, 2.0 - 0.3125, 3.375]);
        assert_eq!(lattice.place_of(point + DVec3::X), [1.5, 7.0], "off the plane");
    }

    #[test]
    fn packing_keeps_colors_within_half_a_step() {
        let (color, share) = Texel::new([0.3, 1.5, 7.0], 0.5).unpack();
        for (found, expected) in color.into_iter().zip([0.3, 1.5, 511.0 / 256.0]) {
            assert!((found - expected).abs() <= 0.5 / 256.0, "{found} for {expected}");
        }
        assert!((share - 0.5).abs() <= 0.5 / 31.0);
        let texel = Texel::new([1.0, 0.5, 2.0], 1.0);
        assert_eq!(texel.0, 256 | 128 << 9 | 511 << 18 | 31 << 27);
        assert_eq!(texel.halves(), [256 | 128 << 9, 511 | 31 << 9]);
    }

    #[test]
    fn texels_are_rounded_half_away_from_zero() {
        let halves = (0..1024).map(|i| i as f32 / 2.0);
        let near = halves.flat_map(|half| [half.next_down(), half, half.next_up()]);
        let others = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.7, 1e30, 0.3, 511.4, 512.6];
        for value in near.chain(others) {
            let expected = value.round().clamp(0.0, 511.0) as u32;
            let texel = Texel::new([value / 256.0; 3], value / 31.0);
            assert_eq!(texel.0 & Texel::CHANNEL_MAX, expected, "{value}");
        }
    }

    #[test]
    fn textures_painted_by_share_replace_all_colour_and_unchanged_ones_are_taken_over() {
        let shares = [0.0, 0.25, 1.0].map(|share| Texel::new([1.9, 0.0, 0.3], share));
        let patch = std::array::from_fn(|i| shares[i % 3]);
        let index = vec![ABSENT, 0, ABSENT, ABSENT];
        let texture = Some(Arc::new(Texture { lattice: lattice(), index, patches: vec![patch] }));
        let color = |share: f32| [share, 1.0 - share, 0.0];
        let old = vec![texture.clone(), None, texture.clone()];
        let painted = painted_by_share(&old, [&Vec::new(); 2], color);
        assert_eq!(painted[1], None);
        let first = painted[0].as_ref().unwrap();
        assert_eq!((&first.index, first.lattice), (&texture.as_ref().unwrap().index, lattice()));
        for (painted, learned) in first.patches[0].iter().zip(patch) {
            assert_eq!(*painted, Texel::new(color(learned.unpack().1), 1.0));
        }
        assert_eq!(first.sample([0.5, 0.5]).share, 0.0, "nothing is known of absent patches");
        let changed = texture.as_deref().cloned().map(Arc::new);
        let new = painted_by_share(&vec![texture, changed], [&old, &painted], color);
        let is_same = |splat: usize| Arc::ptr_eq(new[splat].as_ref().unwrap(), first);
        assert_eq!([is_same(0), is_same(1)], [true, false]);
    }

    #[test]
    fn samples_interpolate_and_absent_patches_have_no_share() {
        let mut index = vec![ABSENT; 4];
        index[0] = 0;
        let mut patch = [Texel::new([1.0, 0.0, 0.0], 1.0); TEXELS];
        patch[1] = Texel::new([0.0, 1.0, 0.0], 1.0);
        let texture = Texture { lattice: lattice(), index, patches: vec![patch] };
        let centre = texture.sample([0.5, 0.5]);
        assert_eq!((centre.color, centre.share), ([1.0, 0.0, 0.0], 1.0));
        let between = texture.sample([0.75, 0.5]);
        assert_eq!(between.color, [0.75, 0.25, 0.0]);
        let rim = texture.sample([4.0, 2.0]);
        assert_eq!((rim.color, rim.share), ([0.5, 0.0, 0.0], 0.5), "half beside an absent patch");
        assert_eq!(texture.sample([6.0, 6.0]), Sample::default());
        assert_eq!(texture.sample([-0.1, 2.0]), Sample::default());
        assert_eq!(texture.sample([f32::NAN, 2.0]), Sample::default());
    }
}
