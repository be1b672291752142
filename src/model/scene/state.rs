//! Everything a trained scene consists of, as plain columns: what checkpoints hold.

use super::sums::N_SUMS;

/// A trained scene at a frame boundary. Row `k` of every column is component `k`.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneState {
    /// World position that seeds are relative to.
    pub origin: [f64; 3],
    /// Seeds, world units.
    pub seeds: Vec<[f32; 3]>,
    /// Sums over everything seen, about the seeds.
    pub sums: StoredSums,
    /// Returns expected, in 64ths; then the frames in which a component was seen (low half) and
    /// seen through (high half).
    pub looks: Vec<[u32; 2]>,
}

/// Sums in the order of [`N_SUMS`], offsets in units of the structural scale.
#[derive(Clone, Debug, PartialEq)]
pub enum StoredSums {
    /// Integer quanta of 2⁻¹⁵.
    Mixed {
        /// One row per component; zeros where the sums are in `wide`.
        rows: Vec<[i32; N_SUMS]>,
        /// Rows of components with so many points that they might not fit, by ascending id.
        wide: Vec<WideRow>,
    },
    /// Single precision.
    F32(Vec<[f32; N_SUMS]>),
    /// Double precision.
    F64(Vec<[f64; N_SUMS]>),
}

/// Sums of one component, whole multiples of 2⁻¹⁵.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WideRow {
    /// The component.
    pub id: u32,
    /// Its sums.
    pub sums: [f64; N_SUMS],
}
