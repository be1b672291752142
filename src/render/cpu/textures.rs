//! Look-up of textures in a drawn picture (`textures.md`, Drawing).
//!
//! Drawing records, for every pixel, the two splats with the largest weights. Afterwards the pixel's ray is
//! intersected with the planes of both, and their textures are read there: two look-ups a pixel, however many
//! splats overlap.

use super::shade;
use super::tile::{GROUPS, Plane};
use super::view::{CameraSplat, CpuView};
use crate::math::simd::{LANES, Vector, dot, gather_rows};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use crate::model::splat::texture::{Lattice, ShownTextures, Texel};
use crate::render::options::TILE;
use glam::DVec3;
use wide::bytemuck::{Pod, Zeroable, cast_ref};

/// Least cosine between ray and normal for a look-up: near grazing angles the intersection is unstable.
pub(in crate::render) const MIN_COSINE: f64 = 0.1;

/// Function that returns the lattice of a splat's texture, if it has one.
pub(super) type LatticeOf<'a> = &'a (dyn Fn(usize) -> Option<Lattice> + Sync);

/// Plane of a textured splat in camera axes, for intersections with pixel rays.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct SurfacePlane {
    /// Normal over the plane's distance: a ray `r` meets the plane at `r/(n·r)`.
    normal: [f32; 3],
    /// Least `|n·r|/|r|` of a look-up.
    least: f32,
    /// Directions of the lattice's columns and rows, texels per world unit.
    axes: [[f32; 3]; 2],
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
            normal: [0.0; 3],
            least: f32::INFINITY,
            axes: [[0.0; 3]; 2],
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
            normal: (normal / distance).as_vec3().to_array(),
            least: (MIN_COSINE / distance.abs()) as f32,
            axes: axes.map(|axis| (axis * lattice.per_unit()).as_vec3().to_array()),
            offset: lattice.place_of(view.centre).map(|v| v as f32),
            shift: shade::directional_shift(view, splat, placed, appearance),
            splat: number as u32,
        }
    }

    pub(super) fn has_texture(&self) -> bool {
        self.splat != u32::MAX
    }
}

/// Where the rays of eight pixels meet planes.
pub(super) struct Met<V> {
    /// Lane mask: clear at grazing angles and behind the camera.
    pub is_met: V,
    /// Column and row in the lattice, texels from its corner.
    pub place: [V; 2],
    /// Depth along the optical axis.
    pub depth: V,
    pub shift: [V; 3],
}

/// Intersects eight rays in camera axes with a plane each.
#[inline(always)]
pub(super) fn meet<V: Vector>(planes: [&SurfacePlane; LANES], ray: [V; 3]) -> Met<V> {
    let mut rows = [cast_ref(planes[0]); LANES];
    for lane in 1..LANES {
        rows[lane] = cast_ref(planes[lane]);
    }
    let [nx, ny, nz, least, ax, ay, az, bx, by, bz, u, v, red, green, blue, _] =
        gather_rows::<V, 16>(rows);
    let per_depth = dot([nx, ny, nz], ray);
    // The values of a plane through the camera are infinite or undefined, and fail the comparison.
    let is_met = (least * dot(ray, ray).sqrt()).mask_at_most(per_depth);
    let inverse = V::splat(1.0) / per_depth;
    let point = [ray[0] * inverse, ray[1] * inverse, ray[2] * inverse];
    let place = [dot([ax, ay, az], point) + u, dot([bx, by, bz], point) + v];
    Met { is_met, place, depth: point[2], shift: [red, green, blue] }
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

    /// True if a splat was drawn in a pixel.
    pub(super) fn has_any(&self) -> bool {
        self.weights[0].as_flattened().iter().any(|&weight| weight > 0.0)
    }

    /// Returns the weight of a pixel's splat and its record number; `which` is 0 for the largest weight.
    #[inline(always)]
    pub(super) fn one(&self, [group, lane]: [usize; 2], which: usize) -> (f32, usize) {
        let number = self.numbers[which][group][lane].to_bits();
        (self.weights[which][group][lane], number as usize)
    }

    /// Returns the weights of the splats of eight pixels and their planes; `which` is 0 for the largest
    /// weights. Pixels without a splat have weight 0 and any plane.
    #[inline(always)]
    pub(super) fn of<'a>(
        &self,
        group: usize,
        which: usize,
        planes: &'a [SurfacePlane],
    ) -> ([f32; LANES], [&'a SurfacePlane; LANES]) {
        let numbers = &self.numbers[which][group];
        let mut of = [&planes[0]; LANES];
        for lane in 0..LANES {
            of[lane] = &planes[numbers[lane].to_bits() as usize];
        }
        (self.weights[which][group], of)
    }
}

/// Textures at eight places, one per pixel.
struct Samples<V> {
    share: V,
    /// Colour times the share.
    color: [V; 3],
}

// Bits of 2²³: an integer below it in the low bits gives their sum.
const INTEGER: u32 = 0x4B00_0000;

