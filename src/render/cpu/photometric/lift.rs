//! From moments in the image to a splat's own parameters (`photometric.md`, Lift): the Jacobian of its
//! projection, once per splat and in f64.
//!
//! A change of a parameter moves the centre by `du` and the covariance by `dΣ`. With the whitening
//! `L`, `Σ⁻¹ = LᵀL` and `z = Lδ`: `d(−½|z|²) = zᵀ(L du) + ½ zᵀ(L dΣ Lᵀ)z`. Colour is linear in its own
//! coefficients; as the mean moves it moves along. How a splat's plane, on which the colour gradient
//! is read, turns with the splat is left out.

use super::super::conic::Conic;
use super::super::exact::pinhole_tangent;
use super::super::projected::{self, ImageAxes};
use super::super::shade::ColorGradient;
use super::super::view::{CameraSplat, CpuView};
use super::sums::{
    COLOR, COLOR_CURVATURE, CURVATURE, GRADIENT, ImageSums, N_QUADRATIC, WEIGHT, moment,
};
use crate::model::scene::photometric::{N_COLOR, N_FORM};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use glam::{DMat2, DVec2, DVec3};
use std::f64::consts::LN_2;

/// What a photograph says of one splat's parameters.
#[derive(Clone, Copy, Debug)]
pub struct ParameterSums {
    /// Gradient of `−½Σρr²` by the form's parameters.
    pub gradient: [f64; N_FORM],
    /// Gauss-Newton block of the form, symmetric.
    pub curvature: [[f64; N_FORM]; N_FORM],
    /// The same gradient by the coefficients of red, green and blue.
    pub color: [[f64; N_COLOR]; 3],
    /// Gauss-Newton block of a channel's coefficients, symmetric; all channels have the same.
    pub color_curvature: [[f64; N_COLOR]; N_COLOR],
    /// Sum of the blending weights over the pixels, px.
    pub weight: f64,
}

/// Place of each feature of `ln α` among the moments: powers of `p` and `q`.
const FEATURES: [(usize, usize); N_QUADRATIC] = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)];

/// The sums of a splat by its parameters; `None` of one that the view does not show.
pub(super) fn lift(
    view: &CpuView,
    splat: &Splat,
    appearance: &Appearance,
    sums: &ImageSums,
) -> Option<ParameterSums> {
    let placed = view.place(splat)?;
    let axes = ImageAxes::new(view, &placed);
    let conic = axes.conic();
    let sums = sums.map(f64::from);
    let moves = [0, 1, 2].map(|axis| moved(view, &placed, &axes, view.camera_from_world.col(axis)));
    let features = form_features(&placed, &axes, &conic, &moves);
    let mut gradient = [0.0; N_FORM];
    let mut curvature = [[0.0; N_FORM]; N_FORM];
    let moments: [[f64; N_QUADRATIC]; N_QUADRATIC] = std::array::from_fn(|f| {
        std::array::from_fn(|g| {
            let ((i, j), (k, l)) = (FEATURES[f], FEATURES[g]);
            sums[CURVATURE + moment(i + k, j + l)]
        })
    });
    for row in 0..N_FORM {
        gradient[row] = (0..N_QUADRATIC).map(|f| features[row][f] * sums[GRADIENT + f]).sum();
        let through: [f64; N_QUADRATIC] = std::array::from_fn(|g| {
            (0..N_QUADRATIC).map(|f| features[row][f] * moments[f][g]).sum()
        });
        for column in 0..=row {
            let value = (0..N_QUADRATIC).map(|g| through[g] * features[column][g]).sum();
            curvature[row][column] = value;
            curvature[column][row] = value;
        }
    }
    let moving = moving_color(view, &placed, appearance, &moves);
    for (k, by_mean) in moving.iter().enumerate() {
        let (pull, bend) = (sums[COLOR + 3 * k], sums[COLOR_CURVATURE]);
        for (i, a) in by_mean.iter().enumerate() {
            gradient[i] += a * pull;
            by_mean.iter().enumerate().for_each(|(j, b)| curvature[i][j] += a * b * bend);
        }
    }
    let (color, color_curvature) = lift_color(view, &placed, &conic, &sums);
    Some(ParameterSums { gradient, curvature, color, color_curvature, weight: sums[WEIGHT] })
}

