//! Numbers of the recipe (`dataset.md`, Plane fit) that several stages share.
//!
//! The window of the plane fit is 5×5. On Lego 3×3 lost .35 dB and a fifth of the points; 7×7, and
//! 5×5 beside 9×9, lost .1 to .2 dB.

use std::ops::RangeInclusive;

/// Pixels from the centre of the window to its side.
pub(super) const RADIUS: usize = 2;
/// Least-squares rounds; from the second on only inliers take part.
pub(super) const ROUNDS: usize = 3;
/// Neighbours that a round needs, the pixel itself included.
pub(super) const MIN_INLIERS: usize = 5;
/// Share of the window that must be inliers in the end.
pub(super) const MIN_SHARE: f64 = 0.3;
/// Pixels on a side of a tile.
pub(super) const TILE: usize = 8;
/// Lengths whose squares and inverses f32 holds.
pub(super) const LENGTHS: RangeInclusive<f64> = 1e-9..=1e9;
