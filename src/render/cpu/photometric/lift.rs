//! Jacobian of a splat's image (centre, covariance, colour) with respect to its parameters
//! (`photographs.md`, Lift). Eight splats are processed at a time, one per lane.
//!
//! A change of a parameter moves the centre by `du` and the covariance by `dΣ`. With the whitening
//! `L`, `Σ⁻¹ = LᵀL` and `z = Lδ`: `d(−½|z|²) = zᵀ(L du) + ½ zᵀ(L dΣ Lᵀ)z`. Colour is linear in its own
//! coefficients and shifts with the mean. The colour gradient is evaluated on the splat's plane; the
//! rotation of that plane with the splat is neglected.

use super::super::record::Gradient;
use super::super::view::CpuView;
use crate::math::simd::{LANES, SET_LANE, Vector, dot, load_rows, scaled, turned};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::observed_cone::ObservedCone;
use crate::model::splat::splats::Splat;
use crate::render::options::LOW_PASS_PX2;
use glam::{DMat3, DVec3};
use std::f64::consts::LN_2;

/// First index of the derivatives with respect to the mean in a linearisation (an array of the
/// derivatives of one splat's image). For each world axis, they are the coefficients of
/// `p, q, p², pq, q²` in `d ln α`. `p` and `q` are the whitened offsets of the records:
/// `α = o·2^−(p²+q²)` with opacity `o`.
pub(super) const BY_MEAN: usize = 0;
/// First index of the derivatives with respect to shape in a linearisation. For each log-scale, then for
/// each rotation axis, they are the coefficients of `p², pq, q²` in `d ln α`.
pub(super) const BY_SHAPE: usize = BY_MEAN + 15;
/// First index of the derivatives of colour in a linearisation. For each channel, they are the
/// derivatives of the colour at a pixel with respect to the mean's world coordinates.
pub(super) const COLOR_BY_MEAN: usize = BY_SHAPE + 18;
/// First index of the viewing direction in a linearisation. The direction leads from the camera to the
/// splat, in world axes, and is clamped to the cone of observed directions.
pub(super) const DIRECTION: usize = COLOR_BY_MEAN + 9;
/// First index of two displacements on the splat's plane in a linearisation. They are world vectors: one
/// per unit of a record's `p`, one per unit of its `q`.
pub(super) const PLANE_VECTORS: usize = DIRECTION + 3;
/// Number of values in a linearisation.
pub(super) const N_LINEAR: usize = PLANE_VECTORS + 6;

/// Ratio of the squared Mahalanobis distance to a record's `p² + q²`.
const UNIT: f64 = 2.0 * LN_2;

/// Eight splats of a view. Unused lanes hold finite values.
pub(super) struct SplatLanes {
    /// Centre in camera axes, world units.
    centre: [[f32; LANES]; 3],
    /// Rotation as a quaternion `w x y z` of any non-zero length.
    rotation: [[f32; LANES]; 4],
    /// Standard deviations, world units.
    scale: [[f32; LANES]; 3],
    /// Change of each colour channel per px of image offset.
    across: [[[f32; LANES]; 2]; 3],
    /// Derivative of each colour channel with respect to the viewing direction.
    directional: [[[f32; LANES]; 3]; 3],
    /// Mean of the observed viewing directions, world axes.
    observed: [[f32; LANES]; 3],
    cone: [[f32; LANES]; 6],
}

impl SplatLanes {
    /// Creates lanes that all hold the same placeholder, a splat in front of the camera.
    pub(super) fn new() -> Self {
        let [zeros, ones] = [[0.0; LANES], [1.0; LANES]];
        Self {
            centre: [zeros, zeros, ones],
            rotation: [ones, zeros, zeros, zeros],
            scale: [ones; 3],
            across: [[zeros; 2]; 3],
            directional: [[zeros; 3]; 3],
            observed: [zeros; 3],
            cone: [zeros; 6],
        }
    }

