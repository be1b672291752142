//! Structs shared by Rust and WGSL. There is no common header, so both define each struct, and
//! `tests/gpu/shaders.rs` compares sizes and offsets with naga's.
//!
//! Splats store scales and a quaternion rather than a covariance, whose six f32 lose the width of needles
//! (`rendering.md`, Tried and dropped). A scalar follows each vector of three, because WGSL aligns vectors of
//! three to 16 bytes and would otherwise pad there.

use super::constants::{
    FLAG_LIVE, PAINT_DEPTH, PAINT_NORMAL, PAINT_STORED, RENDERER_EXACT, RENDERER_PROJECTED,
};
use super::error::GpuError;
use crate::math::camera::Camera;
use crate::model::splat::appearance::Appearance;
use crate::model::splat::observed_cone::ObservedCone;
use crate::model::splat::splats::Splat;
use crate::render::options::{
    ExactOptions, Paint, RenderMethod, RenderOptions, Response, tangent_range,
};

/// WGSL source of each pipeline, without the constants that [`super::constants`] prepends.
pub mod shader {
    use super::super::constants::wgsl;

    /// `composite.wgsl` with its dependencies: composites the splat image over a background.
    pub const COMPOSITE: &str = wgsl!("common", "composite");
    /// `meshes.wgsl`: draws triangles of the user interface.
    pub const MESHES: &str = wgsl!("meshes");
    /// `scatter.wgsl` with its dependencies: replaces single records.
    pub const SCATTER: &str = wgsl!("common", "scatter");
}

/// Splat record in GPU memory, 64 bytes (`rendering.md`, Splat record).
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct GpuSplat {
    /// Centre, world units.
    pub mean: [f32; 3],
    /// Peak opacity; may exceed 1, because alpha rather than opacity is capped.
    pub opacity: f32,
    /// Colour at the centre, sRGB-encoded, nominally in `[0, 1]`.
    pub color: [f32; 3],
    /// Bit 0: [`FLAG_LIVE`]; the other bits are 0.
    pub flags: u32,
    /// Unit quaternion `x y z w`.
    pub rotation: [f32; 4],
    /// Standard deviations, world units.
    pub scale: [f32; 3],
    /// Padding to the size in WGSL, 64 bytes.
    pub padding: u32,
}

impl GpuSplat {
    /// Converts a splat. An empty or invalid splat becomes all zeros, so that no shader encounters
    /// a NaN.
    pub fn new(splat: &Splat) -> Self {
        // With zero opacity and no flag, a shader drops it before any arithmetic.
        if !splat.is_drawable() {
            return bytemuck::Zeroable::zeroed();
        }
        // In f64, where the square of any f32 neither overflows nor vanishes.
        let norm = splat.rotation.iter().map(|&q| f64::from(q).powi(2)).sum::<f64>().sqrt();
        let [w, x, y, z] = splat.rotation.map(|q| (f64::from(q) / norm) as f32);
        Self {
            mean: splat.mean,
            opacity: splat.opacity,
            color: splat.color,
            flags: FLAG_LIVE,
            rotation: [x, y, z, w],
            scale: splat.scale,
            padding: 0,
        }
    }
}

/// Splat record and its index, for updates of single records.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct SparseSplat {
    /// The new record.
    pub splat: GpuSplat,
    /// Index of the record to replace.
    pub index: u32,
    /// Padding to the size in WGSL, 80 bytes.
    pub padding: [u32; 3],
}

/// Appearance in GPU memory, 108 bytes (`rendering.md`, Splat record).
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct GpuAppearance {
    /// Colour gradient per world unit: one row per channel, one column per world axis.
    pub gradient: [[f32; 3]; 3],
    /// Colour change with the unit direction from the camera: one row per channel, one column per world
    /// axis.
    pub directional: [[f32; 3]; 3],
    /// Mean of the unit directions from the cameras to the splat, world axes.
    pub observed: [f32; 3],
    /// Matrix of the cone of observed directions: upper triangle, row by row.
    pub cone: [f32; 6],
}

impl GpuAppearance {
    /// Converts an appearance; `None` if a value is not finite.
    pub fn new(appearance: &Appearance) -> Option<Self> {
        let Appearance { gradient, directional, observed } = *appearance;
        let ObservedCone { mean, inverse } = observed;
        let found = Self { gradient, directional, observed: mean, cone: inverse };
        appearance.is_valid().then_some(found)
    }
}

/// Appearance and its index, for updates of single appearances.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct SparseAppearance {
    /// The new appearance.
    pub appearance: GpuAppearance,
    /// Index of the appearance to replace.
    pub index: u32,
}

