//! Signed distance field, defined only near components with enough points.
//!
//! Each component is a plane segment that contributes its signed distance to nearby grid corners. Its weight
//! decreases along the plane, as the component's Gaussian does, and across it. The distance at a corner is
//! the weighted mean, undefined where the weights sum to too few points. Normals face the cameras, so the two
//! sides of a thin wall stay separate.
//!
//! Space is divided into blocks, each computed from the components that reach it. The result therefore does
//! not depend on the number of threads. Textures are baked with the same weights.

use crate::export::atomic::to_fault;
use crate::export::error::Fault;
use crate::export::stream::ProgressCounter;
use crate::export::video::encode_png;
use crate::math::image::unit_to_byte;
use crate::math::sym3::Sym3;
use crate::model::splat::texture::Texture;
use glam::{DMat3, DVec3, IVec3};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::HashMap;
use std::sync::Arc;

/// Plane segment with an oriented normal, which represents one component.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfel {
    /// Centre, in world units.
    pub mean: DVec3,
    /// Unit normal, facing the observing cameras.
    pub normal: DVec3,
    /// Covariance of the component's points, in world units²; determines the extent along the plane.
    pub covariance: Sym3,
    /// sRGB-encoded colour.
    pub color: DVec3,
    /// Number of points of the component.
    pub evidence: f64,
    /// Texture of the component, in the world of `mean`.
    pub texture: Option<Arc<Texture>>,
}

/// Number of grid corners of a block along each axis.
pub(super) const BLOCK: i32 = 8;
/// Maximum number of grid blocks.
// About 1 GB.
const MAX_BLOCKS: usize = 100_000;
/// Maximum distance from the plane, in cells, at which a segment contributes.
// The corners of a cell that the plane cuts are closer.
const MAX_CELLS_ACROSS: f64 = 2.5;
/// Maximum distance from the centre along the plane, in standard deviations, at which a segment
/// contributes.
const MAX_DEVIATIONS_ALONG: f64 = 2.5;
/// Standard deviation, in cells, whose square is added to a segment's covariance.
// Closes holes between components with few points.
const SPREAD: f64 = 0.5;
/// Minimum sum of weights at a grid corner, in points, for a defined distance.
const MIN_WEIGHT: f64 = 1.0;
/// Minimum number of points of a component, relative to the median of all components.
// Components with fewer are at the rims of observed regions, where depth pixels mix foreground and background.
const MIN_SHARE: f64 = 0.3;
/// Maximum number of points with which a component is weighted.
// A wall seen in every frame must not outweigh the edge of an object in front of it.
const MAX_EVIDENCE: f64 = 64.0;
/// Maximum number of texels per side of an atlas.
const MAX_ATLAS_SIDE: usize = 4096;
/// Number of texels per side of the block of a quad without textures: vertex colours, interpolated.
const PLAIN_SIDE: usize = 4;
/// Minimum cosine between the normals of a quad and of a component whose texture it shows.
// The textures of the other side of a thin wall, and of the next side of a box, show something else.
const MIN_COSINE: f64 = 0.5;
/// Number of blocks of an atlas that are computed between two reports of progress.
const BATCH: usize = 1024;

#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    /// Distance to the surface in cells, positive on the side of the cameras.
    pub distance: f64,
    /// sRGB-encoded colour.
    pub color: DVec3,
}

/// Samples at the corners of a block, x fastest; `None` where the distance is undefined.
pub(super) type Samples = Vec<Option<Sample>>;

pub(super) struct Field {
    pub blocks: Vec<(IVec3, Samples)>,
    index: HashMap<IVec3, usize>,
}

impl Field {
    pub fn new(surfels: &[Surfel], cell: f64) -> Result<Self, Fault> {
        let reached = block_surfel_pairs(surfels, cell)?;
        let groups: Vec<&[(Place, u32)]> = reached.chunk_by(|a, b| a.0 == b.0).collect();
        let blocks = groups.into_par_iter().map(|group| {
            let place = IVec3::from_array(group[0].0);
            let members = group.iter().map(|(_, i)| &surfels[*i as usize]);
            (place, block(place, members, cell))
        });
        let blocks: Vec<(IVec3, Samples)> = blocks.collect();
        let index = blocks.iter().enumerate().map(|(i, (place, _))| (*place, i)).collect();
        Ok(Self { blocks, index })
    }

    pub fn at(&self, corner: IVec3) -> Option<Sample> {
        let place = corner.div_euclid(IVec3::splat(BLOCK));
        self.blocks[*self.index.get(&place)?].1[in_block(corner - BLOCK * place)]
    }
}

