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
//!     texture: None,
//! };
//! let surfels: Vec<Surfel> = (0..10).flat_map(|x| (0..10).map(move |y| surfel(x, y))).collect();
//! let mesh = triangulate(&surfels, 0.05)?;
//! assert!(mesh.positions.iter().all(|p| (p.z - 0.53).abs() < 1e-6));
//! assert!(mesh.triangles.len() > 500);
//! # Ok::<(), vbgs_studio::export::Fault>(())
//! ```

pub(super) mod field;

use super::atomic::{remove_leftovers, write_atomic};
use super::error::{ExportError, Fault};
use super::format::{Axes, ModelFormat, WriteOptions};
use super::glb::mesh::MeshLayout;
use super::local_origin::{OriginCarrier, comment};
use super::source::{Placement, check_axes};
use super::stream::{ProgressCounter, put_floats, write_rows};
use crate::math::image::unit_to_byte;
use glam::DVec3;
use std::fmt::Write as _;
use std::io;
use std::io::Write;
use std::path::Path;

use field::{Atlas, QUAD_TRIANGLES};
pub use field::{Surfel, TriangleMesh, triangulate};

/// Name of the material of a textured OBJ.
const MATERIAL: &str = "surface";

/// File format of meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Binary PLY with vertex colours (`red green blue`).
    Ply,
    /// glTF 2.0, y-up, with linear vertex colours (`COLOR_0`), or with a texture.
    Glb,
    /// Wavefront OBJ text with colours after the coordinates, as MeshLab and Blender read them, or with a
    /// texture in a PNG of the same name, named by an MTL.
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

    /// True if files of this format hold textures.
    pub fn has_textures(self) -> bool {
        self != MeshFormat::Ply
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
    obj_comments(out, comments)?;
    write_rows(out, mesh.positions.len(), steps, |i, row| {
        let [r, g, b] = mesh.colors[i].to_array();
        // Four digits are finer than the bytes of the other formats.
        let line = format!("v {} {r:.4} {g:.4} {b:.4}\n", obj_position(mesh, i));
        row.extend_from_slice(line.as_bytes());
    })?;
    write_rows(out, mesh.triangles.len(), steps, |i, row| {
        let [a, b, c] = mesh.triangles[i].map(|v| v + 1);
        row.extend_from_slice(format!("f {a} {b} {c}\n").as_bytes());
    })
}

fn obj_comments(out: &mut dyn Write, comments: &[String]) -> io::Result<()> {
    comments.iter().try_for_each(|comment| writeln!(out, "# {comment}"))
}

fn obj_position(mesh: &TriangleMesh, i: usize) -> String {
    let [x, y, z] = mesh.positions[i].as_vec3().to_array();
    format!("{x} {y} {z}")
}

/// Writes a mesh with a texture as OBJ text, and its MTL and PNG beside `path`.
fn obj_textured(
    out: &mut dyn Write,
    path: &Path,
    (mesh, atlas): (&TriangleMesh, &Atlas),
    comments: &[String],
    steps: &mut ProgressCounter,
) -> io::Result<()> {
    let [mtl, png] = ["mtl", "png"].map(|extension| path.with_extension(extension));
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    obj_comments(out, comments)?;
    writeln!(out, "mtllib {}", name(&mtl))?;
    // No vertex colours: some programs multiply them with the texture.
    write_rows(out, mesh.positions.len(), steps, |i, row| {
        row.extend_from_slice(format!("v {}\n", obj_position(mesh, i)).as_bytes());
    })?;
    write_rows(out, mesh.n_quads(), steps, |i, row| {
        for [u, v] in atlas.coordinates(i) {
            // From the lower left corner; six digits are finer than a hundredth of a texel.
            row.extend_from_slice(format!("vt {u:.6} {:.6}\n", 1.0 - v).as_bytes());
        }
    })?;
    writeln!(out, "usemtl {MATERIAL}")?;
    write_rows(out, mesh.n_quads(), steps, |i, row| {
        let quad = mesh.quad(i);
        for triangle in QUAD_TRIANGLES.chunks(3) {
            let corner = |k: &usize| format!(" {}/{}", quad[*k] + 1, 4 * i + k + 1);
            let corners: String = triangle.iter().map(corner).collect();
            row.extend_from_slice(format!("f{corners}\n").as_bytes());
        }
    })?;
    let material =
        format!("newmtl {MATERIAL}\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {}\n", name(&png));
    // Last, so that a cancelled export replaces no file, and an OBJ never lacks its texture.
    for (path, content) in [(&png, &atlas.png[..]), (&mtl, material.as_bytes())] {
        remove_leftovers(path);
        write_atomic(path, |out| out.write_all(content)).map_err(io::Error::other)?;
    }
    Ok(())
}

