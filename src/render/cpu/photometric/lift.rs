//! How a splat's own parameters move what the image shows of it (`photometric.md`, Lift): the Jacobian of
//! its projection, once per splat and in f64.
//!
//! A change of a parameter moves the centre by `du` and the covariance by `dΣ`. With the whitening
//! `L`, `Σ⁻¹ = LᵀL` and `z = Lδ`: `d(−½|z|²) = zᵀ(L du) + ½ zᵀ(L dΣ Lᵀ)z`. Colour is linear in its own
//! coefficients; as the mean moves it moves along. How a splat's plane, on which the colour gradient
//! is read, turns with the splat is left out.

use super::super::conic::Conic;
use super::super::exact::pinhole_tangent;
use super::super::projected::ImageAxes;
use super::super::record::Gradient;
use super::super::view::{CameraSplat, CpuView};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use glam::{DMat2, DVec2, DVec3};
use std::f64::consts::LN_2;

/// Where each group of a linearisation begins. By axis of the mean the coefficients of `d ln α` on
/// `p, q, p², pq, q²`, whose `p` and `q` are those of records: `α = o·2^−(p²+q²)`.
pub(super) const BY_MEAN: usize = 0;
/// By logarithm of a scale, then by turn, the coefficients on `p², pq, q²`.
pub(super) const BY_SHAPE: usize = BY_MEAN + 15;
/// By channel the change of the colour at a pixel with each axis of the mean.
pub(super) const MOVING: usize = BY_SHAPE + 18;
/// Unit direction from the camera, world axes.
pub(super) const DIRECTION: usize = MOVING + 9;
/// World vectors from the splat's centre to its plane, per unit of a record's `p` and `q`.
pub(super) const PLACES: usize = DIRECTION + 3;
/// Numbers of a linearisation.
pub(super) const N_LINEAR: usize = PLACES + 6;

/// The linearisation of a splat in a view, in the order of the constants above; `None` of one that the
/// view does not show. `gradient` is that of its record.
pub(super) fn linearize(
    view: &CpuView,
    splat: &Splat,
    appearance: &Appearance,
    gradient: &Gradient,
) -> Option<[f32; N_LINEAR]> {
    let placed = view.place(splat)?;
    let axes = ImageAxes::new(view, &placed);
    let conic = axes.conic();
    let moves = [0, 1, 2].map(|axis| moved(view, &placed, &axes, view.camera_from_world.col(axis)));
    let mut linear = [0.0; N_LINEAR];
    by_form(&placed, &axes, &conic, &moves, &mut linear);
    let direction = view.world_from_camera * placed.m.normalize();
    let moving = moving_color(appearance, gradient, direction, placed.m.length(), &moves);
    let places = places(view, &placed, &conic).map(|place| place.to_array());
    let rest = moving.into_iter().chain([direction.to_array()]).chain(places).flatten();
    for (to, value) in linear[MOVING..].iter_mut().zip(rest) {
        *to = value as f32;
    }
    Some(linear)
}

fn by_form(
    placed: &CameraSplat,
    axes: &ImageAxes,
    conic: &Conic,
    moves: &[Move; 3],
    linear: &mut [f32; N_LINEAR],
) {
    let Conic { p_x, p_y, q_y, .. } = *conic;
    // The records' unit: `p²` there is `½ log₂e` times what it is here.
    let unit = 2.0 * LN_2;
    let root = unit.sqrt();
    let quadratic = |[xx, xy, yy]: [f64; 3]| {
        [
            0.5 * unit * (p_x * p_x * xx + 2.0 * p_x * p_y * xy + p_y * p_y * yy),
            unit * q_y * (p_x * xy + p_y * yy),
            0.5 * unit * q_y * q_y * yy,
        ]
    };
    let mut set = |at: usize, values: &[f64]| {
        for (to, value) in linear[at..].iter_mut().zip(values) {
            *to = *value as f32;
        }
    };
    let [w_x, w_y] = axes.scaled;
    let product = |i: usize, j: usize| {
        [2.0 * w_x[i] * w_x[j], w_x[i] * w_y[j] + w_x[j] * w_y[i], 2.0 * w_y[i] * w_y[j]]
    };
    for (axis, &(shift, change)) in moves.iter().enumerate() {
        let [pp, pq, qq] = quadratic(change);
        let (p, q) = (root * (p_x * shift.x + p_y * shift.y), root * q_y * shift.y);
        set(BY_MEAN + 5 * axis, &[p, q, pp, pq, qq]);
        set(BY_SHAPE + 3 * axis, &quadratic(product(axis, axis)));
        // Turning about an axis mixes the two others, and their variances differ by that much.
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let (s_i, s_j) = (placed.scale[i], placed.scale[j]);
        let factor = (s_i * s_i - s_j * s_j) / (s_i * s_j);
        set(BY_SHAPE + 9 + 3 * axis, &quadratic(product(i, j).map(|x| factor * x)));
    }
}

