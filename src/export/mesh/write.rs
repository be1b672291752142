//! Writing of meshes to files.

use super::field::Surfel;
use super::format::MeshFormat;
use super::nets::{TriangleMesh, triangulate};
use super::text;
use crate::export::atomic::write_atomic;
use crate::export::error::{ExportError, Fault};
use crate::export::format::{Axes, ModelFormat, WriteOptions};
use crate::export::glb::mesh::MeshLayout;
use crate::export::local_origin::comment;
use crate::export::progress::ProgressCounter;
use crate::export::source::{check_axes, file_origin, file_rotation};
use glam::DVec3;
use std::path::Path;

/// Summary of a written mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshSummary {
    /// Number of vertices.
    pub n_vertices: usize,
    /// Number of triangles.
    pub n_triangles: usize,
    /// Size of the file in bytes.
    pub bytes: u64,
}

/// Triangulates surfels on cells of width `cell`, in world units, and writes the mesh atomically. Of the
/// options only axes, up, local origin, unit scale, comments and progress apply; GLB is y-up.
///
/// # Errors
/// [`Fault::NoSurface`] if no surface is found, [`Fault::Setting`] for invalid options,
/// [`Fault::TooLargeForGlb`], [`Fault::Cancelled`], or an error of writing the file.
pub fn write_mesh(
    path: &Path,
    surfels: &[Surfel],
    cell: f64,
    format: MeshFormat,
    options: &WriteOptions,
) -> Result<MeshSummary, ExportError> {
    let (mesh, origin) =
        in_file_axes(surfels, cell, format, options).map_err(|fault| fault.with_path(path))?;
    let (n_vertices, n_triangles) = (mesh.positions.len(), mesh.triangles.len());
    let steps = |n| ProgressCounter::new(options.progress, n);
    let comments: Vec<String> = options.comments.iter().cloned().chain(comment(origin)).collect();
    let n_rows = n_vertices + n_triangles;
    let bytes = match format {
        MeshFormat::Ply => {
            write_atomic(path, |out| text::ply(out, &mesh, &comments, &mut steps(n_rows)))?
        }
        MeshFormat::Obj => {
            write_atomic(path, |out| text::obj(out, &mesh, &comments, &mut steps(n_rows)))?
        }
        MeshFormat::Glb => {
            let layout =
                MeshLayout::new(&mesh, origin, options).map_err(|fault| fault.with_path(path))?;
            let steps = &mut steps(n_rows + n_vertices);
            write_atomic(path, |out| layout.write(out, &mesh, steps))?
        }
    };
    Ok(MeshSummary { n_vertices, n_triangles, bytes })
}

/// Triangulates and returns the mesh and its local origin in the axes and units of the file.
fn in_file_axes(
    surfels: &[Surfel],
    cell: f64,
    format: MeshFormat,
    options: &WriteOptions,
) -> Result<(TriangleMesh, DVec3), Fault> {
    check_axes(options)?;
    let mut mesh = triangulate(surfels, cell)?;
    if mesh.triangles.is_empty() {
        return Err(Fault::NoSurface { n_components: surfels.len() });
    }
    let axes = if format == MeshFormat::Glb { Axes::YUp } else { options.axes };
    let options = WriteOptions { axes, format: ModelFormat::Ply, ..options.clone() };
    let turn = file_rotation(&options);
    let place = |p: &mut DVec3| *p = options.unit_scale * turn.rotate_vector(*p);
    mesh.positions.iter_mut().for_each(place);
    Ok((mesh, file_origin(&options)))
}
