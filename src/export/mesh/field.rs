//! Signed distance field, defined only near components with enough points.
//!
//! Each component is a plane segment that contributes its signed distance to nearby grid corners. Its weight
//! decreases along the plane, as the component's Gaussian does, and across it. The distance at a corner is
//! the weighted mean, undefined where the weights sum to too few points. Normals face the cameras, so the two
//! sides of a thin wall stay separate.
//!
//! Space is divided into blocks, each computed from the components that reach it. The result therefore does
//! not depend on the number of threads.

use crate::export::error::Fault;
use crate::math::sym3::Sym3;
use glam::{DMat3, DVec3, IVec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Plane segment with an oriented normal, which represents one component.
#[derive(Clone, Copy, Debug, PartialEq)]
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
        for z in lo.z..=hi.z {
            for y in lo.y..=hi.y {
                reached.extend((lo.x..=hi.x).map(|x| ([x, y, z], i as u32)));
            }
        }
    }
    // Groups the pairs by block and fixes the order of sums within a block.
    reached.par_sort_unstable();
    match reached.chunk_by(|a, b| a.0 == b.0).count() {
        n if n > MAX_BLOCKS => Err(too_small(cell)),
        _ => Ok(reached),
    }
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

fn block<'a>(place: IVec3, surfels: impl Iterator<Item = &'a Surfel>, cell: f64) -> Samples {
    let origin = BLOCK * place;
    // Weight, weighted distance in cells, weighted colour.
    let mut sums = vec![(0.0, 0.0, DVec3::ZERO); (BLOCK * BLOCK * BLOCK) as usize];
    for surfel in surfels {
        let Some(inverse) = plane_covariance(surfel, cell).inverse().map(|s| s.to_mat3()) else {
            continue;
        };
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