/// Uniforms of splat drawing: one camera and one set of options.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct GpuView {
    /// Camera x axis in world space.
    pub right: [f32; 3],
    /// Near plane: splats at `z ≤ near` (fisheye: at a distance `≤ near`) are not drawn; world units.
    pub near: f32,
    /// Camera y axis in world space.
    pub down: [f32; 3],
    /// Source of colour: one of the constants `PAINT_*` of [`super::constants`].
    pub paint: u32,
    /// Camera z axis in world space.
    pub forward: [f32; 3],
    /// Display factor on the splats' standard deviations.
    pub scale: f32,
    /// Camera centre, world units.
    pub centre: [f32; 3],
    /// Splats with a smaller opacity are not drawn.
    pub opacity_cut: f32,
    /// Rounding error of `centre`: the exact centre minus `centre`.
    pub centre_rest: [f32; 3],
    /// Renderer: one of the constants `RENDERER_*` of [`super::constants`].
    pub renderer: u32,
    /// Focal lengths, px; px per radian through a fisheye.
    pub focal: [f32; 2],
    /// Principal point, px.
    pub principal: [f32; 2],
    /// Width and height, px.
    pub viewport: [f32; 2],
    /// Lower limit to which `x/z` and `y/z` are clamped in the Jacobian (`rendering.md`, Projected
    /// renderer).
    pub tangent_min: [f32; 2],
    /// Upper limit to which `x/z` and `y/z` are clamped in the Jacobian.
    pub tangent_max: [f32; 2],
    /// Distances at the two ends of the depth paint's colour ramp, world units.
    pub depth_range: [f32; 2],
    /// Discriminant of [`crate::render::Antialias`].
    pub antialias: u32,
    /// Discriminant of [`crate::render::Lens`].
    pub lens: u32,
    /// 1 for [`crate::model::splat::appearance::Finishing::is_antialiased`].
    pub is_antialiased: u32,
    /// Padding to the size in WGSL, 144 bytes.
    pub padding: u32,
}

impl GpuView {
    /// Converts a camera and options to uniforms.
    ///
    /// # Errors
    /// [`GpuError::CpuOnly`] for options that the shaders do not support.
    pub fn new(camera: &Camera, options: &RenderOptions) -> Result<Self, GpuError> {
        let k = &camera.intrinsics;
        let axes = camera.pose.rotation();
        let centre = camera.pose.centre();
        let pair = |x: f64, y: f64| [x as f32, y as f32];
        let [tangent_min, tangent_max] = tangent_range(k).map(|range| range.as_vec2().to_array());
        let (renderer, antialias) = match options.method {
            RenderMethod::Exact(ExactOptions { response: Response::Line, .. }) => {
                return Err(GpuError::CpuOnly { found: "response `line`" });
            }
            RenderMethod::Projected => (RENDERER_PROJECTED, 0),
            RenderMethod::Exact(exact) => (RENDERER_EXACT, exact.antialias as u32),
        };
        let (paint, depth_range) = match options.style.paint {
            Paint::Stored => (PAINT_STORED, [0.0, 1.0]),
            Paint::Depth(ends) => (PAINT_DEPTH, ends),
            Paint::Normal => (PAINT_NORMAL, [0.0, 1.0]),
        };
        Ok(Self {
            right: axes.x_axis.as_vec3().to_array(),
            near: options.near.max(0.0) as f32,
            down: axes.y_axis.as_vec3().to_array(),
            paint,
            forward: axes.z_axis.as_vec3().to_array(),
            scale: options.style.scale,
            centre: centre.as_vec3().to_array(),
            opacity_cut: options.style.opacity_cut,
            // Two f32 hold the camera centre to about f64 precision. Subtracted in turn from a mean, they
            // preserve precision far from the origin.
            centre_rest: (centre - centre.as_vec3().as_dvec3()).as_vec3().to_array(),
            renderer,
            focal: pair(k.fx, k.fy),
            principal: pair(k.cx, k.cy),
            viewport: pair(k.width.into(), k.height.into()),
            tangent_min,
            tangent_max,
            depth_range,
            antialias,
            lens: options.method.lens() as u32,
            is_antialiased: 0,
            padding: 0,
        })
    }
}

/// Uniforms of the composite pass.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Composite {
    /// Colour behind the splats, sRGB-encoded.
    pub background: [f32; 3],
    /// Combination of images: one of the constants `COMPARE_*` of [`super::constants`].
    pub mode: u32,
    /// Upper left corner of the second image, fractions of the viewport.
    pub area_min: [f32; 2],
    /// Lower right corner of the second image, fractions of the viewport.
    pub area_max: [f32; 2],
    /// Divider of a wipe (fraction of the width) or gain of a difference.
    pub amount: f32,
    /// Coverage at which a pixel of the second image counts as full.
    pub second_full_coverage: f32,
    /// Padding; the next vector starts at byte 48.
    pub padding: [u32; 2],
    /// Exposure factors of red, green and blue of the first image.
    pub exposure: [f32; 3],
    /// Coverage at which a pixel of the first image counts as full.
    pub full_coverage: f32,
    /// Exposure factors of red, green and blue of the second image.
    pub second_exposure: [f32; 3],
    /// Padding to the size in WGSL, 80 bytes.
    pub end: u32,
}