fn in_block(corner: IVec3) -> usize {
    (corner.x + BLOCK * (corner.y + BLOCK * corner.z)) as usize
}

type Place = [i32; 3];

fn block_surfel_pairs(surfels: &[Surfel], cell: f64) -> Result<Vec<(Place, u32)>, Fault> {
    let mut reached = Vec::new();
    let least = MIN_SHARE * median_evidence(surfels);
    for (i, surfel) in surfels.iter().enumerate().filter(|(_, s)| s.evidence >= least) {
        let (lo, hi) = corners(surfel, cell);
        let [lo, hi] = [lo, hi].map(|corner| corner.div_euclid(IVec3::splat(BLOCK)));
        // Checked before the list grows: a far too small cell would exhaust the memory.
        let n_blocks = (hi.as_dvec3() - lo.as_dvec3() + 1.0).element_product();
        if reached.len() as f64 + n_blocks > 8.0 * MAX_BLOCKS.max(surfels.len()) as f64 {
            return Err(too_small(cell));
        }
        reached.extend(places(lo, hi).map(|place| (place, i as u32)));
    }
    // Groups the pairs by block and fixes the order of sums within a block.
    reached.par_sort_unstable();
    match reached.chunk_by(|a, b| a.0 == b.0).count() {
        n if n > MAX_BLOCKS => Err(too_small(cell)),
        _ => Ok(reached),
    }
}

fn places(lo: IVec3, hi: IVec3) -> impl Iterator<Item = Place> {
    let row = move |y, z| (lo.x..=hi.x).map(move |x| [x, y, z]);
    (lo.z..=hi.z).flat_map(move |z| (lo.y..=hi.y).flat_map(move |y| row(y, z)))
}

fn median_evidence(surfels: &[Surfel]) -> f64 {
    let mut evidence: Vec<f64> = surfels.iter().map(|s| s.evidence).collect();
    evidence.sort_unstable_by(f64::total_cmp);
    evidence.get(evidence.len() / 2).copied().unwrap_or_default()
}

fn too_small(cell: f64) -> Fault {
    Fault::setting(
        "cell",
        format!("cells for which {MAX_BLOCKS} blocks of {BLOCK}\u{b3} are enough"),
        format!("{cell}; give a larger one"),
    )
}

fn corners(surfel: &Surfel, cell: f64) -> (IVec3, IVec3) {
    let [xx, _, _, yy, _, zz] = plane_covariance(surfel, cell).to_array();
    let deviation = DVec3::new(xx, yy, zz).max(DVec3::ZERO).map(f64::sqrt);
    let reach = MAX_DEVIATIONS_ALONG * deviation + MAX_CELLS_ACROSS * cell * surfel.normal.abs();
    let [lo, hi] = [surfel.mean - reach, surfel.mean + reach].map(|p| p / cell);
    (lo.ceil().as_ivec3(), hi.floor().as_ivec3())
}

fn plane_covariance(surfel: &Surfel, cell: f64) -> Sym3 {
    surfel.covariance.add_scaled(1.0, Sym3::diagonal((SPREAD * cell).powi(2)))
}

fn inverse(surfel: &Surfel, cell: f64) -> Option<DMat3> {
    plane_covariance(surfel, cell).inverse().map(|s| s.to_mat3())
}

fn block<'a>(place: IVec3, surfels: impl Iterator<Item = &'a Surfel>, cell: f64) -> Samples {
    let origin = BLOCK * place;
    // Weight, weighted distance in cells, weighted colour.
    let mut sums = vec![(0.0, 0.0, DVec3::ZERO); (BLOCK * BLOCK * BLOCK) as usize];
    for surfel in surfels {
        let Some(inverse) = inverse(surfel, cell) else { continue };
        let (lo, hi) = corners(surfel, cell);
        let lo = (lo - origin).max(IVec3::ZERO);
        let hi = (hi - origin).min(IVec3::splat(BLOCK - 1));
        for z in lo.z..=hi.z {
            for y in lo.y..=hi.y {
                for x in lo.x..=hi.x {
                    let corner = IVec3::new(x, y, z);
                    let at = (origin + corner).as_dvec3() * cell;
                    let (weight, distance) = contribution(surfel, inverse, at, cell);
                    let sum = &mut sums[in_block(corner)];
                    sum.0 += weight;
                    sum.1 += weight * distance;
                    sum.2 += weight * surfel.color;
                }
            }
        }
    }
    let sample = |(weight, distance, color): (f64, f64, DVec3)| {
        let known = weight >= MIN_WEIGHT;
        known.then(|| Sample { distance: distance / weight, color: color / weight })
    };
    sums.into_iter().map(sample).collect()
}