    /// Stores a visible splat in a lane; `gradient` is the colour gradient of its record.
    #[inline(always)]
    pub(super) fn set(
        &mut self,
        lane: usize,
        view: &CpuView,
        (splat, appearance): (&Splat, &Appearance),
        gradient: &Gradient,
    ) {
        // The camera is subtracted in f64, because far from the origin f32 would lose the difference.
        let mean = DVec3::from_array(splat.mean.map(f64::from));
        let centre = (view.camera_from_world * (mean - view.centre)).as_vec3();
        let scale = view.style.display_scales(splat).as_vec3();
        for axis in 0..3 {
            self.centre[axis][lane] = centre[axis];
            self.scale[axis][lane] = scale[axis];
        }
        for (lanes, value) in self.rotation.iter_mut().zip(splat.rotation) {
            lanes[lane] = value;
        }
        let ObservedCone { mean, inverse } = &appearance.observed;
        for (lanes, value) in self.observed.iter_mut().zip(mean) {
            lanes[lane] = *value;
        }
        for (lanes, value) in self.cone.iter_mut().zip(inverse) {
            lanes[lane] = *value;
        }
        for channel in 0..3 {
            for axis in 0..2 {
                self.across[channel][axis][lane] = gradient.across[channel][axis];
            }
            for axis in 0..3 {
                self.directional[channel][axis][lane] = appearance.directional[channel][axis];
            }
        }
    }

    /// Computes the linearisations of the eight splats. The constants [`BY_MEAN`] to [`PLANE_VECTORS`]
    /// define the layout.
    #[inline(always)]
    pub(super) fn linearize<V: Vector>(&self, view: &CpuView) -> [V; N_LINEAR] {
        let mut linear = [V::splat(0.0); N_LINEAR];
        let camera = LiftCamera::new(view);
        let shape = self.shape::<V>(&camera);
        shape.write_form_derivatives(&camera, &mut linear);
        self.write_color_derivatives(&camera, &shape, &mut linear);
        shape.write_plane_vectors(&camera, &mut linear);
        linear
    }

    #[inline(always)]
    fn shape<V: Vector>(&self, camera: &LiftCamera) -> Shape<V> {
        let [x, y, z] = load_rows(&self.centre);
        let per_z = V::splat(1.0) / z;
        let tangent = [x * per_z, y * per_z];
        // Only the Jacobian's point is clamped, not the centre, as in the projected renderer.
        let (mut clamped, mut follows) = (tangent, V::splat(SET_LANE));
        for (k, clamped) in clamped.iter_mut().enumerate() {
            let [low, high] = [V::splat(camera.tangent_lo[k]), V::splat(camera.tangent_hi[k])];
            follows = follows.and(low.mask_at_most(tangent[k]).and(tangent[k].mask_at_most(high)));
            *clamped = clamped.max(low).min(high);
        }
        let axes = self.axes(camera);
        let scale = load_rows(&self.scale);
        let mut rows = [[V::splat(0.0); 2]; 2];
        for k in 0..2 {
            let along = V::splat(camera.focal[k]) * per_z;
            rows[k] = [along, V::splat(0.0) - along * clamped[k]];
        }
        let scaled =
            [project_axes(&axes, scale, 0, rows[0]), project_axes(&axes, scale, 1, rows[1])];
        let whitening = Whitening::new(&scaled);
        let mut shifts = [tangent; 3];
        for (axis, shift) in shifts.iter_mut().enumerate() {
            *shift = camera.centre_derivative(axis, tangent, per_z);
        }
        Shape { per_z, tangent, shifts, follows, axes, scale, rows, scaled, whitening, depth: z }
    }

    /// Returns the unit vectors along the splats' principal axes, in the camera's frame.
    #[inline(always)]
    fn axes<V: Vector>(&self, camera: &LiftCamera) -> [[V; 3]; 3] {
        let [w, x, y, z] = load_rows(&self.rotation);
        let (one, two) = (V::splat(1.0), V::splat(2.0));
        let double = two / (w * w + x * x + y * y + z * z);
        let (dx, dy, dz) = (double * x, double * y, double * z);
        let (xx, yy, zz) = (x * dx, y * dy, z * dz);
        let (xy, xz, yz) = (x * dy, x * dz, y * dz);
        let (wx, wy, wz) = (w * dx, w * dy, w * dz);
        [
            turned(&camera.from_world, [one - yy - zz, xy + wz, xz - wy]),
            turned(&camera.from_world, [xy - wz, one - xx - zz, yz + wx]),
            turned(&camera.from_world, [xz + wy, yz - wx, one - xx - yy]),
        ]
    }

