//! Eight 3-D vectors at a time, as three [`Vector`]s of coordinates.
//!
//! Written without closures, like all code called by kernels: closures over vectors are not compiled
//! for the kernel's instruction set.

use super::vector::Vector;

/// Dot products.
#[inline(always)]
pub fn dot<V: Vector>(a: [V; 3], b: [V; 3]) -> V {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Products of a matrix, given by rows, with column vectors.
#[inline(always)]
pub fn turned<V: Vector>(rows: &[[f32; 3]; 3], [x, y, z]: [V; 3]) -> [V; 3] {
    let mut turned = [x; 3];
    for (turned, [a, b, c]) in turned.iter_mut().zip(rows) {
        *turned = V::splat(*a) * x + V::splat(*b) * y + V::splat(*c) * z;
    }
    turned
}

/// Multiplies the vectors by a scalar per lane.
#[inline(always)]
pub fn scaled<V: Vector>([x, y, z]: [V; 3], factor: V) -> [V; 3] {
    [x * factor, y * factor, z * factor]
}