/// Returns what a plane segment contributes to the field at the point `at`: its weight, and the signed
/// distance of `at` from its plane in cells.
fn contribution(surfel: &Surfel, inverse: DMat3, at: DVec3, cell: f64) -> (f64, f64) {
    let offset = at - surfel.mean;
    let across = offset.dot(surfel.normal);
    let plane = offset - across * surfel.normal;
    let (width, distance) = (plane.dot(inverse * plane), across / cell);
    if width > MAX_DEVIATIONS_ALONG * MAX_DEVIATIONS_ALONG || distance.abs() > MAX_CELLS_ACROSS {
        return (0.0, 0.0);
    }
    let weight = surfel.evidence.min(MAX_EVIDENCE) * (-0.5 * (width + distance * distance)).exp();
    (weight, distance)
}

/// Triangle mesh in world units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions.
    pub positions: Vec<DVec3>,
    /// sRGB-encoded vertex colours in `[0, 1]`.
    pub colors: Vec<DVec3>,
    /// Vertex indices, counter-clockwise seen from the side of the cameras.
    pub triangles: Vec<[u32; 3]>,
}

/// Vertices of the two triangles of a quad.
pub(in crate::export) const QUAD_TRIANGLES: [usize; 6] = [0, 1, 2, 0, 2, 3];
/// Places of the vertices of a quad in its block of an atlas.
const PLACES: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

impl TriangleMesh {
    /// Returns the number of quads, each of two triangles, of a mesh from [`triangulate`].
    pub(in crate::export) fn n_quads(&self) -> usize {
        self.triangles.len() / 2
    }

    /// Returns the vertices around a quad, whose triangles are [`QUAD_TRIANGLES`].
    pub(in crate::export) fn quad(&self, i: usize) -> [usize; 4] {
        let (s, t) = (self.triangles[2 * i], self.triangles[2 * i + 1]);
        // Both begin at one end of their common edge.
        let (s, t) = if s[2] == t[1] { (s, t) } else { (t, s) };
        [s[0], s[1], s[2], t[2]].map(|v| v as usize)
    }
}

/// Triangulates the surface of `surfels` on cells of width `cell`, in world units.
///
/// # Errors
/// [`Fault::Setting`] if the cell is not above 0, or so small that it would need too much memory.
pub fn triangulate(surfels: &[Surfel], cell: f64) -> Result<TriangleMesh, Fault> {
    if !(cell.is_finite() && cell > 0.0) {
        return Err(Fault::setting("cell", "a width above 0", cell));
    }
    let field = Field::new(surfels, cell)?;
    let cut: Vec<(IVec3, DVec3, DVec3)> =
        field.blocks.par_iter().flat_map_iter(|(place, _)| surface_cells(&field, *place)).collect();
    let numbers: HashMap<IVec3, u32> =
        cut.iter().enumerate().map(|(i, (cell, ..))| (*cell, i as u32)).collect();
    let triangles = cut.par_iter().flat_map_iter(|(cell, ..)| {
        (0..3).flat_map(|axis| quad(&field, &numbers, *cell, axis)).collect::<Vec<_>>()
    });
    Ok(TriangleMesh {
        triangles: triangles.collect(),
        positions: cut.iter().map(|(_, position, _)| *position * cell).collect(),
        colors: cut.iter().map(|(.., color)| color.clamp(DVec3::ZERO, DVec3::ONE)).collect(),
    })
}

/// Returns the cells of a block that the surface cuts, each with its lowest corner, vertex (in cells)
/// and colour.
fn surface_cells(field: &Field, place: IVec3) -> Vec<(IVec3, DVec3, DVec3)> {
    let cells = (0..BLOCK * BLOCK * BLOCK)
        .map(|i| BLOCK * place + IVec3::new(i % BLOCK, i / BLOCK % BLOCK, i / (BLOCK * BLOCK)));
    cells.filter_map(|cell| vertex(field, cell).map(|(at, color)| (cell, at, color))).collect()
}

fn vertex(field: &Field, cell: IVec3) -> Option<(DVec3, DVec3)> {
    let mut corners = [Sample { distance: 0.0, color: DVec3::ZERO }; 8];
    for (i, corner) in corners.iter_mut().enumerate() {
        // Only cells with all corners defined: the mesh ends where evidence ends.
        *corner = field.at(cell + offset(i))?;
    }
    // Surface nets: the vertex is the mean of the points where the surface cuts the edges of the cell.
    let (mut n_cuts, mut position, mut color) = (0.0, DVec3::ZERO, DVec3::ZERO);
    for a in 0..8usize {
        for b in [a | 1, a | 2, a | 4].into_iter().filter(|b| *b != a) {
            let (from, to) = (corners[a].distance, corners[b].distance);
            // Zero counts as positive, so the two distances differ and the division is defined.
            if (from < 0.0) != (to < 0.0) {
                let share = from / (from - to);
                let ends = [a, b].map(|i| (cell + offset(i)).as_dvec3());
                position += ends[0].lerp(ends[1], share);
                color += corners[a].color.lerp(corners[b].color, share);
                n_cuts += 1.0;
            }
        }
    }
    (n_cuts > 0.0).then(|| (position / n_cuts, color / n_cuts))
}

