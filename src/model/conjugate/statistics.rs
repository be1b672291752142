//! Sufficient statistics, centred about the initial means.

use crate::math::real::Real;
use crate::math::sym3::Sym3;
use glam::DVec3;

/// Number of sums per component: `N`, `a' = Σ r d` (3), `B' = Σ r d dᵀ` (6), `b = Σ r c` (3)
/// (`model.md`, Sufficient statistics and precision). A point has responsibility `r`, position `s`,
/// colour `c` and offset `d = s − m_k` from the initial mean.
// `Σ r c cᵀ`, which the reference sums as well, is left out: the colour precision is fixed, so nothing reads
// it.
pub const N_SUMS: usize = 13;

/// Sums of one component over one tile (group of neighbouring points), not yet rounded to the totals'
/// number format.
#[derive(Clone, Copy, Debug)]
pub struct TileRecord<R> {
    /// Index of the component.
    pub id: u32,
    /// Index of the tile within its frame.
    pub tile: u32,
    /// Sums in the order listed at [`N_SUMS`].
    pub sums: [R; N_SUMS],
}

/// Number of 32-bit words of a record written by a device: component, tile and sums.
pub const RECORD_WORDS: usize = 2 + N_SUMS;

impl TileRecord<f32> {
    /// Decodes a record from the words written by a device: component, tile, and sums as f32 bits.
    ///
    /// ```
    /// use vbgs_studio::model::conjugate::statistics::{RECORD_WORDS, TileRecord};
    ///
    /// let mut words = [0; RECORD_WORDS];
    /// (words[0], words[1], words[2]) = (7, 3, 1f32.to_bits());
    /// let record = TileRecord::from_words(&words);
    /// assert_eq!((record.id, record.tile, record.sums[0]), (7, 3, 1.0));
    /// ```
    #[inline]
    pub fn from_words(words: &[u32; RECORD_WORDS]) -> Self {
        let sums = std::array::from_fn(|i| f32::from_bits(words[2 + i]));
        Self { id: words[0], tile: words[1], sums }
    }
}

/// Adds a point to a component's sums. The point has responsibility `r` and offset `d` from the
/// component's initial mean.
#[inline(always)]
pub fn add_point<R: Real>(sums: &mut [R; N_SUMS], r: R, d: [R; 3], color: [R; 3]) {
    let rd = [r * d[0], r * d[1], r * d[2]];
    let terms = [
        r,
        rd[0],
        rd[1],
        rd[2],
        rd[0] * d[0],
        rd[0] * d[1],
        rd[0] * d[2],
        rd[1] * d[1],
        rd[1] * d[2],
        rd[2] * d[2],
        r * color[0],
        r * color[1],
        r * color[2],
    ];
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum += term;
    }
}

/// Statistics of one component in f64, still centred about its initial mean.
///
/// ```
/// use vbgs_studio::model::conjugate::statistics::{Moments, N_SUMS, add_point};
///
/// let mut sums = [0.0f64; N_SUMS];
/// add_point(&mut sums, 1.0, [0.1, 0.0, 0.0], [0.5; 3]);
/// add_point(&mut sums, 1.0, [-0.1, 0.0, 0.0], [0.5; 3]);
/// let moments = Moments::from_sums(sums);
/// assert_eq!((moments.count, moments.first.x), (2.0, 0.0));
/// assert!((moments.second.xx - 0.02).abs() < 1e-15);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// Number of points, `N_k = Σ r`.
    pub count: f64,
    /// Sum of the offsets of positions, `a' = Σ r (s − m_k)`.
    pub first: DVec3,
    /// Sum of the squares of offsets, `B' = Σ r (s − m_k)(s − m_k)ᵀ`.
    pub second: Sym3,
    /// Sum of the colours, `b = Σ r c`.
    pub color: DVec3,
}

impl Moments {
    /// Creates the statistics from sums in the order listed at [`N_SUMS`].
    pub fn from_sums(t: [f64; N_SUMS]) -> Self {
        Self {
            count: t[0],
            first: DVec3::new(t[1], t[2], t[3]),
            second: Sym3::from_array([t[4], t[5], t[6], t[7], t[8], t[9]]),
            color: DVec3::new(t[10], t[11], t[12]),
        }
    }

    /// Returns raw moments about the origin, `a = a' + N m` and `B = B' + a'mᵀ + m a'ᵀ + N m mᵀ`.
    pub fn raw(&self, mean_init: DVec3) -> (DVec3, Sym3) {
        let (a, m) = (self.first.to_array(), mean_init.to_array());
        let cross = |i: usize, j: usize| a[i] * m[j] + m[i] * a[j] + self.count * m[i] * m[j];
        let shift = [cross(0, 0), cross(0, 1), cross(0, 2), cross(1, 1), cross(1, 2), cross(2, 2)];
        (self.first + mean_init * self.count, self.second.add_scaled(1.0, Sym3::from_array(shift)))
    }
}
