//! Splats as GLB: one tightly packed buffer view per attribute.
//!
//! One table of columns holds both the declaration and the encoder of each attribute, so accessor, buffer
//! view and bytes cannot disagree. Rows are computed again for each column, so memory stays at one block
//! of rows for any model size. All checks that can reject an export run before a file is created.

use super::container::{F32, U16, row_size};
use super::*;
use crate::export::error::Fault;
use crate::export::format::WriteOptions;
use crate::export::gaussian::{
    Gaussian, color_to_harmonic, directional_to_harmonics, srgb_to_linear,
};
use crate::export::local_origin;
use crate::export::source::Placement;
use crate::export::stream::{ProgressCounter, SplatRows, put_floats, write_rows};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde_json::json;
use std::collections::BTreeMap;
use std::io;
use std::io::Write;

/// glTF constant for the target of buffer views that hold vertex attributes (glTF 2.0, 5.11.5).
pub(super) const ARRAY_BUFFER: u32 = 34962;
const GENERATOR: &str = concat!("vbgs-studio ", env!("CARGO_PKG_VERSION"));

struct Column {
    semantic: &'static str,
    kind: &'static str,
    component: u32,
    encode: fn(&Gaussian, &mut Vec<u8>),
}

impl Column {
    const fn floats(
        semantic: &'static str,
        kind: &'static str,
        encode: fn(&Gaussian, &mut Vec<u8>),
    ) -> Self {
        Self { semantic, kind, component: F32, encode }
    }
}

// Positions first: `document` states the bounds of the first column.
const COLUMNS: [Column; 6] = [
    Column::floats(POSITION, "VEC3", |g, row| put_floats(row, &g.mean.to_array())),
    Column { semantic: COLOR_0, kind: "VEC4", component: U16, encode: put_fallback_color },
    Column::floats(ROTATION, "VEC4", |g, row| put_floats(row, &g.rotation.to_array())),
    Column::floats(SCALE, "VEC3", |g, row| put_floats(row, &g.scale.to_array())),
    Column::floats(OPACITY, "SCALAR", |g, row| put_floats(row, &[g.opacity])),
    Column::floats(SH_0, "VEC3", |g, row| put_floats(row, &color_to_harmonic(g.color).to_array())),
];

const DEGREE_1: [Column; 3] = [
    Column::floats(SH_1[0], "VEC3", |g, row| put_degree_1(g, 0, row)),
    Column::floats(SH_1[1], "VEC3", |g, row| put_degree_1(g, 1, row)),
    Column::floats(SH_1[2], "VEC3", |g, row| put_degree_1(g, 2, row)),
];

#[expect(clippy::indexing_slicing, reason = "called with 0, 1 and 2")]
fn put_degree_1(splat: &Gaussian, coefficient: usize, row: &mut Vec<u8>) {
    put_floats(row, &directional_to_harmonics(splat.directional)[coefficient].to_array());
}

/// Encodes the colour and opacity that viewers without the splat extension draw.
fn put_fallback_color(splat: &Gaussian, row: &mut Vec<u8>) {
    // 16 bits, because linear 8-bit values show banding in dark areas.
    let [r, g, b] = splat.color.to_array().map(srgb_to_linear);
    for channel in [r, g, b, splat.opacity] {
        row.extend(((65535.0 * channel).round() as u16).to_le_bytes());
    }
}

pub(in crate::export) struct GlbLayout {
    pub(in crate::export) json: String,
    columns: Vec<&'static Column>,
    bin_length: u64,
}

impl GlbLayout {
    pub fn new(rows: &impl SplatRows, options: &WriteOptions) -> Result<Self, Fault> {
        let n = rows.n_rows();
        let columns: Vec<&Column> = match rows.has_directions() {
            false => COLUMNS.iter().collect(),
            true => COLUMNS.iter().chain(&DEGREE_1).collect(),
        };
        let declared = columns.iter().map(|column| Declared {
            kind: column.kind,
            component: column.component,
            count: n,
            target: ARRAY_BUFFER,
        });
        let declared: Vec<Declared> = declared.collect();
        let Placement { origin, .. } = Placement::of(options);
        let document = Root {
            // Not required, so that viewers without the extension draw `COLOR_0` as points.
            extensions_used: vec![EXTENSION.to_owned()],
            // No y-up transform in the node, because some readers ignore it: the rows are already rotated.
            ..document(&declared, extremes(rows), primitive(&columns), origin, options)
        };
        let (json, bin_length) = json_chunk(&document, n)?;
        Ok(Self { json, columns, bin_length })
    }

    pub fn n_columns(&self) -> usize {
        self.columns.len()
    }

    pub fn write(
        &self,
        out: &mut dyn Write,
        rows: &impl SplatRows,
        steps: &mut ProgressCounter,
    ) -> io::Result<()> {
        container::write_start(out, &self.json, self.bin_length)?;
        for column in &self.columns {
            write_rows(out, rows.n_rows(), steps, |i, row| (column.encode)(&rows.row(i), row))?;
        }
        Ok(())
    }
}

