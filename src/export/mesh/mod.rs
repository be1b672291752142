//! Triangle mesh from the plane segments of a scene's components (`files.md`, Mesh), weighted by their
//! numbers of points.
//!
//! ```
//! use glam::{DMat3, DVec3};
//! use vbgs_studio::export::mesh::{Surfel, triangulate};
//! use vbgs_studio::math::sym3::Sym3;
//!
//! // A patch of a plane, seen from above.
//! let surfel = |x: i32, y: i32| Surfel {
//!     mean: DVec3::new(0.1 * f64::from(x), 0.1 * f64::from(y), 0.53),
//!     normal: DVec3::Z,
//!     covariance: Sym3::from_mat3(DMat3::from_diagonal(DVec3::new(0.004, 0.004, 1e-6))),
//!     color: DVec3::new(1.0, 0.5, 0.0),
//!     evidence: 50.0,
//! };
//! let surfels: Vec<Surfel> = (0..10).flat_map(|x| (0..10).map(move |y| surfel(x, y))).collect();
//! let mesh = triangulate(&surfels, 0.05)?;
//! assert!(mesh.positions.iter().all(|p| (p.z - 0.53).abs() < 1e-6));
//! assert!(mesh.triangles.len() > 500);
//! # Ok::<(), vbgs_studio::export::Fault>(())
//! ```

pub(super) mod field;

use super::atomic::write_atomic;
use super::error::{ExportError, Fault};
use super::format::{Axes, ModelFormat, WriteOptions};
use super::glb::mesh::MeshLayout;
use super::local_origin::{OriginCarrier, comment};
use super::source::{check_axes, file_origin, file_rotation};
use super::stream::{ProgressCounter, put_floats, write_rows};
use crate::math::image::unit_to_byte;
use glam::DVec3;
use std::fmt::Write as _;
use std::io;
use std::io::Write;
use std::path::Path;

pub use field::{Surfel, TriangleMesh, triangulate};

/// File format of meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Binary PLY with vertex colours (`red green blue`).
    Ply,
    /// glTF 2.0, y-up, with linear vertex colours (`COLOR_0`).
    Glb,
    /// Wavefront OBJ text with colours after the coordinates, as MeshLab and Blender read them.
    Obj,
}

impl MeshFormat {
    /// All formats.
    pub const ALL: [MeshFormat; 3] = [MeshFormat::Ply, MeshFormat::Glb, MeshFormat::Obj];

    /// File extension, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            MeshFormat::Ply => "ply",
            MeshFormat::Glb => "glb",
            MeshFormat::Obj => "obj",
        }
    }

    /// Returns how files of this format store the local origin.
    pub fn origin_carrier(self) -> OriginCarrier {
        match self {
            MeshFormat::Glb => OriginCarrier::Transform,
            MeshFormat::Ply | MeshFormat::Obj => OriginCarrier::Comment,
        }
    }

    /// Derives the format from a file extension, case-insensitive.
    ///
    /// # Errors
    /// [`Fault::UnknownMeshExtension`] for any other extension.
    pub fn from_path(path: &Path) -> Result<Self, ExportError> {
        let found = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let known = Self::ALL.into_iter().find(|format| format.extension() == found);
        known.ok_or_else(|| Fault::UnknownMeshExtension { found }.with_path(path))
    }
}

fn ply(
    out: &mut dyn Write,
    mesh: &TriangleMesh,
    comments: &[String],
    steps: &mut ProgressCounter,
) -> io::Result<()> {
    let mut header = "ply\nformat binary_little_endian 1.0\n".to_owned();
    for comment in comments {
        let _ = writeln!(header, "comment {comment}");
    }
    let _ = writeln!(header, "element vertex {}", mesh.positions.len());
    ["x", "y", "z"].iter().for_each(|n| header.push_str(&format!("property float {n}\n")));
    ["red", "green", "blue"].iter().for_each(|n| header.push_str(&format!("property uchar {n}\n")));
    let _ = writeln!(header, "element face {}", mesh.triangles.len());
    header.push_str("property list uchar int vertex_indices\nend_header\n");
    out.write_all(header.as_bytes())?;
    write_rows(out, mesh.positions.len(), steps, |i, row| {
        put_floats(row, &mesh.positions[i].to_array());
        row.extend_from_slice(&mesh.colors[i].to_array().map(|c| unit_to_byte(c as f32)));
    })?;
    write_rows(out, mesh.triangles.len(), steps, |i, row| {
        // A list of a PLY begins with its length.
        row.push(3);
        mesh.triangles[i].iter().for_each(|v| row.extend_from_slice(&v.to_le_bytes()));
    })
}

/// Writes a mesh as OBJ text. Colours follow the coordinates, and indices start at 1.
fn obj(
    out: &mut dyn Write,
    mesh: &TriangleMesh,
    comments: &[String],
    steps: &mut ProgressCounter,
) -> io::Result<()> {
    for comment in comments {
        writeln!(out, "# {comment}")?;
    }
    write_rows(out, mesh.positions.len(), steps, |i, row| {
        let [x, y, z] = mesh.positions[i].as_vec3().to_array();
        let [r, g, b] = mesh.colors[i].to_array();
        // Four digits are finer than the bytes of the other formats.
        row.extend_from_slice(format!("v {x} {y} {z} {r:.4} {g:.4} {b:.4}\n").as_bytes());
    })?;
    write_rows(out, mesh.triangles.len(), steps, |i, row| {
        let [a, b, c] = mesh.triangles[i].map(|v| v + 1);
        row.extend_from_slice(format!("f {a} {b} {c}\n").as_bytes());
    })
}

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

/// Triangulates plane segments on cells of width `cell`, in world units, and writes the mesh atomically.
/// Only axes, up direction, local origin, unit scale, comments and progress of the options apply. A GLB
/// is always y-up.
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
            write_atomic(path, |out| ply(out, &mesh, &comments, &mut steps(n_rows)))?
        }
        MeshFormat::Obj => {
            write_atomic(path, |out| obj(out, &mesh, &comments, &mut steps(n_rows)))?
        }
        MeshFormat::Glb => {
            let layout =
                MeshLayout::new(&mesh, origin, options).map_err(|fault| fault.with_path(path))?;
            // A GLB stores positions and colours in two passes over the vertices.
            let steps = &mut steps(n_rows + n_vertices);
            write_atomic(path, |out| layout.write(out, &mesh, steps))?
        }
    };
    Ok(MeshSummary { n_vertices, n_triangles, bytes })
}

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
    // glTF prescribes y-up. As a PLY, because the model's format does not concern the mesh.
    let axes = if format == MeshFormat::Glb { Axes::YUp } else { options.axes };
    let options = WriteOptions { axes, format: ModelFormat::Ply, ..options.clone() };
    let turn = file_rotation(&options);
    let place = |p: &mut DVec3| *p = options.unit_scale * turn.rotate_vector(*p);
    mesh.positions.iter_mut().for_each(place);
    Ok((mesh, file_origin(&options)))
}
