//! glTF 2.0 with `KHR_gaussian_splatting` (`files.md`, GLB). Files are y-up, splats in memory z-up.
//! Writing maps `(x, y, z)` to `(x, z, −y)`, and reading always inverts this mapping.
//!
//! This file holds the JSON structures of glTF, as far as splats and meshes need them. Fields are in the order of writing.
//!
//! The `gltf` crate is not used: it only accepts core attribute names and those with an underscore, so
//! `KHR_gaussian_splatting:SCALE` fails its validation and loses its name. The same structs serve reading
//! and writing, so files of this program are always readable.

mod container;
mod import;
#[expect(clippy::indexing_slicing, reason = "all indices come from the mesh's own lists")]
pub(super) mod mesh;
pub(super) mod read;
pub(super) mod write;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

const POSITION: &str = "POSITION";
const COLOR_0: &str = "COLOR_0";
const ROTATION: &str = "KHR_gaussian_splatting:ROTATION";
const SCALE: &str = "KHR_gaussian_splatting:SCALE";
const OPACITY: &str = "KHR_gaussian_splatting:OPACITY";
const SH_0: &str = "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0";
const SH_1: [&str; 3] = [
    "KHR_gaussian_splatting:SH_DEGREE_1_COEF_0",
    "KHR_gaussian_splatting:SH_DEGREE_1_COEF_1",
    "KHR_gaussian_splatting:SH_DEGREE_1_COEF_2",
];
const SH_PREFIX: &str = "KHR_gaussian_splatting:SH_DEGREE_";
const EXTENSION: &str = "KHR_gaussian_splatting";
const KERNEL: &str = "ellipse";
const SRGB: &str = "srgb_rec709_display";
const LINEAR: &str = "lin_rec709_display";
const POINTS: u32 = 0;

pub(super) type Extensions = BTreeMap<String, Value>;

#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Root {
    pub asset: Asset,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub extensions_used: Vec<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub extensions_required: Vec<String>,
    pub scene: Option<usize>,
    #[serde(default)]
    pub scenes: Vec<GltfScene>,
    #[serde(default)]
    pub nodes: Vec<Node>,
    #[serde(default)]
    pub meshes: Vec<Mesh>,
    // Not read, as the next three: splats have none of them.
    #[serde(skip_deserializing, skip_serializing_if = "Vec::is_empty")]
    pub materials: Vec<Value>,
    #[serde(skip_deserializing, skip_serializing_if = "Vec::is_empty")]
    pub textures: Vec<Value>,
    #[serde(skip_deserializing, skip_serializing_if = "Vec::is_empty")]
    pub samplers: Vec<Value>,
    #[serde(skip_deserializing, skip_serializing_if = "Vec::is_empty")]
    pub images: Vec<Value>,
    #[serde(default)]
    pub accessors: Vec<Accessor>,
    #[serde(default)]
    pub buffer_views: Vec<BufferView>,
    #[serde(default)]
    pub buffers: Vec<Buffer>,
}

#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Asset {
    pub version: String,
    #[serde(default)]
    pub generator: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extras: Option<Value>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct GltfScene {
    #[serde(default)]
    pub nodes: Vec<usize>,
}

#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Node {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<usize>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub children: Vec<usize>,
    /// 4×4 transformation matrix, column-major.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub matrix: Option<[f64; 16]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub translation: Option<[f64; 3]>,
    /// Quaternion x y z w.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[f64; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<[f64; 3]>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Mesh {
    pub primitives: Vec<Primitive>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Primitive {
    pub attributes: Attributes,
    /// Accessor of the vertex indices. Written for meshes and ignored on reading, since points have no
    /// indices.
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub indices: Option<usize>,
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub material: Option<usize>,
    pub mode: Option<u32>,
    #[serde(default, skip_serializing_if = "PrimitiveExtensions::is_empty")]
    pub extensions: PrimitiveExtensions,
}

#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct PrimitiveExtensions {
    #[serde(rename = "KHR_gaussian_splatting", skip_serializing_if = "Option::is_none")]
    pub splatting: Option<GaussianSplatting>,
    #[serde(flatten)]
    pub other: Extensions,
}

impl PrimitiveExtensions {
    fn is_empty(&self) -> bool {
        self.splatting.is_none() && self.other.is_empty()
    }
}

/// Attributes of a primitive: semantic and accessor index of each, in the order of writing.
#[derive(Debug)]
pub(super) struct Attributes(pub Vec<(String, usize)>);

impl Attributes {
    pub fn get(&self, semantic: &str) -> Option<usize> {
        self.0.iter().find(|(name, _)| name == semantic).map(|(_, accessor)| *accessor)
    }
}

impl Serialize for Attributes {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(name, accessor)| (name, accessor)))
    }
}

impl<'de> Deserialize<'de> for Attributes {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let map = BTreeMap::deserialize(deserializer)?;
        Ok(Attributes(map.into_iter().collect()))
    }
}

/// Splat extension of a primitive. Missing strings are read as empty, because drafts of the extension
/// lack some.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct GaussianSplatting {
    #[serde(default)]
    pub kernel: String,
    #[serde(default)]
    pub color_space: String,
    #[serde(default)]
    pub projection: String,
    #[serde(default)]
    pub sorting_method: String,
    #[serde(default, skip_serializing_if = "Extensions::is_empty")]
    pub extensions: Extensions,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub buffer_view: Option<usize>,
    #[serde(default, skip_serializing_if = "is_zero")]
    pub byte_offset: usize,
    pub component_type: u32,
    pub count: usize,
    #[serde(rename = "type")]
    pub kind: String,
    #[serde(default, skip_serializing_if = "is_false")]
    pub normalized: bool,
    // Not read: bounds of other accessors have other lengths.
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub min: Option<[f32; 3]>,
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub max: Option<[f32; 3]>,
    // Only its presence matters: sparse accessors are refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sparse: Option<Value>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: usize,
    pub byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub byte_stride: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<u32>,
    #[serde(default, skip_serializing_if = "Extensions::is_empty")]
    pub extensions: Extensions,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uri: Option<String>,
}

fn is_zero(value: &usize) -> bool {
    *value == 0
}

fn is_false(value: &bool) -> bool {
    !*value
}