    /// Writes the derivatives of each colour channel at a pixel with respect to the mean's world
    /// coordinates. A motion of the mean shifts the spatial variation and rotates the viewing direction.
    /// Also writes the viewing direction.
    #[inline(always)]
    fn write_color_derivatives<V: Vector>(
        &self,
        camera: &LiftCamera,
        shape: &Shape<V>,
        linear: &mut [V; N_LINEAR],
    ) {
        let centre = load_rows::<V, 3>(&self.centre);
        let per_distance = V::splat(1.0) / dot(centre, centre).sqrt();
        let direction = scaled(turned(&camera.to_world, centre), per_distance);
        // Outside the observed cone, colour is that of its edge; the rotation of the edge point is neglected.
        let mean = load_rows::<V, 3>(&self.observed);
        let offset = [direction[0] - mean[0], direction[1] - mean[1], direction[2] - mean[2]];
        let [xx, xy, xz, yy, yz, zz] = load_rows::<V, 6>(&self.cone);
        let [x, y, z] = offset;
        let rows = [xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z];
        let one = V::splat(1.0);
        let within = one / dot(offset, rows).max(one).sqrt();
        for axis in 0..3 {
            linear[DIRECTION + axis] = mean[axis] + within * offset[axis];
        }
        for k in 0..3 {
            let w = load_rows::<V, 3>(&self.directional[k]);
            let along = dot(direction, w);
            let turning = within * per_distance;
            let [x, y] = load_rows::<V, 2>(&self.across[k]);
            for axis in 0..3 {
                let turning = (w[axis] - direction[axis] * along) * turning;
                let [u, v] = shape.shifts[axis];
                linear[COLOR_BY_MEAN + 3 * k + axis] = turning - x * u - y * v;
            }
        }
    }
}

/// Camera parameters of the Jacobian, in f32.
struct LiftCamera {
    /// Rotation from world to camera axes, by rows; `to_world` is the inverse.
    from_world: [[f32; 3]; 3],
    to_world: [[f32; 3]; 3],
    focal: [f32; 2],
    tangent_lo: [f32; 2],
    tangent_hi: [f32; 2],
}

impl LiftCamera {
    #[inline(always)]
    fn new(view: &CpuView) -> Self {
        let rows = |matrix: &DMat3| matrix.as_mat3().transpose().to_cols_array_2d();
        Self {
            from_world: rows(&view.camera_from_world),
            to_world: rows(&view.world_from_camera),
            focal: [view.intrinsics.fx as f32, view.intrinsics.fy as f32],
            tangent_lo: view.tangent_lo.as_vec2().to_array(),
            tangent_hi: view.tangent_hi.as_vec2().to_array(),
        }
    }

    /// Returns the derivative of the projected centre with respect to one world coordinate of the mean,
    /// px per world unit.
    #[inline(always)]
    fn centre_derivative<V: Vector>(&self, axis: usize, tangent: [V; 2], per_z: V) -> [V; 2] {
        let ahead = V::splat(self.from_world[2][axis]);
        let mut shift = tangent;
        for (k, shift) in shift.iter_mut().enumerate() {
            let along = V::splat(self.from_world[k][axis]) - *shift * ahead;
            *shift = V::splat(self.focal[k]) * along * per_z;
        }
        shift
    }
}