fn offset(corner: usize) -> IVec3 {
    IVec3::new(corner as i32 & 1, corner as i32 >> 1 & 1, corner as i32 >> 2)
}

/// Returns the two triangles across the edge from `corner` along `axis`. Empty if the surface does not cut the
/// edge, or a cell around it has no vertex.
fn quad(field: &Field, numbers: &HashMap<IVec3, u32>, corner: IVec3, axis: usize) -> Vec<[u32; 3]> {
    let [along, right, up] = [axis, (axis + 1) % 3, (axis + 2) % 3].map(|i| IVec3::AXES[i]);
    let ends = field.at(corner).zip(field.at(corner + along));
    let Some((from, to)) = ends.filter(|(a, b)| (a.distance < 0.0) != (b.distance < 0.0)) else {
        return Vec::new();
    };
    // Counter-clockwise around the edge, seen from its end.
    let around = [corner - right - up, corner - up, corner, corner - right];
    let mut vertices = [0; 4];
    for (vertex, cell) in vertices.iter_mut().zip(around) {
        match numbers.get(&cell) {
            Some(number) => *vertex = *number,
            None => return Vec::new(),
        }
    }
    let [a, b, c, d] = vertices;
    // The cameras are on the side of positive distances.
    match from.distance < to.distance {
        true => vec![[a, b, c], [a, c, d]],
        false => vec![[a, c, b], [a, d, c]],
    }
}

/// Colours of a mesh's surface from textures: an image with a square block of texels for each quad.
pub(in crate::export) struct Atlas {
    /// PNG file of sRGB-encoded colours.
    pub png: Vec<u8>,
    size: [usize; 2],
    blocks: Vec<Block>,
}

#[derive(Clone, Copy, Default)]
struct Block {
    /// First column and row.
    corner: [usize; 2],
    /// Texels per side, a power of two.
    side: usize,
}

impl Atlas {
    /// Bakes the textures of `surfels` for the mesh that [`triangulate`] makes of them.
    pub fn bake(
        mesh: &TriangleMesh,
        surfels: &[Surfel],
        cell: f64,
        steps: &mut ProgressCounter,
    ) -> Result<Self, Fault> {
        let mut reached = block_surfel_pairs(surfels, cell)?;
        reached.retain(|(_, i)| surfels[*i as usize].texture.is_some());
        let groups = reached.chunk_by(|a, b| a.0 == b.0).map(|group| (group[0].0, group));
        let surface = Surface { mesh, surfels, cell, by_block: groups.collect() };
        let quads = (0..mesh.n_quads()).into_par_iter();
        let (blocks, size) = arrange(&quads.map(|i| surface.side(i)).collect::<Vec<_>>())?;
        let mut pixels = vec![0; 3 * size[0] * size[1]];
        for (n, batch) in blocks.chunks(BATCH).enumerate() {
            let texels = batch.par_iter().enumerate();
            let texels = texels.map(|(i, block)| surface.texels(BATCH * n + i, block.side));
            for (Block { corner: [x, y], side }, texels) in
                batch.iter().zip(texels.collect::<Vec<_>>())
            {
                for (row, texels) in texels.chunks(3 * side).enumerate() {
                    let start = 3 * ((y + row) * size[0] + x);
                    pixels[start..start + texels.len()].copy_from_slice(texels);
                }
            }
            steps.advance(batch.len()).map_err(to_fault("bake textures", 0))?;
        }
        let mut png = Vec::new();
        encode_png(&mut png, &pixels, size).map_err(to_fault("encode textures", 0))?;
        Ok(Self { png, size, blocks })
    }

    /// Returns the places of a quad's vertices in the image, from its upper left corner, in `[0, 1]`.
    pub fn coordinates(&self, quad: usize) -> [[f64; 2]; 4] {
        let Block { corner, side } = self.blocks[quad];
        let (rim, length) = (rim(side) as f64, inner_length(side));
        PLACES.map(|place| {
            // Centres of texels, so that interpolation never reads another block.
            let at = |i: usize| corner[i] as f64 + 0.5 + rim + place[i] * length;
            [0, 1].map(|i| at(i) / self.size[i] as f64)
        })
    }
}

