//! Triangle meshes as GLB, in core glTF 2.0, which every viewer draws.

use super::schema::*;
use super::write::{GENERATOR, extras, root_node};
use super::{COLOR_0, POSITION, container};
use crate::export::error::Fault;
use crate::export::format::WriteOptions;
use crate::export::gaussian::srgb_to_linear;
use crate::export::mesh::field::TriangleMesh;
use crate::export::stream::{ProgressCounter, put_floats, write_rows};
use glam::{DVec3, Vec3};
use std::collections::BTreeMap;
use std::io;
use std::io::Write;

const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const TRIANGLES: u32 = 4;
/// Buffer view targets: vertex attributes and indices.
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// Bytes of a position, of a colour with alpha, and of a triangle.
const ROW_BYTES: [usize; 3] = [12, 8, 12];

pub(in crate::export) struct MeshLayout {
    json: String,
    bin_length: u64,
}

impl MeshLayout {
    /// Prepares a file for a mesh and its local origin, both in the axes and units of the file. Fails if the
    /// file would exceed GLB's 32-bit lengths.
    pub fn new(mesh: &TriangleMesh, origin: DVec3, options: &WriteOptions) -> Result<Self, Fault> {
        let (n, m) = (mesh.positions.len(), mesh.triangles.len());
        let bin_length = (n * (ROW_BYTES[0] + ROW_BYTES[1]) + m * ROW_BYTES[2]) as u64;
        let json = serde_json::to_string(&root(mesh, origin, options))
            .map_err(|e| Fault::Io { action: "write the JSON chunk", source: e.into() })?;
        let needed = container::file_size(json.len(), bin_length);
        if needed > u64::from(u32::MAX) {
            return Err(Fault::TooLargeForGlb { n_splats: n, needed });
        }
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
            let [r, g, b] = mesh.colors[i].to_array().map(srgb_to_linear);
            for channel in [r, g, b, 1.0] {
                row.extend_from_slice(&((65535.0 * channel).round() as u16).to_le_bytes());
            }
        })?;
        write_rows(out, mesh.triangles.len(), steps, |i, row| {
            mesh.triangles[i].iter().for_each(|v| row.extend_from_slice(&v.to_le_bytes()));
        })
    }
}

fn root(mesh: &TriangleMesh, origin: DVec3, options: &WriteOptions) -> Root {
    let (n, m) = (mesh.positions.len(), mesh.triangles.len());
    let positions = || mesh.positions.iter().map(|p| p.as_vec3());
    let accessor = |view, kind: &str, component_type, count| Accessor {
        buffer_view: Some(view),
        byte_offset: 0,
        component_type,
        count,
        kind: kind.to_owned(),
        // Colours are fractions; indices must stay integers.
        normalized: component_type == UNSIGNED_SHORT,
        min: (view == 0).then(|| positions().fold(Vec3::INFINITY, Vec3::min).to_array()),
        max: (view == 0).then(|| positions().fold(Vec3::NEG_INFINITY, Vec3::max).to_array()),
        sparse: None,
    };
    let lengths = [n * ROW_BYTES[0], n * ROW_BYTES[1], m * ROW_BYTES[2]];
    let view = |i: usize| BufferView {
        buffer: 0,
        byte_offset: lengths[..i].iter().sum(),
        byte_length: lengths[i],
        byte_stride: None,
        target: Some(if i == 2 { ELEMENT_ARRAY_BUFFER } else { ARRAY_BUFFER }),
        extensions: BTreeMap::new(),
    };
    let primitive = Primitive {
        attributes: Attributes(vec![(POSITION.to_owned(), 0), (COLOR_0.to_owned(), 1)]),
        indices: Some(2),
        mode: Some(TRIANGLES),
        extensions: PrimitiveExtensions::default(),
    };
    Root {
        asset: Asset {
            version: "2.0".to_owned(),
            generator: GENERATOR.to_owned(),
            extras: extras(options, origin),
        },
        extensions_used: Vec::new(),
        extensions_required: Vec::new(),
        scene: Some(0),
        scenes: vec![GltfScene { nodes: vec![0] }],
        nodes: vec![root_node(origin)],
        meshes: vec![Mesh { primitives: vec![primitive] }],
        accessors: vec![
            accessor(0, "VEC3", FLOAT, n),
            accessor(1, "VEC4", UNSIGNED_SHORT, n),
            accessor(2, "SCALAR", UNSIGNED_INT, 3 * m),
        ],
        buffer_views: vec![view(0), view(1), view(2)],
        buffers: vec![Buffer { byte_length: lengths.iter().sum(), uri: None }],
    }
}
