//! The structs that Rust and WGSL share; `tests/gpu/shaders.rs` compares sizes and offsets with naga's.
//!
//! Rust and WGSL have no common header, so both spell each struct and a test compares them. Scales
//! and a quaternion are sent rather than a covariance, whose six f32 lose the width of needles
//! (`rendering.md`, Tried and dropped). Vectors of three are followed by a scalar, because WGSL
//! aligns them to 16 bytes and would pad there anyway.

use super::constants::{
    FLAG_LIVE, PAINT_DEPTH, PAINT_NORMAL, PAINT_STORED, RENDERER_EXACT, RENDERER_PROJECTED,
};
use super::error::GpuError;
use crate::math::camera::Camera;
use crate::model::splat::appearance::Appearance;
use crate::model::splat::observed_cone::ObservedCone;
use crate::model::splat::splats::Splat;
use crate::render::constants::FRUSTUM_MARGIN;
use crate::render::options::{ExactOptions, Paint, RenderMethod, RenderOptions, Response, Support};

/// WGSL of each pipeline: the shared structs, then the file; [`super::constants`] come in front.
pub mod shader {
    /// `record.wgsl` with what it needs: the start of every file that turns splats into pixels.
    pub const RECORD: &str = concat!(
        include_str!("../../../shaders/common.wgsl"),
        include_str!("../../../shaders/paint.wgsl"),
        include_str!("../../../shaders/record.wgsl")
    );
    /// `quads.wgsl` behind what it needs: splats as blended quads.
    pub const QUADS: &str = concat!(
        include_str!("../../../shaders/common.wgsl"),
        include_str!("../../../shaders/paint.wgsl"),
        include_str!("../../../shaders/record.wgsl"),
        include_str!("../../../shaders/quads.wgsl")
    );
    /// `composite.wgsl` behind what it needs: the image over a background.
    pub const COMPOSITE: &str = concat!(
        include_str!("../../../shaders/common.wgsl"),
        include_str!("../../../shaders/composite.wgsl")
    );
    /// `meshes.wgsl`: triangles of a user interface.
    pub const MESHES: &str = include_str!("../../../shaders/meshes.wgsl");
    /// `scatter.wgsl` behind what it needs: changed records to their places.
    pub const SCATTER: &str = concat!(
        include_str!("../../../shaders/common.wgsl"),
        include_str!("../../../shaders/scatter.wgsl")
    );
}

/// Splat record in GPU memory, 64 bytes (`rendering.md`, Splat record).
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct GpuSplat {
    /// Centre, world units.
    pub mean: [f32; 3],
    /// Peak opacity, 0 to 1 or more: alpha is capped, not the opacity.
    pub opacity: f32,
    /// Colour at the centre, sRGB-encoded, nominally in `[0, 1]`.
    pub color: [f32; 3],
    /// Bit 0 [`FLAG_LIVE`], bit 1 selected, bits 8–31 evidence.
    pub flags: u32,
    /// Unit quaternion `x y z w`.
    pub rotation: [f32; 4],
    /// Standard deviations, world units.
    pub scale: [f32; 3],
    /// Frame of birth; 0 when unknown.
    pub birth: u32,
}

impl GpuSplat {
    /// The record of a splat. One that cannot be drawn (empty or not valid) becomes all
    /// zeros, so no shader meets a NaN.
    pub fn new(splat: &Splat) -> Self {
        // Zero opacity and no flag: a shader drops it before any arithmetic.
        if !splat.is_drawable() {
            return bytemuck::Zeroable::zeroed();
        }
        let norm = splat.rotation.iter().map(|&q| f64::from(q).powi(2)).sum::<f64>().sqrt();
        let [w, x, y, z] = splat.rotation.map(|q| (f64::from(q) / norm) as f32);
        Self {
            mean: splat.mean,
            opacity: splat.opacity,
            color: splat.color,
            flags: FLAG_LIVE,
            rotation: [x, y, z, w],
            scale: splat.scale,
            birth: 0,
        }
    }
}

/// A record and its index, for sparse updates.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct SparseSplat {
    /// The new record.
    pub splat: GpuSplat,
    /// Where it goes.
    pub index: u32,
    /// WGSL rounds the size up to 80.
    pub padding: [u32; 3],
}

/// Appearance in GPU memory, 108 bytes (`rendering.md`, Splat record).
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct GpuAppearance {
    /// Colour gradient: row per channel, column per world axis; per world unit.
    pub gradient: [[f32; 3]; 3],
    /// Degree-1 colour, laid out alike.
    pub directional: [[f32; 3]; 3],
    /// Mean of the observed directions.
    pub observed: [f32; 3],
    /// Their cone: upper triangle, row by row.
    pub cone: [f32; 6],
}

impl GpuAppearance {
    /// `None` if it is not finite.
    pub fn new(appearance: &Appearance) -> Option<Self> {
        let Appearance { gradient, directional, observed } = *appearance;
        let ObservedCone { mean, inverse } = observed;
        let found = Self { gradient, directional, observed: mean, cone: inverse };
        appearance.is_valid().then_some(found)
    }
}

/// An appearance and its index, for sparse updates.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct SparseAppearance {
    /// The new values.
    pub appearance: GpuAppearance,
    /// Where they go.
    pub index: u32,
}

