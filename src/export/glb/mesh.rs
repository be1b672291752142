//! Triangle meshes as GLB, in core glTF 2.0, which every viewer draws.

use super::container::{F32, U16, U32};
use super::schema::*;
use super::write::{ARRAY_BUFFER, Declared, document, json_chunk};
use super::{COLOR_0, POSITION, container};
use crate::export::error::Fault;
use crate::export::format::WriteOptions;
use crate::export::gaussian::srgb_to_linear;
use crate::export::mesh::field::TriangleMesh;
use crate::export::stream::{ProgressCounter, put_floats, write_rows};
use glam::{DVec3, Vec3};
use std::io;
use std::io::Write;

const TRIANGLES: u32 = 4;
/// glTF constant for the target of buffer views that hold vertex indices.
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

pub(in crate::export) struct MeshLayout {
    json: String,
    bin_length: u64,
}

impl MeshLayout {
    /// Prepares the layout of a file for a mesh and its local origin. Both are in the file's axes and
    /// units. Fails if the file would exceed GLB's 32-bit lengths.
    pub fn new(mesh: &TriangleMesh, origin: DVec3, options: &WriteOptions) -> Result<Self, Fault> {
        let (n, m) = (mesh.positions.len(), mesh.triangles.len());
        let vertices =
            |kind, component| Declared { kind, component, count: n, target: ARRAY_BUFFER };
        let indices =
            Declared { kind: "SCALAR", component: U32, count: 3 * m, target: ELEMENT_ARRAY_BUFFER };
        let columns = [vertices("VEC3", F32), vertices("VEC4", U16), indices];
        let primitive = Primitive {
            attributes: Attributes(vec![(POSITION.to_owned(), 0), (COLOR_0.to_owned(), 1)]),
            indices: Some(2),
            mode: Some(TRIANGLES),
            extensions: PrimitiveExtensions::default(),
        };
        // Bounds of the rounded positions: glTF requires those of the stored values.
        let positions = || mesh.positions.iter().map(|p| p.as_vec3());
        let bounds = (
            positions().fold(Vec3::INFINITY, Vec3::min).to_array(),
            positions().fold(Vec3::NEG_INFINITY, Vec3::max).to_array(),
        );
        let document = document(&columns, bounds, primitive, origin, options);
        let (json, bin_length) = json_chunk(&document, n)?;
        Ok(Self { json, bin_length })
    }

    pub fn write(
        &self,
        out: &mut dyn Write,
        mesh: &TriangleMesh,
        steps: &mut ProgressCounter,
    ) -> io::Result<()> {
        container::write_start(out, &self.json, self.bin_length)?;
        let n = mesh.positions.len();
        write_rows(out, n, steps, |i, row| put_floats(row, &mesh.positions[i].to_array()))?;
        write_rows(out, n, steps, |i, row| {
            // Vertex colours of glTF are linear.
            let [r, g, b] = mesh.colors[i].to_array().map(srgb_to_linear);
            // An opaque alpha keeps rows at multiples of 4 bytes, as glTF requires.
            for channel in [r, g, b, 1.0] {
                row.extend_from_slice(&((65535.0 * channel).round() as u16).to_le_bytes());
            }
        })?;
        write_rows(out, mesh.triangles.len(), steps, |i, row| {
            mesh.triangles[i].iter().for_each(|v| row.extend_from_slice(&v.to_le_bytes()));
        })
    }
}
