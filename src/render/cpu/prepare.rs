//! From a splat to what the rasteriser reads: `rendering.md` (b) 1 to 6, in f64 and once per splat,
//! so that the f32 of the inner loop starts from correctly rounded numbers.

use super::lanes::EXP2_MIN;
use crate::math::camera::{Camera, Intrinsics};
use crate::model::splats::Splat;
use crate::render::{
    ALPHA_CUT, FRUSTUM_MARGIN, LOW_PASS_PX2, Method, RenderOptions, SCALE_FLOOR, Support, TILE,
};
use glam::{DMat3, DQuat, DVec2, DVec3};
use std::f64::consts::LOG2_E;
use std::ops::Range;

/// Splats per parallel task: small enough to balance 10⁴ splats, large enough to hide the
/// scheduling.
pub(super) const CHUNK: usize = 2048;

/// A splat in the image.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Record {
    /// Projected centre in pixels.
    pub u: f32,
    /// Projected centre in pixels.
    pub v: f32,
    /// `alpha = opacity · 2^−(p² + q²)` with `p = p_x·δx + p_y·δy` and `q = q_y·δy`: a Cholesky
    /// factor of the conic. A sum of squares cannot turn positive by rounding, and its error grows
    /// with `p`, where the expanded form's grows with `(p_x·δx)²`.
    pub p_x: f32,
    pub p_y: f32,
    pub q_y: f32,
    /// Smallest exponent of 2 that passes the alpha cut, and that `exp2` can take.
    pub cut: f32,
    pub opacity: f32,
    pub color: [f32; 3],
    /// View depth; positive, so its bits order like its value.
    pub depth: f32,
    pub rect: Rect,
}

/// Pixels `x0..x1` × `y0..y1`; not empty in a visible record.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rect {
    pub x0: u32,
    pub x1: u32,
    pub y0: u32,
    pub y1: u32,
}

impl Rect {
    /// Rows of tiles it touches.
    pub(super) fn tile_rows(&self) -> Range<usize> {
        self.y0 as usize / TILE..(self.y1 as usize).div_ceil(TILE)
    }

    /// Columns of tiles it touches.
    pub(super) fn tile_columns(&self) -> Range<usize> {
        self.x0 as usize / TILE..(self.x1 as usize).div_ceil(TILE)
    }
}

/// What a chunk held.
pub(super) struct ChunkCount {
    pub n_visible: usize,
    pub n_invalid: usize,
}

/// Camera and options in the form the preparation uses.
pub(super) struct View {
    pub width: usize,
    pub height: usize,
    camera_from_world: DMat3,
    centre: DVec3,
    intrinsics: Intrinsics,
    /// Range of `x/z` and `y/z` inside which the Jacobian follows the splat.
    tangent_lo: DVec2,
    tangent_hi: DVec2,
    near: f32,
    support: Support,
}

/// Packs the visible splats of a chunk into the front of `records`, in order.
pub(super) fn prepare_chunk(splats: &[Splat], records: &mut [Record], view: &View) -> ChunkCount {
    let mut count = ChunkCount { n_visible: 0, n_invalid: 0 };
    for splat in splats {
        if splat.opacity <= 0.0 {
            continue;
        }
        let Some(axes) = axes_of(splat) else {
            count.n_invalid += 1;
            continue;
        };
        if let Some(record) = view.project(splat, axes) {
            records[count.n_visible] = record;
            count.n_visible += 1;
        }
    }
    count
}

/// World directions of the three scales, or `None` if the splat is broken.
fn axes_of(splat: &Splat) -> Option<DMat3> {
    let [w, x, y, z] = splat.rotation.map(f64::from);
    let rotation = DQuat::from_xyzw(x, y, z, w);
    let broken = !splat.is_drawable() || rotation.length_squared() == 0.0;
    (!broken).then(|| DMat3::from_quat(rotation.normalize()))
}

impl View {
    pub(super) fn new(camera: &Camera, options: &RenderOptions) -> Self {
        let k = camera.intrinsics;
        let focal = DVec2::new(k.fx, k.fy);
        let size = DVec2::new(k.width as f64, k.height as f64);
        let principal = DVec2::new(k.cx, k.cy);
        let margin = FRUSTUM_MARGIN * 0.5 * size / focal;
        Self {
            width: k.width as usize,
            height: k.height as usize,
            camera_from_world: camera.pose.rotation().transpose(),
            centre: camera.pose.centre(),
            intrinsics: k,
            tangent_lo: -principal / focal - margin,
            tangent_hi: (size - principal) / focal + margin,
            near: options.near.max(0.0) as f32,
            support: match options.method {
                Method::Projected(support) => support,
                Method::Exact(_) => Support::Alpha,
            },
        }
    }

