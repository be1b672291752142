//! Constants shared by shaders and Rust. Each is defined once, here or in the CPU renderer, and prepended as
//! WGSL to every shader module. Two definitions could diverge unnoticed, because a shader with a different
//! cut draws almost the same image.

use super::textures::LATTICE_WORDS;
use crate::model::conjugate::statistics::RECORD_WORDS;
use crate::model::paper::mixture_device::MAX_TILE_POINTS;
use crate::model::scene::points_device::{LEFT_TO_PROCESSOR, NO_SEED};
use crate::model::scene::state::QUANTUM;
use crate::model::scene::sums::{MAX_OFFSET, N_SUMS, TERM_FACTORS};
use crate::model::splat::appearance::GRADIENT_LIMIT;
use crate::model::splat::texture::{PATCH, Texel};
use crate::render::compare::OUTSIDE_BRIGHTNESS;
use crate::render::cpu::photometric::{MIN_COUNTED_COVERAGE, MIN_WEIGHT, N_IMAGE_SUMS};
use crate::render::cpu::textures::MIN_COSINE;
use crate::render::finish::{MARKER_COLOR, RAMP};
use crate::render::{
    ALPHA_CAP, ALPHA_CUT, Antialias, FOOTPRINT_PX2, LOW_PASS_PX2, Lens, MAX_SCALE_FLOOR_RATIO,
    POINT_SCALE, REFERENCE_VARIANCE, SCALE_FLOOR, TILE, TRANSMITTANCE_STOP,
};
use std::fmt::Write;

