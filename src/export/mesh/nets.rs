//! Zero level set of the distance field as a triangle mesh, by surface nets.
//!
//! Each cell that the surface cuts has one vertex, the mean of the cuts through its edges; each cut edge
//! joins the four cells around it. Only cells with all corners defined have a vertex, so the mesh ends where
//! the evidence does. Existing crates take dense arrays without undefined values; adapting blocks with holes
//! to them would take more code than the method.

use super::field::{BLOCK, Field, Sample, Surfel};
use crate::export::error::Fault;
use glam::{DVec3, IVec3};
use rayon::prelude::*;
use std::collections::HashMap;

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
        let expected = "a width above 0".to_owned();
        return Err(Fault::Setting { setting: "cell", expected, found: cell.to_string() });
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

/// Cells of a block that the surface cuts: lowest corner, vertex in cells, colour.
fn surface_cells(field: &Field, place: IVec3) -> Vec<(IVec3, DVec3, DVec3)> {
    let cells = (0..BLOCK * BLOCK * BLOCK)
        .map(|i| BLOCK * place + IVec3::new(i % BLOCK, i / BLOCK % BLOCK, i / (BLOCK * BLOCK)));
    cells.filter_map(|cell| vertex(field, cell).map(|(at, color)| (cell, at, color))).collect()
}

fn vertex(field: &Field, cell: IVec3) -> Option<(DVec3, DVec3)> {
    let mut corners = [Sample { distance: 0.0, color: DVec3::ZERO }; 8];
    for (i, corner) in corners.iter_mut().enumerate() {
        *corner = field.at(cell + offset(i))?;
    }
    let (mut n_cuts, mut position, mut color) = (0.0, DVec3::ZERO, DVec3::ZERO);
    for a in 0..8usize {
        for b in [a | 1, a | 2, a | 4].into_iter().filter(|b| *b != a) {
            let (from, to) = (corners[a].distance, corners[b].distance);
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

/// The two triangles across the edge from `corner` along `axis`, if it is cut and all four cells around it
/// have vertices.
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