/// How the centre (px per world unit) and the covariance in the image (px² per world unit: xx, xy, yy)
/// change with the mean.
type Move = (DVec2, [f64; 3]);

/// As the mean moves along a direction in camera axes.
fn moved(view: &CpuView, placed: &CameraSplat, axes: &ImageAxes, along: DVec3) -> Move {
    let (k, m) = (&view.intrinsics, placed.m);
    let shift = DVec2::new(
        k.fx * (along.x - m.x / m.z * along.z) / m.z,
        k.fy * (along.y - m.y / m.z * along.z) / m.z,
    );
    // Rows of the Jacobian are `(f/z)·(e − t·e_z)` with the tangent `t`, which is held beyond the
    // image; nearer makes both larger.
    let turned = if axes.follows { shift } else { DVec2::ZERO };
    let rows = [
        axes.jacobian[0] * (-along.z / m.z) - DVec3::Z * (turned.x / m.z),
        axes.jacobian[1] * (-along.z / m.z) - DVec3::Z * (turned.y / m.z),
    ];
    let [d_x, d_y] = rows.map(|row| placed.axes.transpose_mul_vec3(row) * placed.scale);
    let [w_x, w_y] = axes.scaled;
    (shift, [2.0 * w_x.dot(d_x), w_x.dot(d_y) + w_y.dot(d_x), 2.0 * w_y.dot(d_y)])
}

/// By channel how the colour at a pixel changes as the mean moves along the world's axes: what varies
/// over the splat moves along, and the direction it is seen from turns.
fn moving_color(
    appearance: &Appearance,
    gradient: &Gradient,
    direction: DVec3,
    distance: f64,
    moves: &[Move; 3],
) -> [[f64; 3]; 3] {
    std::array::from_fn(|k| {
        let [x, y] = gradient.across[k].map(f64::from);
        let w = DVec3::from_array(appearance.directional[k].map(f64::from));
        let turning = (w - direction * direction.dot(w)) / distance;
        std::array::from_fn(|axis| {
            let (shift, _) = moves[axis];
            turning[axis] - x * shift.x - y * shift.y
        })
    })
}

/// World vectors from the splat's centre to its plane, per unit of a record's `p` and `q`.
fn places(view: &CpuView, placed: &CameraSplat, conic: &Conic) -> [DVec3; 2] {
    let tangent = pinhole_tangent(placed, &view.intrinsics);
    let exact = Conic::new(placed, &tangent);
    let half = [exact.half_l.x, exact.half_l.y];
    let steps: [DVec3; 2] = std::array::from_fn(|i| {
        view.world_from_camera * ((tangent.steps[i] - tangent.x0 * half[i]) * tangent.reach)
    });
    let whitening = DMat2::from_cols(DVec2::new(conic.p_x, 0.0), DVec2::new(conic.p_y, conic.q_y));
    // Offsets in px of one unit of the records' `p` and `q`.
    let back = whitening.inverse() * (2.0 * LN_2).sqrt();
    std::array::from_fn(|i| steps[0] * back.col(i).x + steps[1] * back.col(i).y)
}
