//! The structs that Rust and WGSL share; `tests/shaders.rs` compares sizes and offsets with naga's.

use crate::math::camera::Camera;
use crate::model::splats::Splat;

/// WGSL of each pipeline: the shared structs, then the file.
pub mod shader {
    /// `projected.wgsl`.
    pub const PROJECTED: &str = concat!(
        include_str!("../../../shaders/common.wgsl"),
        include_str!("../../../shaders/projected.wgsl")
    );
    /// `composite.wgsl`.
    pub const COMPOSITE: &str = concat!(
        include_str!("../../../shaders/common.wgsl"),
        include_str!("../../../shaders/composite.wgsl")
    );
    /// `scatter.wgsl`.
    pub const SCATTER: &str = concat!(
        include_str!("../../../shaders/common.wgsl"),
        include_str!("../../../shaders/scatter.wgsl")
    );
}

/// [`GpuSplat::flags`]: the slot holds a splat that can be drawn.
pub const FLAG_LIVE: u32 = 1;

/// Smallest standard deviation relative to `max(1, largest)` (`rendering.md` (a)).
const SCALE_FLOOR: f32 = 1e-6;

/// Splat record in GPU memory, 64 bytes (`rendering.md` (d)).
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct GpuSplat {
    /// Centre, world units.
    pub mean: [f32; 3],
    /// Peak opacity.
    pub opacity: f32,
    /// sRGB-encoded colour, not negative.
    pub color: [f32; 3],
    /// Bit 0 [`FLAG_LIVE`], bit 1 selected, bits 8–31 evidence.
    pub flags: u32,
    /// Unit quaternion `x y z w`.
    pub rotation: [f32; 4],
    /// Standard deviations, world units, floored.
    pub scale: [f32; 3],
    /// Frame of birth; 0 when unknown.
    pub birth: u32,
}

impl GpuSplat {
    /// The record of a splat. One that cannot be drawn (empty, non-finite, no rotation) becomes all
    /// zeros, so no shader meets a NaN.
    pub fn new(splat: &Splat) -> Self {
        let norm = splat.rotation.iter().map(|&q| f64::from(q).powi(2)).sum::<f64>().sqrt();
        if !splat.is_drawable() || norm == 0.0 {
            return bytemuck::Zeroable::zeroed();
        }
        let [w, x, y, z] = splat.rotation.map(|q| (f64::from(q) / norm) as f32);
        let largest = splat.scale.iter().fold(1.0f32, |a, &s| a.max(s));
        Self {
            mean: splat.mean,
            opacity: splat.opacity,
            color: splat.color.map(|c| c.max(0.0)),
            flags: FLAG_LIVE,
            rotation: [x, y, z, w],
            scale: splat.scale.map(|s| s.max(SCALE_FLOOR * largest)),
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

/// Uniforms of the splat pass: one camera.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct View {
    /// The camera's x axis in the world.
    pub right: [f32; 3],
    /// Splats at `z ≤ near` (world units) are not drawn.
    pub near: f32,
    /// The camera's y axis in the world.
    pub down: [f32; 3],
    /// Largest support of a splat, in its standard deviations.
    pub extent_cap: f32,
    /// The camera's z axis in the world.
    pub forward: [f32; 3],
    /// Alignment.
    pub padding: u32,
    /// The camera's centre, world units.
    pub centre: [f32; 3],
    /// Alignment.
    pub padding_centre: u32,
    /// Focal lengths, px.
    pub focal: [f32; 2],
    /// Principal point, px.
    pub principal: [f32; 2],
    /// Columns and rows, px.
    pub viewport: [f32; 2],
    /// Smallest `x/z` and `y/z` that the Jacobian may see (`rendering.md` (b) 2).
    pub tangent_min: [f32; 2],
    /// Largest.
    pub tangent_max: [f32; 2],
    /// WGSL rounds the size up to 112.
    pub padding_end: [u32; 2],
}

/// How far past the image's edge the Jacobian follows a splat, in half image widths.
const FRUSTUM_MARGIN: f64 = 0.3;

impl View {
    /// `near` in world units; `extent_cap` in standard deviations.
    pub fn new(camera: &Camera, near: f32, extent_cap: f32) -> Self {
        let k = &camera.intrinsics;
        let axes = camera.pose.rotation();
        let pair = |x: f64, y: f64| [x as f32, y as f32];
        let size = [f64::from(k.width), f64::from(k.height)];
        let margin = [size[0] / (2.0 * k.fx), size[1] / (2.0 * k.fy)].map(|t| FRUSTUM_MARGIN * t);
        Self {
            right: axes.x_axis.as_vec3().to_array(),
            near,
            down: axes.y_axis.as_vec3().to_array(),
            extent_cap,
            forward: axes.z_axis.as_vec3().to_array(),
            padding: 0,
            centre: camera.pose.centre().as_vec3().to_array(),
            padding_centre: 0,
            focal: pair(k.fx, k.fy),
            principal: pair(k.cx, k.cy),
            viewport: pair(size[0], size[1]),
            tangent_min: pair(-(k.cx / k.fx + margin[0]), -(k.cy / k.fy + margin[1])),
            tangent_max: pair(
                (size[0] - k.cx) / k.fx + margin[0],
                (size[1] - k.cy) / k.fy + margin[1],
            ),
            padding_end: [0; 2],
        }
    }
}

/// Uniforms of the composite pass.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Composite {
    /// sRGB-encoded colour behind the splats.
    pub background: [f32; 3],
    /// 0 shows the first picture, 1 wipes between two, 2 shows what differs.
    pub mode: u32,
    /// Upper left corner of the second picture, shares of the viewport.
    pub area_min: [f32; 2],
    /// Lower right corner.
    pub area_max: [f32; 2],
    /// Divider of a wipe (share of the width) or gain of a difference.
    pub amount: f32,
    /// WGSL rounds the size up to 48.
    pub padding: [u32; 3],
}
