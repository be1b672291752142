//! Quantisation of values to and from SPZ bytes.

use crate::export::gaussian::{color_to_harmonic, harmonic_to_color};
use exr::prelude::f16;
use glam::{DQuat, DVec3};
use std::f64::consts::FRAC_1_SQRT_2;

/// Factor from a coefficient of degree 0 to a fraction of the byte range.
// The format's range exceeds `[0, 1]`, because harmonics can bring such colours back into it.
const COLOR_SCALE: f64 = 0.15;
/// Number of quantisation steps per unit of a scale's natural logarithm.
const SCALE_STEPS: f64 = 16.0;
const SCALE_START: f64 = -10.0;
/// Number of quantisation steps of a written degree 1 coefficient, over the whole byte range.
// As many as the format's reference writer uses.
const COEFFICIENT_STEPS: f64 = 32.0;
/// 9-bit magnitude that represents √½, the largest possible stored component of a quaternion.
const LARGEST_MAGNITUDE: f64 = 511.0;

/// Difference of magnitudes below which quaternion components count as equally large.
const TIE_TOLERANCE: f64 = 1e-5;
/// Difference between quaternion components below which rotations count as equal.
// Above f32 rounding.
const ROTATION_TOLERANCE: f64 = 1e-6;

pub(super) fn fixed(bytes: [u8; 3], fraction_bits: u8) -> f64 {
    // Shifted up and back to extend the sign.
    let value = i32::from_le_bytes([0, bytes[0], bytes[1], bytes[2]]) >> 8;
    f64::from(value) * 0.5f64.powi(fraction_bits.into())
}

/// Decodes a coordinate of version 1, an IEEE 754 half-precision number.
pub(super) fn half(bytes: [u8; 2]) -> f64 {
    f16::from_le_bytes(bytes).to_f64()
}

pub(super) fn color(bytes: [u8; 3]) -> DVec3 {
    let byte = DVec3::from_array(bytes.map(f64::from));
    harmonic_to_color((byte / 255.0 - 0.5) / COLOR_SCALE)
}

pub(super) fn scale(bytes: [u8; 3]) -> DVec3 {
    let byte = DVec3::from_array(bytes.map(f64::from));
    (byte / SCALE_STEPS + SCALE_START).exp()
}

/// Decodes the quaternion `w x y z` of versions 1 and 2. Only x, y and z are stored, and w is not
/// negative.
pub(super) fn first_three(bytes: [u8; 3]) -> [f64; 4] {
    let [x, y, z] = bytes.map(|b| f64::from(b) / 127.5 - 1.0);
    [(1.0 - x * x - y * y - z * z).max(0.0).sqrt(), x, y, z]
}

/// Decodes the quaternion `w x y z` of version 3 and later. The upper two bits give the index of the
/// largest of x, y, z, w. The other bits are sign and magnitude of the other three.
pub(super) fn smallest_three(bytes: [u8; 4]) -> [f64; 4] {
    let bits = u32::from_le_bytes(bytes);
    let largest = (bits >> 30) as usize;
    let mut xyzw = [0.0; 4];
    let others = (0..4).rev().filter(|&i| i != largest);
    for (i, shift) in others.zip([0, 10, 20]) {
        let magnitude = f64::from(bits >> shift & 511) / LARGEST_MAGNITUDE * FRAC_1_SQRT_2;
        xyzw[i] = if bits >> shift & 512 == 0 { magnitude } else { -magnitude };
    }
    let sum: f64 = xyzw.iter().map(|v| v * v).sum();
    xyzw[largest] = (1.0 - sum).max(0.0).sqrt();
    let [x, y, z, w] = xyzw;
    [w, x, y, z]
}

pub(super) fn coefficient(byte: u8) -> f64 {
    (f64::from(byte) - 128.0) / 128.0
}