    /// The record of a splat, or `None` if no pixel can see it.
    fn project(&self, splat: &Splat, axes: DMat3) -> Option<Record> {
        // The camera is subtracted in f64: far from the origin f32 would lose the difference.
        let mean = DVec3::from_array(splat.mean.map(f64::from));
        let m = self.camera_from_world * (mean - self.centre);
        let depth = m.z as f32;
        let opacity = f64::from(splat.opacity);
        if depth <= self.near || opacity < ALPHA_CUT {
            return None;
        }
        let tangent = m.truncate() / m.z;
        let k = &self.intrinsics;
        let centre = DVec2::new(k.fx * tangent.x + k.cx, k.fy * tangent.y + k.cy);
        let covariance = self.covariance(splat, axes, tangent, m.z);
        let rect = match self.support {
            Support::Alpha => {
                self.rect_of_alpha(centre, covariance, (2.0 * (opacity / ALPHA_CUT).ln()).sqrt())
            }
            Support::Tile3Sigma => self.rect_of_tiles(centre, covariance),
        }?;
        let record = covariance.record(splat, centre, depth, rect);
        let finite = [record.u, record.v, record.p_x, record.p_y, record.q_y, depth];
        finite.iter().all(|value| value.is_finite()).then_some(record)
    }

    /// `J S Jᵀ + 0.3·I` through the image `W = J R Q diag(s)` of the scaled axes.
    fn covariance(&self, splat: &Splat, axes: DMat3, tangent: DVec2, z: f64) -> Covariance2 {
        let k = &self.intrinsics;
        let clamped = tangent.max(self.tangent_lo).min(self.tangent_hi);
        let camera_axes = self.camera_from_world * axes;
        let row_x = DVec3::new(k.fx / z, 0.0, -k.fx * clamped.x / z);
        let row_y = DVec3::new(0.0, k.fy / z, -k.fy * clamped.y / z);
        let scale = DVec3::from_array(splat.scale.map(f64::from));
        let scale = scale.max(DVec3::splat(SCALE_FLOOR * scale.max_element().max(1.0)));
        let w_x = camera_axes.transpose_mul_vec3(row_x) * scale;
        let w_y = camera_axes.transpose_mul_vec3(row_y) * scale;
        let (xx, yy) = (w_x.length_squared(), w_y.length_squared());
        // Lagrange's identity: the determinant as a sum of positive terms does not cancel.
        let det = w_x.cross(w_y).length_squared() + LOW_PASS_PX2 * (xx + yy + LOW_PASS_PX2);
        Covariance2 { xx: xx + LOW_PASS_PX2, yy: yy + LOW_PASS_PX2, xy: w_x.dot(w_y), det }
    }

    /// Pixels whose centres lie in the box of the ellipse of `radius` standard deviations.
    fn rect_of_alpha(&self, centre: DVec2, c: Covariance2, radius: f64) -> Option<Rect> {
        let half = radius * DVec2::new(c.xx.sqrt(), c.yy.sqrt());
        let lo = (centre - half - 0.5).ceil();
        let hi = (centre + half - 0.5).floor() + 1.0;
        self.clip(lo, hi)
    }

    /// The reference's rectangle of tiles: a square of `⌈3√λ₁⌉` around the centre's pixel index.
    fn rect_of_tiles(&self, centre: DVec2, c: Covariance2) -> Option<Rect> {
        /// Floor of the reference under the root of the larger eigenvalue.
        const ROOT_FLOOR: f64 = 0.1;
        let half_trace = 0.5 * (c.xx + c.yy);
        let largest = half_trace + (half_trace * half_trace - c.det).max(ROOT_FLOOR).sqrt();
        let radius = (3.0 * largest.sqrt()).ceil();
        let tile = TILE as f64;
        let index = centre - 0.5;
        let lo = ((index - radius) / tile).trunc() * tile;
        let hi = ((index + radius + tile - 1.0) / tile).trunc() * tile;
        self.clip(lo, hi)
    }

    /// Casts saturate: far outside is empty, infinite is the whole image.
    fn clip(&self, lo: DVec2, hi: DVec2) -> Option<Rect> {
        let limit = |value: f64, size: usize| (value as u32).min(size as u32);
        let rect = Rect {
            x0: limit(lo.x, self.width),
            x1: limit(hi.x, self.width),
            y0: limit(lo.y, self.height),
            y1: limit(hi.y, self.height),
        };
        (rect.x0 < rect.x1 && rect.y0 < rect.y1).then_some(rect)
    }
}

/// Projected covariance in px², low-pass included.
#[derive(Clone, Copy)]
struct Covariance2 {
    xx: f64,
    xy: f64,
    yy: f64,
    det: f64,
}

impl Covariance2 {
    fn record(self, splat: &Splat, centre: DVec2, depth: f32, rect: Rect) -> Record {
        // exp(−½ D²) = 2^−(½ log₂e · D²), and D² = (√(yy/det)·δx − xy/√(yy·det)·δy)² + δy²/yy.
        let unit = (0.5 * LOG2_E).sqrt();
        Record {
            u: centre.x as f32,
            v: centre.y as f32,
            p_x: (unit * (self.yy / self.det).sqrt()) as f32,
            p_y: (-unit * self.xy / (self.yy * self.det).sqrt()) as f32,
            q_y: (unit / self.yy.sqrt()) as f32,
            cut: ((ALPHA_CUT / f64::from(splat.opacity)).log2() as f32).max(EXP2_MIN),
            opacity: splat.opacity,
            color: splat.color.map(|channel| channel.max(0.0)),
            depth,
            rect,
        }
    }
}