/// By parameter the coefficients of `d ln α` on the moments `1, p, q, p², pq, q²`, whose `p` and `q`
/// are those of records: `α = o·2^−(p²+q²)`.
fn form_features(
    placed: &CameraSplat,
    axes: &ImageAxes,
    conic: &Conic,
    moves: &[Move; 3],
) -> [[f64; N_QUADRATIC]; N_FORM] {
    let mut features = [[0.0; N_QUADRATIC]; N_FORM];
    let mut set = |parameter: usize, shift: DVec2, [xx, xy, yy]: [f64; 3]| {
        let Conic { p_x, p_y, q_y, .. } = *conic;
        let a = [p_x * shift.x + p_y * shift.y, q_y * shift.y];
        let s = [
            p_x * p_x * xx + 2.0 * p_x * p_y * xy + p_y * p_y * yy,
            q_y * (p_x * xy + p_y * yy),
            q_y * q_y * yy,
        ];
        // The records' unit: `p²` there is `½ log₂e` times what it is here.
        let unit = 2.0 * LN_2;
        let root = unit.sqrt();
        features[parameter] =
            [0.0, root * a[0], root * a[1], 0.5 * unit * s[0], unit * s[1], 0.5 * unit * s[2]];
    };
    let [w_x, w_y] = axes.scaled;
    let product = |i: usize, j: usize| {
        [2.0 * w_x[i] * w_x[j], w_x[i] * w_y[j] + w_x[j] * w_y[i], 2.0 * w_y[i] * w_y[j]]
    };
    for (axis, &(shift, change)) in moves.iter().enumerate() {
        set(axis, shift, change);
        set(3 + axis, DVec2::ZERO, product(axis, axis));
        // Turning about an axis mixes the two others, and their variances differ by that much.
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let (s_i, s_j) = (placed.scale[i], placed.scale[j]);
        let factor = (s_i * s_i - s_j * s_j) / (s_i * s_j);
        set(6 + axis, DVec2::ZERO, product(i, j).map(|x| factor * x));
    }
    features[N_FORM - 1] = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    features
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
    view: &CpuView,
    placed: &CameraSplat,
    appearance: &Appearance,
    moves: &[Move; 3],
) -> [[f64; 3]; 3] {
    let across = projected::gradient(&ColorGradient::new(appearance, view), placed, view).across;
    let direction = view.world_from_camera * placed.m.normalize();
    std::array::from_fn(|k| {
        let [x, y] = across[k].map(f64::from);
        let w = DVec3::from_array(appearance.directional[k].map(f64::from));
        let turning = (w - direction * direction.dot(w)) / placed.m.length();
        std::array::from_fn(|axis| {
            let (shift, _) = moves[axis];
            turning[axis] - x * shift.x - y * shift.y
        })
    })
}

type ColorSums = ([[f64; N_COLOR]; 3], [[f64; N_COLOR]; N_COLOR]);

/// The colour of a channel is `c + W·d + G·e(p, q)`: linear in its seven coefficients.
fn lift_color(view: &CpuView, placed: &CameraSplat, conic: &Conic, sums: &[f64]) -> ColorSums {
    let direction = view.world_from_camera * placed.m.normalize();
    let place = places(view, placed, conic);
    let [one, p, q, pp, pq, qq] = std::array::from_fn(|i| sums[COLOR_CURVATURE + i]);
    let color = std::array::from_fn(|k| {
        let at = COLOR + 3 * k;
        let constant = sums[at];
        let by_place = place[0] * sums[at + 1] + place[1] * sums[at + 2];
        let d = direction * constant;
        [constant, d.x, d.y, d.z, by_place.x, by_place.y, by_place.z]
    });
    let linear = place[0] * p + place[1] * q;
    let mut curvature = [[0.0; N_COLOR]; N_COLOR];
    let fixed = [1.0, direction.x, direction.y, direction.z];
    for (i, a) in fixed.iter().enumerate() {
        for (j, b) in fixed.iter().enumerate() {
            curvature[i][j] = a * b * one;
        }
        for j in 0..3 {
            curvature[i][4 + j] = a * linear[j];
            curvature[4 + j][i] = a * linear[j];
        }
    }
    for i in 0..3 {
        for j in 0..3 {
            curvature[4 + i][4 + j] = place[0][i] * place[0][j] * pp
                + (place[0][i] * place[1][j] + place[1][i] * place[0][j]) * pq
                + place[1][i] * place[1][j] * qq;
        }
    }
    (color, curvature)
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