pub(super) fn to_fixed(v: f64, fraction_bits: u8) -> [u8; 3] {
    let largest = f64::from((1 << 23) - 1);
    let value = (v * 2f64.powi(fraction_bits.into())).round().clamp(-largest, largest);
    let [a, b, c, _] = (value as i32).to_le_bytes();
    [a, b, c]
}

pub(super) fn to_opacity(opacity: f64) -> u8 {
    nearest(255.0 * opacity)
}

pub(super) fn to_color(color: DVec3) -> [u8; 3] {
    let coefficient = color_to_harmonic(color);
    coefficient.to_array().map(|f| nearest(255.0 * (COLOR_SCALE * f + 0.5)))
}

/// Inverse of [`scale`]: quantises the natural logarithm of each scale in steps of 1/16. Represents
/// scales from 4.5·10⁻⁵ to 376.
pub(super) fn to_scale(scale: DVec3) -> [u8; 3] {
    scale.to_array().map(|s| nearest(SCALE_STEPS * (s.ln() - SCALE_START)))
}

/// Inverse of [`smallest_three`]: encodes a rotation without one quaternion component. Omits the first
/// of the largest components, or another one if the decoded rotation is then more accurate.
pub(super) fn to_smallest_three(rotation: DQuat) -> [u8; 4] {
    // The search makes a rotation that was read from a file keep its bytes.
    let xyzw = rotation.to_array();
    let most = xyzw.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    let first = xyzw.iter().position(|v| v.abs() >= most - TIE_TOLERANCE).unwrap_or(3);
    let candidate = |left_out: usize| {
        let bytes = encode_without(left_out, xyzw);
        let [w, x, y, z] = smallest_three(bytes);
        (bytes, difference(DQuat::from_xyzw(x, y, z, w), rotation))
    };
    let better = |best: ([u8; 4], f64), other: ([u8; 4], f64)| {
        if other.1 < best.1 - ROTATION_TOLERANCE { other } else { best }
    };
    (0..4).map(candidate).fold(candidate(first), better).0
}

/// Inverse of [`first_three`]: encodes a rotation by 3 bytes. Of the 8 roundings up and down, the one with the
/// most accurate rotation is chosen.
pub(super) fn to_first_three(rotation: DQuat) -> [u8; 3] {
    let [x, y, z, w] = rotation.to_array();
    let exact = [x, y, z].map(|v| 127.5 * (if w < 0.0 { -v } else { v } + 1.0));
    // Near w = 0 rotations err by up to 12 degrees after plain rounding, because w follows from the others.
    let candidates = (0..8u8).map(|up| {
        let rounded = [0, 1, 2].map(|i| nearest(exact[i].floor() + f64::from(up >> i & 1)));
        let [w, x, y, z] = first_three(rounded);
        (rounded, DQuat::from_xyzw(x, y, z, w).normalize().dot(rotation).abs())
    });
    let nearer = |a: ([u8; 3], f64), b: ([u8; 3], f64)| if b.1 > a.1 { b } else { a };
    candidates.reduce(nearer).map_or([0; 3], |(bytes, _)| bytes)
}

/// Returns the largest difference of quaternion components of two rotations, where `q` and `−q` are
/// equal.
fn difference(a: DQuat, b: DQuat) -> f64 {
    let b = if a.dot(b) < 0.0 { -b } else { b };
    (a - b).to_array().iter().fold(0.0, |most, v| most.max(v.abs()))
}

fn encode_without(left_out: usize, xyzw: [f64; 4]) -> [u8; 4] {
    let mut bits = left_out as u32;
    for i in (0..4).filter(|&i| i != left_out) {
        let magnitude = (LARGEST_MAGNITUDE * xyzw[i].abs() / FRAC_1_SQRT_2).round();
        let magnitude = magnitude.min(LARGEST_MAGNITUDE) as u32;
        // Zero has no sign: `q` and `−q` are the same rotation and give the same bytes.
        let is_negative = magnitude > 0 && (xyzw[i] < 0.0) != (xyzw[left_out] < 0.0);
        bits = bits << 10 | u32::from(is_negative) << 9 | magnitude;
    }
    bits.to_le_bytes()
}