/// Uniforms of whatever draws splats: one camera, one set of options.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct GpuView {
    /// The camera's x axis in the world.
    pub right: [f32; 3],
    /// Splats at `z ≤ near` (fisheye: at a distance `≤ near`) are not drawn; world units.
    pub near: f32,
    /// The camera's y axis in the world.
    pub down: [f32; 3],
    /// Largest support of a splat, in its standard deviations.
    pub extent_cap: f32,
    /// The camera's z axis in the world.
    pub forward: [f32; 3],
    /// Factor on the standard deviations.
    pub scale: f32,
    /// The camera's centre, world units.
    pub centre: [f32; 3],
    /// Splats of less opacity are not drawn.
    pub opacity_cut: f32,
    /// What rounding took from `centre`.
    pub centre_rest: [f32; 3],
    /// `RENDERER_*` of [`super::constants`].
    pub renderer: u32,
    /// Focal lengths, px; px per radian through a fisheye.
    pub focal: [f32; 2],
    /// Principal point, px.
    pub principal: [f32; 2],
    /// Columns and rows, px.
    pub viewport: [f32; 2],
    /// Smallest `x/z` and `y/z` that the Jacobian may see (`rendering.md`, Projected renderer).
    pub tangent_min: [f32; 2],
    /// Largest `x/z` and `y/z` that the Jacobian may see.
    pub tangent_max: [f32; 2],
    /// Ends of the depth paint, world units.
    pub depth_range: [f32; 2],
    /// The setting's place in [`crate::render::Antialias`].
    pub antialias: u32,
    /// The lens's place in [`crate::render::Lens`].
    pub lens: u32,
    /// `PAINT_*` of [`super::constants`].
    pub paint: u32,
    /// WGSL rounds the size up to 144.
    pub padding: u32,
}

impl GpuView {
    /// `extent_cap` in standard deviations. [`GpuError::CpuOnly`] for what the shaders do not have.
    pub fn new(
        camera: &Camera,
        options: &RenderOptions,
        extent_cap: f32,
    ) -> Result<Self, GpuError> {
        let k = &camera.intrinsics;
        let axes = camera.pose.rotation();
        let centre = camera.pose.centre();
        let pair = |x: f64, y: f64| [x as f32, y as f32];
        let size = [f64::from(k.width), f64::from(k.height)];
        let margin = [size[0] / (2.0 * k.fx), size[1] / (2.0 * k.fy)].map(|t| FRUSTUM_MARGIN * t);
        let (renderer, antialias) = match options.method {
            RenderMethod::Projected(Support::Tile3Sigma) => {
                return Err(GpuError::CpuOnly { found: "support of three standard deviations" });
            }
            RenderMethod::Exact(ExactOptions { response: Response::Line, .. }) => {
                return Err(GpuError::CpuOnly { found: "response `line`" });
            }
            RenderMethod::Projected(Support::Alpha) => (RENDERER_PROJECTED, 0),
            RenderMethod::Exact(exact) => (RENDERER_EXACT, exact.antialias as u32),
        };
        let (paint, depth_range) = match options.look.paint {
            Paint::Stored => (PAINT_STORED, [0.0, 1.0]),
            Paint::Depth(ends) => (PAINT_DEPTH, ends),
            Paint::Normal => (PAINT_NORMAL, [0.0, 1.0]),
        };
        Ok(Self {
            right: axes.x_axis.as_vec3().to_array(),
            near: options.near.max(0.0) as f32,
            down: axes.y_axis.as_vec3().to_array(),
            // WGSL may assume that there are no infinities.
            extent_cap: extent_cap.min(f32::MAX),
            forward: axes.z_axis.as_vec3().to_array(),
            scale: options.look.scale,
            centre: centre.as_vec3().to_array(),
            opacity_cut: options.look.opacity_cut,
            // Two f32 together hold the camera's place to about f64: subtracted one after the other
            // from a mean, far scenes keep their digits.
            centre_rest: (centre - centre.as_vec3().as_dvec3()).as_vec3().to_array(),
            renderer,
            focal: pair(k.fx, k.fy),
            principal: pair(k.cx, k.cy),
            viewport: pair(size[0], size[1]),
            tangent_min: pair(-(k.cx / k.fx + margin[0]), -(k.cy / k.fy + margin[1])),
            tangent_max: pair(
                (size[0] - k.cx) / k.fx + margin[0],
                (size[1] - k.cy) / k.fy + margin[1],
            ),
            depth_range,
            antialias,
            lens: options.method.lens() as u32,
            paint,
            padding: 0,
        })
    }
}

/// Uniforms of the composite pass.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Composite {
    /// sRGB-encoded colour behind the splats.
    pub background: [f32; 3],
    /// `COMPARE_*` of [`super::constants`].
    pub mode: u32,
    /// Upper left corner of the second picture, shares of the viewport.
    pub area_min: [f32; 2],
    /// Lower right corner.
    pub area_max: [f32; 2],
    /// Divider of a wipe (share of the width) or gain of a difference.
    pub amount: f32,
    /// Coverage that counts as full in the second picture.
    pub second_full_coverage: f32,
    /// The next vector begins at 48.
    pub padding: [u32; 2],
    /// Factors on the first picture's colour.
    pub exposure: [f32; 3],
    /// Coverage that counts as full in the first picture.
    pub full_coverage: f32,
    /// Factors on the second picture's colour.
    pub second_exposure: [f32; 3],
    /// WGSL rounds the size up to 80.
    pub end: u32,
}
