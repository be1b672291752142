//! Signed distances to the surface, known only near evidence.
//!
//! Each component is a piece of a plane: at a point of space it says how far the plane is, with a weight
//! that falls with the distance along the plane, as the component's own Gaussian does, and across it. The
//! distance there is the weighted mean; where the weights do not add up to a few points, nothing is
//! known, and no surface comes of it. The planes have the side that cameras saw: two sheets of a thin wall
//! stay apart.
//!
//! Space is divided into blocks, each computed by itself from the components that reach it: the result
//! does not depend on the number of threads.

use crate::export::error::Fault;
use crate::math::sym3::Sym3;
use glam::{DMat3, DVec3, IVec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// A piece of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surfel {
    /// Its middle, world units.
    pub mean: DVec3,
    /// Unit normal, towards the cameras that saw it.
    pub normal: DVec3,
    /// Of its points, world units²; how far it reaches along the plane is from this.
    pub covariance: Sym3,
    /// sRGB-encoded colour.
    pub color: DVec3,
    /// Points behind it.
    pub evidence: f64,
}

/// Corners of a block along each axis.
pub(super) const BLOCK: i32 = 8;
/// Most blocks: about 1 GB.
const MAX_BLOCKS: usize = 100_000;
/// Distance across the plane, cells, beyond which a component says nothing: the corners of a cell that
/// the plane cuts are nearer.
const REACH: f64 = 2.5;
/// Distance along the plane, standard deviations, beyond which it says nothing.
const WIDTH: f64 = 2.5;
/// Added to the deviation along the plane, cells: between components of few points there is no hole.
const SPREAD: f64 = 0.5;
/// Weights that add up to less than so many points are no evidence.
const MIN_WEIGHT: f64 = 1.0;
/// Components with less than this share of the median's points say nothing: they stand at the rims of
/// what was seen, where pixels mix what is near and what is far.
const MIN_SHARE: f64 = 0.3;
/// More points than this make a component no more certain: a wall seen in every frame must not
/// outweigh the edge of what stands before it.
const MAX_EVIDENCE: f64 = 64.0;

/// What is known at a corner of the grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    /// To the surface, cells; positive on the side of the cameras.
    pub distance: f64,
    /// sRGB-encoded.
    pub color: DVec3,
}

/// The corners of a block, x first; `None` where nothing is known.
pub(super) type Samples = Vec<Option<Sample>>;

/// Signed distances on a grid.
pub(super) struct Field {
    /// Blocks by their place, in order of it.
    pub blocks: Vec<(IVec3, Samples)>,
    index: HashMap<IVec3, usize>,
}

impl Field {
    /// Of these surfels, on cells of this width.
    pub fn new(surfels: &[Surfel], cell: f64) -> Result<Self, Fault> {
        let reached = reached(surfels, cell)?;
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

    /// What is known at a corner.
    pub fn at(&self, corner: IVec3) -> Option<Sample> {
        let place = corner.div_euclid(IVec3::splat(BLOCK));
        self.blocks[*self.index.get(&place)?].1[in_block(corner - BLOCK * place)]
    }
}

/// Number of a corner among those of its block.
fn in_block(corner: IVec3) -> usize {
    (corner.x + BLOCK * (corner.y + BLOCK * corner.z)) as usize
}

type Place = [i32; 3];

/// Blocks and the surfels that reach them, in order.
fn reached(surfels: &[Surfel], cell: f64) -> Result<Vec<(Place, u32)>, Fault> {
    let mut reached = Vec::new();
    let least = MIN_SHARE * median_evidence(surfels);
    for (i, surfel) in surfels.iter().enumerate().filter(|(_, s)| s.evidence >= least) {
        let (lo, hi) = corners(surfel, cell);
        let [lo, hi] = [lo, hi].map(|corner| corner.div_euclid(IVec3::splat(BLOCK)));
        // Before anything is listed: a cell far too small would ask for all memory there is.
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
    Fault::Setting {
        setting: "cell",
        expected: format!("cells for which {MAX_BLOCKS} blocks of {BLOCK}\u{b3} are enough"),
        found: format!("{cell}; give a larger one"),
    }
}

/// The lowest and the highest corner of the grid that a surfel reaches.
fn corners(surfel: &Surfel, cell: f64) -> (IVec3, IVec3) {
    let [xx, _, _, yy, _, zz] = along(surfel, cell).to_array();
    let deviation = DVec3::new(xx, yy, zz).max(DVec3::ZERO).map(f64::sqrt);
    let reach = WIDTH * deviation + REACH * cell * surfel.normal.abs();
    let [lo, hi] = [surfel.mean - reach, surfel.mean + reach].map(|p| p / cell);
    (lo.ceil().as_ivec3(), hi.floor().as_ivec3())
}

/// The covariance by which a surfel reaches along its plane.
fn along(surfel: &Surfel, cell: f64) -> Sym3 {
    surfel.covariance.add_scaled(1.0, Sym3::diagonal((SPREAD * cell).powi(2)))
}

fn block<'a>(place: IVec3, surfels: impl Iterator<Item = &'a Surfel>, cell: f64) -> Samples {
    let origin = BLOCK * place;
    // Weight, weighted distance in cells, weighted colour.
    let mut sums = vec![(0.0, 0.0, DVec3::ZERO); (BLOCK * BLOCK * BLOCK) as usize];
    for surfel in surfels {
        let Some(inverse) = along(surfel, cell).inverse().map(|s| s.to_mat3()) else { continue };
        let (lo, hi) = corners(surfel, cell);
        let lo = (lo - origin).max(IVec3::ZERO);
        let hi = (hi - origin).min(IVec3::splat(BLOCK - 1));
        for z in lo.z..=hi.z {
            for y in lo.y..=hi.y {
                for x in lo.x..=hi.x {
                    let corner = IVec3::new(x, y, z);
                    let at = (origin + corner).as_dvec3() * cell;
                    let (weight, distance) = said(surfel, inverse, at, cell);
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

/// Weight and distance in cells that a surfel gives a point.
fn said(surfel: &Surfel, inverse: DMat3, at: DVec3, cell: f64) -> (f64, f64) {
    let offset = at - surfel.mean;
    let across = offset.dot(surfel.normal);
    let plane = offset - across * surfel.normal;
    let (width, distance) = (plane.dot(inverse * plane), across / cell);
    if width > WIDTH * WIDTH || distance.abs() > REACH {
        return (0.0, 0.0);
    }
    let weight = surfel.evidence.min(MAX_EVIDENCE) * (-0.5 * (width + distance * distance)).exp();
    (weight, distance)
}
