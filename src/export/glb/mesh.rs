//! Triangle meshes as GLB, in core glTF 2.0, which every viewer draws.

use super::container::{F32, U16, U32};
use super::write::{ARRAY_BUFFER, Declared, document, json_chunk};
use super::*;
use super::{COLOR_0, POSITION, container};
use crate::export::error::Fault;
use crate::export::format::WriteOptions;
use crate::export::gaussian::srgb_to_linear;
use crate::export::mesh::field::{Atlas, QUAD_TRIANGLES, TriangleMesh};
use crate::export::stream::{ProgressCounter, put_floats, write_rows};
use glam::{DVec3, Vec3};
use serde_json::json;
use std::collections::BTreeMap;
use std::io;
use std::io::Write;

const TRIANGLES: u32 = 4;
/// glTF constant for the target of buffer views that hold vertex indices.
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// glTF constant for bilinear interpolation of texels.
const LINEAR_FILTER: u32 = 9729;
/// glTF constant for images that do not repeat.
const CLAMP_TO_EDGE: u32 = 33071;
const UNLIT: &str = "KHR_materials_unlit";

pub(in crate::export) struct MeshLayout {
    json: String,
    bin_length: u64,
}

impl MeshLayout {
    /// Prepares the layout of a file for a mesh and its local origin. Both are in the file's axes and
    /// units. With an atlas every quad has its own vertices. Fails if the file would exceed GLB's 32-bit
    /// lengths.
    pub fn new(
        mesh: &TriangleMesh,
        atlas: Option<&Atlas>,
        origin: DVec3,
        options: &WriteOptions,
    ) -> Result<Self, Fault> {
        let m = mesh.triangles.len();
        let n = if atlas.is_some() { 4 * mesh.n_quads() } else { mesh.positions.len() };
        let vertices =
            |kind, component| Declared { kind, component, count: n, target: ARRAY_BUFFER };
        let indices =
            Declared { kind: "SCALAR", component: U32, count: 3 * m, target: ELEMENT_ARRAY_BUFFER };
        let (semantic, colors) = match atlas {
            None => (COLOR_0, vertices("VEC4", U16)),
            Some(_) => ("TEXCOORD_0", vertices("VEC2", F32)),
        };
        let columns = [vertices("VEC3", F32), colors, indices];
        let primitive = Primitive {
            attributes: Attributes(vec![(POSITION.to_owned(), 0), (semantic.to_owned(), 1)]),
            indices: Some(2),
            material: atlas.map(|_| 0),
            mode: Some(TRIANGLES),
            extensions: PrimitiveExtensions::default(),
        };
        // Bounds of the rounded positions: glTF requires those of the stored values.
        let stored = |i: usize| if atlas.is_some() { mesh.quad(i / 4)[i % 4] } else { i };
        let positions = || (0..n).map(|i| mesh.positions[stored(i)].as_vec3());
        let bounds = (
            positions().fold(Vec3::INFINITY, Vec3::min).to_array(),
            positions().fold(Vec3::NEG_INFINITY, Vec3::max).to_array(),
        );
        let mut document = document(&columns, bounds, primitive, origin, options);
        if let Some(atlas) = atlas {
            add_image(&mut document, atlas.png.len());
        }
        let (json, bin_length) = json_chunk(&document, n)?;
        Ok(Self { json, bin_length })
    }

    pub fn write(
        &self,
        out: &mut dyn Write,
        mesh: &TriangleMesh,
        atlas: Option<&Atlas>,
        steps: &mut ProgressCounter,
    ) -> io::Result<()> {
        container::write_start(out, &self.json, self.bin_length)?;
        if let Some(atlas) = atlas {
            return write_textured(out, mesh, atlas, steps);
        }
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

/// Adds a PNG behind the columns, as the colour of the first material.
fn add_image(document: &mut Root, n_bytes: usize) {
    let view = document.buffer_views.len();
    for buffer in &mut document.buffers {
        document.buffer_views.push(BufferView {
            buffer: 0,
            byte_offset: buffer.byte_length,
            byte_length: n_bytes,
            byte_stride: None,
            target: None,
            extensions: BTreeMap::new(),
        });
        buffer.byte_length += n_bytes.next_multiple_of(4);
    }
    document.images = vec![json!({ "bufferView": view, "mimeType": "image/png" })];
    // Without smaller levels of the image, which would mix blocks of different places.
    document.samplers = vec![json!({
        "magFilter": LINEAR_FILTER, "minFilter": LINEAR_FILTER,
        "wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE,
    })];
    document.textures = vec![json!({ "sampler": 0, "source": 0 })];
    // Photographs contain the light of the scene. Viewers without the extension add their own.
    document.materials = vec![json!({
        "pbrMetallicRoughness": {
            "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0, "roughnessFactor": 1.0,
        },
        "extensions": { UNLIT: {} },
    })];
    document.extensions_used = vec![UNLIT.to_owned()];
}

fn write_textured(
    out: &mut dyn Write,
    mesh: &TriangleMesh,
    atlas: &Atlas,
    steps: &mut ProgressCounter,
) -> io::Result<()> {
    let n = mesh.n_quads();
    write_rows(out, n, steps, |i, row| {
        mesh.quad(i).iter().for_each(|v| put_floats(row, &mesh.positions[*v].to_array()));
    })?;
    write_rows(out, n, steps, |i, row| {
        atlas.coordinates(i).iter().for_each(|place| put_floats(row, place));
    })?;
    write_rows(out, n, steps, |i, row| {
        let vertices = QUAD_TRIANGLES.map(|v| (4 * i + v) as u32);
        vertices.iter().for_each(|v| row.extend_from_slice(&v.to_le_bytes()));
    })?;
    out.write_all(&atlas.png)?;
    let padding = atlas.png.len().next_multiple_of(4) - atlas.png.len();
    out.write_all(&[0; 4][..padding])
}