/// Returns the number of texels between the edge of a block and its quad.
// Smoothed edges of triangles are drawn from places a little outside, which must not show other blocks.
fn rim(side: usize) -> usize {
    if side < PLAIN_SIDE { 0 } else { (side / 8).clamp(1, 2) }
}

/// Returns the distance of a quad's vertices in its block, texels.
fn inner_length(side: usize) -> f64 {
    (side - 1 - 2 * rim(side)) as f64
}

/// Returns places for blocks, and the size of the image. `sides` are their texels per side, powers of two; all
/// are halved until they fit.
fn arrange(sides: &[usize]) -> Result<(Vec<Block>, [usize; 2]), Fault> {
    const MAX_TEXELS: usize = MAX_ATLAS_SIDE * MAX_ATLAS_SIDE;
    let halved = |side: usize, times: u32| (side >> times).max(1);
    let area = |times| sides.iter().map(|side| halved(*side, times).pow(2)).sum::<usize>();
    let times = (0..=MAX_ATLAS_SIDE.ilog2()).find(|times| area(*times) <= MAX_TEXELS);
    let times = times.ok_or_else(|| {
        let found = format!("one that gives {}; give a larger one", sides.len());
        Fault::setting("cell", format!("a width that gives {MAX_TEXELS} quads at most"), found)
    })?;
    let mut order: Vec<usize> = (0..sides.len()).collect();
    order.sort_by_key(|i| Reverse(sides[*i]));
    let mut blocks = vec![Block::default(); sides.len()];
    let mut n_texels = 0;
    for i in order {
        let side = halved(sides[i], times);
        // On a Z-order curve squares of descending size leave no gaps.
        let corner = [n_texels, n_texels >> 1].map(every_second_bit);
        blocks[i] = Block { corner, side };
        n_texels += side * side;
    }
    let bits = n_texels.next_power_of_two().ilog2();
    Ok((blocks, [1 << bits.div_ceil(2), 1 << (bits / 2)]))
}

fn every_second_bit(n: usize) -> usize {
    (0..usize::BITS / 2).map(|bit| (n >> (2 * bit) & 1) << bit).sum()
}

/// Returns the value at a place in a quad, linear on each of its triangles, from the values of its vertices.
fn interpolate([a, b, c, d]: [DVec3; 4], [u, v]: [f64; 2]) -> DVec3 {
    if u >= v { a + u * (b - a) + v * (c - b) } else { a + v * (d - a) + u * (c - d) }
}

/// Surface of a mesh and the components with textures near it.
struct Surface<'a> {
    mesh: &'a TriangleMesh,
    surfels: &'a [Surfel],
    cell: f64,
    by_block: HashMap<Place, &'a [(Place, u32)]>,
}

struct Textured<'a> {
    surfel: &'a Surfel,
    texture: &'a Texture,
    inverse: DMat3,
}

/// Texture at a point.
struct Shown {
    weight: f64,
    share: f64,
    /// Colour times the share.
    color: DVec3,
    /// Width of a texel, world units.
    pitch: f64,
}

impl<'a> Surface<'a> {
    fn vertices(&self, quad: usize) -> [DVec3; 4] {
        self.mesh.quad(quad).map(|v| self.mesh.positions[v])
    }

