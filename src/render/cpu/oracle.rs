//! The slow, plain renderer that the fast ones are measured against: f64, no tiles, no lanes, every
//! splat in every pixel, straight from the formulas of `rendering.md` (b). It shares no arithmetic
//! with the fast path.

use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::model::splats::Splat;
use crate::render::{
    ALPHA_CAP, ALPHA_CUT, FRUSTUM_MARGIN, LOW_PASS_PX2, Method, RenderOptions, SCALE_FLOOR,
    Support, TILE, TRANSMITTANCE_STOP,
};
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;

/// A splat in f64; the fields are those of [`Splat`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatF64 {
    /// Centre, world units.
    pub mean: DVec3,
    /// Peak opacity.
    pub opacity: f64,
    /// sRGB-encoded colour.
    pub color: DVec3,
    /// Standard deviations along the rotated axes, world units.
    pub scale: DVec3,
    /// Orientation of those axes; any length but zero.
    pub rotation: DQuat,
}

impl From<&Splat> for SplatF64 {
    fn from(splat: &Splat) -> Self {
        let [w, x, y, z] = splat.rotation.map(f64::from);
        Self {
            mean: DVec3::from_array(splat.mean.map(f64::from)),
            opacity: splat.opacity.into(),
            color: DVec3::from_array(splat.color.map(f64::from)),
            scale: DVec3::from_array(splat.scale.map(f64::from)),
            rotation: DQuat::from_xyzw(x, y, z, w),
        }
    }
}

/// What one pixel sees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Colour over the background, clamped to `[0, 1]`, and coverage.
    pub rgba: [f64; 4],
    /// Mean view depth `z` in world units with the blending weights; 0 where coverage is 0.
    pub depth: f64,
    /// Splats that were blended.
    pub n_blended: usize,
}

/// A view of some splats, ready to be sampled.
#[derive(Clone, Debug)]
pub struct Oracle {
    width: usize,
    height: usize,
    background: DVec3,
    alpha_cut: f64,
    transmittance_stop: f64,
    splats: Vec<Projected>,
}

#[derive(Clone, Copy, Debug)]
struct Projected {
    z: f64,
    centre: DVec2,
    conic: DMat2,
    opacity: f64,
    color: DVec3,
    /// First and last tile, or `None` if the support is unlimited.
    tiles: Option<[DVec2; 2]>,
}

impl Oracle {
    /// Projects and sorts the splats; those that are broken or hidden are left out.
    pub fn new(splats: &[SplatF64], camera: &Camera, options: &RenderOptions) -> Self {
        let mut projected: Vec<Projected> =
            splats.iter().filter_map(|splat| project(splat, camera, options)).collect();
        projected.sort_by(|a, b| a.z.total_cmp(&b.z));
        Self {
            width: camera.intrinsics.width as usize,
            height: camera.intrinsics.height as usize,
            background: DVec3::from_array(options.background.map(f64::from)),
            alpha_cut: ALPHA_CUT,
            transmittance_stop: TRANSMITTANCE_STOP,
            splats: projected,
        }
    }

    /// The same view with both thresholds moved: shows what f32 may do in a pixel that lies on one
    /// (`rendering.md` (g)).
    pub fn with_thresholds(&self, alpha_cut: f64, transmittance_stop: f64) -> Self {
        Self { alpha_cut, transmittance_stop, ..self.clone() }
    }

    /// One pixel, in O(splats).
    pub fn pixel(&self, column: usize, row: usize) -> Sample {
        let pixel = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
        let mut transmittance = 1.0;
        let (mut color, mut depth, mut n_blended) = (DVec3::ZERO, 0.0, 0);
        for splat in &self.splats {
            let Some(alpha) = splat.alpha(pixel).filter(|alpha| *alpha >= self.alpha_cut) else {
                continue;
            };
            let next = transmittance * (1.0 - alpha);
            if next < self.transmittance_stop {
                break;
            }
            color += splat.color * (alpha * transmittance);
            depth += splat.z * (alpha * transmittance);
            transmittance = next;
            n_blended += 1;
        }
        let coverage = 1.0 - transmittance;
        let color =
            (color + self.background * transmittance).clamp(DVec3::ZERO, DVec3::ONE).to_array();
        Sample {
            rgba: [color[0], color[1], color[2], coverage],
            depth: if n_blended > 0 { depth / coverage } else { 0.0 },
            n_blended,
        }
    }