/// Concatenates files of `shaders/` at compile time; a file must follow the files that it depends on.
macro_rules! wgsl {
    ($($file:literal),+) => {
        concat!($(include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", $file, ".wgsl"))),+)
    };
}
pub(super) use wgsl;

/// Bit of [`super::layout::GpuSplat::flags`], set if the slot holds a drawable splat.
pub const FLAG_LIVE: u32 = 1;

// Values of `GpuView::renderer`.
pub(super) const RENDERER_PROJECTED: u32 = 0;
pub(super) const RENDERER_EXACT: u32 = 1;

// Values of `GpuView::paint`.
pub(super) const PAINT_STORED: u32 = 0;
pub(super) const PAINT_DEPTH: u32 = 1;
/// Value of [`super::layout::GpuView::paint`]: colours splats by the direction of their shortest axis.
pub const PAINT_NORMAL: u32 = 2;

// Values of `Composite::mode`.
pub(super) const COMPARE_NOTHING: u32 = 0;
pub(super) const COMPARE_WIPE: u32 = 1;
pub(super) const COMPARE_DIFFERENCE: u32 = 2;

// Workgroup size of `tiles`: one lane per pixel of a tile and per value of a digit.
pub(super) const GROUP: u32 = 256;
// The prefix sum of a workgroup takes one step per bit. An even number ends in the half where it started.
const _: () = assert!(GROUP.is_power_of_two() && GROUP.ilog2().is_multiple_of(2));
pub(super) const SCATTER_GROUP: u32 = 64;
// Points per workgroup when `points` sums terms, and its size: one lane per sum.
pub(super) const SUM_GROUP: u32 = 64;
const _: () = assert!(SUM_GROUP as usize >= N_SUMS);
// Grid cells per workgroup in the prefix sum over means, divided among its lanes.
pub(super) const STRIP_CELLS: u32 = 16 * GROUP;
// Workgroups of the radix sort passes that read all keys; fixed, because only the GPU knows their number.
pub(super) const N_STRIPS: u32 = 1024;

// Number of `vec4` values that hold a splat's sums in one tile in `photometric`.
pub(super) const N_QUARTERS: u32 = (N_IMAGE_SUMS as u32).div_ceil(4);

/// Indices of the counters in the counter buffer of [`super::tiles`]. The buffer is not read back
/// within a frame.
pub(super) mod slot {
    pub(in super::super) const N_SPLATS: u32 = 0;
    /// Slot of the number of splats with at least one entry (splat-tile pair).
    pub(in super::super) const N_VISIBLE: u32 = 1;
    /// Slot of the number of stored entries (splat-tile pairs).
    pub(in super::super) const N_ENTRIES: u32 = 2;
    /// Slot of the number of entries (splat-tile pairs) that the image needs, saturated at the largest
    /// u32.
    pub(in super::super) const N_NEEDED: u32 = 3;
    /// Slot of the depth key of the nearest splat with an entry; the key is all ones if there is no
    /// such splat.
    pub(in super::super) const NEAREST: u32 = 4;
    /// Slot of the depth key of the farthest splat with an entry.
    pub(in super::super) const FARTHEST: u32 = 5;
    pub(in super::super) const N_SLOTS: usize = 6;
}

/// WGSL names and values of the integer constants.
const WORDS: [(&str, u32); 39] = [
    ("FLAG_LIVE", FLAG_LIVE),
    ("RENDERER_PROJECTED", RENDERER_PROJECTED),
    ("RENDERER_EXACT", RENDERER_EXACT),
    ("ANTIALIAS_FOOTPRINT", Antialias::Footprint as u32),
    ("ANTIALIAS_NONE", Antialias::None as u32),
    ("ANTIALIAS_REFERENCE", Antialias::Reference as u32),
    ("LENS_PINHOLE", Lens::Pinhole as u32),
    ("LENS_FISHEYE", Lens::Fisheye as u32),
    ("PAINT_STORED", PAINT_STORED),
    ("PAINT_DEPTH", PAINT_DEPTH),
    ("PAINT_NORMAL", PAINT_NORMAL),
    ("COMPARE_NOTHING", COMPARE_NOTHING),
    ("COMPARE_WIPE", COMPARE_WIPE),
    ("COMPARE_DIFFERENCE", COMPARE_DIFFERENCE),
    ("GROUP", GROUP),
    ("SCATTER_GROUP", SCATTER_GROUP),
    ("STRIP_CELLS", STRIP_CELLS),
    ("N_STRIPS", N_STRIPS),
    ("TILE", TILE as u32),
    ("N_SPLATS", slot::N_SPLATS),
    ("N_VISIBLE", slot::N_VISIBLE),
    ("N_ENTRIES", slot::N_ENTRIES),
    ("N_NEEDED", slot::N_NEEDED),
    ("NEAREST", slot::NEAREST),
    ("FARTHEST", slot::FARTHEST),
    ("N_IMAGE_SUMS", N_IMAGE_SUMS as u32),
    ("N_QUARTERS", N_QUARTERS),
    ("TILE_POINTS", MAX_TILE_POINTS as u32),
    ("RECORD_WORDS", RECORD_WORDS as u32),
    ("NO_SEED", NO_SEED),
    ("OPEN", LEFT_TO_PROCESSOR),
    ("N_SUMS", N_SUMS as u32),
    ("SUM_GROUP", SUM_GROUP),
    ("PATCH", PATCH as u32),
    ("LATTICE_WORDS", LATTICE_WORDS as u32),
    ("CHANNEL_BITS", Texel::CHANNEL_BITS),
    ("CHANNEL_MAX", Texel::CHANNEL_MAX),
    ("COLOR_ONE", Texel::COLOR_ONE),
    ("SHARE_ONE", Texel::SHARE_ONE),
];

/// WGSL names and values of the floating-point constants.
const NUMBERS: [(&str, f32); 16] = [
    ("ALPHA_CAP", ALPHA_CAP as f32),
    ("ALPHA_CUT", ALPHA_CUT as f32),
    ("TRANSMITTANCE_STOP", TRANSMITTANCE_STOP as f32),
    ("LOW_PASS", LOW_PASS_PX2 as f32),
    ("FOOTPRINT", FOOTPRINT_PX2 as f32),
    ("REFERENCE_VARIANCE", REFERENCE_VARIANCE as f32),
    ("SCALE_FLOOR", SCALE_FLOOR as f32),
    ("FLATTEST", MAX_SCALE_FLOOR_RATIO as f32),
    ("POINT_SCALE", POINT_SCALE as f32),
    ("GRADIENT_LIMIT", GRADIENT_LIMIT as f32),
    ("OUTSIDE", OUTSIDE_BRIGHTNESS),
    ("SEEN", MIN_COUNTED_COVERAGE),
    ("MIN_WEIGHT", MIN_WEIGHT),
    ("MAX_OFFSET", MAX_OFFSET),
    ("QUANTA", (1.0 / QUANTUM) as f32),
    ("MIN_COSINE", MIN_COSINE as f32),
];

/// Prepends the declarations of all shared constants to a shader.
pub fn with_constants(shader: &str) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    for (name, value) in WORDS {
        let _ = writeln!(text, "const {name}: u32 = {value}u;");
    }
    // `{:?}` prints the shortest digits that restore the same f32; the suffix makes WGSL parse them as f32.
    for (name, value) in NUMBERS {
        let _ = writeln!(text, "const {name}: f32 = {value:?}f;");
    }
    let [r, g, b] = MARKER_COLOR;
    let _ = writeln!(text, "const MARK = vec3<f32>({r:?}f, {g:?}f, {b:?}f);");
    let _ = writeln!(text, "const RAMP = array<vec3<f32>, {}>(", RAMP.len());
    for [r, g, b] in RAMP {
        let _ = writeln!(text, "    vec3<f32>({r:?}f, {g:?}f, {b:?}f),");
    }
    let _ = writeln!(text, ");\nconst TERM_FACTORS = array<vec2<u32>, {N_SUMS}>(");
    for [a, b] in TERM_FACTORS {
        let _ = writeln!(text, "    vec2<u32>({a}u, {b}u),");
    }
    text + ");\n" + shader
}

/// Creates a shader module with the shared constants prepended.
pub(super) fn module(device: &wgpu::Device, label: &str, shader: &str) -> wgpu::ShaderModule {
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(with_constants(shader).into()),
    })
}