/// Adds textures to the premultiplied colours of eight pixels. `coverage` is the sum of all weights, `rays`
/// are in camera axes. Returns `None` if no texture is met.
#[inline(always)]
pub(super) fn add_textures<V: Vector>(
    colors: [V; 3],
    coverage: V,
    (owners, group): (&Owners, usize),
    rays: [V; 3],
    planes: &[SurfacePlane],
    textures: ShownTextures<'_>,
) -> Option<[V; 3]> {
    let mut textured = None;
    let per = V::splat(1.0) / coverage.max(V::splat(f32::MIN_POSITIVE));
    for which in 0..2 {
        let (weights, planes) = owners.of(group, which, planes);
        let (mut sides, mut is_textured) = ([-1.0; LANES], false);
        for lane in 0..LANES {
            if weights[lane] <= 0.0 {
                continue;
            }
            if let Some(lattice) = textures.lattice(planes[lane].splat as usize) {
                sides[lane] = lattice.side() as f32;
                is_textured = true;
            }
        }
        if !is_textured {
            continue;
        }
        let met = meet(planes, rays);
        let Some(samples) = sample(textures, planes, &met, V::load(&sides)) else { continue };
        let weight = V::load(&weights);
        let mut sums = textured.unwrap_or(colors);
        for channel in 0..3 {
            let drawn = colors[channel] * per - met.shift[channel];
            let change = samples.color[channel] - samples.share * drawn;
            sums[channel] = sums[channel] + weight * change;
        }
        textured = Some(sums);
    }
    let mut textured = textured?;
    for channel in &mut textured {
        *channel = channel.max(V::splat(0.0));
    }
    Some(textured)
}

/// Interpolates the textures of planes bilinearly. They have `sides` texels a side, a negative number if there is no
/// texture. The share is 0 where a plane is not met. Returns `None` if no place is within its lattice.
#[inline(always)]
fn sample<V: Vector>(
    textures: ShownTextures<'_>,
    planes: [&SurfacePlane; LANES],
    met: &Met<V>,
    sides: V,
) -> Option<Samples<V>> {
    let (zero, one) = (V::splat(0.0), V::splat(1.0));
    let [x, y] = met.place;
    let columns = zero.mask_at_most(x).and(x.mask_at_most(sides));
    let rows = zero.mask_at_most(y).and(y.mask_at_most(sides));
    let is_inside = met.is_met.and(columns).and(rows);
    let inside = is_inside.sign_bits();
    if inside == 0 {
        return None;
    }
    // Undefined places become 0.
    let x = (x.and(is_inside) - V::splat(0.5)).max(zero);
    let y = (y.and(is_inside) - V::splat(0.5)).max(zero);
    let (column, row) = (x.truncated(), y.truncated());
    let (mut x0, mut y0) = ([0.0; LANES], [0.0; LANES]);
    // Of each of four texels, red and green, then blue and share, as bits.
    let mut texels = [[[0.0; LANES]; 2]; 4];
    for lane in 0..LANES {
        (x0[lane], y0[lane]) = (column[lane] as f32, row[lane] as f32);
        if inside >> lane & 1 == 0 {
            continue;
        }
        let at = [column[lane] as usize, row[lane] as usize];
        let four = textures.four(planes[lane].splat as usize, at);
        for i in 0..4 {
            let [low, high] = four[i].halves();
            (texels[i][0][lane], texels[i][1][lane]) = (f32::from_bits(low), f32::from_bits(high));
        }
    }
    let (right, below) = (x - V::load(&x0), y - V::load(&y0));
    let (left, above) = (one - right, one - below);
    let parts = [left * above, right * above, left * below, right * below];
    let (mut share, mut color) = (zero, [zero; 3]);
    let integer = V::splat(f32::from_bits(INTEGER));
    let first = Texel::CHANNEL_MAX;
    let second = first << Texel::CHANNEL_BITS;
    for i in 0..4 {
        let [low, high] = [V::load(&texels[i][0]), V::load(&texels[i][1])];
        let [r, g] = [low.replace_low_bits(first, INTEGER), low.replace_low_bits(second, INTEGER)];
        let [b, s] =
            [high.replace_low_bits(first, INTEGER), high.replace_low_bits(second, INTEGER)];
        let weight = parts[i] * (s - integer);
        share = share + weight;
        color[0] = color[0] + weight * (r - integer);
        color[1] = color[1] + weight * (g - integer);
        color[2] = color[2] + weight * (b - integer);
    }
    // The share, in each product once, and green were read as second values of their halves.
    let shift = (1 << Texel::CHANNEL_BITS) as f32;
    let unit = 1.0 / (Texel::SHARE_ONE as f32 * shift);
    let of_color = unit / Texel::COLOR_ONE as f32;
    share = share * V::splat(unit);
    color[0] = color[0] * V::splat(of_color);
    color[1] = color[1] * V::splat(of_color / shift);
    color[2] = color[2] * V::splat(of_color);
    Some(Samples { share, color })
}