/// Returns the minimum and maximum of the positions after rounding to f32.
fn extremes(rows: &impl SplatRows) -> ([f32; 3], [f32; 3]) {
    // Of the rounded positions: validators compare the bounds with the data.
    let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let positions = (0..rows.n_rows()).into_par_iter().map(|i| rows.row(i).mean.as_vec3());
    let (min, max) = positions
        .fold(|| none, |(min, max), p| (min.min(p), max.max(p)))
        .reduce(|| none, |a, b| (a.0.min(b.0), a.1.max(b.1)));
    (min.to_array(), max.to_array())
}

/// Accessor and buffer view of one column of the file.
pub(super) struct Declared {
    pub kind: &'static str,
    pub component: u32,
    pub count: usize,
    pub target: u32,
}

/// Returns a glTF document with one mesh. The first column holds the positions, with bounds `min` and
/// `max`.
pub(super) fn document(
    columns: &[Declared],
    (min, max): ([f32; 3], [f32; 3]),
    primitive: Primitive,
    origin: DVec3,
    options: &WriteOptions,
) -> Root {
    let accessor = |(i, column): (usize, &Declared)| Accessor {
        buffer_view: Some(i),
        byte_offset: 0,
        component_type: column.component,
        count: column.count,
        kind: column.kind.to_owned(),
        // The 16-bit integers are colours, which glTF reads as fractions.
        normalized: column.component == U16,
        min: (i == 0).then_some(min),
        max: (i == 0).then_some(max),
        sparse: None,
    };
    let mut end = 0;
    let view = |column: &Declared| {
        let byte_offset = end;
        let byte_length = column.count * row_size(column.kind, column.component);
        end += byte_length;
        BufferView {
            buffer: 0,
            byte_offset,
            byte_length,
            byte_stride: None,
            target: Some(column.target),
            extensions: BTreeMap::new(),
        }
    };
    let buffer_views = columns.iter().map(view).collect();
    let translation = (origin != DVec3::ZERO).then_some(origin.to_array());
    Root {
        asset: Asset {
            version: "2.0".to_owned(),
            generator: GENERATOR.to_owned(),
            extras: extras(options, origin),
        },
        scene: Some(0),
        scenes: vec![GltfScene { nodes: vec![0] }],
        nodes: vec![Node { mesh: Some(0), translation, ..Node::default() }],
        meshes: vec![Mesh { primitives: vec![primitive] }],
        accessors: columns.iter().enumerate().map(accessor).collect(),
        buffer_views,
        buffers: vec![Buffer { byte_length: end, uri: None }],
        ..Root::default()
    }
}

/// Returns the JSON text of a document and the length of its buffer in bytes. Fails if the file would
/// exceed GLB's 32-bit lengths.
pub(super) fn json_chunk(document: &Root, n_splats: usize) -> Result<(String, u64), Fault> {
    let json = serde_json::to_string(document)
        .map_err(|e| Fault::Io { action: "write the JSON chunk", source: e.into() })?;
    let bin_length = document.buffers.iter().map(|buffer| buffer.byte_length as u64).sum();
    let needed = container::file_size(json.len(), bin_length);
    // A wrapped length would silently give a broken file.
    match needed > u64::from(u32::MAX) {
        true => Err(Fault::TooLargeForGlb { n_splats, needed }),
        false => Ok((json, bin_length)),
    }
}

fn primitive(columns: &[&Column]) -> Primitive {
    let attributes = columns.iter().enumerate().map(|(i, c)| (c.semantic.to_owned(), i)).collect();
    let splatting = GaussianSplatting {
        kernel: KERNEL.to_owned(),
        color_space: SRGB.to_owned(),
        projection: "perspective".to_owned(),
        sorting_method: "cameraDistance".to_owned(),
        extensions: BTreeMap::new(),
    };
    Primitive {
        attributes: Attributes(attributes),
        indices: None,
        material: None,
        mode: Some(POINTS),
        extensions: PrimitiveExtensions { splatting: Some(splatting), other: BTreeMap::new() },
    }
}

/// Returns the content of `asset.extras`: up axis, unit if known, comments and local origin. `None` if
/// there is nothing to store besides the up axis.
fn extras(options: &WriteOptions, origin: DVec3) -> Option<serde_json::Value> {
    let mut extras = serde_json::Map::new();
    // The unit of scaled lengths is unknown here.
    if options.is_metric() && options.unit_scale == 1.0 {
        extras.insert("units".to_owned(), json!("metres"));
    }
    if !options.comments.is_empty() {
        extras.insert("comments".to_owned(), json!(options.comments));
    }
    if origin != DVec3::ZERO {
        extras.insert(local_origin::EXTRA.to_owned(), json!(origin.to_array()));
    }
    if extras.is_empty() {
        return None; // no metadata
    }
    // Redundant in glTF, but other splat formats differ.
    extras.insert("up".to_owned(), json!("y"));
    Some(extras.into())
}