/// Image geometry of eight splats.
struct Shape<V> {
    depth: V,
    per_z: V,
    /// `x/z` and `y/z` of the centre in camera axes.
    tangent: [V; 2],
    /// Derivatives of the projected centre with respect to the mean's world coordinates, px per world
    /// unit.
    shifts: [[V; 2]; 3],
    /// Mask: set for splats whose Jacobian is evaluated at the centre itself, not at a clamped
    /// position.
    follows: V,
    /// Unit vectors along the splats' principal axes, in the camera's frame.
    axes: [[V; 3]; 3],
    scale: [V; 3],
    /// Non-zero entries of each row of the projection's Jacobian, px per world unit. The first entry
    /// belongs to the row's own axis, the second to depth.
    rows: [[V; 2]; 2],
    /// Principal axes, scaled by their standard deviations and projected to each image axis, px.
    scaled: [[V; 3]; 2],
    whitening: Whitening<V>,
}

impl<V: Vector> Shape<V> {
    /// Returns the derivative of the image covariance `[xx, xy, yy]` with respect to one world
    /// coordinate of the mean, in px² per world unit.
    #[inline(always)]
    fn covariance_derivative(&self, camera: &LiftCamera, axis: usize) -> [V; 3] {
        let zero = V::splat(0.0);
        let nearer = zero - V::splat(camera.from_world[2][axis]) * self.per_z;
        let mut moved = [[zero; 3]; 2];
        for (k, moved) in moved.iter_mut().enumerate() {
            // Rows of the Jacobian are `(f/z)·(e − t·e_z)`. The tangent `t` is clamped outside the image.
            // Decreasing depth enlarges both entries.
            let turned = self.shifts[axis][k].and(self.follows) * self.per_z;
            let row = [self.rows[k][0] * nearer, self.rows[k][1] * nearer - turned];
            *moved = project_axes(&self.axes, self.scale, k, row);
        }
        let [w_x, w_y] = self.scaled;
        let two = V::splat(2.0);
        [
            two * dot(w_x, moved[0]),
            dot(w_x, moved[1]) + dot(w_y, moved[0]),
            two * dot(w_y, moved[1]),
        ]
    }

    #[inline(always)]
    fn write_form_derivatives(&self, camera: &LiftCamera, linear: &mut [V; N_LINEAR]) {
        let root = V::splat(UNIT.sqrt() as f32);
        let Whitening { p_x, p_y, q_y } = self.whitening;
        for axis in 0..3 {
            let shift = self.shifts[axis];
            linear[BY_MEAN + 5 * axis] = root * (p_x * shift[0] + p_y * shift[1]);
            linear[BY_MEAN + 5 * axis + 1] = root * q_y * shift[1];
            let change = self.whitening.quadratic(self.covariance_derivative(camera, axis));
            linear[BY_MEAN + 5 * axis + 2..][..3].copy_from_slice(&change);
            let wider = self.whitening.quadratic(self.product(axis, axis));
            linear[BY_SHAPE + 3 * axis..][..3].copy_from_slice(&wider);
            // Rotation about an axis mixes the other two in proportion to the difference of their variances.
            let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
            let (s_i, s_j) = (self.scale[i], self.scale[j]);
            let factor = (s_i - s_j) * (s_i + s_j) / (s_i * s_j);
            let turn = self.whitening.quadratic(self.product(i, j));
            for (k, turn) in turn.into_iter().enumerate() {
                linear[BY_SHAPE + 9 + 3 * axis + k] = factor * turn;
            }
        }
    }

    /// Returns the symmetrised product `[xx, xy, yy]` of two principal axes projected to the image,
    /// px².
    #[inline(always)]
    fn product(&self, i: usize, j: usize) -> [V; 3] {
        let ([w_x, w_y], two) = (self.scaled, V::splat(2.0));
        [two * w_x[i] * w_x[j], w_x[i] * w_y[j] + w_x[j] * w_y[i], two * w_y[i] * w_y[j]]
    }

