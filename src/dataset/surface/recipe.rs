//! Constants of the recipe (`dataset.md`, Plane fit) shared by several stages.
//!
//! The window of the plane fit is 5×5. On Lego, 3×3 lost .35 dB and a fifth of the points; 7×7, and 5×5
//! combined with 9×9, lost .1 to .2 dB.

use std::ops::RangeInclusive;

/// Pixels from the centre of the window to its side.
pub(super) const RADIUS: usize = 2;
/// Least-squares rounds; from the second on, only inliers count.
pub(super) const ROUNDS: usize = 3;
/// Least number of inliers in a round, including the pixel itself.
pub(super) const MIN_INLIERS: usize = 5;
/// Least final share of inliers in the window.
pub(super) const MIN_SHARE: f64 = 0.3;
/// Pixels on a side of a tile.
pub(super) const TILE: usize = 8;
/// Lengths whose squares and inverses are representable in f32.
pub(super) const LENGTHS: RangeInclusive<f64> = 1e-9..=1e9;