    /// The whole image.
    pub fn render(&self) -> Image<Sample> {
        let data = (0..self.width * self.height)
            .into_par_iter()
            .map(|i| self.pixel(i % self.width, i / self.width))
            .collect();
        Image::from_vec(self.width, self.height, data)
    }
}

impl Projected {
    /// Alpha at a pixel centre before the cut, or `None` outside the support.
    fn alpha(&self, pixel: DVec2) -> Option<f64> {
        if let Some([first, end]) = self.tiles {
            let tile = (pixel / TILE as f64).floor();
            if tile.cmplt(first).any() || tile.cmpge(end).any() {
                return None;
            }
        }
        let offset = pixel - self.centre;
        let exponent = -0.5 * offset.dot(self.conic * offset);
        (exponent <= 0.0).then(|| ALPHA_CAP.min(self.opacity * exponent.exp()))
    }
}

fn project(splat: &SplatF64, camera: &Camera, options: &RenderOptions) -> Option<Projected> {
    let k = &camera.intrinsics;
    let (rotation, translation) = camera.pose.inverse();
    let m = rotation * splat.mean + translation;
    let finite = splat.mean.is_finite()
        && splat.opacity.is_finite()
        && splat.color.is_finite()
        && splat.scale.is_finite()
        && splat.rotation.is_finite()
        && splat.rotation.length_squared() > 0.0;
    if !finite || splat.opacity <= 0.0 || m.z <= options.near.max(0.0) {
        return None;
    }
    let floor = SCALE_FLOOR * splat.scale.max_element().max(1.0);
    let scale = splat.scale.max(DVec3::splat(floor));
    let q = rotation * DMat3::from_quat(splat.rotation.normalize());
    let s = q * DMat3::from_diagonal(scale * scale) * q.transpose();

    let (a, b) = (m.x / m.z, m.y / m.z);
    let clamp = |ratio: f64, principal: f64, size: u32, focal: f64| {
        let size = f64::from(size);
        let beyond = FRUSTUM_MARGIN * size / (2.0 * focal);
        ratio.max(-(principal / focal + beyond)).min((size - principal) / focal + beyond)
    };
    let (a_clamped, b_clamped) = (clamp(a, k.cx, k.width, k.fx), clamp(b, k.cy, k.height, k.fy));
    let j_x = DVec3::new(k.fx / m.z, 0.0, -k.fx * a_clamped / m.z);
    let j_y = DVec3::new(0.0, k.fy / m.z, -k.fy * b_clamped / m.z);
    let xx = j_x.dot(s * j_x) + LOW_PASS_PX2;
    let xy = j_x.dot(s * j_y);
    let yy = j_y.dot(s * j_y) + LOW_PASS_PX2;
    let det = xx * yy - xy * xy;
    if det <= 0.0 || !det.is_finite() {
        return None;
    }
    let centre = DVec2::new(k.fx * a + k.cx, k.fy * b + k.cy);
    Some(Projected {
        z: m.z,
        centre,
        conic: DMat2::from_cols(DVec2::new(yy, -xy), DVec2::new(-xy, xx)) * det.recip(),
        opacity: splat.opacity,
        color: splat.color.max(DVec3::ZERO),
        tiles: (options.method == Method::Projected(Support::Tile3Sigma))
            .then(|| tiles_of_three_sigma(centre, 0.5 * (xx + yy), det)),
    })
}

/// First and end tile of the reference's square, in its pixel-index coordinates `centre − ½`.
fn tiles_of_three_sigma(centre: DVec2, half_trace: f64, det: f64) -> [DVec2; 2] {
    let largest = half_trace + (half_trace * half_trace - det).max(0.1).sqrt();
    let radius = (3.0 * largest.sqrt()).ceil();
    let tile = TILE as f64;
    let index = centre - 0.5;
    [((index - radius) / tile).trunc(), ((index + radius + tile - 1.0) / tile).trunc()]
}