    /// Writes the displacements on the splat's plane, in world axes, per unit of the image offsets `p`
    /// and `q`. A displacement leads from the splat's centre to the point of largest response on that
    /// offset's ray (`rendering.md`, Rational conic).
    #[inline(always)]
    fn write_plane_vectors(&self, camera: &LiftCamera, linear: &mut [V; N_LINEAR]) {
        let [x, y] = self.tangent;
        let zero = V::splat(0.0);
        // In standard deviations along each axis: the ray through the centre and its change per pixel.
        let (mut ray, mut steps) = ([zero; 3], [[zero; 3]; 2]);
        for i in 0..3 {
            let [right, down, ahead] = self.axes[i];
            let sharpness = V::splat(1.0) / self.scale[i];
            ray[i] = (x * right + y * down + ahead) * sharpness;
            steps[0][i] = right * sharpness * V::splat(1.0 / camera.focal[0]);
            steps[1][i] = down * sharpness * V::splat(1.0 / camera.focal[1]);
        }
        let per_ray = V::splat(1.0) / dot(ray, ray);
        let mut worlds = [[zero; 3]; 2];
        for k in 0..2 {
            let half = dot(steps[k], ray) * per_ray;
            let mut step = [zero - x * half, zero - y * half, zero - half];
            step[k] = step[k] + V::splat(1.0 / camera.focal[k]);
            worlds[k] = turned(&camera.to_world, scaled(step, self.depth));
        }
        // Inverse of the whitening: offsets in px per unit of the records' `p` and `q`.
        let Whitening { p_x, p_y, q_y } = self.whitening;
        let root = V::splat(UNIT.sqrt() as f32);
        let (by_p, by_q) = (root / p_x, root / q_y);
        let aside = zero - by_q * p_y / p_x;
        for axis in 0..3 {
            linear[PLANE_VECTORS + axis] = worlds[0][axis] * by_p;
            linear[PLANE_VECTORS + 3 + axis] = worlds[0][axis] * aside + worlds[1][axis] * by_q;
        }
    }
}

/// Triangular factor `L` of the inverse image covariance `LᵀL`, per px. The covariance includes the
/// low-pass.
#[derive(Clone, Copy)]
struct Whitening<V> {
    p_x: V,
    p_y: V,
    q_y: V,
}

impl<V: Vector> Whitening<V> {
    #[inline(always)]
    fn new([w_x, w_y]: &[[V; 3]; 2]) -> Self {
        let (one, low_pass) = (V::splat(1.0), V::splat(LOW_PASS_PX2 as f32));
        let (xx, yy, xy) = (dot(*w_x, *w_x), dot(*w_y, *w_y), dot(*w_x, *w_y));
        // Lagrange's identity: as a sum of positive terms, the determinant does not cancel.
        let cross = [
            w_x[1] * w_y[2] - w_x[2] * w_y[1],
            w_x[2] * w_y[0] - w_x[0] * w_y[2],
            w_x[0] * w_y[1] - w_x[1] * w_y[0],
        ];
        let det = dot(cross, cross) + low_pass * (xx + yy + low_pass);
        let yy = yy + low_pass;
        let per_root = one / (yy * det).sqrt();
        Self { p_x: yy * per_root, p_y: V::splat(0.0) - xy * per_root, q_y: one / yy.sqrt() }
    }

    /// Returns `½ zᵀ(L dΣ Lᵀ)z` as coefficients of `p²`, `pq` and `q²` of the records.
    /// `dΣ = [xx, xy, yy]` is a change of the image covariance and `z` the whitened offset.
    #[inline(always)]
    fn quadratic(&self, [xx, xy, yy]: [V; 3]) -> [V; 3] {
        let Self { p_x, p_y, q_y } = *self;
        let (unit, half) = (V::splat(UNIT as f32), V::splat(0.5 * UNIT as f32));
        let (mixed, below) = (p_x * xy + p_y * yy, q_y * yy);
        [half * (p_x * (p_x * xx + p_y * xy) + p_y * mixed), unit * q_y * mixed, half * q_y * below]
    }
}

/// Projects the scaled principal axes by one row of the Jacobian, px. `row` holds the Jacobian's
/// entries for the camera axis `across` and for depth.
#[inline(always)]
fn project_axes<V: Vector>(
    axes: &[[V; 3]; 3],
    scale: [V; 3],
    across: usize,
    row: [V; 2],
) -> [V; 3] {
    let mut image = scale;
    for (image, axis) in image.iter_mut().zip(axes) {
        *image = (row[0] * axis[across] + row[1] * axis[2]) * *image;
    }
    image
}