/// Inverse of [`coefficient`]: quantises a degree 1 coefficient in fewer than 256 steps.
pub(super) fn to_coefficient(f: f64) -> u8 {
    let step = 256.0 / COEFFICIENT_STEPS;
    nearest(((128.0 * f) / step).round() * step + 128.0)
}

fn nearest(v: f64) -> u8 {
    // The cast saturates at 0 and 255.
    v.round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_and_its_negative_are_the_same_bytes() {
        for q in [
            [0.0, 0.0, 0.0, 1.0],
            [1.0, -0.0, 0.0, 0.0],
            [0.5, -0.5, 0.1, 0.7],
            [0.0, 1e-9, 0.0, -1.0],
        ] {
            let turn = DQuat::from_array(q).normalize();
            assert_eq!(to_smallest_three(turn), to_smallest_three(-turn), "{q:?}");
        }
    }

    #[test]
    fn turns_whose_largest_numbers_tie_keep_their_bytes() {
        let half = FRAC_1_SQRT_2;
        let quarter = [half, 0.0, 0.0, half];
        // After rounding, another component is the largest.
        let near = [0.7, 0.1, 0.0, 0.70005];
        for q in [quarter, [0.0, -half, half, 0.0], [0.5, 0.5, -0.5, 0.5], near] {
            let bytes = to_smallest_three(DQuat::from_array(q).normalize());
            let [w, x, y, z] = smallest_three(bytes);
            for nudge in [-1e-7, 0.0, 1e-7] {
                let nudged = DQuat::from_xyzw(x + nudge, y, z, w - nudge).normalize();
                assert_eq!(to_smallest_three(nudged), bytes, "{q:?} {nudge}");
            }
        }
    }

    #[test]
    fn halves() {
        for (bits, value) in [
            (0x3C00u16, 1.0),
            (0xC000, -2.0),
            (0x7BFF, 65504.0),
            (0x0001, 0.5f64.powi(24)),
            (0x3555, 0.333_251_953_125),
            (0xFC00, f64::NEG_INFINITY),
        ] {
            assert_eq!(half(bits.to_le_bytes()), value);
        }
        assert!(half([1, 0x7C]).is_nan());
    }

    #[test]
    fn fixed_points_have_a_sign() {
        assert_eq!(fixed([0, 0xF0, 0xFF], 12), -1.0);
        assert_eq!(fixed([0xFF, 0xFF, 0x7F], 0), 8_388_607.0);
    }

    #[test]
    fn values_beyond_24_bits_are_the_largest() {
        assert_eq!(to_fixed(1e9, 0), [0xFF, 0xFF, 0x7F]);
        assert_eq!(to_fixed(-1e9, 0), [0x01, 0x00, 0x80]);
    }

    #[test]
    fn the_most_accurate_encoding_of_a_turn_is_chosen() {
        // Without the first of the largest components the error is 6e-4 larger.
        let turn = DQuat::from_xyzw(-7.0, -7.0, 0.0, 6.0).normalize();
        assert_eq!(to_smallest_three(turn), [0, 212, 94, 251]);
        assert_eq!(encode_without(0, [0.0, 0.6, -0.8, 0.0]), [0, 252, 47, 27]);
        let a = DQuat::from_xyzw(0.5, 0.5, 0.5, 0.5);
        assert_eq!(difference(a, DQuat::from_xyzw(0.75, -0.25, -0.25, -0.25)), 0.75);
        assert_eq!(difference(a, -a), 0.0);
        let turn = DQuat::from_xyzw(0.1, -0.3, 0.5, 0.8).normalize();
        assert_eq!(to_first_three(turn), to_first_three(-turn));
        assert_eq!(to_first_three(DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0))[0], 255);
    }
}