/// Summary of a written mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshSummary {
    /// Number of vertices. A GLB with a texture repeats them for each quad.
    pub n_vertices: usize,
    /// Number of triangles.
    pub n_triangles: usize,
    /// Size of the file in bytes, without the MTL and PNG of an OBJ.
    pub bytes: u64,
}

/// Triangulates plane segments on cells of width `cell`, in world units, and writes the mesh atomically.
/// Only axes, up direction, local origin, registration, unit scale, comments and progress of the options apply. A GLB
/// is always y-up. If any segment has a texture, GLB and OBJ have a texture instead of vertex colours. That
/// of an OBJ is in files of its name beside it, `.mtl` and `.png`.
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
    let fail = |fault: Fault| fault.with_path(path);
    let comments = options.all_comments();
    let options = &WriteOptions { comments: &comments, ..options.clone() };
    let mut mesh = checked_mesh(surfels, cell, options).map_err(fail)?;
    let is_textured = format.has_textures() && surfels.iter().any(|s| s.texture.is_some());
    let (n_vertices, n_triangles) = (mesh.positions.len(), mesh.triangles.len());
    let n_steps = match (format, is_textured) {
        (MeshFormat::Ply | MeshFormat::Obj, false) => n_vertices + n_triangles,
        // A GLB stores positions and colours in two passes over the vertices.
        (MeshFormat::Glb, false) => 2 * n_vertices + n_triangles,
        // Quads count once for their texels and for each of their columns.
        (MeshFormat::Glb, true) => 4 * mesh.n_quads(),
        (_, true) => n_vertices + 3 * mesh.n_quads(),
    };
    let mut steps = ProgressCounter::new(options.progress, n_steps);
    // Textures lie in the world, so before the mesh is rotated.
    let atlas = is_textured.then(|| Atlas::bake(&mesh, surfels, cell, &mut steps));
    let atlas = atlas.transpose().map_err(fail)?;
    let origin = to_file_axes(&mut mesh, format, options);
    let comments: Vec<String> = options.comments.iter().cloned().chain(comment(origin)).collect();
    let bytes = match (format, &atlas) {
        (MeshFormat::Ply, _) => write_atomic(path, |out| ply(out, &mesh, &comments, &mut steps))?,
        (MeshFormat::Obj, None) => {
            write_atomic(path, |out| obj(out, &mesh, &comments, &mut steps))?
        }
        (MeshFormat::Obj, Some(atlas)) => write_atomic(path, |out| {
            obj_textured(out, path, (&mesh, atlas), &comments, &mut steps)
        })?,
        (MeshFormat::Glb, atlas) => {
            let layout = MeshLayout::new(&mesh, atlas.as_ref(), origin, options).map_err(fail)?;
            write_atomic(path, |out| layout.write(out, &mesh, atlas.as_ref(), &mut steps))?
        }
    };
    Ok(MeshSummary { n_vertices, n_triangles, bytes })
}

fn checked_mesh(
    surfels: &[Surfel],
    cell: f64,
    options: &WriteOptions,
) -> Result<TriangleMesh, Fault> {
    check_axes(options)?;
    let mesh = triangulate(surfels, cell)?;
    match mesh.triangles.is_empty() {
        true => Err(Fault::NoSurface { n_components: surfels.len() }),
        false => Ok(mesh),
    }
}

/// Moves a mesh to the axes and units of a file. Returns the local origin in these.
fn to_file_axes(mesh: &mut TriangleMesh, format: MeshFormat, options: &WriteOptions) -> DVec3 {
    // glTF prescribes y-up. As a PLY, because the model's format does not concern the mesh.
    let axes = if format == MeshFormat::Glb { Axes::YUp } else { options.axes };
    let options = WriteOptions { axes, format: ModelFormat::Ply, ..options.clone() };
    let placement = Placement::of(&options);
    mesh.positions.iter_mut().for_each(|p| *p = placement.place(*p));
    placement.origin
}
