//! Meshes as PLY and OBJ.

use super::nets::TriangleMesh;
use crate::export::progress::ProgressCounter;
use crate::export::stream::{put_floats, write_rows};
use crate::math::image::unit_to_byte;
use std::fmt::Write as _;
use std::io::{self, Write};

/// Writes a binary PLY with 8-bit vertex colours and triangles.
pub(super) fn ply(
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
        row.push(3);
        mesh.triangles[i].iter().for_each(|v| row.extend_from_slice(&v.to_le_bytes()));
    })
}

/// Writes an OBJ: colours follow the coordinates, indices start at 1.
pub(super) fn obj(
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
        row.extend_from_slice(format!("v {x} {y} {z} {r:.4} {g:.4} {b:.4}\n").as_bytes());
    })?;
    write_rows(out, mesh.triangles.len(), steps, |i, row| {
        let [a, b, c] = mesh.triangles[i].map(|v| v + 1);
        row.extend_from_slice(format!("f {a} {b} {c}\n").as_bytes());
    })
}