    fn near(&self, [a, b, c, d]: [DVec3; 4]) -> Vec<Textured<'a>> {
        let normal = (c - a).cross(d - b).normalize_or_zero();
        let lo = (a.min(b).min(c).min(d) / self.cell).floor().as_ivec3();
        let hi = (a.max(b).max(c).max(d) / self.cell).ceil().as_ivec3();
        let [first, last] = [lo, hi].map(|corner| corner.div_euclid(IVec3::splat(BLOCK)));
        let groups = places(first, last).filter_map(|place| self.by_block.get(&place));
        let mut numbers: Vec<u32> = groups.flat_map(|group| group.iter()).map(|p| p.1).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let textured = |i: u32| {
            let surfel = &self.surfels[i as usize];
            let is_near = || {
                let (from, to) = corners(surfel, self.cell);
                from.cmple(hi).all() && to.cmpge(lo).all()
            };
            let is_shown = surfel.normal.dot(normal) >= MIN_COSINE && is_near();
            let texture = surfel.texture.as_deref().filter(|_| is_shown)?;
            Some(Textured { surfel, texture, inverse: inverse(surfel, self.cell)? })
        };
        numbers.into_iter().filter_map(textured).collect()
    }

    /// Returns the two textures with the largest weights at a point.
    // A mean of more would blur, because planes of components differ.
    fn shown(&self, near: &[Textured], at: DVec3) -> [Option<Shown>; 2] {
        let mut found = [None, None];
        let weight_of = |shown: &Option<Shown>| shown.as_ref().map_or(0.0, |s| s.weight);
        for Textured { surfel, texture, inverse } in near {
            let (weight, _) = contribution(surfel, *inverse, at, self.cell);
            if weight <= weight_of(&found[1]) {
                continue;
            }
            let sample = texture.sample(texture.lattice.place_of(at).map(|v| v as f32));
            if sample.share > 0.0 {
                let color = DVec3::from_array(sample.color.map(f64::from));
                let pitch = texture.lattice.per_unit().recip();
                found[1] = Some(Shown { weight, share: sample.share.into(), color, pitch });
                found.sort_by(|a, b| weight_of(b).total_cmp(&weight_of(a)));
            }
        }
        found
    }

    /// Returns the number of texels per side that shows all detail of a quad's textures, a power of two.
    fn side(&self, quad: usize) -> usize {
        let vertices = self.vertices(quad);
        let near = self.near(vertices);
        let places = PLACES.into_iter().chain([[0.5; 2]]);
        let shown = places.flat_map(|place| self.shown(&near, interpolate(vertices, place)));
        let pitch = shown.flatten().map(|shown| shown.pitch).fold(f64::INFINITY, f64::min);
        let [a, b, c, d] = vertices;
        let edges = [a - b, b - c, c - d, d - a].map(DVec3::length);
        // The outer texels have their centres on the edges.
        let n_pitches = (edges.into_iter().fold(0.0, f64::max) / pitch).ceil();
        let mut side = PLAIN_SIDE;
        while inner_length(side) < n_pitches && side < MAX_ATLAS_SIDE {
            side *= 2;
        }
        side
    }

    /// Returns the texels of a quad's block, row by row, as bytes of red, green and blue.
    fn texels(&self, quad: usize, side: usize) -> Vec<u8> {
        let vertices = self.vertices(quad);
        let colors = self.mesh.quad(quad).map(|v| self.mesh.colors[v]);
        let near = self.near(vertices);
        let along = |i| match side {
            1 => 0.5,
            _ => (i as f64 - rim(side) as f64) / inner_length(side),
        };
        let texel = |i: usize| {
            let place = [i % side, i / side].map(along);
            let shown = self.shown(&near, interpolate(vertices, place));
            let (mut weight, mut share, mut color) = (0.0, 0.0, DVec3::ZERO);
            for shown in shown.into_iter().flatten() {
                weight += shown.weight;
                share += shown.weight * shown.share;
                color += shown.weight * shown.color;
            }
            let drawn = interpolate(colors, place);
            let color =
                if weight > 0.0 { color / weight + (1.0 - share / weight) * drawn } else { drawn };
            color.to_array().map(|c| unit_to_byte(c as f32))
        };
        (0..side * side).flat_map(texel).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::texture::{Lattice, Texel};

    fn surfel(mean: [f64; 3], normal: DVec3, variance: [f64; 3], evidence: f64) -> Surfel {
        let covariance = Sym3::from_mat3(DMat3::from_diagonal(variance.into()));
        let color = DVec3::new(0.25, 0.5, 0.75);
        Surfel { mean: mean.into(), normal, covariance, color, evidence, texture: None }
    }

    fn textured(surfel: Surfel, anchor: [f32; 3], half: f32, level: u8) -> Surfel {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let lattice = Lattice { anchor, axes, half, level };
        let patches = vec![[Texel::new([0.5; 3], 1.0); 16]];
        let texture = Texture { lattice, index: vec![0; 1 << (2 * level)], patches };
        Surfel { texture: Some(Arc::new(texture)), ..surfel }
    }

    /// Field of one block, whose colours are coordinates.
    fn field(distance: impl Fn(DVec3) -> f64) -> Field {
        let at = |[x, y, z]: Place| DVec3::new(x.into(), y.into(), z.into());
        let corners = places(IVec3::ZERO, IVec3::splat(BLOCK - 1)).map(at);
        let samples = corners.map(|at| Some(Sample { distance: distance(at), color: at }));
        let blocks = vec![(IVec3::ZERO, samples.collect())];
        Field { blocks, index: HashMap::from([(IVec3::ZERO, 0)]) }
    }

    fn surface<'a>(
        mesh: &'a TriangleMesh,
        surfels: &'a [Surfel],
        cell: f64,
        reached: &'a [(Place, u32)],
    ) -> Surface<'a> {
        let groups = reached.chunk_by(|a, b| a.0 == b.0).map(|group| (group[0].0, group));
        Surface { mesh, surfels, cell, by_block: groups.collect() }
    }

    #[test]
    fn components_below_a_share_of_the_median_are_left_out() {
        let of = |evidence| surfel([0.0; 3], DVec3::Z, [0.01; 3], evidence);
        let reached = block_surfel_pairs(&[2.9, 3.0, 10.0, 10.0].map(of), 1.0).unwrap();
        let mut numbers: Vec<u32> = reached.iter().map(|pair| pair.1).collect();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers, [1, 2, 3]);
    }

    #[test]
    fn blocks_are_counted_before_they_are_listed() {
        let line = |x: f64, reach: f64| {
            surfel([x, 4.0, 4.0], DVec3::Z, [(reach / 2.5).powi(2) - 0.25, 0.0, 0.0], 1.0)
        };
        // Eight times the same 100,000 blocks are allowed; one pair more is not.
        let mut surfels = vec![line(0.0, 399_996.0); 8];
        assert_eq!(block_surfel_pairs(&surfels, 1.0).unwrap().len(), 800_000);
        surfels.push(surfel([-4.0, 4.0, 4.0], DVec3::Z, [0.0; 3], 1.0));
        assert!(block_surfel_pairs(&surfels, 1.0).is_err());
        assert!(block_surfel_pairs(&[line(4.0, 400_000.0)], 1.0).is_err(), "100,001 blocks");
    }

    #[test]
    fn a_segment_reaches_along_and_across_its_plane() {
        let segment = surfel([0.0; 3], DVec3::X, [0.0; 3], 1.0);
        assert_eq!(corners(&segment, 0.5), (IVec3::new(-3, -1, -1), IVec3::new(3, 1, 1)));
        let at = |evidence, point: [f64; 3]| {
            let segment = surfel([0.0; 3], DVec3::Z, [1.0; 3], evidence);
            contribution(&segment, DMat3::IDENTITY, point.into(), 0.5)
        };
        assert_eq!(at(10.0, [2.5, 0.0, 0.0]), (10.0 * (-3.125f64).exp(), 0.0));
        assert_eq!(at(10.0, [0.0, 0.0, 1.25]), (10.0 * (-3.125f64).exp(), 2.5));
        assert_eq!(at(100.0, [1.0, 2.0, -1.0]), (64.0 * (-4.5f64).exp(), -2.0));
        assert_eq!(at(10.0, [2.6, 0.0, 0.0]), (0.0, 0.0));
        assert_eq!(at(10.0, [0.0, 0.0, -1.3]), (0.0, 0.0));
    }

    #[test]
    fn the_field_of_a_segment_is_the_distance_from_its_plane_in_cells() {
        let segment = surfel([2.0, 2.0, 2.1], DVec3::Z, [1.0, 1.0, 0.0], 40.0);
        let field = Field::new(&[segment], 0.5).unwrap();
        for (z, expected) in [(4, -0.2), (5, 0.8)] {
            let Sample { distance, color } = field.at(IVec3::new(4, 4, z)).unwrap();
            assert!((distance - expected).abs() < 1e-12, "{distance}");
            assert!(color.distance(DVec3::new(0.25, 0.5, 0.75)) < 1e-12, "{color}");
        }
    }

    #[test]
    fn a_vertex_is_the_mean_of_all_cut_edges() {
        let tilted = field(|at| at.dot(DVec3::new(1.0, 2.0, 4.0)) - 2.5);
        let (position, color) = vertex(&tilted, IVec3::ZERO).unwrap();
        assert!(position.distance(DVec3::new(0.5, 0.55, 0.225)) < 1e-12, "{position}");
        assert!(color.distance(position) < 1e-12, "{color}");
        // Zero counts as positive.
        assert_eq!(vertex(&field(|at| at.z), IVec3::ZERO), None);
        assert_eq!(vertex(&field(|at| 1.0 - at.z), IVec3::ZERO), None);
        let at_top = DVec3::new(0.5, 0.5, 1.0);
        assert_eq!(vertex(&field(|at| at.z - 1.0), IVec3::ZERO), Some((at_top, at_top)));
    }

    #[test]
    fn quads_face_positive_distances_and_are_found_again() {
        let number = |[x, y, z]: Place| IVec3::new(x, y, z);
        let cells = places(IVec3::ZERO, IVec3::splat(BLOCK - 1)).map(number);
        let numbers = cells.map(|cell| (cell, in_block(cell) as u32)).collect();
        let of =
            |distance: fn(f64) -> f64| quad(&field(|at| distance(at.z)), &numbers, IVec3::ONE, 2);
        let (up, down) = ([[64, 65, 73], [64, 73, 72]], [[64, 73, 65], [64, 72, 73]]);
        assert_eq!(of(|z| z - 1.5), up);
        assert_eq!(of(|z| 1.5 - z), down);
        assert_eq!(of(|z| z - 2.0), up);
        assert!(of(|z| z - 1.0).is_empty() && of(|z| 2.0 - z).is_empty());
        let triangles = [up, down].concat();
        let mesh = TriangleMesh { triangles, ..TriangleMesh::default() };
        assert_eq!((mesh.quad(0), mesh.quad(1)), ([64, 65, 73, 72], [64, 72, 73, 65]));
    }

    #[test]
    fn blocks_of_an_atlas_have_rims_and_shrink_together() {
        let sides = [1, 2, 4, 8, 16, 64];
        assert_eq!(sides.map(rim), [0, 0, 1, 1, 2, 2]);
        assert_eq!(sides.map(inner_length), [0.0, 1.0, 1.0, 5.0, 11.0, 59.0]);
        let (blocks, size) = arrange(&[4096, 4096]).unwrap();
        let corners: Vec<_> = blocks.iter().map(|block| (block.corner, block.side)).collect();
        assert_eq!(corners, [([0, 0], 2048), ([2048, 0], 2048)]);
        assert_eq!(size, [4096, 2048]);
        let blocks = vec![Block { corner: [8, 0], side: 8 }];
        let atlas = Atlas { png: Vec::new(), size: [16, 8], blocks };
        let ([left, right], [top, bottom]) = ([9.5 / 16.0, 14.5 / 16.0], [1.5 / 8.0, 6.5 / 8.0]);
        let expected = [[left, top], [right, top], [right, bottom], [left, bottom]];
        assert_eq!(atlas.coordinates(0), expected);
    }

    #[test]
    fn a_quad_shows_components_that_face_and_reach_it() {
        let of = |at: f64, normal| {
            let plain = surfel([at; 3], normal, [0.01, 0.01, 0.0], 1.0);
            textured(plain, [at as f32; 3], 0.5, 0)
        };
        let surfels = [of(10.25, DVec3::Z), of(10.25, DVec3::NEG_Z), of(8.6, DVec3::Z)];
        let reached = block_surfel_pairs(&surfels, 0.5).unwrap();
        let mesh = TriangleMesh::default();
        let vertices = PLACES.map(|[x, y]| DVec3::new(10.0 + 0.5 * x, 10.0 + 0.5 * y, 10.0));
        let near = surface(&mesh, &surfels, 0.5, &reached).near(vertices);
        assert_eq!(near.iter().map(|near| near.surfel).collect::<Vec<_>>(), [&surfels[0]]);
    }

    #[test]
    fn the_longest_edge_of_a_quad_determines_its_texels() {
        let corners = [[100.0, 100.0], [106.75, 100.0], [104.75, 101.5], [102.0, 101.5]];
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let wide = || surfel([103.375, 100.75, 100.0], DVec3::Z, [9.0, 9.0, 0.0], 10.0);
        let coarse = [textured(wide(), [103.375, 100.75, 100.0], 4.0, 3)];
        let fine = [textured(wide(), [102.375, 100.75, 100.0], 0.0064, 5)];
        let side = |surfels: &[Surfel], first: usize| {
            let mut positions = corners.map(|[x, y]| DVec3::new(x, y, 100.0)).to_vec();
            positions.rotate_left(first);
            let triangles = triangles.clone();
            let mesh = TriangleMesh { positions, triangles, ..TriangleMesh::default() };
            let reached = block_surfel_pairs(surfels, 1.0).unwrap();
            surface(&mesh, surfels, 1.0, &reached).side(0)
        };
        // 27 texels of 0.25 beside rims of 2.
        assert_eq!([0, 1, 2, 3].map(|first| side(&coarse, first)), [32; 4]);
        assert_eq!(side(&fine, 0), MAX_ATLAS_SIDE);
    }

    #[test]
    fn colours_are_linear_on_each_triangle() {
        let values = [[0.0; 3], [1.0, 0.0, 0.0], [1.0; 3], [0.0, 1.0, 0.0]].map(DVec3::from_array);
        assert_eq!(interpolate(values, [0.75, 0.25]), DVec3::new(0.75, 0.25, 0.25));
        assert_eq!(interpolate(values, [0.25, 0.75]), DVec3::new(0.25, 0.75, 0.25));
        let colors = [[1.0, 0.0, 0.2], [0.0; 3], [1.0, 0.0, 0.6], [0.0; 3]];
        let mesh = TriangleMesh {
            positions: values.to_vec(),
            colors: colors.map(DVec3::from_array).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        assert_eq!(surface(&mesh, &[], 1.0, &[]).texels(0, 1), [255, 0, 102]);
    }
}
