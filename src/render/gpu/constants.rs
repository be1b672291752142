//! Constants that shaders share with Rust. They are written once, here or where the CPU renderer has
//! them, and stand as WGSL in front of every shader when its module is made: two truths would drift
//! apart in silence, because a shader with another cut draws nearly the same picture.

use crate::model::conjugate::statistics::RECORD_WORDS;
use crate::model::paper::mixture_device::MAX_TILE_POINTS;
use crate::model::scene::points_device::{NO_SEED, OPEN};
use crate::model::scene::state::QUANTUM;
use crate::model::scene::sums::{MAX_OFFSET, N_SUMS, TERM_FACTORS};
use crate::model::splat::appearance::GRADIENT_LIMIT;
use crate::render::compare::OUTSIDE;
use crate::render::cpu::photometric::{MIN_WEIGHT, N_IMAGE_SUMS, SEEN};
use crate::render::paint::{MARK, RAMP};
use crate::render::{
    ALPHA_CAP, ALPHA_CUT, Antialias, FLATTEST, FOOTPRINT_PX2, LOW_PASS_PX2, Lens, POINT_SCALE,
    REFERENCE_VARIANCE, SCALE_FLOOR, TILE, TRANSMITTANCE_STOP,
};
use std::fmt::Write;

/// [`super::layout::GpuSplat::flags`]: the slot holds a splat that can be drawn.
pub const FLAG_LIVE: u32 = 1;

/// [`super::layout::GpuView::renderer`]: covariances projected to the image.
pub const RENDERER_PROJECTED: u32 = 0;
/// [`super::layout::GpuView::renderer`]: the response along each ray.
pub const RENDERER_EXACT: u32 = 1;

/// [`super::layout::GpuView::paint`]: the splats' own colours.
pub const PAINT_STORED: u32 = 0;
/// [`super::layout::GpuView::paint`]: by distance to the camera.
pub const PAINT_DEPTH: u32 = 1;
/// [`super::layout::GpuView::paint`]: by the direction of the shortest axis.
pub const PAINT_NORMAL: u32 = 2;

/// [`super::layout::Composite::mode`]: the first picture alone.
pub const COMPARE_NOTHING: u32 = 0;
/// [`super::layout::Composite::mode`]: one picture left, the other right of a divider.
pub const COMPARE_WIPE: u32 = 1;
/// [`super::layout::Composite::mode`]: what differs.
pub const COMPARE_DIFFERENCE: u32 = 2;

/// Lanes of a workgroup of [`super::tiles`]: a lane for each pixel of a tile and each value of a digit.
pub(super) const GROUP: u32 = 256;
// The running sum of a workgroup takes a step for each bit, and ends in the half where it began.
const _: () = assert!(GROUP.is_power_of_two() && GROUP.ilog2().is_multiple_of(2));
/// Lanes of a workgroup of sparse uploads.
pub(super) const SCATTER_GROUP: u32 = 64;
/// Points whose terms a workgroup of [`super::points`] adds, a lane a sum; and its lanes.
pub(super) const SUM_GROUP: u32 = 64;
const _: () = assert!(SUM_GROUP as usize >= N_SUMS);
/// Cells of means that a workgroup counts up; the lanes of one share them.
pub(super) const STRIP_CELLS: u32 = 16 * GROUP;
/// Workgroups of the passes of the radix sort over all keys.
pub(super) const N_STRIPS: u32 = 1024;

/// A splat's sums of [`super::photometric`] in one tile, by fours.
pub(super) const N_QUARTERS: u32 = (N_IMAGE_SUMS as u32).div_ceil(4);

/// Slots of the buffer of counts of [`super::tiles`], which never leave the GPU within a frame.
pub(super) mod slot {
    /// Splats in the scene.
    pub(in super::super) const N_SPLATS: u32 = 0;
    /// Of those, with an entry at least.
    pub(in super::super) const N_VISIBLE: u32 = 1;
    /// Pairs of splat and tile that fit.
    pub(in super::super) const N_ENTRIES: u32 = 2;
    /// Pairs there are; the largest u32 stands for more.
    pub(in super::super) const N_NEEDED: u32 = 3;
    /// Key of the nearest splat with an entry, all ones without any.
    pub(in super::super) const NEAREST: u32 = 4;
    /// Key of the farthest one.
    pub(in super::super) const FARTHEST: u32 = 5;
    /// Slots there are.
    pub(in super::super) const N_SLOTS: usize = 6;
}

/// Whole numbers by their names in WGSL.
const WORDS: [(&str, u32); 33] = [
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
    ("OPEN", OPEN),
    ("N_SUMS", N_SUMS as u32),
    ("SUM_GROUP", SUM_GROUP),
];

/// Other numbers by their names in WGSL.
const NUMBERS: [(&str, f32); 15] = [
    ("ALPHA_CAP", ALPHA_CAP as f32),
    ("ALPHA_CUT", ALPHA_CUT as f32),
    ("TRANSMITTANCE_STOP", TRANSMITTANCE_STOP as f32),
    ("LOW_PASS", LOW_PASS_PX2 as f32),
    ("FOOTPRINT", FOOTPRINT_PX2 as f32),
    ("REFERENCE_VARIANCE", REFERENCE_VARIANCE as f32),
    ("SCALE_FLOOR", SCALE_FLOOR as f32),
    ("FLATTEST", FLATTEST as f32),
    ("POINT_SCALE", POINT_SCALE as f32),
    ("GRADIENT_LIMIT", GRADIENT_LIMIT as f32),
    ("OUTSIDE", OUTSIDE),
    ("SEEN", SEEN),
    ("MIN_WEIGHT", MIN_WEIGHT),
    ("MAX_OFFSET", MAX_OFFSET),
    ("QUANTA", (1.0 / QUANTUM) as f32),
];

/// A shader behind the declarations of all shared constants.
pub fn with_constants(shader: &str) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    for (name, value) in WORDS {
        let _ = writeln!(text, "const {name}: u32 = {value}u;");
    }
    // The shortest digits that give the same f32 back, read as f32 because of the suffix.
    for (name, value) in NUMBERS {
        let _ = writeln!(text, "const {name}: f32 = {value:?}f;");
    }
    let [r, g, b] = MARK;
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

/// A module of a shader that leaves the shared constants out.
pub(super) fn module(device: &wgpu::Device, label: &str, shader: &str) -> wgpu::ShaderModule {
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(with_constants(shader).into()),
    })
}
