//! Vectors of space, eight at a time: three [`Vector`]s hold their coordinates.
//!
//! Written out or in loops, as all that kernels call must be: what a closure over vectors holds is not
//! compiled for the kernel's instructions.

use super::vector::Vector;

/// Products of pairs.
#[inline(always)]
pub fn dot<V: Vector>(a: [V; 3], b: [V; 3]) -> V {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vectors times a matrix, which is given by rows.
#[inline(always)]
pub fn turned<V: Vector>(rows: &[[f32; 3]; 3], [x, y, z]: [V; 3]) -> [V; 3] {
    let mut turned = [x; 3];
    for (turned, [a, b, c]) in turned.iter_mut().zip(rows) {
        *turned = V::splat(*a) * x + V::splat(*b) * y + V::splat(*c) * z;
    }
    turned
}

/// Every coordinate times a factor.
#[inline(always)]
pub fn scaled<V: Vector>([x, y, z]: [V; 3], factor: V) -> [V; 3] {
    [x * factor, y * factor, z * factor]
}
